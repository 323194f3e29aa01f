"""Information of a dive on its hull: evidence, derivatives of the problem, posterior, and intervals."""

from dataclasses import replace

import numpy as np
import pytest
from support.hull_errors import profile_of, steady_controls
from support.smoothing import GLIDE, MEASURED, PETREL, H, fly, with_measured

from gliderhpc.estimation.preparation import prepare_profile
from gliderhpc.estimation.resample import corrected, on_steps
from gliderhpc.estimation.self_motion import flight_guesses
from gliderhpc.estimation.settings import EstimationSettings, RecordSettings, SmootherSettings
from gliderhpc.estimation.smoother.estimate import LastPass, filter_fallback
from gliderhpc.estimation.smoother.forcing import hull_forcing, sample_slopes
from gliderhpc.estimation.smoother.hull_errors import HullErrors, InformedDirections, stated_errors
from gliderhpc.estimation.smoother.information import HullInformation, symmetric
from gliderhpc.estimation.smoother.information_sweeps import (
    moved,
    sensitivity_sweeps,
    sum_information,
    without_far_rows,
)
from gliderhpc.estimation.smoother.iterate import iterate_passes
from gliderhpc.estimation.smoother.local_noise import dispersion, other_assumptions, with_local_noise
from gliderhpc.estimation.smoother.posterior import posterior_errors, with_hull_errors
from gliderhpc.estimation.smoother.problem import Trajectory, segment_rows
from gliderhpc.flight.glider import SENSED, Glider
from gliderhpc.flight.hull_parameters import (
    ACTUATOR_LAG,
    hull_parameters,
    moved_platform,
    with_covariance,
    with_values,
)
from gliderhpc.observations.records import ProfileRecord
from gliderhpc.outcomes import Outcome
from gliderhpc.platform_sections import CalibrationErrors

pytestmark = pytest.mark.compiled

TIGHT = SmootherSettings(tolerance=1e-8, estimate="mode", adaptive=False)
STEPS = 600


@pytest.fixture(scope="module")
def flown():
    """Return a minute of a dive, and its profile in the form for the smoother."""
    dive = fly(21, STEPS)
    measured = np.where(np.isfinite(dive.problem.measured), dive.problem.measured, dive.states[:, MEASURED])
    profile = profile_of(PETREL, measured, steady_controls(PETREL.platform, STEPS))
    return dive, profile, hull_parameters(PETREL.platform)


def _map_cost(flown, forcing, parameters, eta):
    """Return the least cost of the dive with a changed hull: half the sum of squares of the converged MAP."""
    dive, profile, _ = flown
    platform = moved_platform(PETREL.platform, parameters, eta)
    moved = profile_of(Glider(platform), profile.series.measurements, profile.series.controls)
    measured = dive.problem.measured.copy()
    measured[dive.problem.fed] += forcing.samples @ eta[forcing.reading]
    problem = with_measured(dive.problem, measured)._replace(
        bodies=moved.bodies, mean=dive.problem.mean + forcing.start.T @ eta
    )
    smoothed = iterate_passes(moved.glider.hull, problem, dive.guess, TIGHT)
    assert smoothed.outcome is Outcome.CONVERGED
    return smoothed


def test_the_score_is_the_slope_of_the_evidence(flown):
    """About the converged path it equals differences of the MAP's cost over the hull, to 1e-5 (docs/smoother.md)."""
    dive, profile, parameters = flown
    at = profile.series.measurements
    forcing = hull_forcing(profile, dive.problem, RecordSettings(), parameters, at)
    smoothed = _map_cost(flown, forcing, parameters, np.zeros(len(parameters)))
    path = Trajectory(smoothed.states.copy(), np.vstack([smoothed.disturbances, smoothed.disturbances[-1]]))
    information = sum_information(PETREL.hull, [dive.problem], forcing, path, segment_rows(dive.problem))[0]
    names = [p.key for p in parameters]
    for key in ("viscous.K_D0", "viscous.K_L", "position.battery", "buoyancy.neutral_volume", "sensors.pitch_offset"):
        eta = np.zeros(len(parameters))
        eta[names.index(key)] = 1e-3
        ahead, behind = (_map_cost(flown, forcing, parameters, sign * eta).cost for sign in (1.0, -1.0))
        slope = -(ahead - behind) / 2e-3
        assert information.score[names.index(key)] == pytest.approx(slope, rel=1e-5, abs=1e-6), key


