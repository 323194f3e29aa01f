"""Calibration: parameters that a fit determines, steady segments, hulls recovered on twins, and the command."""

import math
from dataclasses import replace

import numpy as np
import pytest
import yaml
from support.missions import changed_observations, glide_series, program, replaced, samples_of
from support.steady_glides import glides

from benchmarks.calibration import ONE_PITCH, coverage, summary, twin
from gliderhpc import load_platform
from gliderhpc.api import hulls
from gliderhpc.calibration import workflow
from gliderhpc.calibration.glides import fit as fit_module
from gliderhpc.calibration.glides.fit import TRIM, CalibrationVerdict, calibrate_on_glides, fit_trim
from gliderhpc.calibration.glides.score import NO_ERRORS, Errors, Score, check_errors, score_of
from gliderhpc.calibration.glides.search import (
    PARAMETER_BOUND,
    START_COUNT,
    CalibrationSearch,
    HeldParameter,
    best_start,
    correlated_scale,
)
from gliderhpc.calibration.glides.segment_errors import SegmentErrors, choose_buoyancy, steady_parameters
from gliderhpc.calibration.glides.text import notes, warnings
from gliderhpc.calibration.settings import CalibrateSettings, CalibrationSettings
from gliderhpc.errors import CalibrationError, InputError, ProfileError
from gliderhpc.estimation import steady_segments as segments_module
from gliderhpc.estimation.least_squares import directions, jackknife_covariance, sensitivity
from gliderhpc.estimation.resample import on_steps
from gliderhpc.estimation.self_motion import angle_of_attack
from gliderhpc.estimation.steady_segments import SegmentSettings, join_segments, segments_of, steady_segments
from gliderhpc.flight.glider import Glider
from gliderhpc.flight.hull_parameters import (
    PARAMETERS,
    PARAMETERS_BY_DENSITY,
    TREND,
    righting_moment,
    with_values,
)
from gliderhpc.flight.steady_glide import least_glide_angle, steady_glide
from gliderhpc.observations import open_observations
from gliderhpc.platform import Platform, read_platform
from gliderhpc.platform_sections import number_at
from gliderhpc.simulator import load_scenario, read_scenario, simulate_mission

pytestmark = pytest.mark.compiled

PETREL = read_platform("petrel-l")
STEADY = SegmentSettings()
KEYS = [parameter.key for parameter in PARAMETERS]

# What a fit determines


def regression(seed=0, clusters=40, members=25, shared=0.0):
    """A line through points whose errors have a part in common within clusters: Jacobian, residuals, clusters."""
    rng = np.random.default_rng(seed)
    cluster = np.repeat(np.arange(clusters), members)
    design = np.column_stack([np.ones(len(cluster)), np.repeat(rng.standard_normal(clusters), members)])
    errors = rng.standard_normal(len(cluster)) + shared * np.repeat(rng.standard_normal(clusters), members)
    return design, errors - design @ np.linalg.lstsq(design, errors, rcond=None)[0], cluster


def test_independent_errors_give_the_usual_covariance():
    design, residuals, cluster = regression()
    usual = np.linalg.inv(design.T @ design)
    found = jackknife_covariance(design, residuals, cluster)
    np.testing.assert_allclose(np.diag(found), np.diag(usual), rtol=0.5)


def test_errors_shared_within_a_cluster_count_once():
    """Forty clusters of 25 samples that share almost all their error contain no more information than forty samples."""
    design, residuals, cluster = regression(shared=3.0)
    found = jackknife_covariance(design, residuals, cluster)
    one_each = np.linalg.inv(design[::25].T @ design[::25]) * np.mean(residuals.reshape(40, 25).mean(axis=1) ** 2)
    np.testing.assert_allclose(np.diag(found), np.diag(one_each), rtol=0.5)
    assert np.diag(found).min() > 5.0 * np.diag(np.linalg.inv(design.T @ design)).max()


def test_the_jackknife_is_what_leaving_a_cluster_out_moves():
    design, residuals, cluster = regression(clusters=5, members=4)
    whole = np.linalg.lstsq(design, residuals, rcond=None)[0]
    moves = []
    for number in range(5):
        rest = cluster != number
        moves.append(whole - np.linalg.lstsq(design[rest], residuals[rest], rcond=None)[0])
    expected = 4.0 / 5.0 * np.array(moves).T @ np.array(moves)
    np.testing.assert_allclose(jackknife_covariance(design, residuals, cluster), expected, rtol=1e-10)


def test_a_direction_that_nothing_sees_has_no_singular_value():
    found = directions(np.array([[1.0, 1.0, 0.0], [2.0, 2.0, 0.0]]))
    assert [direction.singular_value > 1e-12 for direction in found] == [True, False, False]
    np.testing.assert_allclose(np.abs(found[0].vector), [math.sqrt(0.5), math.sqrt(0.5), 0.0], atol=1e-12)


def test_an_estimate_moves_against_what_is_held():
    jacobian = np.array([[1.0], [2.0], [3.0]])
    np.testing.assert_allclose(sensitivity(jacobian, 0.5 * jacobian), [[-0.5]])


def test_errors_that_a_leg_shares_have_a_larger_scale():
    rng = np.random.default_rng(0)
    leg = np.repeat(np.arange(50), 20)
    alone = rng.standard_normal(1000)
    shared = np.repeat(rng.standard_normal(50), 20)
    assert correlated_scale(alone, leg, 0.0) == pytest.approx(1.0, abs=0.15)
    assert correlated_scale(shared, leg, 0.0) == pytest.approx(math.sqrt(20.0), rel=0.3)
    assert correlated_scale(np.zeros(1000), leg, 0.1) == pytest.approx(0.1)


# The numbers of a hull


@pytest.mark.parametrize("parameter", PARAMETERS, ids=KEYS)
def test_parameters_are_moved_by_plausible_deviations_and_back(parameter):
    moved = parameter.moved(PETREL, 0.5)
    hull = with_values(PETREL, {parameter.key: moved})
    assert parameter.value(hull) == moved != parameter.value(PETREL)
    assert with_values(hull, {parameter.key: parameter.value(PETREL)}) == PETREL
    start, step = parameter.value(PETREL), parameter.spread(PETREL)
    origin = parameter.origin(PETREL)
    expected = origin + (start - origin) * math.exp(0.5 * step) if parameter.factor else start + 0.5 * step
    assert moved == pytest.approx(expected)
    ahead, behind = (parameter.moved(PETREL, 0.5 + change) for change in (1e-5, -1e-5))
    assert parameter.slope(PETREL, 0.5) == pytest.approx((ahead - behind) / 2e-5, rel=1e-6)


