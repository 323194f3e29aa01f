"""Checks of records: planted errors are found within their stated errors, and clean records raise no alarm."""

import json
import logging
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from pydantic import ValidationError
from support.missions import program

from benchmarks.record_checks import SETTINGS, expected, inspect_open, twin_records, twin_scenario, with_errors
from gliderhpc.api.missions import warn_about_records
from gliderhpc.estimation.currents import depth_averaged_current, single_cycle, track_of
from gliderhpc.estimation.least_squares import left_out_covariance
from gliderhpc.estimation.preparation import vibration_set
from gliderhpc.estimation.resample import corrected, harmonics, on_steps
from gliderhpc.estimation.self_motion import SelfMotion, glide_angle_motion
from gliderhpc.estimation.settings import EstimationSettings, RecordSettings
from gliderhpc.estimation.steady_segments import SteadySegments, join_segments
from gliderhpc.flight.hull_parameters import with_covariance, with_values
from gliderhpc.mission.settings import build_settings
from gliderhpc.observations import open_observations
from gliderhpc.platform import read_platform
from gliderhpc.platform_sections import CalibrationErrors
from gliderhpc.record_checks import CheckSettings, CheckVerdict, Finding
from gliderhpc.record_checks.compass import (
    CONSTANT,
    DEVIATION,
    Leg,
    compass_findings,
    leg_of,
    sense_finding,
)
from gliderhpc.record_checks.depth_rate import NEUTRAL_VOLUME, SIDES, steady_depth_rate
from gliderhpc.record_checks.finding import judge_size, undetermined_if_insensitive
from gliderhpc.record_checks.inspection import LAG, lag_finding
from gliderhpc.record_checks.pitch import GAIN, PITCH, VOLUME, pitch_findings
from gliderhpc.record_checks.turns import TurnInformation, TurnStretches, turn_information
from gliderhpc.simulator import load_scenario, simulate_mission

pytestmark = pytest.mark.compiled

PETREL = read_platform("petrel-l")
CALIBRATED = with_covariance(
    PETREL, CalibrationErrors(parameters=(NEUTRAL_VOLUME,), deviation=(5.0,), correlation=((),))
)
CHECKS = CheckSettings()
NO_TURNS = TurnInformation(np.zeros((5, 5)), np.zeros(5), 0)
SEEDS = range(20)
LEVEL = 0.05
ALARMS = 5
"""More of 20 at a rate of 5 % are less likely than 1 in 3000."""


@pytest.mark.parametrize(
    ("name", "smallest", "refused"),
    [
        ("profiles", 1, 0), ("lag_profiles", 1, 0), ("level", 0.001, 0), ("level", 0.999, 1), ("timing_error", 0, -0.1),
        ("least_pitch", 0, -0.1), ("least_deviation", 0, -0.1), ("plausible_deviation", 0.1, 0),
        ("least_pitch_scale", 0, -0.1), ("coefficient_error", 0.1, 0), ("drag_difference", 0.1, 0),
    ],
)  # fmt: skip
def test_settings_are_taken_up_to_their_ends(name, smallest, refused):
    assert getattr(CheckSettings.model_validate({name: smallest}), name) == smallest
    with pytest.raises(ValidationError, match=name):
        CheckSettings.model_validate({name: refused})


def alarms(found):
    return sum(finding.verdict is CheckVerdict.FOUND for finding in found)


# The compass, on legs made by hand


def legs(seed, errors=(0.0,) * 5, headings=None, memory=0.0, count=30):
    """Legs through a current that changes from profile to profile, their compass off by errors (5,) in degrees."""
    rng = np.random.default_rng(seed)
    psi = rng.uniform(0.0, 2.0 * np.pi, count) if headings is None else np.radians(np.resize(headings, count))
    current, found = rng.normal(0.0, 0.05, 2), []
    for number, heading in enumerate(psi):
        current = memory * current + np.sqrt(1.0 - memory**2) * rng.normal(0.0, 0.05, 2)
        motion = 0.3 * np.array([np.cos(heading), np.sin(heading)])
        basis = np.append(1.0, harmonics([heading])[0])
        by_error = -np.outer([-motion[1], motion[0]], basis)
        seen = current + by_error @ np.radians(errors) + 0.05 * motion
        found.append(Leg(1e4 * number, seen, by_error, -motion))
    return found


