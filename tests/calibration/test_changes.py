"""A hull that changes among the dives of a calibration: the warning, on steady glides and on whole dives."""

from dataclasses import replace

import numpy as np
import pytest
from support.missions import program

import gliderhpc as gh
from gliderhpc.calibration.changes import MIN_ON_EACH_SIDE, find_change
from gliderhpc.flight.hull_parameters import (
    errors_in_units,
    hull_parameters,
    stated_covariance,
    with_covariance,
    with_values,
)
from gliderhpc.mission_hull.estimate import ProfileTerm
from gliderhpc.platform import read_platform
from gliderhpc.simulator import simulate_mission
from gliderhpc.simulator.scenario import load_scenario
from gliderhpc.studies.hull import MissionTerms, in_order_of_time

PETREL = read_platform("petrel-l")
LIGHTER = with_values(PETREL, {"buoyancy.neutral_volume": PETREL.buoyancy.neutral_volume - 60.0})
"""The hull after it has gained buoyancy: an object of 62 g was lost."""

PARAMETERS = hull_parameters(PETREL)
DIVES = 12


def dives_with_step(after, size=0.5, seed=0):
    """Information of dives on every parameter, in which the neutral volume is larger by `size` from a dive on."""
    rng = np.random.default_rng(seed)
    volume = [p.key for p in PARAMETERS].index("buoyancy.neutral_volume")
    terms = []
    for number in range(1, DIVES + 1):
        eta = np.zeros(len(PARAMETERS))
        eta[volume] = size if number > after else 0.0
        score = 400.0 * eta + rng.normal(scale=20.0, size=len(eta))
        time = np.datetime64("2024-05-01T00:00:00", "ns") + np.timedelta64(3 * number, "h")
        terms.append(ProfileTerm(number, time, np.zeros(len(eta)), score, 400.0 * np.eye(len(eta))))
    return MissionTerms(PETREL, PARAMETERS, in_order_of_time(reversed(terms)), without=())


def test_a_change_is_described_with_its_onset_size_and_remedy():
    warning = find_change(dives_with_step(after=6)).warning
    assert warning.startswith(
        "the hull changed among these dives, abruptly at profile 7 (7 to 7), with probability 1.000"
    )
    assert "neutral oil volume by +" in warning
    assert warning.endswith("calibrate the dives before and after it separately (`profiles`)")


@pytest.mark.parametrize("size", [0.0, 0.02])
def test_no_change_and_one_smaller_than_the_scatter_give_no_warning(size):
    assert [find_change(dives_with_step(after=6, size=size, seed=seed)) for seed in range(5)] == [None] * 5


@pytest.mark.parametrize("after", [MIN_ON_EACH_SIDE - 1, DIVES - MIN_ON_EACH_SIDE + 1])
def test_a_few_dives_at_one_end_are_no_change_of_the_hull(after):
    """Those of one end can be in rougher water."""
    assert find_change(dives_with_step(after=after)) is None


def test_the_stated_errors_of_the_mean_include_the_change():
    """Half of the dives lie a quarter of a plausible deviation on each side of the mean."""
    covariance = 0.01 * np.eye(len(PARAMETERS))
    hull = with_covariance(PETREL, errors_in_units(PETREL, PARAMETERS, np.zeros(len(PARAMETERS)), covariance))
    widened = find_change(dives_with_step(after=6)).widened(hull, PARAMETERS)
    added = np.diag(stated_covariance(widened, PARAMETERS)) - 0.01
    volume = [p.key for p in PARAMETERS].index("buoyancy.neutral_volume")
    assert added[volume] == pytest.approx(0.25**2, rel=0.2)
    assert np.delete(added, volume).max() < 0.2 * added[volume]


def test_too_few_dives_show_no_change():
    dives = dives_with_step(after=2)
    assert find_change(replace(dives, terms=dives.terms[-3:])) is None


def fly(path, changed):
    """Fly calm dives; from the seventh on with the lighter hull if `changed`."""

    def run(make, jobs):
        for job in jobs:
            yield make(replace(job, platform=LIGHTER if changed and job.number > 6 else PETREL))

    scenario = load_scenario("calm").replaced({"profiles": DIVES, "depth": 100.0})
    return simulate_mission(PETREL, path, scenario=scenario, seed=4, run=run).path


@pytest.mark.compiled
@pytest.mark.parametrize("changed", [True, False])
def test_steady_glides_show_that_the_hull_changed(tmp_path, changed):
    mission = fly(tmp_path / "mission.nc", changed)
    out = tmp_path / "hull.yaml"
    answer = program("calibrate", mission, "--platform", "petrel-l", "--out", out, "--set", "rounds.most=0")
    assert answer.status == 0, answer.err
    assert ("the hull changed among these dives, abruptly at profile 7" in " ".join(answer.out.split())) == changed
    assert ("The hull changed among these dives" in gh.load_platform(out).source) == changed


@pytest.mark.compiled
@pytest.mark.long
@pytest.mark.parametrize("changed", [True, False])
def test_whole_dives_show_that_the_hull_changed(tmp_path, changed):
    """Those held out for the score count too."""
    found = gh.calibrate(fly(tmp_path / "mission.nc", changed), "petrel-l", workers=2, rounds={"most": 3})
    rounds = found.dives.rounds
    assert [term.number for term in rounds.terms] == list(range(1, DIVES + 1))
    assert ("abruptly at profile 7" in found.change) == changed
    assert (found.change in found.warnings) == changed
    assert ("The hull changed among these dives" in found.platform.source) == changed