SQUEEZED = with_values(PETREL, {"buoyancy.compressibility": 4.5e-6, "buoyancy.thermal_expansion": 6e-5})


@pytest.mark.parametrize("steps", [-PARAMETER_BOUND, PARAMETER_BOUND])
def test_every_number_at_its_bound_is_one_that_a_platform_may_have(steps):
    """A calibration by density wrote a negative thermal expansion, which the next command refused."""
    for parameter in {*PARAMETERS, *PARAMETERS_BY_DENSITY}:
        hull = with_values(SQUEEZED, {parameter.key: parameter.moved(SQUEEZED, steps)})
        Platform.model_validate(hull.model_dump())
        assert righting_moment(hull) > 0.0


def test_a_hull_that_states_no_compressibility_starts_from_a_typical_one():
    segments = glides(PETREL, PETREL)
    segments = replace(segments, seawater=np.ones((len(segments), 4)))
    hull, _, _ = choose_buoyancy(PETREL, segments, segments.empty(), "auto")
    assert (hull.buoyancy.compressibility, hull.buoyancy.thermal_expansion) == (4.5e-6, 6e-5)
    hull, _, _ = choose_buoyancy(SQUEEZED, segments, segments.empty(), "auto")
    assert hull == SQUEEZED


def test_two_numbers_of_one_list_are_both_held():
    hull = with_values(PETREL, {"position.hull.2": 0.03, "position.hull.1": 0.001, "position.battery": 0.1})
    assert hull.position.hull == (PETREL.position.hull[0], 0.001, 0.03)
    assert hull.position.battery == 0.1


def test_righting_moment_is_that_of_hull_and_battery():
    expected = 66.92 * 0.0218 + 20.37 * 0.0172
    assert righting_moment(PETREL) == pytest.approx(expected)


# Steady segments

DIVE = steady_glide(Glider(PETREL), 0.35, math.radians(-23.0), 50.0)


def gliding(seconds=400.0, change=None, start=50.0, hull=PETREL, dive=DIVE):
    """Record of a hull gliding down, its controls changed by a function of them and of time."""
    n = round(seconds / 0.1)
    volume = hull.buoyancy.neutral_volume_m3 - dive.net_mass / hull.buoyancy.water_density
    controls = np.tile([dive.battery_position, 0.0, volume, 0.0], (n, 1))
    if change is not None:
        change(controls, 0.1 * np.arange(n))
    state = dive.state
    state[5] = start
    return glide_series(hull, state, controls)[0]


def test_a_steady_dive_is_cut_into_equal_parts():
    found = segments_of(gliding(), PETREL, STEADY)
    assert len(found) == 6
    np.testing.assert_allclose(np.diff(found.time) / np.timedelta64(1, "s"), (400.0 - STEADY.settling) / 6.0, rtol=0.01)
    np.testing.assert_allclose(found.depth_rate, DIVE.depth_rate, rtol=0.05)
    np.testing.assert_allclose(found.pitch, DIVE.pitch, atol=math.radians(0.2))
    assert found.straight.all()
    errors = SegmentErrors(PETREL, PARAMETERS, found)(np.zeros(len(PARAMETERS)))
    np.testing.assert_allclose(errors, 0.0, atol=1e-3)


def test_the_path_not_the_pitch_is_steeper_than_the_least_glide_angle():
    """A hull of little lift dives on a path of 29 degrees at a pitch of 22, and cannot glide flatter than 25."""
    dull = with_values(PETREL, {"viscous.K_L": 260.0})
    dive = steady_glide(Glider(dull), 0.35, math.radians(-22.0), 50.0)
    assert abs(dive.pitch) < least_glide_angle(dull) < abs(dive.pitch - angle_of_attack(dull, dive.pitch)) / 1.05
    assert len(segments_of(gliding(hull=dull, dive=dive), dull, STEADY)) == 6


def test_segments_exclude_the_vibration_set_and_the_settling_after_it():
    """The oil moves from 200 to 205 s: nothing counts from a guard before until a guard and the settling after."""

    def pumped(controls, time):
        controls[:, 2] -= 1e-6 * np.clip(10.0 * (time - 200.0), 0.0, 50.0)

    found = segments_of(gliding(change=pumped), PETREL, STEADY)
    volumes = np.unique(found.actuators[:, 2].round(9))
    assert len(volumes) == 2
    assert np.ptp(volumes) == pytest.approx(50e-6, rel=1e-6)
    seconds = (found.time - np.datetime64("2024-01-01", "ns")) / np.timedelta64(1, "s")
    guard, settling = PETREL.vibration.guard, STEADY.settling
    # Three segments on either side, of equal lengths each.
    expected = [settling + (200.0 - guard - settling) * part / 6.0 for part in (1, 3, 5)]
    begins = 205.0 + guard + settling
    expected += [begins + (400.0 - begins) * part / 6.0 for part in (1, 3, 5)]
    np.testing.assert_allclose(seconds, expected, atol=1.0)


def test_a_turn_is_no_straight_flight_and_only_roll_and_turn_count():
    def rotated(controls, _):
        controls[:, 1] = math.radians(60.0)

    found = segments_of(gliding(change=rotated), PETREL, STEADY)
    assert not found.straight.any()
    counted = SegmentErrors(PETREL, PARAMETERS, found).counted
    np.testing.assert_array_equal(counted, np.tile([False, False, True, True], (len(found), 1)))


