"""Intervals of the smoother on hulls other than the platform file's: twins, for every value of `smoother.hull`.

Usage: ``python -m benchmarks.hull_errors [--twins N]`` writes ``docs/hull-errors.md``.
"""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks import hull_missions
from benchmarks.hull_commands import flown_hull
from gliderhpc import Glider
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.estimation.smoother.estimate import SmoothedEstimate
from gliderhpc.estimation.smoother.hull_errors import HullErrors, stated_errors
from gliderhpc.estimation.smoother.information import HullInformation
from gliderhpc.estimation.smoother.posterior import posterior_errors, with_hull_errors
from gliderhpc.findings.formatting import markdown
from gliderhpc.flight.hull_parameters import hull_parameters, moved_platform
from gliderhpc.flight.steady_glide import glides_stably
from gliderhpc.observations.series import averages_between
from gliderhpc.platform import Platform
from gliderhpc.simulator import simulate_profile
from gliderhpc.twins.cases import course_of, with_coefficient_errors, world
from gliderhpc.vocabulary import CHANNELS

DEPTH, SIZE, TWINS, SETTLED = 200.0, 0.15, 6, 60.0
TRUE, COEFFICIENTS, EVERYTHING = "true hull", "coefficients within 15 %", "everything wrong"
KINDS = (TRUE, COEFFICIENTS, EVERYTHING)
WAYS = ("believed", "held", "corrected")
QUANTITIES = (*CHANNELS, "u", "v", "w")
_VELOCITY, _TRACK = slice(6, 9), slice(3, 5)
_BELIEF_STREAM = 77
TEMPLATE = Path(__file__).with_suffix(".md")
PAGE = Path(__file__).resolve().parents[1] / "docs" / "hull-errors.md"

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Outcome:
    """One twin by one way: errors and deviations ``(m, 9)`` in steady glide, and the current's error and covariance."""

    error: Array
    deviation: Array
    current: Array
    covariance: Array

    @property
    def coverage(self) -> Array:
        """Share (9,) of the truth in the 68 % intervals."""
        return np.asarray((np.abs(self.error) <= self.deviation).mean(axis=0))

    @property
    def distance(self) -> float:
        """Squared distance of the current from the truth by its covariance."""
        return float(self.current @ np.linalg.solve(self.covariance, self.current))


@dataclass(frozen=True)
class Twin:
    """One twin: its outcome by each way, and its parameters' errors over their stated deviations (p,)."""

    outcomes: dict[str, Outcome]
    deviations: Array
    names: tuple[str, ...]


def believed(true: Platform, kind: str, seed: int) -> Platform:
    """Hull that the estimator is given."""
    rng = np.random.default_rng([seed, _BELIEF_STREAM])
    if kind == TRUE:
        return true
    while True:
        parameters = hull_parameters(true)
        off = SIZE * rng.standard_normal(len(parameters))
        hull = with_coefficient_errors(true, rng) if kind == COEFFICIENTS else moved_platform(true, parameters, off)
        if glides_stably(Glider(hull)):
            return hull


def fly_twin(true: Platform, kind: str, seed: int) -> Twin | None:
    """Fly and smooth one twin; None where the filter refuses the record with that hull."""
    settings, hull = EstimationSettings(), believed(true, kind, seed)
    record, truth = simulate_profile(true, world(DEPTH), seed, number=course_of(seed))
    own = hull_missions.smooth_record(record, hull, settings)
    if own is None:
        return None
    profile, smoothed, information = own.profile, own.smoothed, own.information
    series, every = profile.series, settings.steps_per_record
    after = posterior_errors(stated_errors(hull, information.parameters), information)
    states = np.column_stack([np.interp(series.time, truth.time, column) for column in truth.states.T])
    edges = np.arange(len(truth.disturbances) + 1, dtype=np.float64) * truth.step
    disturbances = averages_between(truth.disturbances, edges, series.time)
    steady = ~profile.vibrating[:-1] & (series.time[:-1] >= SETTLED) & (series.time[1:] <= edges[-1])
    outcomes = {}
    for way, estimate in _by_way(smoothed.thinned(every), information, after):
        found = np.hstack([estimate.disturbances, estimate.states[: len(estimate.disturbances), _VELOCITY]])
        stated = np.hstack([estimate.disturbances_std, estimate.states_std[: len(estimate.disturbances), _VELOCITY]])
        error = found - np.hstack([disturbances, states[:-1, _VELOCITY]])[::every]
        elapsed, moved = float(series.time[-1]), states[-1, _TRACK] - states[0, _TRACK]
        outcomes[way] = Outcome(
            error[steady[::every]],
            stated[steady[::every]],
            (estimate.displacement - moved) / elapsed,
            estimate.displacement_covariance / elapsed**2,
        )
    eta = np.array([p.steps(hull, p.value(true)) for p in information.parameters])
    return Twin(outcomes, (after.mean - eta) / np.sqrt(np.diag(after.covariance)), information.names)


