"""Buoyancy from measured density compared with the depth slope: twins in a stratified ocean, and real missions.

Usage: ``python -m benchmarks.seawater [--mission NAME OBSERVATIONS DENSITY.yaml SLOPE.yaml PROFILES] ...`` writes
``docs/seawater.md``. The two hulls of a mission are what ``gliderhpc calibrate`` made with ``--set seawater=density`` and
``--set seawater=depth_slope``; the profiles, such as ``12,24,36``, are best those that were held out.
"""

import argparse
import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gliderhpc import Glider, load_platform
from gliderhpc.calibration.glides.segment_errors import SegmentErrors
from gliderhpc.calibration.settings import CalibrateSettings
from gliderhpc.errors import ProfileError
from gliderhpc.estimation.filter import run_filters
from gliderhpc.estimation.preparation import by_density, prepare_profile
from gliderhpc.estimation.resample import on_steps
from gliderhpc.estimation.self_motion import depth_rate
from gliderhpc.estimation.smoother.iterate import run_smoother
from gliderhpc.estimation.steady_segments import join_segments, segments_of
from gliderhpc.findings.formatting import markdown
from gliderhpc.observations import ProfileRecord, ProfileSeries, open_observations
from gliderhpc.observations.profile_numbers import select_profiles
from gliderhpc.platform import Platform, with_overrides
from gliderhpc.simulator import load_scenario, simulate_profile
from gliderhpc.studies.validation import run_forward

HULL = {"buoyancy.compressibility": "4.5e-6", "buoyancy.thermal_expansion": "6e-5", "buoyancy.depth_slope": "0"}
SEED, TWINS, DEPTH = 1, 2, 250.0
HEAVE, DEPTH_COLUMN = 2, 3
WAYS = ("density", "depth_slope")
SETTLED, GLIDING = 120.0, 0.03
TEMPLATE = Path(__file__).with_suffix(".md")
PAGE = Path(__file__).resolve().parents[1] / "docs" / "seawater.md"

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Heave:
    """Heave disturbance in steady glide (N): medians of its size and of itself, and its scatter, dive and climb."""

    size: Array
    median: Array
    deviation: Array

    @property
    def common(self) -> float:
        """Part common to dive and climb, which buoyancy, of the same sign in both, can explain."""
        return float(self.median.mean())


def heave_of(disturbance: Array, series: ProfileSeries, vibrating: NDArray[np.bool_]) -> Heave:
    """Take the statistics of a heave disturbance ``(n + 1,)``."""
    rate = depth_rate(series)
    counted = ~vibrating & (series.weights > 0.0) & (series.time - series.time[0] > SETTLED)
    legs = [disturbance[counted & (sign * rate > GLIDING)] for sign in (1.0, -1.0)]
    return Heave(*(np.array([f(leg) for leg in legs]) for f in (lambda b: np.median(np.abs(b)), np.median, np.std)))


def heaves(platform: Platform, records: Iterable[ProfileRecord], way: str) -> tuple[Heave, Heave]:
    """Filter and smooth some profiles; medians over them of what either makes of the heave."""
    settings = CalibrateSettings(seawater=way)
    profiles = [prepare_profile(Glider(platform), on_steps(record, settings)) for record in records]
    filtered, smoothed = [], []
    for profile, prior in zip(profiles, run_filters(profiles, settings), strict=True):
        if isinstance(prior, ProfileError):
            raise prior
        if by_density(platform, profile.series) != (way == "density"):
            raise ProfileError(f"profile {profile.series.number} does not go by {way}")
        smooth = run_smoother(profile, prior, settings)
        last = smooth.disturbances[-1:, HEAVE]
        estimates = prior.disturbances[:, HEAVE], np.append(smooth.disturbances[:, HEAVE], last)
        for found, estimate in zip((filtered, smoothed), estimates, strict=True):
            found.append(heave_of(estimate, profile.series, profile.vibrating))
    return _median(filtered), _median(smoothed)


def _median(found: list[Heave]) -> Heave:
    return Heave(
        *(np.median([getattr(one, name) for one in found], axis=0) for name in ("size", "median", "deviation"))
    )


def dive_error(platform: Platform, record: ProfileRecord, way: str) -> float:
    """Root mean square error of the depth (m) of a dive flown open loop, without the climb."""
    series = on_steps(record, CalibrateSettings(seawater=way))
    depth = series.measurements[:, DEPTH_COLUMN]
    half = int(np.argmax(depth))
    return math.sqrt(float(np.mean((run_forward(Glider(platform), series).states[:half, 5] - depth[:half]) ** 2)))


