"""Sensitivity to the hull's errors: derivatives of the step, and the recursion compared with dense least squares."""

import numpy as np
import pytest
from support.dense_least_squares import ORDER, DenseLeastSquares, dense_transition
from support.hull_errors import hull_only, profile_of, steady_controls, step_slope
from support.sizes import scaled
from support.smoothing import GLIDE, MEASURED, PETREL, SAMPLED, SEGMENTS, fly, with_measured, with_velocity
from support.specimens import lopsided_platform, random_disturbances, random_state

from gliderhpc.estimation.preparation import controls_of
from gliderhpc.estimation.settings import RecordSettings
from gliderhpc.estimation.smoother.forcing import hull_forcing, velocity_offsets, with_sample_errors
from gliderhpc.estimation.smoother.information import symmetric
from gliderhpc.estimation.smoother.information_sweeps import sensitivity_sweeps, sum_information
from gliderhpc.estimation.smoother.problem import Trajectory, segment_rows
from gliderhpc.flight.glider import Glider
from gliderhpc.flight.hull_parameters import ACTUATOR_LAG, hull_parameters
from gliderhpc.kernels.sensitivity_memory import allocate_scratch
from gliderhpc.kernels.sensitivity_segments import linearise_with_constants
from gliderhpc.kernels.smoother_memory import BLOCK

STEPS = 4 * BLOCK + 10


@pytest.mark.parametrize("seed", range(3))
def test_derivatives_of_a_segment_by_the_hull_are_complex_steps(seed):
    """Test every parameter of the catalogue, for random states, with rudder and battery turned (docs/smoother.md)."""
    rng = np.random.default_rng(seed)
    platform = lopsided_platform(K_delta=3.0, K_L0=0.4)
    glider, n = Glider(platform), 2
    raw = np.tile([*rng.uniform(-0.02, 0.02, 1), *rng.uniform(-1.0, 1.0, 1), 2e-4, 0.1], (n, 1))
    raw[1, 0] += 0.005
    state, b = random_state(rng), random_disturbances(rng, 1)[0]
    measurements = np.tile(state[MEASURED], (n + 1, 1))
    profile, parameters = profile_of(glider, measurements, raw), hull_only(platform)
    fed = np.array([True, False, True])
    dive = fly(1, 2).problem._replace(bodies=profile.bodies, fed=fed)
    forcing = hull_forcing(profile, dive, RecordSettings(), parameters, profile.series.measurements)
    scratch = allocate_scratch(segment_rows(dive, longest=n), forcing)
    path = np.tile(state, (n + 1, 1)), np.tile(b, (n + 1, 1))
    block, sensitivity = scratch.block, scratch.sensitivity
    linearise_with_constants(
        glider.hull, dive, forcing, *path, scratch.segments, 0, block, 0, scratch.tally, scratch.gradient, sensitivity
    )
    controls = controls_of(platform, profile.series)
    Phi, middle = dense_transition(controls[1], path[0][1], b, np.ones(6), platform)[0], path[0][1]
    Phi = Phi[np.ix_(ORDER, ORDER)]
    for parameter, row in zip(parameters, sensitivity.forced[0, :, : len(parameters)].T, strict=True):
        expected = Phi @ step_slope(platform, parameter, state, raw[0], b)
        expected = (expected + step_slope(platform, parameter, middle, raw[1], b))[[*range(10), 16, 17]]
        scale = np.abs(expected).max()
        assert scale > 0.0, parameter.key
        np.testing.assert_allclose(row, expected, rtol=1e-9, atol=1e-11 * scale, err_msg=parameter.key)


@pytest.fixture(scope="module", params=SEGMENTS)
def case(request):
    """Return the largest number of steps of a segment, and whether the velocity relative to the water is measured."""
    return request.param


@pytest.fixture(scope="module")
def longest(case):
    return case[0]


@pytest.fixture(scope="module")
def problem(case):
    """Return a dive with gaps, a path that does not follow from its disturbances, and all parameters of its hull."""
    flown = fly(3, STEPS, turn=0.02)
    measured = flown.problem.measured.copy()
    measured[20:50] = np.nan
    measured[60, 2] = np.nan
    measured[70, [0, 3]] = np.nan
    dive = with_measured(flown.problem, measured)
    if case[1]:
        measured, variance = with_velocity(flown, measured)
        dive = with_measured(dive._replace(variance=variance), measured)
    dive.noise[30:40] *= 30.0
    rng = np.random.default_rng(4)
    path = flown.glide
    states = path.states + 1e-3 * rng.standard_normal(path.states.shape)
    disturbances = path.disturbances + 0.01 * rng.standard_normal(path.disturbances.shape)
    states[:, 3:5] = 0.0
    profile = profile_of(PETREL, path.states[:, MEASURED].copy(), steady_controls(PETREL.platform, STEPS))
    np.testing.assert_allclose(controls_of(PETREL.platform, profile.series)[0, :4], GLIDE.control, rtol=1e-12)
    # The actuators are at rest, and their lag has no effect.
    parameters = [p for p in hull_parameters(PETREL.platform) if p.key != ACTUATOR_LAG]
    forcing = hull_forcing(profile, dive, RecordSettings(), parameters, profile.series.measurements)
    if case[1]:
        forcing = with_sample_errors(forcing, velocity_offsets(len(forcing.samples), 0.003))
    return dive, Trajectory(states, disturbances), forcing, parameters