@pytest.mark.parametrize("memory", [0.0, 0.9], ids=["white current", "lasting current"])
def test_a_clean_compass_raises_alarms_at_the_stated_rate(memory):
    checks = CheckSettings(level=LEVEL, least_deviation=0.0)
    found = [compass_findings(legs(seed, memory=memory), NO_TURNS, checks) for seed in SEEDS]
    for quantity in (0, 1):
        chosen = [findings[quantity] for findings in found]
        assert all(finding.verdict is not CheckVerdict.UNDETERMINED for finding in chosen)
        assert alarms(chosen) <= ALARMS


def test_errors_of_the_compass_are_found_within_their_errors():
    errors = (8.0, 12.0, -8.0, 4.0, 0.0)
    found = [compass_findings(legs(seed, errors, count=60), NO_TURNS, CHECKS) for seed in SEEDS]
    constants, deviations = ([findings[which] for findings in found] for which in (0, 1))
    assert alarms(constants) >= 15
    assert alarms(deviations) >= 18
    inside = [abs(finding.size - 8.0) < 2.0 * finding.error for finding in constants]
    assert np.mean(inside) >= 0.8
    sizes = np.array([finding.size for finding in deviations])
    assert np.sqrt(np.mean(sizes**2)) == pytest.approx(np.linalg.norm(errors[1:]), abs=3.0)
    assert "heading_deviation=[" in deviations[0].suggestion


def test_two_opposite_legs_determine_the_constant_but_not_the_first_harmonic():
    """Both legs are set to the same side by a first harmonic, and to opposite sides by a constant."""
    found = [
        compass_findings(legs(seed, (9.0, 12.0, 0.0, 0.0, 0.0), (90.0, 270.0)), NO_TURNS, CHECKS) for seed in SEEDS
    ]
    assert np.mean([findings[0].size for findings in found]) == pytest.approx(9.0, abs=1.5)
    assert alarms([findings[0] for findings in found]) >= 15
    assert all(findings[1].verdict is CheckVerdict.UNDETERMINED for findings in found)


def mirrored(found):
    """The same legs with a heading counted counter-clockwise from north: east and west are exchanged."""
    east = np.array([1.0, -1.0])
    return [replace(leg, current=leg.current - leg.by_speed + east * leg.by_speed, by_speed=east * leg.by_speed)
            for leg in found]  # fmt: skip


@pytest.mark.parametrize("memory", [0.0, 0.9], ids=["white current", "lasting current"])
def test_a_heading_of_the_wrong_sense_is_found_and_no_other(memory):
    right = [legs(seed, (15.0, 5.0, -5.0, 0.0, 0.0), memory=memory) for seed in SEEDS]
    assert {sense_finding(each, CHECKS).verdict for each in right} == {CheckVerdict.NOTHING}
    wrong = [sense_finding(mirrored(each), CHECKS) for each in right]
    assert {finding.verdict for finding in wrong} == {CheckVerdict.FOUND}
    assert np.mean([finding.size for finding in wrong]) == pytest.approx(1.0, abs=0.1)
    assert "the heading increases counter-clockwise" in wrong[0].line


@pytest.mark.parametrize(
    ("changes", "stronger", "why"),
    [
        ({"count": 5}, 1.0, "at least 6 are needed"),
        ({"headings": (40.0, 220.0)}, 1.0, "nearly along one line"),
        ({"count": 8}, 8.0, "would not be found"),
    ],
)
def test_few_or_opposite_legs_and_strong_currents_do_not_determine_the_sense(changes, stronger, why):
    finding = sense_finding([replace(leg, current=stronger * leg.current) for leg in legs(4, **changes)], CHECKS)
    assert finding.verdict is CheckVerdict.UNDETERMINED
    assert why in finding.remark


def test_one_heading_does_not_determine_the_deviation():
    finding = compass_findings(legs(1, headings=(40.0,)), NO_TURNS, CHECKS)[1]
    assert finding.verdict is CheckVerdict.UNDETERMINED


def test_too_few_legs_leave_the_compass_undetermined():
    found = compass_findings(legs(1, count=5), NO_TURNS, CHECKS)
    assert [finding.verdict for finding in found] == [CheckVerdict.UNDETERMINED] * 2
    assert "at least 6 are needed" in found[0].remark