@pytest.mark.parametrize(
    ("change", "fragment"),
    [
        (lambda m: m.__setitem__((slice(None), 3), 0.1 * m[:, 3]), "in steady flight"),
        (lambda m: m.__setitem__((slice(None), 1), -m[:, 1]), "in steady flight"),
        (lambda m: m.__setitem__((slice(None), 1), m[:, 1] * np.linspace(1.0, 3.0, len(m))), "in steady flight"),
        (lambda m: m.__setitem__((slice(None), 3), 10.0 * np.exp(np.arange(len(m)) / 600.0)), "in steady flight"),
        (lambda m: m.__setitem__((slice(None), 3), 2.0), "no undisturbed stretch"),
    ],
    ids=["stalled", "nose up while diving", "pitching", "accelerating", "at the surface"],
)  # fmt: skip
def test_flight_that_is_not_steady_is_refused(change, fragment):
    series = gliding(200.0)
    measurements = series.measurements.copy()
    change(measurements)
    with pytest.raises(ProfileError, match=f"profile 1: .*{fragment}"):
        segments_of(replaced(series, measurements=measurements), PETREL, STEADY)


def test_steady_flight_is_found_for_a_hull_that_cannot_glide_as_flat(twin, caplog):
    """With too little lift and too much drag no flight is steep enough; calibration is to correct just that."""
    factors = {"viscous.K_L": 0.62, "viscous.K_D": 1.4, "viscous.K_D0": 1.1}
    poor = with_values(PETREL, {key: factor * number_at(PETREL, key) for key, factor in factors.items()})
    settings = CalibrateSettings()
    with open_observations(twin) as opened:
        with pytest.raises(ProfileError, match="in steady flight"):
            segments_of(on_steps(opened.profile(1), settings, poor), poor, STEADY)
        with pytest.raises(InputError, match="no steady flight to calibrate on"):
            steady_segments(opened, poor, (1, 2), settings, STEADY)
        found, expected = (
            steady_segments(opened, hull, (1, 2), settings, STEADY, allow_flatter=True) for hull in (poor, PETREL)
        )
    assert "petrel-l finds no steady flight; segments are selected with more lift" in caplog.text
    np.testing.assert_array_equal(found.time, expected.time)


@pytest.mark.parametrize("flatter", [True, False], ids=["a flatter hull does", "no hull does"])
def test_steady_climbs_are_sought_with_a_flatter_hull_if_there_are_none(twin, caplog, monkeypatch, flatter):
    """A hull fitted to dives alone could not follow a single climb of a simulated mission."""
    found_by = segments_module._segments_of_all

    def dives_alone(observations, platform, *given):
        found, reasons = found_by(observations, platform, *given)
        seen = found if flatter and platform != PETREL else [one.select(one.depth_rate > 0.0) for one in found]
        return seen, reasons

    monkeypatch.setattr(segments_module, "_segments_of_all", dives_alone)
    with open_observations(twin) as opened:
        found = steady_segments(opened, PETREL, (1, 2), CalibrateSettings(), STEADY, allow_flatter=True)
    assert (found.depth_rate > 0.0).any()
    assert (found.depth_rate < 0.0).any() == flatter
    assert ("petrel-l finds no steady flight on climbs; segments are selected with" in caplog.text) == flatter
    assert ("no steady flight on climbs: a hull fitted to the rest may be badly wrong there" in caplog.text) != flatter


# Twins


@pytest.fixture(scope="module")
def twins():
    return [twin(seed) for seed in range(100, 104)]


def test_the_true_hull_is_found_again(twins):
    """Four twins that the page does not count: nine intervals in ten hold the truth, and estimates are near it."""
    inside = [t.covered(key) for t in twins for key in KEYS if t.verdict(key) is CalibrationVerdict.ESTIMATED]
    assert len(inside) > 35
    assert np.mean(inside) >= 0.9
    for t in twins:
        for key, least in (("buoyancy.neutral_volume", 40.0), ("position.battery", 0.004), ("viscous.K_D0", 1.2)):
            assert t.verdict(key) is CalibrationVerdict.ESTIMATED
            assert abs(t.error(key)) < least
        np.testing.assert_array_less(t.found.held_out.after[:3], 0.5 * t.found.held_out.before[:3])


def test_parameters_that_the_glides_do_not_determine_are_held_and_named(twins):
    """Petrel-L has no rudder; induced drag hardly shows in depth rate and pitch."""
    for t in twins:
        for key in ("viscous.K_delta", "viscous.K_D"):
            assert t.verdict(key) is CalibrationVerdict.UNDETERMINED
        for p in t.found.parameters:
            assert math.isnan(p.interval[0]) == (p.verdict is not CalibrationVerdict.ESTIMATED)
            unchanged = p.verdict in (CalibrationVerdict.UNDETERMINED, CalibrationVerdict.CONFOUNDED)
            assert (p.after == p.before) == unchanged


@pytest.mark.long
def test_glides_at_a_single_pitch_determine_fewer_parameters():
    """Without a range of pitch the moments that go with the angle of attack cannot be separated."""
    one, several = twin(0, ONE_PITCH), twin(0)
    estimated = [sum(found.verdict(key) is CalibrationVerdict.ESTIMATED for key in KEYS) for found in (one, several)]
    assert one.verdict("viscous.K_L") is CalibrationVerdict.UNDETERMINED
    assert estimated[0] < estimated[1]


def test_the_offset_of_the_roll_is_found_from_turns(twins):
    """The platforms given state offsets of up to a degree that the records do not have; turns show it."""
    every = [next(p for p in t.found.parameters if p.parameter.key == "sensors.roll_offset") for t in twins]
    found = [p for p in every if p.verdict is CalibrationVerdict.ESTIMATED]
    assert len(found) >= 3
    assert all(p.interval[0] < 0.0 < p.interval[1] for p in found)
    worst = max(found, key=lambda p: abs(p.before))
    assert abs(worst.after) < 0.4 * abs(worst.before)
    assert all(t.found.platform.sensors.roll_offset == p.after for t, p in zip(twins, every, strict=True))


def test_a_hull_with_a_rudder_keeps_the_offset_of_the_roll_as_an_error():
    segments = glides(PETREL, PETREL)
    steered = replace(segments, actuators=segments.actuators + np.array([0.0, 0.0, 0.0, 0.01]))
    kept, found = (SegmentErrors(PETREL, steady_parameters(PETREL, each), each) for each in (steered, segments))
    motion = ["viscous.K_p", "viscous.K_q", "added_mass.1", "added_mass.2"]
    attitude = ["sensors.roll_offset", "sensors.pitch_offset", "sensors.pitch_scale"]
    assert [p.key for p in kept.unfitted] == [*attitude, *motion]
    assert [p.key for p in found.unfitted] == [*attitude[1:], *motion]