def _by_way(
    smoothed: SmoothedEstimate, information: HullInformation, errors: HullErrors
) -> Iterator[tuple[str, SmoothedEstimate]]:
    yield "believed", smoothed
    for way in ("held", "corrected"):
        yield way, with_hull_errors(smoothed, information, errors, corrected=way == "corrected")[0]


def _table(heads: list[str], kinds: dict[str, list[Twin]], row: object) -> str:
    rows = [[kind, way, *row([t.outcomes[way] for t in twins])] for kind, twins in kinds.items() for way in WAYS]  # type: ignore[operator]
    return markdown(["hull", "smoother.hull", *heads], rows)


def _coverage(outcomes: list[Outcome]) -> list[str]:
    return [f"{share:.2f}" for share in np.mean([one.coverage for one in outcomes], axis=0)]


def _errors(outcomes: list[Outcome]) -> list[str]:
    square = np.mean([np.mean(one.error**2, axis=0) for one in outcomes], axis=0)
    scale = np.array([1.0] * 6 + [1e3] * 3)
    return [f"{value:.3g}" for value in scale * np.sqrt(square)]


def _currents(outcomes: list[Outcome]) -> list[str]:
    error = np.sqrt(np.mean([one.current @ one.current / 2.0 for one in outcomes]))
    deviation = np.median([np.sqrt(np.trace(one.covariance) / 2.0) for one in outcomes])
    distances = np.array([one.distance for one in outcomes])
    inside = [f"{np.mean(distances <= limit):.2f}" for limit in (1.0, 4.0)]
    return [f"{error:.4f}", f"{deviation:.4f}", *inside]


def _parameters(kinds: dict[str, list[Twin]]) -> str:
    rows = []
    for kind, twins in kinds.items():
        size = np.sqrt(np.mean([np.mean(twin.deviations**2) for twin in twins]))
        worst = max(twins, key=lambda twin: np.abs(twin.deviations).max())
        place = int(np.abs(worst.deviations).argmax())
        beyond = np.mean([np.mean(np.abs(twin.deviations) > 2.0) for twin in twins])
        largest = f"{abs(worst.deviations[place]):.1f} (`{worst.names[place]}`)"
        rows.append([kind, str(len(twins)), f"{size:.2f}", f"{beyond:.3f}", largest])
    return markdown(["hull", "twins", "root mean square", "share beyond 2", "largest"], rows)


def main(arguments: list[str] | None = None) -> None:
    """Fly the twins and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--twins", type=int, default=TWINS, help="twins of each kind")
    count = parser.parse_args(arguments).twins
    true, seeds = flown_hull(world(DEPTH)), range(1, count + 1)
    found = {kind: [fly_twin(true, kind, seed) for seed in seeds] for kind in KINDS}
    kinds = {kind: [twin for twin in twins if twin is not None] for kind, twins in found.items()}
    page = TEMPLATE.read_text("utf-8").format(
        twins=count,
        seeds=f"{seeds[0]} to {seeds[-1]}",
        depth=DEPTH,
        size=SIZE,
        count=len(hull_parameters(true)),
        coverage=_table([*QUANTITIES], kinds, _coverage),
        errors=_table([*QUANTITIES], kinds, _errors),
        currents=_table(["error", "stated", "in 39 %", "in 86 %"], kinds, _currents),
        parameters=_parameters(kinds),
        missions=hull_missions.table(true),
        dives=hull_missions.DIVES,
        mission_depth=hull_missions.DEPTH,
    )
    PAGE.write_text(page, "utf-8")


if __name__ == "__main__":
    main()