@pytest.mark.parametrize("error", [0.0, 15.0])
def test_few_legs_rule_nothing_out_unless_a_plausible_error_would_have_been_found(error):
    """Six legs and five unknowns leave one degree of freedom at most: a threshold of hundreds of degrees."""
    few = [compass_findings(legs(seed, (error, 0.0, 0.0, 0.0, 0.0), count=6), NO_TURNS, CHECKS) for seed in SEEDS]
    quiet = [finding for found in few for finding in found if finding.verdict is CheckVerdict.NOTHING]
    assert all(finding.threshold <= CHECKS.plausible_deviation for finding in quiet)
    vague = [found[0].remark for found in few if found[0].verdict is CheckVerdict.UNDETERMINED]
    assert vague
    assert all("an error of 20 degree would not be found; 6 legs, but about" in remark for remark in vague)


def test_few_legs_find_the_constant_without_the_harmonics():
    errors = (15.0, 0.0, 0.0, 0.0, 0.0)
    found = [compass_findings(legs(seed, errors, memory=0.9, count=6), NO_TURNS, CHECKS)[0] for seed in SEEDS]
    assert alarms(found) >= 10
    assert any("includes both harmonics" in finding.remark for finding in found)
    assert all(abs(finding.size - 15.0) < 3.0 * finding.error for finding in found if finding.found)


def test_no_number_of_legs_is_named_that_is_out_of_reach():
    noisy = [replace(leg, current=leg.current * [3.0, -2.0]) for leg in legs(3, count=6)]
    finding = compass_findings(noisy, NO_TURNS, CheckSettings(level=1e-12))[0]
    assert finding.verdict is CheckVerdict.UNDETERMINED
    assert "6 legs, but many more are needed" in finding.remark


def stretches(seed, deviation=(0.0,) * 4, profiles=24):
    """Stretches of turning flight whose rate depends on roll, measured by a compass with a deviation (degree)."""
    rng = np.random.default_rng(seed)
    parts = []
    for number in range(profiles):
        heading, roll = rng.uniform(0.0, 2.0 * np.pi, 60), rng.normal(0.0, 0.1, 60)
        rudder, climbing = rng.normal(0.0, 0.1, 60), np.arange(60) >= 30
        rate = np.where(climbing, -0.1, 0.1) * roll + 0.05 * rudder + 0.002
        sine, cosine, sine2, cosine2 = harmonics(heading).T
        slope = np.column_stack([cosine, -sine, 2.0 * cosine2, -2.0 * sine2]) @ np.radians(deviation)
        rate = rate * (1.0 + slope) + rng.normal(0.0, 0.001, 60)
        parts.append(TurnStretches(np.full(60, number), heading, roll, rudder, rate, climbing))
    return parts


def test_turns_determine_the_deviation_of_the_compass():
    deviation = np.array([6.0, -4.0, 2.0, 1.0])
    inside = []
    for seed in SEEDS:
        found = turn_information(stretches(seed, deviation), np.radians(20.0))
        covariance = np.linalg.inv(found.information[1:, 1:])
        estimate = covariance @ found.vector[1:]
        inside.append(np.abs(estimate - np.radians(deviation)) < 2.0 * np.sqrt(np.diag(covariance)))
        assert found.information[0, 0] == 0.0
    assert np.mean(inside) >= 0.8


def test_straight_flight_has_no_turns():
    parts = [replace(part, rate=0.01 * part.rate) for part in stretches(0)]
    assert turn_information(parts, np.radians(20.0)).count == 0


def test_turns_not_explained_by_roll_are_not_counted():
    rng = np.random.default_rng(0)
    parts = [replace(part, rate=part.rate + rng.normal(0.0, 0.01, 60)) for part in stretches(0)]
    assert turn_information(parts, np.radians(20.0)).count == 0
    assert turn_information(stretches(0), np.radians(20.0)).count > 0


# The pitch, on segments made by hand


FEW_SEEDS = range(8)
"""More than two alarms of 8 at a rate of 5 % are less likely than 1 in 150."""
COUNT = 20
"""Segments of a profile, half of them diving."""