def test_errors_of_the_attitude_act_as_in_the_correction_of_a_record():
    """Derivatives are those of the balance with roll and pitch as corrected for other sensors, by differences."""
    segments = glides(TRUTH, PETREL)
    errors = SegmentErrors(PETREL, PARAMETERS, segments)
    steps, small = np.full(len(PARAMETERS), 0.1), 1e-3
    scale = math.exp(0.02 * small)
    moved = (
        replace(segments, roll=segments.roll - math.radians(small)),
        replace(segments, pitch=segments.pitch - math.radians(small)),
        replace(segments, pitch=segments.pitch * scale),
    )
    expected = [(SegmentErrors(PETREL, PARAMETERS, each)(steps) - errors(steps)) / small for each in moved]
    by_attitude = errors.by_unfitted(steps)[:, :3]
    np.testing.assert_allclose(by_attitude, np.column_stack(expected), rtol=0.01, atol=1e-6)


@pytest.mark.long
def test_the_stated_neutral_volume_allows_for_an_offset_of_the_pitch():
    """An offset of the pitch of one degree moves the fit by about the amount stated in the platform file."""
    segments = glides(TRUTH, PETREL)
    offset = replace(segments, pitch=segments.pitch + math.radians(1.0))
    straight, off = (
        calibrate_on_glides(PETREL, each, each.empty(), CalibrationSettings()) for each in (segments, offset)
    )
    moved = off.platform.buoyancy.neutral_volume - straight.platform.buoyancy.neutral_volume
    stated = straight.platform.calibration
    names = list(stated.parameters)
    volume, pitch = names.index("buoyancy.neutral_volume"), names.index("sensors.pitch_offset")
    assert abs(moved) > 5.0
    # The errors are those of the file: truth minus estimate.
    assert stated.covariance[volume, pitch] / stated.deviation[pitch] == pytest.approx(-moved, rel=0.1)


def test_a_larger_added_mass_acts_in_a_steady_glide_like_a_smaller_pitch_moment():
    """Eq. 20: the Munk moment (M_f3 - M_f1) u w of P x V has the form of K_M alpha V^2; only the sum acts."""
    segments = glides(TRUTH, PETREL)
    errors = SegmentErrors(PETREL, PARAMETERS, segments)
    steps, place = np.zeros(len(PARAMETERS)), [p.key for p in errors.unfitted].index("added_mass.2")
    by_mass = errors.by_unfitted(steps)[:, place] / errors.unfitted[place].slope(PETREL, 0.0)
    moment = KEYS.index("viscous.K_M")
    by_moment = errors.jacobian(steps, [moment])[:, 0] / PARAMETERS[moment].slope(PETREL, 0.0)
    pitch = errors.kind == 1
    assert np.abs(by_moment[pitch]).min() > 1e-4
    # Apart from the cosine of the angle of attack.
    np.testing.assert_allclose(by_mass[pitch], by_moment[pitch], rtol=0.03)


def test_the_stated_pitch_moment_allows_for_an_error_of_the_added_mass():
    """A hull with another added mass gets a pitch moment that is wrong by the amount stated in the platform file."""
    given = with_values(PETREL, {"added_mass.2": 1.1 * PETREL.added_mass[2]})
    hold = ("K_D", "K_L", "K_M0", "position.reservoir.0", "depth_slope")
    segments = glides(TRUTH, PETREL)
    found = calibrate_on_glides(given, segments, segments.empty(), CalibrationSettings(hold=hold)).platform
    stated = found.calibration
    moment, mass = (list(stated.parameters).index(key) for key in ("viscous.K_M", "added_mass.2"))
    excess = given.added_mass[2] - PETREL.added_mass[2]
    assert pytest.approx(-excess, rel=0.05) == found.viscous.K_M - TRUTH.viscous.K_M
    assert stated.covariance[moment, mass] / stated.deviation[mass] ** 2 == pytest.approx(-1.0, rel=0.05)
    assert stated.deviation[moment] > 0.95 * stated.deviation[mass]


def test_the_coverage_page_counts_the_twins_inside_the_interval(twins):
    line = next(row for row in coverage(twins).splitlines() if "neutral_volume" in row)
    inside = sum(t.covered("buoyancy.neutral_volume") for t in twins)
    assert f"| {len(twins)} | {inside} ({inside / len(twins):.0%}) |" in line
    assert f"in {len(twins)} twins" in summary(twins)


# The fit


TRUTH = with_values(
    PETREL,
    {"buoyancy.neutral_volume": 640.0, "viscous.K_D0": 10.0, "position.hull.2": 0.0235, "position.battery": 0.104},
)


def test_exact_glides_give_the_exact_hull():
    hold = ("K_D", "K_L", "K_M", "K_M0", "position.reservoir.0", "depth_slope")
    segments = glides(TRUTH, PETREL)
    found = calibrate_on_glides(PETREL, segments, segments.empty(), CalibrationSettings(hold=hold))
    for parameter in found.parameters:
        key = parameter.parameter.key
        if key in ("buoyancy.neutral_volume", "viscous.K_D0", "position.hull.2", "position.battery"):
            assert parameter.verdict is CalibrationVerdict.ESTIMATED
            assert parameter.after == pytest.approx(parameter.parameter.value(TRUTH), rel=1e-4)
    asked = [p.parameter.key for p in found.parameters if p.verdict is CalibrationVerdict.ASKED]
    assert asked == [key for key in KEYS if key.partition(".")[2] in hold or key in hold]
    assert len(asked) == len(hold)
    np.testing.assert_allclose(found.fitted.after[:2], 0.0, atol=1e-5)
    assert found.held_out.segments == 0
    assert np.isnan(found.held_out.before).all()


def test_the_start_of_the_rounds_fits_only_the_trim():
    """Exact glides of a hull whose lift is off as well: the trim comes near, and the lift stays as it was."""
    truth = with_values(TRUTH, {"viscous.K_L": 480.0})
    found = fit_trim(PETREL, glides(truth, PETREL), CalibrationSettings())
    for key in ("buoyancy.neutral_volume", "viscous.K_D0", "position.hull.2", "position.battery"):
        parameter = PARAMETERS[KEYS.index(key)]
        assert abs(parameter.steps(truth, parameter.value(found))) < 0.05
    others = [p for p in PARAMETERS if p.key not in TRIM]
    assert [p.value(found) for p in others] == [p.value(PETREL) for p in others]
    held = fit_trim(PETREL, glides(truth, PETREL), CalibrationSettings(hold=("K_D0",)))
    assert held.viscous.K_D0 == PETREL.viscous.K_D0


