"""Hull errors estimated from missions flown with the platform file's hull.

Part of ``docs/hull-errors.md``, which `benchmarks.hull_errors` writes.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.hull_commands import UNSPREAD
from gliderhpc import Glider
from gliderhpc.errors import InputError, ProfileError
from gliderhpc.estimation.filter import run_filter
from gliderhpc.estimation.preparation import PreparedProfile, prepare_profile
from gliderhpc.estimation.priors import default_prior
from gliderhpc.estimation.resample import on_steps
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.estimation.smoother.estimate import SmoothedEstimate
from gliderhpc.estimation.smoother.information import HullInformation, smoothed_hull_information
from gliderhpc.estimation.smoother.iterate import run_smoother
from gliderhpc.findings.formatting import markdown
from gliderhpc.flight.hull_parameters import hull_parameters
from gliderhpc.mission_hull.estimate import HullPrior, ProfileTerm, solve_mission
from gliderhpc.observations.records import ProfileRecord
from gliderhpc.platform import Platform
from gliderhpc.simulator import Scenario, simulate_profile
from gliderhpc.simulator.scenario import load_scenario
from gliderhpc.twins.cases import course_of, drawn_from, with_white_errors, world

DEPTH, DIVES = 150.0, 8
SHIPPED = ("calm", "paper", "demo", "impulses", "fouling")
DRAWN = "drawn from the prior"
WHITE = "calm, white errors of the angles"

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Values:
    """One mission: dives summed up, errors over stated deviations (p,), names, and the deviations left (p,)."""

    dives: int
    errors: Array
    names: tuple[str, ...]
    left: Array

    @property
    def largest(self) -> str:
        """Largest error, with its parameter."""
        place = int(np.abs(self.errors).argmax())
        return f"{self.errors[place]:+.1f} (`{self.names[place]}`)"


def scenarios(hull: Platform) -> dict[str, Scenario]:
    """Scenarios by the name of their disturbances."""
    found = {name: load_scenario(name).replaced({"depth": DEPTH, **UNSPREAD}) for name in SHIPPED}
    found[WHITE] = with_white_errors(found["calm"])
    found[DRAWN] = world(DEPTH, disturbances=drawn_from(default_prior(hull)))
    return found


@dataclass(frozen=True)
class SmoothedRecord:
    """A record smoothed about a hull, and what it says of it."""

    profile: PreparedProfile
    smoothed: SmoothedEstimate
    information: HullInformation


def smooth_record(record: ProfileRecord, hull: Platform, settings: EstimationSettings) -> SmoothedRecord | None:
    """Smooth a record about a hull; None where the filter refuses it with that hull, or the smoother has no estimate."""
    profile = prepare_profile(Glider(hull), on_steps(record, settings, hull))
    try:
        filtered = run_filter(profile, settings)
    except ProfileError:
        return None
    smoothed = run_smoother(profile, filtered, settings)
    if smoothed.last_pass is None:
        return None
    information = smoothed_hull_information(profile, smoothed, smoothed.last_pass, settings)
    return SmoothedRecord(profile, smoothed, information)


def fly_dive(hull: Platform, scenario: Scenario, seed: int) -> ProfileTerm | None:
    """Fly and smooth one dive; None where the scenario's disturbances do not let this hull surface."""
    try:
        record, _ = simulate_profile(hull, scenario, seed, number=course_of(seed))
    except InputError:
        return None
    own = smooth_record(record, hull, EstimationSettings())
    if own is None:
        return None
    found = own.information
    time = np.datetime64("2024-01-01T00:00:00", "ns") + np.timedelta64(6 * seed, "h")
    return ProfileTerm(seed, time, np.zeros(len(found.score)), found.score, found.information, found.others)


def combine_terms(hull: Platform, dives: list[ProfileTerm]) -> Values:
    """Sum up dives of a hull that stays; its true errors are zero."""
    parameters = hull_parameters(hull)
    found = solve_mission(dives, HullPrior.plausible(np.zeros(len(parameters)))).smoothed[-1]
    return Values(len(dives), found.mean / found.std, tuple(p.key for p in parameters), found.std)


def table(hull: Platform) -> str:
    """Errors of the values, with the noise's assumption believed and with the spread of the others in the intervals."""
    rows = []
    for name, scenario in scenarios(hull).items():
        dives = [dive for seed in range(1, DIVES + 1) if (dive := fly_dive(hull, scenario, seed)) is not None]
        for way, terms in (("one", [replace(dive, others=()) for dive in dives]), ("all", dives)):
            values = combine_terms(hull, terms)
            rows.append([
                name, str(values.dives), way, f"{np.sqrt(np.mean(values.errors**2)):.2f}",
                f"{np.mean(np.abs(values.errors) > 2.0):.2f}", values.largest, f"{np.median(values.left):.2f}",
            ])  # fmt: skip
    heads = ["disturbances", "dives", "assumptions of the noise", "root mean square", "share beyond 2", "largest",
             "median deviation left"]  # fmt: skip
    return markdown(heads, rows)