def segments(
    seed, offset=0.0, profiles=16, steepness=(17.0, 33.0), errors=None, hull=PETREL, water=None, scatter=0.02
):  # fmt: skip
    """Steady segments of a hull with errors and scatter from profile to profile, pitch off by degrees."""
    rng = np.random.default_rng(seed)
    diving, zero = np.arange(COUNT) < COUNT // 2, np.zeros(COUNT)
    parts = []
    for number in range(profiles):
        pitch = np.radians(np.where(diving, -1.0, 1.0) * rng.uniform(*steepness))
        actuators = np.column_stack([zero, zero, np.where(diving, 300e-6, 1050e-6), zero])
        depth = rng.uniform(10.0, 200.0, COUNT)
        seawater = np.full((COUNT, 4), np.nan) if water is None else water(depth)
        here = SteadySegments(
            np.full(COUNT, number), np.zeros(COUNT, "datetime64[ns]"), actuators, zero, pitch, zero, depth,
            np.where(diving, 1.0, -1.0), np.ones(COUNT, dtype=bool), seawater, np.full((COUNT, 3), np.nan),
            np.full(COUNT, ""),
        )  # fmt: skip
        rate = steady_depth_rate(hull, here, errors or {}, by_density=water is not None)
        rate = rate * (1.0 + rng.normal(0.0, scatter)) + rng.normal(0.0, 0.003, COUNT)
        parts.append(replace(here, depth_rate=rate, pitch=pitch + np.radians(offset)))
    return join_segments(parts)


def test_a_clean_pitch_raises_alarms_at_the_stated_rate():
    checks = CheckSettings(level=LEVEL, least_pitch=0.0)
    assert alarms([pitch_findings(PETREL, segments(seed), checks)[0] for seed in FEW_SEEDS]) <= 2


def test_an_offset_of_the_pitch_is_found_within_its_error():
    found = [pitch_findings(PETREL, segments(seed, 2.5), CHECKS)[0] for seed in FEW_SEEDS]
    assert alarms(found) >= 7
    assert all(abs(finding.size - 2.5) < 2.5 * finding.error for finding in found if finding.found)


@pytest.mark.parametrize(
    "errors",
    [{NEUTRAL_VOLUME: 150.0}, {"viscous.K_D0": 0.3}, {"viscous.K_L": 0.3}, {"viscous.K_D": -0.3}, {SIDES: 0.1}],
    ids=["zero", "drag", "lift", "induced drag", "dives and climbs differ"],
)
def test_a_wrong_hull_is_not_a_wrong_pitch(errors):
    clean = [pitch_findings(CALIBRATED, segments(seed, errors=errors), CHECKS)[0] for seed in range(3)]
    assert alarms(clean) == 0
    off = [pitch_findings(CALIBRATED, segments(seed, 3.0, errors=errors), CHECKS)[0] for seed in range(3)]
    assert alarms(off) >= 2


@pytest.mark.parametrize("errors", [{}, {SIDES: -0.25}], ids=["pitch", "climbs slowed"])
def test_glides_of_one_steepness_suggest_no_correction(errors):
    """Pitch read too high makes climbs slow and dives fast, and so does a drag that is larger in climbs."""
    for seed in range(3):
        offset = 0.0 if errors else 2.5
        finding = pitch_findings(CALIBRATED, segments(seed, offset, steepness=(24.0, 24.0), errors=errors), CHECKS)[0]
        assert finding.verdict is not CheckVerdict.FOUND
        assert finding.suggestion == ""


def thermocline(depth):
    """Water (n, 4) that is 4 kg/m3 lighter above 80 m."""
    above = 1.0 / (1.0 + np.exp((depth - 80.0) / 10.0))
    return np.column_stack([depth, 1027.0 + 0.0045 * depth - 4.0 * above, 8.0 + 12.0 * above, depth])


def test_a_hull_by_density_is_checked_in_the_water_that_was_measured():
    hull = with_values(CALIBRATED, {"buoyancy.compressibility": 4.5e-6, "buoyancy.depth_slope": 0.0})
    for offset, verdict in ((0.0, CheckVerdict.NOTHING), (2.5, CheckVerdict.FOUND)):
        finding = pitch_findings(hull, segments(1, offset, hull=hull, water=thermocline), CHECKS)[0]
        assert finding.verdict is verdict
        assert abs(finding.size - offset) < 2.5 * finding.error
    finding = pitch_findings(hull, segments(1, 2.5), CHECKS)[0]
    assert finding.verdict is CheckVerdict.UNDETERMINED
    assert "density" in finding.remark


