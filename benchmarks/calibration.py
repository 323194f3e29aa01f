"""Calibration compared with known truth and on real missions; writes ``docs/calibration.md``.

Usage: ``python -m benchmarks.calibration [NAME=OBSERVATIONS:PLATFORM ...]``, where OBSERVATIONS are imported records.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from benchmarks.command_line import positional
from benchmarks.sections import section_of, with_section
from gliderhpc import Glider, load_platform
from gliderhpc.calibration.glides.fit import CalibrationVerdict, GlideCalibration, calibrate_on_glides
from gliderhpc.calibration.glides.segment_errors import choose_buoyancy
from gliderhpc.calibration.glides.text import SCORES, figures, interval_text, remark_of
from gliderhpc.calibration.settings import CalibrateSettings
from gliderhpc.calibration.workflow import profiles_to_read, split_segments
from gliderhpc.errors import GliderhpcError
from gliderhpc.estimation.resample import on_steps
from gliderhpc.estimation.steady_segments import SteadySegments, join_segments, segments_of, steady_segments
from gliderhpc.findings.formatting import markdown
from gliderhpc.flight.hull_parameters import ATTITUDE_PARAMETERS, PARAMETERS, moved_platform, with_values
from gliderhpc.flight.steady_glide import glides_stably
from gliderhpc.observations import open_observations
from gliderhpc.platform import Platform
from gliderhpc.simulator import Scenario, simulate_profile

PLATFORM = "petrel-l"
TWINS = 60
FIRST_SEED = 1000
"""Twins that no development of the calibration has seen."""
PROFILES = 12
HELD_OUT = 4
PITCHES = (19.0, 32.0)
ONE_PITCH = (23.0, 23.0)
SETTINGS = CalibrateSettings()
_ATTITUDE_STREAM = 81
UNFLOWN = "viscous.K_delta"
"""Petrel-L has no rudder."""


@dataclass(frozen=True, eq=False)
class Twin:
    """Hull drawn about the platform's, and the result of its calibration."""

    truth: Platform
    found: GlideCalibration

    def verdict(self, key: str) -> CalibrationVerdict:
        """Outcome of a parameter."""
        return self._of(key).verdict

    def covered(self, key: str) -> bool:
        """True where the true value lies in the stated interval."""
        found = self._of(key)
        return found.interval[0] <= found.parameter.value(self.truth) <= found.interval[1]

    def half_interval(self, key: str) -> float:
        """Half the interval's width in the platform file's unit."""
        return 0.5 * (self._of(key).interval[1] - self._of(key).interval[0])

    def error(self, key: str) -> float:
        """Estimate less truth in the platform file's unit."""
        return self._of(key).after - self._of(key).parameter.value(self.truth)

    def _of(self, key: str):
        return next(found for found in self.found.parameters if found.parameter.key == key)


def draw_hull(platform: Platform, rng: np.random.Generator) -> Platform:
    """Draw every parameter within one plausible deviation of the platform's, until the hull glides stably."""
    while True:
        drawn = {p.key: p.moved(platform, rng.uniform(-1.0, 1.0)) for p in PARAMETERS if p.key != UNFLOWN}
        hull = with_values(platform, drawn)
        if glides_stably(Glider(hull)):
            return hull


def fly(
    hull: Platform, platform: Platform, rng: np.random.Generator, number: int, pitches: tuple[float, float]
) -> SteadySegments:
    """Simulate one profile of a hull and cut its record into steady segments, judged by the platform."""
    scenario = Scenario().replaced(
        {
            "depth": 120.0,
            "actuation": {"pitch": rng.uniform(*pitches)},
            "steering": {"interval": 200.0, "longest_turn": 150.0},
        }
    )
    record, _ = simulate_profile(hull, scenario, int(rng.integers(2**31)), number=number)
    return segments_of(on_steps(record, SETTINGS, platform), platform, SETTINGS.steady)


def twin(seed: int, pitches: tuple[float, float] = PITCHES, profiles: int = PROFILES) -> Twin:
    """Draw a hull, fly it, and calibrate on its records a platform that is wrong on the attitude's offsets and scale."""
    hull, rng = load_platform(PLATFORM), np.random.default_rng(seed)
    offsets = np.random.default_rng([seed, _ATTITUDE_STREAM]).uniform(-1.0, 1.0, len(ATTITUDE_PARAMETERS))
    platform = moved_platform(hull, ATTITUDE_PARAMETERS, offsets)
    while True:
        truth = draw_hull(hull, rng)
        try:
            flown = join_segments([fly(truth, platform, rng, number, pitches) for number in range(1, profiles + 1)])
        except GliderhpcError:
            # A hull that cannot fly this scenario is no twin.
            continue
        apart = flown.profile % HELD_OUT == 0
        return Twin(
            truth, calibrate_on_glides(platform, flown.select(~apart), flown.select(apart), SETTINGS.calibration)
        )


def coverage(twins: Sequence[Twin]) -> str:
    """Markdown of every parameter over the twins: estimated, covered, errors, held."""
    rows = []
    for parameter in PARAMETERS:
        key = parameter.key
        estimated = [twin for twin in twins if twin.verdict(key) is CalibrationVerdict.ESTIMATED]
        held = len(twins) - len(estimated)
        cells = [f"`{key}`", parameter.unit, f"{len(estimated)}"]
        if estimated:
            errors = np.array([twin.error(key) for twin in estimated])
            half = np.median([twin.half_interval(key) for twin in estimated])
            inside = sum(twin.covered(key) for twin in estimated)
            cells += [f"{inside} ({inside / len(estimated):.0%})", f"{np.sqrt(np.mean(errors**2)):.3g}", f"{half:.3g}"]
        else:
            cells += ["", "", ""]
        rows.append([*cells, str(held)])
    return markdown(
        (
            "parameter",
            "unit",
            "estimated",
            "true value inside",
            "error, RMS",
            "half interval, median",
            "held and named",
        ),
        rows,
    )