def test_the_lift_can_be_fitted_with_the_drag_held():
    truth = with_values(PETREL, {"viscous.K_L": 380.0})
    segments = glides(truth, PETREL)
    hold = ("K_D0", "K_D", "K_M", "K_M0", "position.reservoir.0", "depth_slope", "neutral_volume")
    found = calibrate_on_glides(PETREL, segments, segments.empty(), CalibrationSettings(hold=hold))
    lift = next(p for p in found.parameters if p.parameter.key == "viscous.K_L")
    assert lift.verdict is CalibrationVerdict.ESTIMATED
    assert lift.after == pytest.approx(380.0, rel=1e-3)


@pytest.mark.long
def test_a_trend_of_the_neutral_volume_is_found_where_asked():
    segments = glides(TRUTH, PETREL, trend=3.0)
    found = calibrate_on_glides(PETREL, segments, segments.empty(), CalibrationSettings(trend=True))
    trend = next(p for p in found.parameters if p.parameter is TREND)
    assert trend.verdict is CalibrationVerdict.ESTIMATED
    # The reservoir's trim drifts with the volume in these glides, but is taken out in them.
    assert trend.after == pytest.approx(3.0, rel=0.02)
    assert found.reference_time == np.datetime64("2024-01-26", "ns")
    unasked = calibrate_on_glides(PETREL, segments, segments.empty(), CalibrationSettings())
    assert not any(p.parameter is TREND for p in unasked.parameters)


def test_a_false_segment_in_twenty_does_not_move_the_fit():
    segments = glides(TRUTH, PETREL)
    rate, pitch = segments.depth_rate.copy(), segments.pitch.copy()
    rate[::20] *= 1.5
    pitch[::20] *= 1.2
    settings = CalibrationSettings(hold=("K_D", "K_L", "K_M", "K_M0", "position.reservoir.0", "depth_slope"))
    found = calibrate_on_glides(PETREL, replace(segments, depth_rate=rate, pitch=pitch), segments.empty(), settings)
    volume = next(p for p in found.parameters if p.parameter.key == "buoyancy.neutral_volume")
    assert volume.after == pytest.approx(640.0, abs=5.0)


@pytest.mark.long
def test_a_parameter_that_reaches_its_bound_is_held_there():
    """A battery zero 12.5 cm off: back at the platform's, the worst value known, it would spoil every other number."""
    truth = with_values(PETREL, {"position.battery": PETREL.position.battery - 0.125})
    segments = glides(truth, PETREL)
    found = calibrate_on_glides(PETREL, segments, segments.empty(), CalibrationSettings())
    verdicts = {p.parameter.key: p.verdict for p in found.parameters}
    assert verdicts["position.battery"] is CalibrationVerdict.IMPLAUSIBLE
    assert found.platform.position.battery == pytest.approx(PETREL.position.battery - 0.12)
    assert found.platform.buoyancy.neutral_volume == pytest.approx(PETREL.buoyancy.neutral_volume, abs=30.0)
    assert found.fitted.after[1] < 0.01 * found.fitted.before[1], "5 mm of 125 are left, and their degrees of pitch"
    (left,) = [line for line in notes(found) if line.startswith("the best fit lies outside the plausible range, so")]
    assert "position.battery" in left


@pytest.mark.long
def test_an_error_that_nothing_explains_is_named():
    """A battery zero 40 cm off is a wrong zero or unit of the actuator, not a hull."""
    truth = with_values(PETREL, {"position.battery": PETREL.position.battery - 0.4})
    segments = glides(truth, PETREL)
    found = calibrate_on_glides(PETREL, segments, segments.empty(), CalibrationSettings())
    stated = warnings(found)
    assert not any("hardly balances" in line for line in stated)
    grown = replace(found.held_out, segments=9, errors_before=Errors(np.full(4, 0.01), np.full(4, 0.01)),
                    errors_after=Errors(np.array([0.01, 0.01, 0.01, 0.05]), np.full(4, 0.01)))  # fmt: skip
    (warning,) = [line for line in warnings(replace(found, held_out=grown)) if "hardly balances" in line]
    assert "at the profiles held out, the turn rate is in error by 2.86 degree/s, and by 0.57 " in warning
    assert "`calibration.hold=[K_beta,K_MR,K_MY,K_r]`" in warning
    assert any(line.startswith("the pitch is still in error by") for line in stated)
    assert not any("the roll is still in error" in line for line in stated)


@pytest.mark.parametrize(
    ("key", "steps"), [("position.reservoir.0", 3.0), ("position.battery", -3.0), ("battery_eccentricity", -3.0)]
)
def test_a_hull_three_plausible_deviations_off_is_fitted(key, steps):
    """Whatever is held on the way, the remaining errors are small, and never larger than at the start."""
    parameter = next(p for p in PARAMETERS if p.key == key)
    segments = glides(with_values(TRUTH, {key: parameter.moved(PETREL, steps)}), PETREL)
    found = calibrate_on_glides(PETREL, segments, segments.empty(), CalibrationSettings())
    assert found.fitted.after[0] < 0.005
    np.testing.assert_array_less(found.fitted.after[1:3], math.radians(0.5))


def test_parameters_whose_platform_value_is_refuted_are_held_elsewhere():
    """At one pitch reservoir and neutral volume trim alike, and neither can be where the platform has it."""
    reservoir = next(p for p in PARAMETERS if p.key == "position.reservoir.0")
    truth = with_values(PETREL, {reservoir.key: reservoir.moved(PETREL, 3.0)})
    segments = glides(truth, PETREL, pitches=(23.0,))
    hold = tuple(key for key in KEYS if key not in ("position.reservoir.0", "viscous.K_M0", "viscous.K_M"))
    found = calibrate_on_glides(PETREL, segments, segments.empty(), CalibrationSettings(hold=hold, undetermined=0.001))
    refuted = [p for p in found.parameters if p.verdict is CalibrationVerdict.REFUTED]
    assert refuted
    assert all(abs(p.steps) > 0.1 and p.after != p.before and math.isnan(p.interval[0]) for p in refuted)
    assert found.fitted.after[1] < 0.1 * found.fitted.before[1]
    assert any("contradict the platform's value, so held at the most probable value" in line for line in notes(found))


