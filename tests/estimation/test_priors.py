"""Usual priors of the disturbances for gliders that are driven by little weight."""

from types import SimpleNamespace

import numpy as np
import pytest

from gliderhpc.estimation import priors
from gliderhpc.estimation.filter import run_filter
from gliderhpc.estimation.preparation import PreparedProfile, prepare_profile
from gliderhpc.estimation.priors import (
    SLOW_RECORD,
    USUAL_WEIGHT,
    candidate_priors,
    default_prior,
    for_weight,
    smoother_prior,
)
from gliderhpc.estimation.resample import on_steps
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.estimation.smoother.iterate import run_smoother
from gliderhpc.flight.glider import Glider
from gliderhpc.flight.hull_parameters import with_values
from gliderhpc.platform import read_platform
from gliderhpc.simulator import simulate_profile
from gliderhpc.simulator.scenario import load_scenario

SETTINGS = EstimationSettings(step=0.25)
PETREL, SLOCUM = read_platform("petrel-l"), read_platform("slocum")


def test_forces_are_a_part_of_a_small_weight():
    prior = default_prior(PETREL)
    light = for_weight(prior, USUAL_WEIGHT / 3.0)
    np.testing.assert_allclose(light.deviation[:3], np.array(prior.deviation[:3]) / 3.0)
    assert light.deviation[3:] == prior.deviation[3:]
    assert light.correlation_time == prior.correlation_time
    assert for_weight(prior, 5.0) == prior
    assert for_weight(prior, 0.0) == prior, "the record does not show the drive"


def test_filter_and_smoother_use_it_and_a_tuned_prior_stays():
    assert candidate_priors(PETREL, weight=0.5)["usual"] == for_weight(default_prior(PETREL), 0.5)
    assert smoother_prior(SLOCUM, default_prior(SLOCUM), weight=0.5) == for_weight(SLOW_RECORD, 0.5)
    own = PETREL.model_copy(update={"prior": default_prior(PETREL)})
    assert candidate_priors(own, weight=0.5) == {"usual": own.prior}


@pytest.mark.parametrize(
    ("weight", "expected"),
    [
        (np.repeat([2.0, -1.0], 100), 1.5),  # The neutral volume is wrong by 0.5 N.
        (np.full(200, -0.7), 0.7),  # A climb alone.
        (np.repeat([3.0, 1.0], 100), 2.0),  # It is wrong by more than the drive.
    ],
)
def test_driving_weight_is_half_the_difference_between_the_legs(weight, expected):
    glider = SimpleNamespace(net_weight=lambda bodies, depth: weight)
    series = SimpleNamespace(measurements=np.zeros((201, 4)))
    profile = PreparedProfile(glider, series, np.zeros((200, 11)), np.zeros(201, bool))
    assert profile.driving_weight == pytest.approx(expected)


def speed_error(monkeypatch, seed, *, usual):
    """RMS error of the speed of a slow dive in weak gusts, m/s, if `usual` with the usual forces in the prior."""
    hull = with_values(PETREL, {"buoyancy.depth_slope": 0.0})
    water = {
        "disturbances": {"slow_rms": [0.03, 0.0, 0.05, 0.0, 0.01, 0.0], "impulse_interval": None},
        "gusts": {"kind": "gaussian", "rms": 0.01},
    }
    light = {"pitch": 20.0, "dive_net_mass": 0.045, "climb_net_mass": -0.045}
    dive = {"depth": 60.0, "depth_spread": 0.0, "actuation": light, **water}
    record, truth = simulate_profile(hull, load_scenario("impulses").replaced(dive), seed)
    profile = prepare_profile(Glider(hull), on_steps(record, SETTINGS, hull))
    with monkeypatch.context() as patch:
        if usual:
            patch.setattr(priors, "for_weight", lambda prior, weight: prior)
        smoothed = run_smoother(profile, run_filter(profile, SETTINGS), SETTINGS)
    true_speed = np.interp(profile.series.time, truth.time, truth.states[:, 6])
    steady = ~profile.vibrating & (profile.series.time > 60.0)
    return np.sqrt(np.mean((smoothed.states[:, 6] - true_speed)[steady] ** 2))


@pytest.mark.compiled
def test_speed_of_a_glider_that_is_driven_by_half_a_newton(monkeypatch):
    """With forces of the usual size in the prior, the gusts seemed to drive the glider as much as its weight."""
    before, now = (
        np.mean([speed_error(monkeypatch, seed, usual=usual) for seed in (1, 2, 3)]) for usual in (True, False)
    )
    assert before > 0.03
    assert now < 0.25 * before
