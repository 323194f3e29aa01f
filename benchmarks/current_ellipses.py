"""Coverage of the stated ellipses of the current, on twins with calibrated hulls.

Writes ``docs/current-ellipses.md``. Usage: ``python -m benchmarks.current_ellipses [--hulls N] [--rows FILE]``, where FILE
keeps the twins as they come, and those that it holds are not flown again.

A twin is a hull drawn about the platform's as in ``benchmarks.calibration``, with sensors that are off. Its own dives are
calibrated on, as ``gliderhpc calibrate`` does, and further dives are inverted with the calibrated hull as ``run-mission``
does. The ellipses are those that the archive's root would state.
"""

import argparse
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.calibration import HELD_OUT, PITCHES, PLATFORM, PROFILES, SETTINGS, draw_hull
from gliderhpc import Glider, load_platform
from gliderhpc.calibration.glides.fit import calibrate_on_glides
from gliderhpc.errors import GliderhpcError, ProfileError
from gliderhpc.estimation.current_errors import CurrentSettings, Drift, current_uncertainty
from gliderhpc.estimation.currents import current_from_displacement, cycles_of, depth_averaged_current
from gliderhpc.estimation.preparation import prepare_profile
from gliderhpc.estimation.profile import ProfileEstimate, estimate_profiles
from gliderhpc.estimation.resample import on_steps
from gliderhpc.estimation.self_motion import model_motion
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.estimation.steady_segments import join_segments, segments_of
from gliderhpc.findings.formatting import markdown
from gliderhpc.flight.hull_parameters import with_covariance
from gliderhpc.observations import ProfileRecord
from gliderhpc.platform import Platform
from gliderhpc.platform_sections import CalibrationErrors
from gliderhpc.simulator import ProfileTruth, Scenario, simulate_profile
from gliderhpc.studies.library.scores import COVERAGE, sigma_distance
from gliderhpc.twins.cases import paper_dive

Row = dict[str, Any]

FIRST_SEED = 5000
HULLS = 32
DIVES, DEPTH = 2, 250.0
"""Inverted dives of each hull, and how deep they go, m."""

CALIBRATION_DEPTH = 120.0
BATCH = 8
"""Hulls whose dives are inverted side by side."""

OFFSETS = {"roll_offset": 0.5, "pitch_offset": 0.5, "heading_offset": 2.0}
"""Standard deviations of the sensors' constant errors, degree, as in ``twin currents``."""

SPEED = (0.0, 0.45)
"""Of the uniform current, m/s; shear and gusts of the scenario ``paper`` come on top."""

ESTIMATES = ("adjoint", "smoothed")
BANDS = {1: (0.3, 0.6), 2: (0.8, 0.97)}
"""Shares inside that are asked for, by sigma."""


@dataclass(frozen=True, eq=False)
class Twin:
    """A calibrated hull with the dives that the true one made."""

    seed: int
    calibrated: Platform
    offsets: Mapping[str, float]
    dives: Sequence[tuple[ProfileRecord, ProfileTruth]]


def twin(seed: int) -> Twin:
    """Draw a hull and its sensors, calibrate the platform on its dives, and fly the dives to be inverted."""
    platform, rng = load_platform(PLATFORM), np.random.default_rng(seed)
    offsets = {name: float(rng.normal(0.0, deviation)) for name, deviation in OFFSETS.items()}
    while True:
        truth = draw_hull(platform, rng)
        try:
            return Twin(seed, calibrated(platform, truth, offsets, rng), offsets, dives(truth, offsets, rng))
        except GliderhpcError:
            # A hull that cannot fly these scenarios, or cannot be calibrated, is no twin.
            continue


def calibrated(platform: Platform, truth: Platform, offsets: Mapping[str, float], rng: np.random.Generator) -> Platform:
    """Calibrate the platform on the steady glides of a true hull."""
    parts = []
    for number in range(1, PROFILES + 1):
        scenario = Scenario().replaced(
            {
                "depth": CALIBRATION_DEPTH,
                "actuation": {"pitch": float(rng.uniform(*PITCHES))},
                "steering": {"interval": 200.0, "longest_turn": 150.0},
                "sensors": {**Scenario().sensors.model_dump(), **offsets},
            }
        )
        record, _ = simulate_profile(truth, scenario, int(rng.integers(2**31)), number=number)
        parts.append(segments_of(on_steps(record, SETTINGS), platform, SETTINGS.steady))
    flown = join_segments(parts)
    apart = flown.profile % HELD_OUT == 0
    return calibrate_on_glides(platform, flown.select(~apart), flown.select(apart), SETTINGS.calibration).platform