def depth_rate_error(platform: Platform, records: Iterable[ProfileRecord], way: str) -> float:
    """Root mean square error of the depth rate (cm/s) over the steady segments of some profiles."""
    settings = CalibrateSettings(seawater=way)
    parts = []
    for record in records:
        try:
            parts.append(segments_of(on_steps(record, settings), platform, settings.steady))
        except ProfileError as error:
            print(f"left out: {error}")
    errors = SegmentErrors(platform, (), join_segments(parts))
    return 100.0 * math.sqrt(float(np.mean(errors.all_errors(np.zeros(0))[errors.counted[:, 0], 0] ** 2)))


def _row(name: str, estimator: str, found: Heave) -> tuple[str, ...]:
    pairs = (f"{found.median[0]:+.2f}, {found.median[1]:+.2f}", f"{found.size[0]:.2f}, {found.size[1]:.2f}")
    return (name, estimator, *pairs, f"{found.deviation[0]:.2f}, {found.deviation[1]:.2f}", f"{found.common:+.3f}")


_HEAVE = ("buoyancy by", "estimate", "median, dive and climb", "median size", "scatter", "common part")


def twins() -> str:
    """Table of the twins: still water of one density, and the stratified ocean both ways."""
    platform, scenario = with_overrides(load_platform("petrel-l"), HULL), load_scenario("stratified")
    scenario = scenario.replaced({"depth": DEPTH})
    rows, sunk = [], []
    for name, water, way in (
        ("water of one density", scenario.replaced({"ocean": None}).model_copy(update={"ocean": None}), "depth_slope"),
        ("density", scenario, "density"),
        ("depth slope", scenario, "depth_slope"),
    ):
        records = [simulate_profile(platform, water, SEED, number=n)[0] for n in range(1, TWINS + 1)]
        filtered, smoothed = heaves(platform, records, way)
        rows += [_row(name, "filter", filtered), _row("", "smoother", smoothed)]
        sunk.append((name, f"{np.median([dive_error(platform, record, way) for record in records]):.1f}"))
    return "\n".join(
        [
            markdown(_HEAVE, rows),
            "",
            "Depth of the dive simulated open loop, as by `validate`, root mean square error (m): "
            + ", ".join(f"{name} {error}" for name, error in sunk)
            + ".",
        ]
    )


def mission(name: str, observations: str, hulls: tuple[str, str], profiles: str) -> tuple[list[tuple[str, ...]], ...]:
    """Rows of one real mission: its hulls and depth rates, and its heave."""
    fits, rows = [], []
    with open_observations(observations) as opened:
        records = [opened.profile(number) for number in select_profiles(opened.profile_numbers, profiles)]
    for way, path in zip(WAYS, hulls, strict=True):
        platform = load_platform(path)
        buoyancy, label = platform.buoyancy, way.replace("_", " ")
        value = f"{buoyancy.depth_slope:.4g} N/m" if way == "depth_slope" else f"{buoyancy.compressibility:.3g} /dbar"
        error = depth_rate_error(platform, records, way)
        fits.append((name, label, f"{buoyancy.neutral_volume:.0f}", value, f"{error:.2f}"))
        filtered, smoothed = heaves(platform, records, way)
        rows += [(name, *_row(label, "filter", filtered)), (name, *_row(label, "smoother", smoothed))]
        print(fits[-1], *rows[-2:], sep="\n", flush=True)
    return fits, rows


def main() -> None:
    """Make the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--mission", nargs=5, action="append", default=[], metavar="X")
    fits, rows, chosen = [], [], []
    for name, observations, density, slope, profiles in parser.parse_args().mission:
        fit, row = mission(name, observations, (density, slope), profiles)
        fits += fit
        rows += row
        chosen.append(f"{name} {profiles}")
    fitted = markdown(("mission", "buoyancy by", "neutral volume, cm3", "fitted or held", "depth rate, cm/s"), fits)
    text = TEMPLATE.read_text("utf-8").format(
        twins=twins(),
        fitted=fitted,
        heave=markdown(("mission", *_HEAVE), rows),
        chosen="; ".join(chosen),
        depth=DEPTH,
        count=TWINS,
        seed=SEED,
    )
    PAGE.write_text(text, "utf-8")


if __name__ == "__main__":
    main()