def test_smoothed_sensitivities_are_the_slopes_of_the_map(flown):
    """They are those of the Gauss-Newton problem, and agree up to the neglected curvature."""
    dive, profile, parameters = flown
    forcing = hull_forcing(profile, dive.problem, RecordSettings(), parameters, profile.series.measurements)
    smoothed = _map_cost(flown, forcing, parameters, np.zeros(len(parameters)))
    path = Trajectory(smoothed.states.copy(), np.vstack([smoothed.disturbances, smoothed.disturbances[-1]]))
    rows = np.arange(0, STEPS, 50)
    _, found = sensitivity_sweeps(PETREL.hull, dive.problem, forcing, path, segment_rows(dive.problem, rows), rows)
    for key in ("viscous.K_D0", "position.battery", "sensors.pitch_offset"):
        j = [p.key for p in parameters].index(key)
        eta = np.zeros(len(parameters))
        eta[j] = 1e-3
        ahead, behind = (_map_cost(flown, forcing, parameters, sign * eta) for sign in (1.0, -1.0))
        states = ((ahead.states - behind.states) / 2e-3)[rows][:, SENSED]
        disturbances = ((ahead.disturbances - behind.disturbances) / 2e-3)[rows]
        expected = np.hstack([states, disturbances])
        scale = np.sqrt(dive.problem.deviation)
        assert np.linalg.norm((found.states[..., j] - expected) / scale) < 0.05 * np.linalg.norm(expected / scale), key
        moved = (ahead.displacement - behind.displacement) / 2e-3
        np.testing.assert_allclose(found.displacement[:, j], moved, atol=0.05 * np.abs(moved).max())


def test_the_first_guess_depends_on_drag_and_lift_only(flown):
    """The slopes are differences of the guess itself, from a glide by a hull that has lift at zero angle of attack."""
    dive, profile, _ = flown
    platform = with_values(PETREL.platform, {"viscous.K_L0": 0.4})
    lifted = replace(profile, glider=Glider(platform))
    parameters = hull_parameters(platform)
    found = hull_forcing(lifted, dive.problem, RecordSettings(), parameters, profile.series.measurements).start
    acting = set()
    for j, parameter in enumerate(parameters):
        if parameter.key.startswith("sensors."):
            continue
        ahead, behind = (
            flight_guesses(
                moved_platform(platform, parameters, sign * 1e-3 * np.eye(len(parameters))[j]), profile.series
            )
            for sign in (1.0, -1.0)
        )
        slope = (ahead - behind)[0, SENSED] / 2e-3
        np.testing.assert_allclose(found[j, :10], slope, rtol=1e-6, atol=1e-12)
        if slope.any():
            acting.add(parameter.key)
    assert acting == {"viscous.K_D0", "viscous.K_D", "viscous.K_L0", "viscous.K_L"}
    assert found[[p.key for p in parameters].index("sensors.pitch_offset"), 1] < 0.0