def test_only_a_calibrated_hull_gets_a_correction_and_what_is_corrected_is_counted():
    records = RecordSettings(pitch_offset=1.0, pitch_scale=0.8)
    finding = pitch_findings(CALIBRATED, segments(2, 2.5), CHECKS, records)[0]
    assert finding.suggestion == f"`records.pitch_offset={1.0 + finding.size / 0.8:.2f}`"
    assert pitch_findings(PETREL, segments(2, 2.5), CHECKS)[0].suggestion.startswith("calibrate the hull")


def misread(seed, scale, steepness):
    """Segments whose pitch has to be multiplied by a scale to be true."""
    true = segments(seed, steepness=steepness, profiles=24, scatter=0.005)
    return replace(true, pitch=true.pitch / scale + np.radians(1.5))


def test_a_scale_of_the_pitch_is_found_where_steepness_varies_enough():
    for seed in range(2):
        offset, gain, *_ = pitch_findings(CALIBRATED, misread(seed, 0.86, (17.0, 55.0)), CHECKS)
        assert (gain.quantity, gain.verdict) == (GAIN, CheckVerdict.FOUND)
        assert abs(gain.size + 0.14) < 2.5 * gain.error
        assert gain.suggestion == f"`records.pitch_scale={1.0 + gain.size:.3f}`"
        assert abs(offset.size - 1.5) < 2.5 * offset.error
        right = pitch_findings(CALIBRATED, misread(seed, 1.0, (17.0, 55.0)), CHECKS)[-1]
        assert right.verdict is CheckVerdict.NOTHING
    assert pitch_findings(CALIBRATED, misread(0, 0.86, (20.0, 26.0)), CHECKS)[-1].verdict is CheckVerdict.UNDETERMINED


def test_glides_of_one_steepness_do_not_contradict_the_hull():
    """Errors that cannot be separated led the fit in circles, and a right hull was said not to fit the glides."""
    gain = pitch_findings(CALIBRATED, segments(0, steepness=(22.4, 23.6), scatter=0.01), CHECKS)[-1]
    assert (gain.quantity, gain.verdict) == (GAIN, CheckVerdict.UNDETERMINED)
    assert gain.remark.startswith("known only to")
    assert "more glides that differ more in steepness are needed" in gain.remark


def test_a_hull_that_cannot_glide_as_recorded_is_named_as_such():
    level = segments(0)
    finding = pitch_findings(CALIBRATED, replace(level, depth_rate=level.depth_rate, pitch=-level.pitch), CHECKS)[0]
    assert finding.verdict is CheckVerdict.UNDETERMINED
    assert finding.remark.startswith("the hull cannot glide as most of these records show: calibrate the hull")


def test_few_glides_rule_nothing_out_unless_a_plausible_error_would_have_been_found():
    limits = {PITCH: 2.0, GAIN: 0.3}
    found = []
    for profiles in (3, 4, 6):
        scattered = segments(profiles, steepness=(17.0, 55.0), profiles=profiles, scatter=0.005)
        found += pitch_findings(CALIBRATED, scattered, CHECKS)
    judged_by_limits = [f for f in found if f.quantity in limits and f.verdict is CheckVerdict.NOTHING]
    assert all(f.threshold <= limits[f.quantity] for f in judged_by_limits)
    assert any("would not be found; more glides" in f.remark for f in found)


def test_dives_without_climbs_leave_the_pitch_undetermined():
    whole = segments(0)
    finding = pitch_findings(PETREL, whole.select(whole.depth_rate > 0.0), CHECKS)[0]
    assert finding.verdict is CheckVerdict.UNDETERMINED
    assert "climbs" in finding.remark
    assert pitch_findings(PETREL, None, CHECKS)[0].verdict is CheckVerdict.UNDETERMINED