class DenseHull:
    """Dense problem with the hull's errors as further unknowns: their information and score, and the sensitivities."""

    def __init__(self, dive, path, forcing, parameters):
        dense = DenseLeastSquares(dive, path, GLIDE.control)
        raw = steady_controls(PETREL.platform, 1)[0]
        n, p = len(dive.bodies), len(forcing.start)
        self.slopes = np.zeros((n + 1, 18, p))
        self.slopes[0, :16] = forcing.start.T
        own = [j for j, parameter in enumerate(parameters) if not parameter.key.startswith("sensors.")]
        for k in range(n):
            Phi = self._transition(dive, path, k)
            self.slopes[k + 1] = Phi @ self.slopes[k]
            for j in own:
                b = path.disturbances[k]
                self.slopes[k + 1, :, j] += step_slope(PETREL.platform, parameters[j], path.states[k], raw, b)
        maps = dense.maps[:, ORDER]
        rows, columns, values = [np.eye(maps.shape[2])], [np.zeros((maps.shape[2], p))], [np.zeros(maps.shape[2])]
        sizes = []
        for k, channel in np.argwhere(np.isfinite(dive.measured)):
            deviation = np.sqrt(dive.variance[k, channel])
            by_records = np.zeros(p)
            by_records[forcing.reading] = forcing.samples[forcing.number[k], channel]
            by_eta = self.slopes[k, channel] - by_records
            # The two cancel for the offset of the compass, on which a dive has no information.
            sizes.append((self.slopes[k, channel] ** 2 + by_records**2) / deviation**2)
            residual = dive.measured[k, channel] - path.states[k, SAMPLED[channel]]
            offset = dense.offsets[k, ORDER[channel]]
            rows.append(maps[k, channel][None] / deviation)
            columns.append(by_eta[None] / deviation)
            values.append(np.array([(residual - offset) / deviation]))
        A, B, value = np.vstack(rows), np.vstack(columns), np.concatenate(values)
        by_unknown = np.linalg.lstsq(A, B, rcond=None)[0]
        left = B - A @ by_unknown
        self.information = left.T @ left
        self.scale = np.sqrt(np.sum(sizes, axis=0))
        self.score = left.T @ value
        self.smoothed = self.slopes - np.einsum("kim,mp->kip", maps, by_unknown)

    @staticmethod
    def _transition(dive, path, k):
        Phi, _ = dense_transition(GLIDE.control, path.states[k], path.disturbances[k], dive.decay)
        return Phi[np.ix_(ORDER, ORDER)]


@pytest.fixture(scope="module")
def dense(problem, found):
    return DenseHull(*problem)


@pytest.fixture(scope="module")
def found(problem, longest):
    dive, path, forcing, _ = problem
    wanted = np.arange(0, STEPS + 1, 7)
    return sensitivity_sweeps(PETREL.hull, dive, forcing, path, segment_rows(dive, wanted, longest=longest), wanted)


def test_information_and_score_are_those_of_the_hull_as_states(found, dense):
    """The separate-bias form is exact: to 1e-9 of each parameter's own scale (docs/smoother.md)."""
    information, _ = found
    scale = dense.scale
    matrix, size = symmetric(information.matrix), np.outer(scale, scale)
    np.testing.assert_allclose(matrix / size, dense.information / size, rtol=0.0, atol=1e-9)
    largest = np.abs(dense.score / scale).max()
    np.testing.assert_allclose(information.score / scale, dense.score / scale, rtol=0.0, atol=1e-9 * largest)


def test_smoothed_sensitivities_are_those_of_the_hull_as_states(found, dense):
    _, smoothed = found
    for k, states, track in zip(smoothed.rows, smoothed.states, smoothed.track, strict=True):
        expected = dense.smoothed[k]
        scale = np.abs(dense.smoothed).max(axis=(0, 2))[:, None]
        np.testing.assert_allclose(states / scale[:16], expected[:16] / scale[:16], atol=1e-9)
        np.testing.assert_allclose(track / scale[16:], expected[16:] / scale[16:], atol=1e-9)
    np.testing.assert_allclose(smoothed.displacement, dense.smoothed[-1, 16:], rtol=1e-8, atol=1e-10)


def test_assumptions_of_the_noise_are_each_as_if_alone(problem, longest):
    """They share steps and derivatives, and have separate covariances, gains and sums."""
    dive, path, forcing, _ = problem
    assumed = [dive, dive._replace(noise=0.1 * dive.noise), dive._replace(variance=4.0 * dive.variance)]
    assumed = assumed[: scaled(3, 2)]
    wanted = np.array([0, STEPS])
    rows = segment_rows(dive, wanted, longest=longest)
    together = sum_information(PETREL.hull, assumed, forcing, path, rows)
    for one, found in zip(assumed, together, strict=True):
        alone, _ = sensitivity_sweeps(PETREL.hull, one, forcing, path, rows, wanted)
        for name in ("matrix", "score", "filtered"):
            np.testing.assert_allclose(getattr(found, name), getattr(alone, name), rtol=1e-11, atol=1e-12)
    assert np.abs(together[0].score - together[1].score).max() > 0.01