def test_samples_change_as_the_correction_of_the_record_changes():
    """For every error of the records, after other corrections, compare with differences of the correction itself."""
    sensors = {"sensors.pitch_scale": 1.02, "sensors.pitch_offset": 0.7, "sensors.heading_offset": 4.0}
    sensors |= {"sensors.heading_deviation.0": 2.0, "sensors.heading_deviation.3": -1.0, "sensors.roll_offset": -0.4}
    platform = with_values(PETREL.platform, sensors)
    settings = RecordSettings(
        pitch_scale=0.98, pitch_offset=-0.5, heading_offset=1.0, heading_deviation=(1.0, -2.0, 0.5, 1.5)
    )
    rng, n = np.random.default_rng(2), 50
    time, nothing = np.arange(n, dtype=float), np.zeros(n)
    record = ProfileRecord(
        number=1, epoch=np.datetime64("2024-01-01", "ns"), time=time, roll=rng.uniform(-0.2, 0.2, n),
        pitch=rng.uniform(-0.5, 0.5, n), heading=rng.uniform(0.5, 5.0, n), depth=0.15 * time + 10.0,
        battery_position=nothing, battery_rotation=nothing, ballast_volume=nothing, rudder=nothing,
    )  # fmt: skip

    def read(hull):
        found = corrected(corrected(record, hull.sensors), settings)
        return np.column_stack([found.roll, np.asarray(found.pitch), np.unwrap(found.heading), found.depth])

    inside = slice(2, -2)
    errors = [p for p in hull_parameters(platform) if p.key.startswith("sensors.") and p.key != ACTUATOR_LAG]
    assert len(errors) == 9
    for parameter in errors:
        step = 1e-4 * parameter.slope(platform, 0.0)
        ahead, behind = (
            read(with_values(platform, {parameter.key: parameter.value(platform) + sign * step})) for sign in (1, -1)
        )
        expected = ((ahead - behind) / 2e-4)[inside]
        actual = sample_slopes(platform, settings, parameter, read(platform), np.full(n, 0.15))[inside]
        np.testing.assert_allclose(actual, expected, atol=1e-6, err_msg=parameter.key)


def test_the_masses_change_as_the_lag_of_the_actuators_changes():
    """A battery and a pump that move at changing speeds: compare with differences of the prepared profile."""
    rng, n = np.random.default_rng(3), 60
    time, level = np.arange(n, dtype=float), np.full(n, 0.1)
    record = ProfileRecord(
        number=1, epoch=np.datetime64("2024-01-01", "ns"), time=time, roll=level, pitch=level, heading=level,
        depth=0.15 * time + 10.0, battery_position=1e-3 * rng.standard_normal(n).cumsum(),
        battery_rotation=0.1 * rng.standard_normal(n).cumsum(), ballast_volume=4e-4 + 1e-6 * rng.uniform(0, 9, n),
        rudder=0.1 * rng.standard_normal(n),
    )  # fmt: skip
    settings = EstimationSettings(records=RecordSettings(actuator_lag=0.25))

    def prepared(lag):
        hull = with_values(PETREL.platform, {ACTUATOR_LAG: lag})
        return prepare_profile(Glider(hull), on_steps(record, settings, hull))

    profile = prepared(0.4)
    parameters = hull_parameters(profile.glider.platform)
    dive = fly(1, len(profile.bodies)).problem
    forcing = hull_forcing(profile, dive, RecordSettings(), parameters, profile.series.measurements)
    lag = [p.key for p in parameters].index(ACTUATOR_LAG)
    assert lag not in forcing.reading
    moved = prepared(0.4 + profile.series.step).bodies - prepared(0.4 - profile.series.step).bodies
    expected = parameters[lag].slope(profile.glider.platform, 0.0) * moved / (2.0 * profile.series.step)
    inside = slice(20, -20)
    np.testing.assert_allclose(
        forcing.bodies[forcing.row[inside], list(forcing.moving).index(lag)], expected[inside], rtol=1e-9, atol=1e-12
    )
    assert np.abs(expected[inside]).max(axis=0)[[0, 1, 2, 9]].min() > 0.0


def _information(parameters, seed=0, rows=40):
    rng, p = np.random.default_rng(seed), len(parameters)
    root = rng.standard_normal((p, p))
    return HullInformation(
        parameters=tuple(parameters), value=np.ones(p), plausible_deviation=np.ones(p),
        score=root @ rng.standard_normal(p), information=root @ root.T, others=(),
        displacement=rng.standard_normal((2, p)),
        states=rng.standard_normal((rows, 12, p)), disturbances=rng.standard_normal((rows, 6, p)),
    )  # fmt: skip