def test_a_covariance_by_leaving_out_counts_a_prior_once():
    rng = np.random.default_rng(0)
    design = np.column_stack([np.ones(200), rng.standard_normal(200), np.zeros(200)])
    profile, values = np.repeat(np.arange(20), 10), rng.standard_normal(200)
    weights, prior = rng.uniform(0.5, 2.0, 200), np.array([0.0, 0.3, 0.25])

    def estimate(used):
        """Least squares with the prior as three observations more."""
        root = np.sqrt(np.append(weights[used], prior))
        rows, seen = np.vstack([design[used], np.eye(3)]), np.append(values[used], np.zeros(3))
        return np.linalg.lstsq(root[:, None] * rows, root * seen)[0]

    whole = estimate(np.full(200, True))
    moves = np.array([estimate(profile != number) for number in range(20)]) - whole
    normal = design.T @ (weights[:, None] * design) + np.diag(prior)
    once = np.linalg.inv(normal) @ np.diag(prior) @ np.linalg.inv(normal)
    found = left_out_covariance(design, weights, values - design @ whole, profile, prior)
    np.testing.assert_allclose(found, 19.0 / 20.0 * moves.T @ moves + once, rtol=1e-9, atol=1e-15)
    assert found[2, 2] == pytest.approx(4.0)


# Whole twins


@pytest.fixture(scope="module")
def flown():
    return twin_records(1, twin_scenario("calm").replaced({"profiles": 10}))


@pytest.fixture(scope="module")
def clean_twin(flown):
    return inspect_open(flown)


@pytest.fixture(scope="module")
def added_errors():
    return RecordSettings(depth_lag=3.0, pitch_offset=2.0)


@pytest.fixture(scope="module")
def twin_with_errors(flown, added_errors):
    return inspect_open(flown, added_errors)


def test_a_clean_twin_raises_no_alarm(clean_twin):
    assert {finding.quantity for finding in clean_twin.findings} >= {LAG, PITCH, GAIN, CONSTANT, DEVIATION}
    assert clean_twin.found == ()
    assert len(clean_twin.profiles) == 10


def test_errors_added_to_a_twin_are_found(twin_with_errors, added_errors):
    found = {finding.quantity: finding for finding in twin_with_errors.findings}
    for quantity in (LAG, PITCH):
        finding = found[quantity]
        assert finding.verdict is CheckVerdict.FOUND
        assert abs(finding.size - expected(finding, added_errors)) < 2.5 * finding.error
        assert f"{finding.size:.3g}" in finding.line.replace("+", "")
    assert found[VOLUME].verdict is CheckVerdict.NOTHING


def test_few_profiles_rule_no_lag_out_that_is_beyond_reach(flown):
    """Three profiles leave two degrees of freedom: a threshold beyond every lag tried."""
    settings = EstimationSettings()
    finding = lag_finding(PETREL, [on_steps(record, settings) for record in flown[:3]], settings, CHECKS)
    assert finding.verdict is CheckVerdict.UNDETERMINED
    assert "an error of 3 s would not be found; 3 profiles, but more are needed" in finding.remark


def test_a_hull_in_calm_water_shows_no_lag(tmp_path):
    """Where innovations are far below their variances, the logarithm of these had decided for a lag of -2.3 s."""
    shipped, settings = read_platform("slocum"), EstimationSettings()
    sensors = shipped.sensors.model_copy(update={"sample_interval": 1.0})
    scenario = load_scenario("calm").replaced({"profiles": 4, "depth": 100.0})
    flown_hull = shipped.model_copy(update={"sensors": sensors})
    simulate_mission(flown_hull, tmp_path / "calm.nc", scenario=scenario, seed=4)
    lag = {"actuator_lag": scenario.actuation.lag}
    hull = flown_hull.model_copy(update={"sensors": sensors.model_copy(update=lag)})
    with open_observations(tmp_path / "calm.nc") as opened:
        series = [on_steps(opened.profile(number), settings, hull) for number in opened.profile_numbers]
    finding = lag_finding(hull, series, settings, CHECKS)
    assert abs(finding.size) < 1.0
    assert finding.verdict is CheckVerdict.NOTHING


def test_a_lag_is_corrected_on_a_calibrated_hull_only(flown, added_errors):
    settings = EstimationSettings()
    late = [on_steps(with_errors(record, added_errors), settings) for record in flown]
    findings = [lag_finding(hull, late, settings, CHECKS) for hull in (PETREL, CALIBRATED)]
    assert all(finding.found for finding in findings)
    assert findings[0].suggestion == "calibrate the hull, then inspect again"
    assert findings[1].suggestion == f"`records.depth_lag={findings[1].size:.2f}`"