class CurvedErrors:
    """Errors of one parameter that are almost zero below -1 plausible deviation and grow with the square above it."""

    kind, leg, profile = np.zeros(40, dtype=np.int64), np.arange(40), np.arange(40)
    parameters = PARAMETERS[:1]

    def __init__(self, growth):
        self.growth = growth

    def __call__(self, steps):
        return np.full(40, self.growth * max(steps[0] + 1.0, 0.0) ** 2)

    def jacobian(self, steps, _):
        return np.full((40, 1), 2.0 * self.growth * max(steps[0] + 1.0, 0.0))

    def parts(self):
        return [(np.ones(40, dtype=bool), np.ones(1, dtype=bool))]

    def flatness(self, _):
        return 0.0


@pytest.mark.parametrize(("growth", "refuted"), [(0.0224, True), (0.001, False)])
def test_a_value_that_the_errors_exclude_is_refuted_although_their_slope_at_the_fit_is_small(growth, refuted):
    """Held at the platform's value, a fit like this one ended with a drag and a lift in error by tens of deviations."""
    search = CalibrationSearch(CurvedErrors(growth), np.ones(1, dtype=bool), 1.0, lambda _: None)
    search.fit_everything(1, 1e-6)
    search.scales = np.full(4, 0.02)
    search._hold(HeldParameter(0, CalibrationVerdict.UNDETERMINED))
    assert (search.held[0].verdict is CalibrationVerdict.REFUTED) == refuted
    assert (search.steps[0] < -0.5) == refuted


def test_the_best_of_several_starts_is_taken(monkeypatch):
    """A fit caught in a distant minimum, as from the platform's own hull here, is not selected."""
    segments = glides(TRUTH, PETREL)
    errors = SegmentErrors(PETREL, PARAMETERS, segments)
    fit, starts = CalibrationSearch.fit_everything, []

    def caught(self, times, tolerance):
        starts.append(self.steps.copy())
        if len(starts) == 1:
            self.steps = np.full(len(KEYS), 2.0)
        else:
            fit(self, times, tolerance)

    monkeypatch.setattr(CalibrationSearch, "fit_everything", caught)
    lines = []
    found = best_start(errors, np.isin(KEYS, ["buoyancy.neutral_volume", "viscous.K_D0"]), lines.append)
    np.testing.assert_array_equal(starts[0], 0.0)
    assert len(starts) == len(lines) == START_COUNT
    assert found[KEYS.index("viscous.K_D0")] == pytest.approx(math.log(10.0 / PETREL.viscous.K_D0) / 0.4, abs=0.3)
    assert np.count_nonzero(found) == 2


def shift_result(monkeypatch, key, steps):
    """Make every fit end at so many plausible deviations of one number."""
    fit = CalibrationSearch.run

    def run(self, start):
        fit(self, start)
        self.steps[KEYS.index(key)] = steps

    monkeypatch.setattr(CalibrationSearch, "run", run)


FOUR = ("buoyancy.neutral_volume", "viscous.K_D0", "position.hull.2", "position.battery")
EASY = CalibrationSettings(hold=tuple(key for key in KEYS if key not in FOUR))


def test_a_fit_that_is_worse_than_its_start_is_refused(monkeypatch):
    segments = glides(TRUTH, PETREL)
    shift_result(monkeypatch, "position.battery", 4.0)
    with pytest.raises(CalibrationError, match=r"no fit is better than the platform \(cost"):
        calibrate_on_glides(PETREL, segments, segments.empty(), EASY)


def test_a_hull_that_does_worse_on_the_profiles_held_out_is_refused():
    """The profiles held out were flown with another hull, the platform's own."""
    truth = with_values(PETREL, {"position.battery": PETREL.position.battery - 0.05})
    with pytest.raises(CalibrationError, match="error of pitch than the platform on the profiles held out"):
        calibrate_on_glides(PETREL, glides(truth, PETREL), glides(PETREL, PETREL), EASY)


def test_one_segment_that_hardly_balances_does_not_decide():
    """Nineteen errors have halved, and one segment turns at 95 degrees a second: it is reported, and not judged by."""
    before, after = np.full(20, 0.014), np.full(20, 0.007)
    after[7] = 1.66
    found = [
        Errors(np.full(4, np.sqrt(np.mean(x**2))), np.full(4, np.sqrt(np.mean(np.sort(x)[:19] ** 2))))
        for x in (before, after)
    ]
    check_errors(Score((1,), 20, *found), Score((), 0, NO_ERRORS, NO_ERRORS))
    whole = [Errors(each.all, each.all) for each in found]
    with pytest.raises(CalibrationError, match="error of depth rate"):
        check_errors(Score((1,), 20, *whole), Score((), 0, NO_ERRORS, NO_ERRORS))


def test_an_error_as_large_as_before_is_not_refused_for_chance():
    """In turbulent water the rate of turn hardly follows the balance: four per cent more is nothing."""
    score = [Errors(x, x) for x in (np.array([0.1, 0.2, 0.02, 0.0140]), np.array([0.015, 0.005, 0.018, 0.0146]))]
    nothing = Score((), 0, NO_ERRORS, NO_ERRORS)
    check_errors(nothing, Score((1,), 100, *score))
    with pytest.raises(CalibrationError, match=r"error of turn rate .* on the profiles held out"):
        check_errors(nothing, Score((1,), 100, score[0], Errors(*2 * [np.array([0.015, 0.005, 0.018, 0.0180])])))


def test_the_usual_errors_leave_out_the_largest_twentieth():
    segments = glides(TRUTH, PETREL)
    found = score_of(PETREL, segments)
    errors = SegmentErrors(PETREL, (), segments)
    pitch = np.sort(np.abs(errors.all_errors(np.zeros(0))[:, 1][errors.counted[:, 1]]))
    assert found.all[1] == pytest.approx(np.sqrt(np.mean(pitch**2)))
    assert found.trimmed[1] == pytest.approx(np.sqrt(np.mean(pitch[: int(np.ceil(0.95 * len(pitch)))] ** 2)))
    assert found.trimmed[1] < found.all[1]