def summary(twins: Sequence[Twin]) -> str:
    """Sentence on all parameters of all twins together."""
    inside = [
        twin.covered(p.key) for twin in twins for p in PARAMETERS if twin.verdict(p.key) is CalibrationVerdict.ESTIMATED
    ]
    least = min(
        np.mean([twin.covered(p.key) for twin in twins if twin.verdict(p.key) is CalibrationVerdict.ESTIMATED])
        for p in PARAMETERS
        if any(twin.verdict(p.key) is CalibrationVerdict.ESTIMATED for twin in twins)
    )
    return (
        f"Of {len(inside)} intervals in {len(twins)} twins {sum(inside)} contain the true value ({np.mean(inside):.1%}); "
        f"the lowest share of a parameter is {least:.0%} of the twins that estimate it."
    )


def scores(twins: Sequence[Twin]) -> list[str]:
    """Held-out errors of the twins, medians, before and after."""
    before, after = (
        np.median([getattr(twin.found.held_out, when) for twin in twins], axis=0) for when in ("before", "after")
    )
    return [
        markdown(
            ("held out, median of the twins", *SCORES[2:]), [["before", *figures(before)], ["after", *figures(after)]]
        )
    ]


def real(label: str) -> list[str]:
    """Section on one real mission, given as ``NAME=OBSERVATIONS:PLATFORM``."""
    name, _, rest = label.partition("=")
    path, _, hull = rest.rpartition(":")
    platform = load_platform(hull)
    with open_observations(path) as opened:
        taken, _ = profiles_to_read(opened, None, None, SETTINGS)
        parts = split_segments(steady_segments(opened, platform, taken, SETTINGS, SETTINGS.steady), None)
    platform, *parts = choose_buoyancy(platform, *parts, SETTINGS.seawater)
    found = calibrate_on_glides(platform, *parts, SETTINGS.calibration)
    rows = [
        [f"{kind}, {when}", str(score.segments), str(len(score.profiles)), *figures(values)]
        for kind, score in (("fitted", found.fitted), ("held out", found.held_out))
        for when, values in (("before", score.before), ("after", score.after))
    ]
    parameters = [
        [f"`{p.parameter.key}`", p.parameter.unit, f"{p.before:.5g}", f"{p.after:.5g}", interval_text(p), remark_of(p)]
        for p in found.parameters
    ]
    return [
        f"### {name}, hull `{hull}`",
        "",
        markdown(("errors, root mean square", "segments", "profiles", *SCORES[2:]), rows),
        "",
        markdown(("parameter", "unit", "before", "after", "95 % interval", "remark"), parameters),
        "",
    ]


FIELD = "by-the-documented-commands"
"""Mark of the section that `benchmarks.calibration_field` writes."""

METHOD = Path(__file__).with_name("calibration.md")
"""Text of the page before its figures."""


def page(twins: Sequence[Twin], one_pitch: Sequence[Twin], missions: Iterable[str]) -> str:
    """Text of the page."""
    lines = [
        METHOD.read_text("utf-8").rstrip(), "",
        f"<!-- {FIELD} -->", f"<!-- /{FIELD} -->", "",
        "## Twins", "",
        f"Hulls drawn about `{PLATFORM}`, every parameter uniformly within one plausible deviation. The offsets of roll and pitch",
        "and the scale of the pitch are drawn likewise, and are not in the given platform.",
        f"{PROFILES} dives each to 120 m, pitch of {PITCHES[0]:g} to {PITCHES[1]:g} degrees drawn for every dive, turns of up to",
        "150 s every 200 s, the simulator's usual slow disturbances, yaw impulses, sensors and lagging actuators; every fourth",
        "dive held out. Seeds",
        f"{FIRST_SEED} to {FIRST_SEED + len(twins) - 1}.", "", summary(twins), "", coverage(twins), "", *scores(twins), "",
        f"With all dives at {ONE_PITCH[0]:g} degrees, {len(one_pitch)} twins: {summary(one_pitch)}", "", coverage(one_pitch), "",
        "## Real missions", "",
        "Every fourth profile is held out; settings are the defaults. The errors are those of the balance at the fitted and the held-out",
        f"profiles, under the hull as shipped and as calibrated, measured on {datetime.now(UTC):%Y-%m-%d}.", "",
    ]  # fmt: skip
    for mission in missions:
        lines += real(mission)
    return "\n".join(lines).rstrip() + "\n"


def main(missions: Sequence[str], count: int = TWINS) -> None:
    """Calibrate the twins and the missions, and write the page."""
    seeds = range(FIRST_SEED, FIRST_SEED + count)
    twins = [twin(seed) for seed in seeds]
    one_pitch = [twin(seed, ONE_PITCH) for seed in seeds[: max(count // 5, 1)]]
    path = Path(__file__).resolve().parents[1] / "docs" / "calibration.md"
    # What `benchmarks.calibration_field` wrote stays.
    field = section_of(path.read_text("utf-8"), FIELD)
    path.write_text(with_section(page(twins, one_pitch, missions), FIELD, field), "utf-8")


if __name__ == "__main__":
    main(positional(__doc__, missions={"nargs": "*"}).missions)