def dives(
    truth: Platform, offsets: Mapping[str, float], rng: np.random.Generator
) -> list[tuple[ProfileRecord, ProfileTruth]]:
    """Fly the dives that are inverted, on any course in any current."""
    base, flown = paper_dive(DEPTH, speed=SPEED), []
    for _ in range(DIVES):
        scenario = base.replaced(
            {
                "sensors": {**base.sensors.model_dump(), **offsets},
                "actuation": {**base.actuation.model_dump(), "pitch": float(rng.uniform(*PITCHES))},
                "steering": {
                    **base.steering.model_dump(),
                    "courses": (float(rng.uniform(0.0, 360.0)),),
                    "waypoints": (),
                },
            }
        )
        flown.append(simulate_profile(truth, scenario, int(rng.integers(2**31))))
    return flown


def inverted(twins: Sequence[Twin]) -> Iterator[Row]:
    """One row per dive and estimate: current, truth, and inputs of its ellipse."""
    # The adjoint is the second opinion in a covariance only where it does not start from the smoothed path.
    settings = EstimationSettings(start="prior")
    tasks = [
        ((one, number), prepare_profile(Glider(one.calibrated), on_steps(record, settings)))
        for one in twins
        for number, (record, _) in enumerate(one.dives)
    ]
    for (one, number), estimate in estimate_profiles(tasks, settings, with_hull=True):
        if not isinstance(estimate, ProfileError):
            yield from rows_of(one, number, estimate)


def rows_of(one: Twin, number: int, estimate: ProfileEstimate) -> Iterator[Row]:
    """Rows of one dive, by either estimate where it has a current."""
    (record, truth), smoothed = one.dives[number], estimate.smoothed
    errors = CurrentSettings().errors(one.calibrated)
    motion = model_motion(estimate.solution.states, estimate.vibrating, estimate.series.step)
    adjoint = depth_averaged_current(record, estimate.series, motion, cycles_of(estimate.series), errors)
    found = {"adjoint": adjoint}
    if smoothed is not None and smoothed.outcome.usable:
        moved, covariance = smoothed.displacement, smoothed.displacement_covariance
        found["smoothed"] = current_from_displacement(record, estimate.series.time, moved, covariance, errors)
    for name, current in found.items():
        if current is not None:
            drift = current.drift
            yield {
                "seed": one.seed, "dive": number, "estimate": name, "offsets": dict(one.offsets),
                "truth": truth.current.tolist(), "velocity": drift.velocity.tolist(), "track": drift.track.tolist(),
                "elapsed": drift.elapsed, "position_variance": drift.position_variance, "bridged": drift.bridged,
                "track_covariance": drift.track_covariance.tolist(),
            }  # fmt: skip


def drift_of(row: Row, disagreement: np.ndarray) -> Drift:
    """Inputs of a row's ellipse."""
    return Drift(
        np.array(row["velocity"]),
        np.array(row["track"]),
        row["elapsed"],
        row["position_variance"],
        row["bridged"],
        np.array(row["track_covariance"]),
        disagreement,
    )


def disagreements(rows: Sequence[Row]) -> dict[tuple[int, int], np.ndarray]:
    """Adjoint's less smoothed current of every dive that has both, m/s; zero of the others."""
    found: dict[tuple[int, int], dict[str, np.ndarray]] = {}
    for row in rows:
        found.setdefault((row["seed"], row["dive"]), {})[row["estimate"]] = np.array(row["velocity"])
    return {
        dive: both["adjoint"] - both["smoothed"] if len(both) == len(ESTIMATES) else np.zeros(2)
        for dive, both in found.items()
    }


def error_of(row: Row) -> np.ndarray:
    """Estimated minus true current, m/s."""
    return np.array(row["velocity"]) - np.array(row["truth"])


def along_and_across(row: Row) -> np.ndarray:
    """Error along and across the track, m/s."""
    track = np.array(row["track"]) / np.linalg.norm(row["track"])
    return np.array([error_of(row) @ track, error_of(row) @ np.array([-track[1], track[0]])])