@pytest.mark.long
def test_a_hull_without_stable_glides_is_fitted_again_with_the_lateral_terms_held(monkeypatch):
    stable = iter([False, True, True])
    monkeypatch.setattr(fit_module, "glides_stably", lambda _: next(stable))
    segments = glides(TRUTH, PETREL)
    free = CalibrationSettings(hold=tuple(key for key in EASY.hold if key not in fit_module.LATERAL))
    found = calibrate_on_glides(PETREL, segments, segments.empty(), free)
    held = [p.parameter.key for p in found.parameters if p.verdict is CalibrationVerdict.UNSTABLE]
    assert held == ["viscous.K_beta", "viscous.K_MR", "viscous.K_MY", "viscous.K_r"]
    monkeypatch.setattr(fit_module, "glides_stably", lambda _: False)
    with pytest.raises(CalibrationError, match="no stable dive and climb, even with the lateral terms held"):
        calibrate_on_glides(PETREL, segments, segments.empty(), EASY)


@pytest.mark.parametrize("better", [True, False])
def test_a_fit_that_knows_less_than_the_platform_is_repeated_with_the_lateral_terms_held(monkeypatch, better):
    """If fewer parameters remain undetermined, and the turns fit about as well."""
    monkeypatch.setattr(fit_module, "reason_to_hold", lambda *_, **__: CalibrationVerdict.CONFOUNDED)
    monkeypatch.setattr(fit_module, "is_better_held", lambda *_: better)
    segments = glides(TRUTH, PETREL)
    free = CalibrationSettings(hold=tuple(key for key in EASY.hold if key not in fit_module.LATERAL))
    found = calibrate_on_glides(PETREL, segments, segments.empty(), free)
    held = [p.parameter.key for p in found.parameters if p.verdict is CalibrationVerdict.CONFOUNDED]
    assert held == (list(fit_module.LATERAL) if better else [])


@pytest.mark.long
@pytest.mark.parametrize("seed", [0, 1])
def test_the_true_hull_is_not_lost_near_neutral_stability(tmp_path, seed):
    """On these missions, fits with free lateral terms doubled the lift and left the drag unknown."""
    path = tmp_path / "mission.nc"
    simulate_mission(PETREL, path, scenario=load_scenario("impulses").replaced({"profiles": 8}), seed=seed)
    found = hulls.calibrate(path, PETREL, workers=0, rounds={"most": 0})
    assert (found.table.loc[["viscous.K_L", "viscous.K_beta"], "after"] == [442.0, -116.0]).all()
    drag = found.table.loc["viscous.K_D0"]
    assert drag["after"] == pytest.approx(PETREL.viscous.K_D0, rel=0.05)
    assert drag["high"] / drag["low"] < 1.5


def test_one_parameter_may_be_held_without_brackets():
    assert CalibrationSettings(hold="K_L").hold == ("K_L",)
    assert CalibrationSettings(hold=["K_L", "K_D0"]).hold == ("K_L", "K_D0")


def test_a_key_counts_the_numbers_of_a_list_from_zero():
    assert number_at(PETREL, "position.hull.2") == PETREL.position.hull[2]
    for key in ("position.hull.-1", "position.hull.+1", "position.hull.3"):
        with pytest.raises(KeyError):
            number_at(PETREL, key)


def test_too_few_profiles_are_refused():
    segments = glides(TRUTH, PETREL, profiles=2)
    with pytest.raises(InputError, match="steady flight in 2 profiles apart from those held out, but at least 3"):
        calibrate_on_glides(PETREL, segments, segments.empty(), CalibrationSettings())


def test_segments_are_joined_in_order():
    one, two = glides(TRUTH, PETREL, profiles=1), glides(TRUTH, PETREL, profiles=2)
    both = join_segments([one, two])
    assert len(both) == len(one) + len(two)
    np.testing.assert_array_equal(both.profile[len(one) :], two.profile)


# The verb

OFF = {"platform.buoyancy.neutral_volume": "800", "platform.position.battery": "0.105"}
"""Errors given to the platform."""

GLIDES_ALONE = ("--set", "rounds.most=0")
"""Arguments by which only the steady glides are used."""


@pytest.fixture(scope="module")
def mission(tmp_path_factory):
    """Mission of four short, calm dives of petrel-l."""
    scenario = read_scenario({"name": "short", "profiles": 4, "depth": 60.0})
    return simulate_mission(PETREL, tmp_path_factory.mktemp("calibrate") / "short.nc", scenario=scenario, seed=2).path


@pytest.fixture(scope="module")
def written(mission):
    """Output of the program, and the file that it wrote."""
    out = mission.with_name("calibrated.yaml")
    wrong = [word for key, value in OFF.items() for word in ("--set", f"{key}={value}")]
    return program("calibrate", mission, "--platform", "petrel-l", "--out", out, *GLIDES_ALONE, *wrong), out


def test_the_file_is_the_hull_with_the_estimates(written):
    answer, out = written
    assert answer.status == 0, answer.err
    platform = load_platform(out)
    assert platform.buoyancy.neutral_volume == pytest.approx(PETREL.buoyancy.neutral_volume, abs=50.0)
    assert platform.position.battery == pytest.approx(PETREL.position.battery, abs=0.004)
    assert platform.mass == PETREL.mass
    assert platform.source.startswith(PETREL.source.strip())
    for fragment in (
        "gliderhpc calibrate",
        "short.nc",
        "profiles 1, 2, 3",
        "held out",
        "neutral_volume=800",
        "before and",
    ):
        assert fragment in platform.source
    assert yaml.safe_load(out.read_text("utf-8"))["name"] == "petrel-l"


def test_the_program_says_what_changed_and_what_did_not(written):
    answer, out = written
    for fragment in ("95 % interval", "singular value", "held out, after", "not determined"):
        assert fragment in answer.out
    for key in KEYS:
        assert key in answer.out
    assert f"written to {out}" in answer.out