def test_the_posterior_is_that_of_bayes_and_takes_a_singular_covariance(flown):
    information = _information(flown[2])
    errors = stated_errors(PETREL.platform, information.parameters)
    np.testing.assert_array_equal(errors.covariance, np.eye(len(information.parameters)))
    after = posterior_errors(errors, information)
    expected = np.linalg.inv(information.information + np.eye(len(information.parameters)))
    np.testing.assert_allclose(after.covariance, expected, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(after.mean, expected @ information.score, rtol=1e-9, atol=1e-12)
    known = replace(errors, covariance=np.zeros_like(errors.covariance))
    np.testing.assert_array_equal(posterior_errors(known, information).covariance, 0.0)


def test_a_dive_that_contradicts_the_stated_errors_does_not_narrow_them(flown):
    information = _information(flown[2])
    p = len(information.parameters)
    before = HullErrors(np.zeros(p), 0.01 * np.eye(p))
    matrix = information.information
    for size, contradicts in ((1.0, False), (3.0, True)):
        # A score that is `size` standard deviations off in every direction.
        score = size * np.linalg.cholesky(matrix + 0.01 * matrix @ matrix) @ np.ones(p)
        chi_square, freedom = InformedDirections.of(matrix).disagreement(score, before.covariance)
        assert (freedom, chi_square) == (p, pytest.approx(p * size**2))
        after = posterior_errors(before, replace(information, score=score))
        narrowed = before.updated(score, matrix)
        np.testing.assert_array_equal(after.mean, narrowed.mean)
        np.testing.assert_array_equal(after.covariance, before.covariance if contradicts else narrowed.covariance)


def test_a_calibration_s_covariance_is_read_in_plausible_deviations(flown):
    keys = ("viscous.K_D0", "position.battery")
    found = CalibrationErrors(parameters=keys, deviation=(0.1, 0.003), correlation=((), (0.5,)))
    platform, information = with_covariance(PETREL.platform, found), _information(flown[2])
    covariance = stated_errors(platform, information.parameters).covariance
    places = [information.names.index(key) for key in keys]
    slopes = [information.parameters[j].slope(platform, 0.0) for j in places]
    np.testing.assert_allclose(np.sqrt(np.diag(covariance))[places], np.array([0.1, 0.003]) / slopes)
    assert covariance[places[0], places[1]] == pytest.approx(0.5 * 0.1 * 0.003 / (slopes[0] * slopes[1]))
    others = np.delete(np.arange(len(covariance)), places)
    np.testing.assert_array_equal(covariance[np.ix_(others, others)], np.eye(len(others)))


def _smoothed(rows=40):
    states = np.zeros((rows, 12))
    fallback = filter_fallback(_Filtered(states, np.zeros((rows + 1, 6))))
    return replace(
        fallback, states_std=np.full((rows, 12), 0.1), disturbances=np.zeros((rows, 6)),
        disturbances_std=np.full((rows, 6), 0.2), displacement=np.zeros(2), displacement_covariance=0.3 * np.eye(2),
    )  # fmt: skip


class _Filtered:
    def __init__(self, states, disturbances):
        self.states, self.disturbances = states, disturbances


@pytest.mark.parametrize("corrected_by_dive", [False, True])
def test_the_hull_s_part_is_in_every_interval(flown, corrected_by_dive):
    information = _information(flown[2])
    errors = posterior_errors(stated_errors(PETREL.platform, information.parameters), information)
    result, part = with_hull_errors(_smoothed(), information, errors, corrected=corrected_by_dive)
    square = errors.covariance + (0.0 if corrected_by_dive else np.outer(errors.mean, errors.mean))
    k, i = 7, 4
    V = information.disturbances[k, i]
    assert result.disturbances_std[k, i] ** 2 == pytest.approx(0.04 + V @ square @ V)
    moved = V @ errors.mean if corrected_by_dive else 0.0
    assert result.disturbances[k, i] == pytest.approx(moved)
    U = information.states[k, 7]
    assert result.states_std[k, 7] ** 2 == pytest.approx(0.01 + U @ square @ U)
    D = information.displacement
    np.testing.assert_allclose(result.displacement_covariance, 0.3 * np.eye(2) + D @ square @ D.T)
    shares = 1.0 - 0.04 / result.disturbances_std[:, i] ** 2
    assert part.share[12 + i] == pytest.approx(np.median(shares))


@pytest.mark.long
def test_uncertainty_of_a_held_hull_obeys_the_law_of_total_variance(flown):
    """The mean of ``C + m m'`` over dives whose score has its stated covariance obeys the law of total variance."""
    information = _information(flown[2], seed=3)
    before = stated_errors(PETREL.platform, information.parameters)
    rng, total = np.random.default_rng(5), np.zeros_like(before.covariance)
    root = np.linalg.cholesky(information.information + information.information @ information.information)
    draws = 20000
    for z in rng.standard_normal((draws, len(root))):
        after = posterior_errors(before, replace(information, score=root @ z))
        total += (after.covariance + np.outer(after.mean, after.mean)) / draws
    np.testing.assert_allclose(total, before.covariance, atol=0.05)


def test_bursts_of_noise_have_their_own_scale():
    """Quiet stretches have a smaller scale, bursts a larger one; slow disturbances keep the dive's scale."""
    dive = fly(2, 400).problem
    assert (-dive.step / np.log(dive.decay) < 120.0).all()
    dive = dive._replace(decay=np.array([*np.full(5, np.exp(-dive.step / 3600.0)), dive.decay[5]]))
    spent = np.zeros((400, 6))
    spent[150:200] = 30.0
    resolved = np.full((400, 6), 0.05)
    last, steady = LastPass(dive, np.sqrt(spent * resolved * dive.noise), resolved), np.ones(400, dtype=bool)
    local = with_local_noise(last, 1.0, steady)
    factor = local.noise / dive.noise
    np.testing.assert_array_equal(factor[:, :5], 1.0)
    assert factor[175, 5] > 20.0
    assert factor[50, 5] < 0.2


def test_noise_of_one_scale_is_left_as_it_is():
    """If sums of squares vary no more than by chance, stretches have no separate scales."""
    dive = fly(2, 4000).problem
    rng = np.random.default_rng(3)
    resolved = np.full((4000, 6), 0.1)
    spent = resolved * rng.standard_normal((4000, 6)) ** 2
    # One independent value every ten steps, as resolved by the record.
    spent = np.repeat(spent.reshape(400, 10, 6)[:, :1], 10, axis=1).reshape(4000, 6)
    last = LastPass(dive, np.sqrt(spent * dive.noise), resolved)
    local = with_local_noise(last, 1.0, np.ones(4000, dtype=bool))
    factor = local.noise / dive.noise
    assert factor.std() < 0.2
    assert factor.mean() == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize(("variance", "tolerance"), [(0.0, 0.1), (1.0, 0.3)])
def test_the_dispersion_of_the_noise_is_found(variance, tolerance):
    """It follows from moments of random stretches, whose scales have that relative variance."""
    rng, width, count = np.random.default_rng(4), 20, 4000
    scale = np.ones(count) if variance == 0.0 else 3.0 * rng.gamma(1.0 / variance, variance, count)
    # Four resolved values in each stretch, each over five steps.
    values = scale[:, None] * rng.standard_normal((count, 4)) ** 2
    spent = np.repeat(values / 5.0, 5, axis=1).reshape(-1, 1)
    resolved = np.full((count * width, 1), 4.0 / width)
    assert dispersion(spent, resolved, width)[0] == pytest.approx(variance, abs=tolerance)
    assert dispersion(spent[:0], resolved[:0], width)[0] == 0.0


def _forced(flown):
    dive, profile, parameters = flown
    path = Trajectory(dive.glide.states, dive.glide.disturbances)
    return hull_forcing(profile, dive.problem, RecordSettings(), parameters, profile.series.measurements), path


def test_other_noise_assumptions_reduce_the_noise_or_drop_actuated_samples():
    """They have less noise where the dive was quieter and nowhere more, or no samples while actuators move."""
    dive = fly(2, 400).problem
    spent = np.full((400, 6), 0.01)
    spent[150:200] = 30.0
    resolved = np.full((400, 6), 0.05)
    last = LastPass(dive, np.sqrt(spent * resolved * dive.noise), resolved)
    vibrating = np.zeros(401, dtype=bool)
    vibrating[40:80] = True
    local = with_local_noise(last, 1.0, ~vibrating[:-1])
    one_scale, quieter, between = other_assumptions(last, local, vibrating)
    np.testing.assert_array_equal(one_scale.noise, dive.noise)
    assert (quieter.noise <= local.noise).all()
    assert (quieter.noise[300] < 0.5 * local.noise[300]).all()
    assert np.isnan(between.measured[vibrating]).all()
    np.testing.assert_array_equal(between.measured[~vibrating], local.measured[~vibrating])


def test_a_filter_that_flies_off_leaves_information_all_the_same(flown):
    """A stretch where the linearised filter is in error by metres per second is linearised about the smoothed path."""
    dive, profile, parameters = flown
    forcing = hull_forcing(profile, dive.problem, RecordSettings(), parameters, profile.series.measurements)
    rows, path = segment_rows(dive.problem), dive.guess
    about, _ = sensitivity_sweeps(PETREL.hull, dive.problem, forcing, path, rows, rows[::10])
    np.testing.assert_array_equal(without_far_rows(about.filtered), about.filtered)
    wild = about.filtered.copy()
    wild[40:46, 4:7] += 30.0
    wild[46:48, 0] -= 8.0

    def information(deviations):
        about = moved(PETREL.hull, dive.problem, path, rows, deviations)
        return sum_information(PETREL.hull, [dive.problem], forcing, about, rows)[0]

    assert not _is_finite(information(wild))
    held = without_far_rows(wild)
    assert not held[40:48].any()
    np.testing.assert_array_equal(held[48:], about.filtered[48:])
    assert _is_finite(information(held))


def test_a_moved_path_is_a_run_of_the_model_inside_segments(flown):
    """The disturbances' deviations decay from the first row of each segment, where the path moves as prescribed."""
    dive = flown[0]
    rows, path = segment_rows(dive.problem, longest=4), dive.guess
    deviations = 1e-3 * np.random.default_rng(6).standard_normal((len(rows), 16))
    about = moved(PETREL.hull, dive.problem, path, rows, deviations)
    np.testing.assert_allclose(about.states[rows][:, SENSED], path.states[rows][:, SENSED] + deviations[:, :10])
    controls = np.tile(GLIDE.control, (STEPS, 1))
    for segment in (0, 5, len(rows) - 2):
        first, stop = rows[segment], rows[segment + 1]
        steps = np.arange(stop - first)[:, None]
        expected = path.disturbances[first:stop] + dive.problem.decay**steps * deviations[segment, 10:]
        np.testing.assert_allclose(about.disturbances[first:stop], expected)
        run = PETREL.simulate(about.states[first], controls[first : stop - 1], about.disturbances[first : stop - 1], H)
        np.testing.assert_allclose(about.states[first:stop], run, rtol=1e-12, atol=1e-12)


def _is_finite(information):
    return bool(np.isfinite(information.score).all() and np.isfinite(information.matrix).all())


def test_information_is_symmetric_and_grows_with_samples(flown):
    dive, profile, parameters = flown
    forcing, path = _forced(flown)
    rows = segment_rows(dive.problem)
    whole = symmetric(sum_information(PETREL.hull, [dive.problem], forcing, path, rows)[0].matrix)
    half = dive.problem.measured.copy()
    half[STEPS // 2 :] = np.nan
    part_dive = with_measured(dive.problem, half)
    part_forcing = hull_forcing(profile, part_dive, RecordSettings(), parameters, profile.series.measurements)
    part = symmetric(sum_information(PETREL.hull, [part_dive], part_forcing, path, rows)[0].matrix)
    np.testing.assert_array_equal(whole, whole.T)
    change = np.linalg.eigvalsh(whole - part)
    assert change.min() > -1e-9 * change.max()
    assert change.max() > 1.0
