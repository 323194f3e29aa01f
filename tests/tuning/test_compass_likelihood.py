"""The likelihood by which a compass's errors are found in the currents of legs (restricted maximum likelihood)."""

import numpy as np
import pytest
import scipy

from gliderhpc.estimation.preparation import harmonics
from gliderhpc.tuning.record_checks import CheckSettings, CheckVerdict
from gliderhpc.tuning.record_checks.compass import Leg, TurnInformation, _System, compass_findings

CHECKS = CheckSettings()
NO_TURNS = TurnInformation(np.zeros((5, 5)), np.zeros(5), 0)
LIKELIHOODS = [(1e3, 0.0), (1e4, 0.5), (1e5, 3.0), (1e6, 20.0)]
"""Memory of the current (s), and variance of its lasting part over that of its white part."""


def legs(seed, headings, errors=(0.0,) * 5):
    """Legs at some headings (degree) through a current drawn for each, their compass off by errors (5,) (degree)."""
    rng = np.random.default_rng(seed)
    found = []
    for number, heading in enumerate(np.radians(headings)):
        motion = 0.3 * np.array([np.cos(heading), np.sin(heading)])
        by_error = -np.outer([-motion[1], motion[0]], np.append(1.0, harmonics([heading])[0]))
        current = rng.normal(0.0, 0.02, 2) + by_error @ np.radians(errors)
        found.append(Leg(1e4 * number, current, by_error, -motion))
    return found


def restricted_likelihood(legs, memory, ratio):
    """-2 log of the density of the contrasts that neither mean, speed nor errors enter, at the best variance."""
    time = np.array([leg.time for leg in legs])
    current = np.concatenate([[leg.current[axis] for leg in legs] for axis in (0, 1)])
    errors = np.concatenate([[leg.by_error[axis] for leg in legs] for axis in (0, 1)])
    speed = np.concatenate([[leg.by_speed[axis] for leg in legs] for axis in (0, 1)])
    design = np.column_stack([errors, np.kron(np.eye(2), np.ones((len(legs), 1))), speed])
    contrasts = scipy.linalg.null_space(design.T)
    kernel = np.eye(len(legs)) + ratio * np.exp(-np.abs(time[:, None] - time[None, :]) / memory)
    covariance = contrasts.T @ np.kron(np.eye(2), kernel) @ contrasts
    seen = contrasts.T @ current
    variance = seen @ np.linalg.solve(covariance, seen) / len(seen)
    return len(seen) * np.log(variance) + np.linalg.slogdet(covariance)[1]


def test_the_likelihood_is_that_of_the_contrasts():
    """Harville (1974): equal up to what does not depend on the covariance."""
    drawn = legs(3, np.random.default_rng(1).uniform(0.0, 360.0, 14))
    system = _System(drawn, NO_TURNS, CHECKS)
    design = np.column_stack([system._by_error, system._nuisance])
    prior, vector = np.eye(design.shape[1]), np.zeros(design.shape[1])
    ours = [system._posterior(design, prior, vector, memory, ratio)[0] for memory, ratio in LIKELIHOODS]
    dense = [restricted_likelihood(drawn, memory, ratio) for memory, ratio in LIKELIHOODS]
    np.testing.assert_allclose(np.diff(ours), np.diff(dense), rtol=1e-6)


@pytest.mark.parametrize(
    ("headings", "remark"),
    [
        (np.arange(0.0, 720.0, 24.0), "both harmonics; 30 legs, 0 stretches of turns"),
        (
            np.resize([0.0, 120.0, 240.0], 30),
            "first harmonic; the second cannot be separated from it; 30 legs, 0 stretches of turns",
        ),
    ],
    ids=["all headings", "three headings"],
)
def test_a_deviation_names_the_harmonics_that_the_headings_separate(headings, remark):
    finding = compass_findings(legs(2, headings, (0.0, 25.0, -25.0, 0.0, 0.0)), NO_TURNS, CHECKS)[1]
    assert finding.verdict is CheckVerdict.FOUND
    assert finding.remark == remark