def test_profiles_can_be_chosen_and_held_out(mission, tmp_path):
    answer = program(
        "calibrate", mission, "--platform", "petrel-l", "--out", tmp_path / "one.yaml", "--profiles", "1:4",
        "--hold-out", "2", "--set", "calibration.hold=[K_L,K_D0]", "--set", "calibration.trend=true",
    )  # fmt: skip
    assert answer.status == 0, answer.err
    for fragment in (
        "profiles 1, 3, 4",
        "of profile 2",
        "held as requested",
        "trend",
        "the neutral volume is that at 2024",
    ):
        assert fragment in answer.out
    assert load_platform(tmp_path / "one.yaml").viscous.K_D0 == PETREL.viscous.K_D0


@pytest.mark.parametrize(
    ("arguments", "fragment"),
    [
        (
            ("--set", "calibration.hold=[K_X]"),
            "--set calibration.hold: no parameter K_X; the parameters are buoyancy.neutral",
        ),
        (("--set", "calibration.undetermined=2"), "--set calibration.undetermined"),
        (("--set", "steady.lenth=9"), "--set steady.lenth: no such setting"),
        (("--profiles", "9"), "--profiles 9: no profile 9"),
        (("--hold-out", "7"), "--hold-out 7: no profile 7"),
        (("--hold-out", "1:4"), "--hold-out leaves no profile for the fit"),
        (("--out", "nowhere/one.yaml"), "nowhere/one.yaml: the folder"),
    ],
)
def test_wrong_usage_is_reported_in_one_line(mission, tmp_path, arguments, fragment):
    answer = program("calibrate", mission, "--platform", "petrel-l", "--out", tmp_path / "one.yaml", *arguments)
    assert answer.status == 2
    assert fragment in answer.err.splitlines()[-1]
    assert "Traceback" not in answer.err
    assert not list(tmp_path.iterdir())


def test_a_mission_without_steady_flight_is_refused(mission, tmp_path):
    def stay_at_surface(content):
        for number in range(1, 5):
            rows = samples_of(content, number)
            content["depth"][rows] = 3.0 + 0.01 * (np.arange(content["depth"][rows].size) % 2)

    still = changed_observations(mission, tmp_path / "still.nc", stay_at_surface)
    answer = program("calibrate", still, "--platform", "petrel-l", "--out", tmp_path / "one.yaml")
    assert answer.status == 2
    assert "still.nc: no steady flight to calibrate on; 4 of 4: profile 1: no undisturbed stretch" in answer.err
    assert not (tmp_path / "one.yaml").exists()


def test_a_profile_held_out_without_steady_flight_does_not_stop_the_others(mission, tmp_path):
    def stay_at_surface(content):
        content["depth"][samples_of(content, 2)] = 3.0

    still = changed_observations(mission, tmp_path / "still.nc", stay_at_surface)
    hold = ("--set", f"calibration.hold=[{','.join(KEYS[3:])}]")
    answer = program(
        "calibrate",
        still,
        "--platform",
        "petrel-l",
        "--out",
        tmp_path / "one.yaml",
        "--hold-out",
        "2",
        *GLIDES_ALONE,
        *hold,
    )  # fmt: skip
    assert answer.status == 0, answer.err
    assert "profile 2 is left out" in answer.err
    assert "no profile was held out" in answer.out
    assert load_platform(tmp_path / "one.yaml").name == "petrel-l"


@pytest.mark.parametrize(
    ("values", "fragment"),
    [
        ({"buoyancy.thermal_expansion": -1e-5}, "thermal_expansion is -1e-05"),
        ({"position.hull.2": -0.1}, "no stable steady dive and climb"),
    ],
)
def test_a_platform_that_could_not_be_used_is_not_written(mission, tmp_path, monkeypatch, values, fragment):
    """A file that the next command refuses must not come with exit status 0."""
    found = calibrate_on_glides(PETREL, glides(TRUTH, PETREL), glides(TRUTH, PETREL), EASY)
    corrupted = replace(found, platform=with_values(found.platform, values))
    monkeypatch.setattr(workflow, "calibrate_on_glides", lambda *_: corrupted)
    answer = program("calibrate", mission, "--platform", "petrel-l", "--out", tmp_path / "one.yaml", *GLIDES_ALONE)
    assert answer.status == 1
    (line,) = answer.err.splitlines()[-1:]
    assert fragment in line
    assert "nothing is written" in line
    assert not list(tmp_path.iterdir())


def test_a_fit_that_is_refused_exits_with_one_line_and_no_file(mission, tmp_path, monkeypatch):
    def refused(*_):
        raise CalibrationError("calibration: the fit is worse than its start, so nothing is written; look")

    monkeypatch.setattr(workflow, "calibrate_on_glides", refused)
    answer = program("calibrate", mission, "--platform", "petrel-l", "--out", tmp_path / "one.yaml", *GLIDES_ALONE)
    assert answer.status == 1
    assert answer.err.splitlines()[-1].startswith("gliderhpc: calibration: the fit is worse than its start")
    assert not list(tmp_path.iterdir())


def test_a_trend_is_a_neutral_volume_that_changes():
    segments = glides(PETREL, PETREL)
    errors = SegmentErrors(PETREL, (*PARAMETERS, TREND), segments)
    steps = np.zeros(len(errors.parameters))
    steps[-1] = 2.0 / TREND.spread(PETREL)
    moved = errors.all_errors(steps)[:, 0]
    days = (segments.time - errors.reference) / np.timedelta64(1, "D")
    for i in np.flatnonzero(np.abs(days) == 15.0)[:4]:
        shifted = with_values(PETREL, {"buoyancy.neutral_volume": PETREL.buoyancy.neutral_volume + 2.0 * days[i]})
        alone = SegmentErrors(shifted, PARAMETERS, segments).all_errors(np.zeros(len(PARAMETERS)))[i, 0]
        assert moved[i] == pytest.approx(alone, rel=1e-9, abs=1e-15)
        assert abs(moved[i]) > 1e-4


def test_a_hull_near_its_least_glide_angle_is_avoided():
    """The barrier rises where a hull could hardly glide as flat as was measured."""
    errors = SegmentErrors(PETREL, PARAMETERS, glides(PETREL, PETREL, pitches=(20.0,)))
    steps = np.zeros(len(PARAMETERS))
    assert errors.flatness(steps) == 0.0
    steps[KEYS.index("viscous.K_D0")], steps[KEYS.index("viscous.K_L")] = 4.0, -4.0
    assert errors.flatness(steps) > math.radians(5.0)