# Corrections


@pytest.fixture(scope="module")
def record(brief):
    with open_observations(brief) as opened:
        return opened.profile(2)


def test_corrections_invert_the_errors_of_a_record(record):
    errors = RecordSettings(
        pitch_offset=1.5, pitch_scale=0.86, heading_offset=-3.0, heading_deviation=(5.0, -4.0, 2.0, 1.0), depth_lag=2.0
    )  # fmt: skip
    back = corrected(with_errors(record, errors), errors)
    np.testing.assert_allclose(back.pitch, record.pitch, atol=1e-12)
    np.testing.assert_allclose(np.exp(1j * back.heading), np.exp(1j * record.heading), atol=1e-9)
    assert np.isnan(back.depth[-2:]).all()
    np.testing.assert_allclose(back.depth[:-2], record.depth[:-2], atol=1e-9)


def test_nothing_is_corrected_by_default(record):
    assert corrected(record, RecordSettings()) is record


def test_a_gap_of_the_depth_moves_with_it(record):
    depth = record.depth.copy()
    depth[100:150] = np.nan
    moved = corrected(replace(record, depth=depth), RecordSettings(depth_lag=5.0)).depth
    assert np.flatnonzero(np.isnan(moved))[0] in (95, 96)
    assert np.isfinite(moved[150:-6]).all()


@pytest.mark.parametrize("lag", [0.5, -0.5, 1.3])
def test_a_lag_corrected_leaves_the_noise_of_the_depth(record, lag):
    """Half way between two samples their mean would have half the variance, and lags would seem likelier for it."""
    depth, noise = 0.2 * record.time, 0.1 * np.random.default_rng(6).standard_normal(len(record.time))
    clean, noisy = (
        corrected(replace(record, depth=each), RecordSettings(depth_lag=lag)).depth for each in (depth, depth + noise)
    )
    inside = slice(2, -2)
    np.testing.assert_allclose(clean[inside], 0.2 * (record.time + lag)[inside], atol=1e-9)
    assert np.std((noisy - clean)[inside]) == pytest.approx(0.1, rel=0.1)


def test_requested_corrections_are_stored_and_applied(record):
    settings = build_settings(
        {}, {"records.pitch_offset": "2.0", "records.pitch_scale": "0.86", "records.heading_deviation": "[1, 0, 0, 0]"}
    )
    assert settings.model_dump(mode="json")["records"]["pitch_offset"] == 2.0
    assert settings.model_dump(mode="json")["records"]["pitch_scale"] == 0.86
    plain, better = (on_steps(record, chosen) for chosen in (EstimationSettings(), settings))
    assert better.measurements[:, 1] == pytest.approx(0.86 * (plain.measurements[:, 1] - np.radians(2.0)))


def test_derivatives_of_a_leg_by_compass_errors_agree_with_differences(record):
    """The current of a record whose compass is turned, against the leg's own derivative."""
    settings = EstimationSettings()
    errors = RecordSettings(heading_offset=0.1, heading_deviation=(0.2, -0.1, 0.1, 0.3))
    leg = leg_of(PETREL, record, on_steps(record, settings), SETTINGS.current.errors(PETREL))
    turned = with_errors(record, errors)
    other = leg_of(PETREL, turned, on_steps(turned, settings), SETTINGS.current.errors(PETREL))
    predicted = leg.by_error @ np.radians([0.1, 0.2, -0.1, 0.1, 0.3])
    assert other.current - leg.current == pytest.approx(predicted, abs=0.02 * np.linalg.norm(predicted))


def test_the_derivative_of_a_leg_by_the_speed_agrees_with_a_difference(record):
    """With a track that is 1 % too short: the current is the displacement between fixes less that through the water."""
    settings = EstimationSettings()
    series, errors = on_steps(record, settings), SETTINGS.current.errors(PETREL)
    leg = leg_of(PETREL, record, series, errors)
    motion = glide_angle_motion(PETREL, series, vibration_set(PETREL, series))
    slower = SelfMotion(0.99 * motion.steps, motion.bridged)
    current = depth_averaged_current(record, track_of(series, slower, single_cycle(series)), errors).velocity
    assert current - leg.current == pytest.approx(-0.01 * leg.by_speed, rel=1e-9)
    assert leg.time == series.epoch.astype("datetime64[ns]").astype(np.int64) / 1e9