def coverage_row(rows: Sequence[Row], estimate: str, settings: CurrentSettings) -> list[str]:
    """One line of the table: shares inside, with the binomial error of hulls, and sizes of errors and ellipses."""
    own = [row for row in rows if row["estimate"] == estimate]
    errors, apart = settings.errors(CALIBRATED), disagreements(rows)
    stated = [current_uncertainty(drift_of(row, apart[row["seed"], row["dive"]]), errors) for row in own]
    distance = np.array([sigma_distance(error_of(r), s.covariance) for r, s in zip(own, stated, strict=True)])
    parts = np.array([along_and_across(row) for row in own])
    hulls = len({row["seed"] for row in own})
    shares = [
        f"{np.mean(distance <= sigma):.2f} ± {np.sqrt(share * (1.0 - share) / hulls):.2f}"
        for sigma, share in COVERAGE.items()
    ]
    axes = np.median([one.axes for one in stated], axis=0)
    return [
        estimate,
        f"{len(own)} of {hulls}",
        *shares,
        f"{np.sqrt(np.mean((parts**2).sum(axis=1))):.4f}",
        *(f"{value:.4f}" for value in np.sqrt(np.mean(parts**2, axis=0))),
        f"{axes[0]:.4f}; {axes[1]:.4f}",
    ]


CALIBRATED = with_covariance(load_platform(PLATFORM), CalibrationErrors(parameters=(), deviation=(), correlation=()))
"""Stands for any calibrated hull where its terms are asked for."""

PUBLISHED = CurrentSettings(axial_error=0.055, relative_error=0.26, heading_error=8.0)

HEADS = (
    "estimate", "dives of hulls", "within 1 sigma (39 %)", "within 2 sigma (86 %)", "error, RMS, m/s", "along the track",
    "across it", "semi-axes, median, m/s",
)  # fmt: skip


def page(rows: Sequence[Row]) -> str:
    """Text of the page."""
    seeds = sorted({row["seed"] for row in rows})
    spread = ", ".join(f"{value:g} in {name.partition('_')[0]}" for name, value in OFFSETS.items())
    errors = CurrentSettings().errors(CALIBRATED)
    return "\n".join([
        "# Ellipses of the current, on twins with calibrated hulls", "",
        "If you use `current.budget=published` with a calibrated hull, this page shows how often the resulting ellipses contain the",
        "true current, and where their constants come from.",
        "",
        "Made by `python -m benchmarks.current_ellipses`. Hulls drawn about `" + PLATFORM + "`, every parameter uniformly",
        "within one plausible deviation, are calibrated on nine dives of their own (three held out) as",
        f"[calibration.md](calibration.md) does, and {DIVES} further dives each to {DEPTH:g} m are inverted with the",
        f"calibrated hull, in a uniform current of {SPEED[0]:g} to {SPEED[1]:g} m/s in any direction with the shear and gusts",
        "of the scenario `paper`. Constant errors of the sensors, in calibration and dives alike, are normal with standard",
        f"deviations of {spread} (degree); the error of the fixes is 5 m per coordinate. Seeds {seeds[0]} to {seeds[-1]}.", "",
        f"The ellipses are those that the archive states with a calibrated hull and `current.budget=published`: {errors.axial_error:g} m/s along the track,",
        f"{errors.heading_error:g} degrees of the course, nothing relative to the current; in addition fixes, surface drift and the",
        "estimate's own terms. The errors given with the shares are binomial, with each hull counted once.", "",
        markdown(HEADS, [coverage_row(rows, name, CurrentSettings()) for name in ESTIMATES]), "",
        "With the paper's terms, which are meant for hulls that were never calibrated, the same twins give:", "",
        markdown(HEADS, [coverage_row(rows, name, PUBLISHED) for name in ESTIMATES]), "",
        "The spread of compass offsets determines the error across the track: a compass with a larger offset needs",
        "`current.heading_error`, and `gliderhpc inspect` finds offsets where a mission turns.",
    ])  # fmt: skip


def flown(hulls: int, keep: Path | None) -> list[Row]:
    """Rows of so many hulls; those that a file holds already are taken from it."""
    rows: list[Row] = json.loads(keep.read_text("utf-8")) if keep is not None and keep.exists() else []
    done = {row["seed"] for row in rows}
    left = [seed for seed in range(FIRST_SEED, FIRST_SEED + hulls) if seed not in done]
    for first in range(0, len(left), BATCH):
        rows += inverted([twin(seed) for seed in left[first : first + BATCH]])
        if keep is not None:
            keep.write_text(json.dumps(rows), "utf-8")
    return rows


def main() -> None:
    """Fly the twins and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hulls", type=int, default=HULLS)
    parser.add_argument("--rows", type=Path)
    given = parser.parse_args()
    text = page(flown(given.hulls, given.rows))
    target = Path(__file__).resolve().parents[1] / "docs" / "current-ellipses.md"
    target.write_text(text + "\n", "utf-8")
    print(text)


if __name__ == "__main__":
    main()