@pytest.mark.parametrize("missing", ["entry_fix", "exit_fix"])
def test_a_profile_without_a_fix_is_no_leg(record, missing):
    settings, errors = EstimationSettings(), SETTINGS.current.errors(PETREL)
    without = replace(record, **{missing: None})
    assert leg_of(PETREL, without, on_steps(without, settings), errors) is None


def test_a_profile_without_a_glide_is_no_leg(record):
    """A record that stays level goes nowhere by the glide angle."""
    settings, errors = EstimationSettings(), SETTINGS.current.errors(PETREL)
    level = replace(record, depth=5.0 + 0.01 * (np.arange(len(record.depth)) % 2))
    assert leg_of(PETREL, level, on_steps(level, settings), errors) is None


# The verb


def test_the_verb_prints_and_writes(brief, tmp_path):
    answer = program("inspect", brief, "--platform", "petrel-l", "--out", tmp_path / "checks.json")
    assert answer.status == 0, answer.err
    assert "lag of depth behind attitude" in answer.out
    found = json.loads((tmp_path / "checks.json").read_text())
    assert found["profiles"] == [1, 2, 3]
    deviation = next(one for one in found["findings"] if one["quantity"] == DEVIATION)
    assert (deviation["verdict"], deviation["size"], deviation["suggestion"]) == ("not determined", None, "")


def test_the_verb_refuses_in_one_line(brief, tmp_path):
    for arguments, words in (
        ((tmp_path / "none.nc",), "no such file"),
        ((brief, "--out", tmp_path / "no" / "checks.json"), "does not exist; create it first"),
        ((brief, "--set", "inspect.levels=1"), "no such setting"),
    ):
        answer = program("inspect", *arguments, "--platform", "petrel-l")
        assert answer.status == 2
        assert words in answer.line


def test_a_run_logs_what_it_finds_and_only_that(flown, caplog):
    settings = build_settings({}, {})
    with caplog.at_level(logging.WARNING, "gliderhpc.run"):
        for errors, lines in ((RecordSettings(), 0), (RecordSettings(pitch_offset=2.5), 1)):
            caplog.clear()
            records = {record.number: with_errors(record, errors) for record in flown}
            opened = SimpleNamespace(faults={}, profile=records.__getitem__)
            warn_about_records(opened, PETREL, settings, list(records))
            assert len([r for r in caplog.records if PITCH in r.getMessage()]) == lines


# Findings


def test_a_finding_lies_beyond_its_threshold_either_way():
    assert [judge_size(size, 1.0) for size in (-1.5, -1.0, 0.0, 1.0, 1.5)] == [
        CheckVerdict.FOUND, CheckVerdict.NOTHING, CheckVerdict.NOTHING, CheckVerdict.NOTHING, CheckVerdict.FOUND,
    ]  # fmt: skip


def test_an_insensitive_check_is_undetermined_rather_than_clear():
    def finding(size, threshold):
        return Finding("check", "quantity", "1", size, 0.5, threshold, judge_size(size, threshold))

    for size, threshold in ((0.0, 2.0), (3.0, 2.5)):
        clear = finding(size, threshold)
        assert undetermined_if_insensitive(clear, 2.0, "more") is clear
    vague = undetermined_if_insensitive(finding(1.0, 2.5), 2.0, "more glides are needed")
    assert vague.verdict is CheckVerdict.UNDETERMINED
    assert vague.remark == "+1 ± 0.5, threshold 2.5: an error of 2 would not be found; more glides are needed"


def test_the_defaults_of_the_checks_are_those_of_the_page():
    """Their meaning stands at each setting; docs/record-checks.md has the rates of false alarms at these."""
    assert CheckSettings().model_dump() == {
        "profiles": 48, "lag_profiles": 12, "level": 0.01, "timing_error": 0.5, "least_pitch": 0.5,
        "least_deviation": 2.0, "plausible_deviation": 20.0, "least_pitch_scale": 0.05, "coefficient_error": 0.3,
        "drag_difference": 0.05,
    }  # fmt: skip
