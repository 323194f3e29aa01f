"""Errors of the compass compared with currents that rotate at the inertial or the tidal period."""

from dataclasses import replace

import numpy as np

from gliderhpc.estimation.resample import harmonics
from gliderhpc.record_checks import CheckSettings, CheckVerdict
from gliderhpc.record_checks.compass import Leg, compass_findings
from gliderhpc.record_checks.rotary import CurrentModel, is_explained_by_rotation, rotating_columns
from gliderhpc.record_checks.turns import TurnInformation

CHECKS = CheckSettings()
NO_TURNS = TurnInformation(np.zeros((5, 5)), np.zeros(5), 0)
INERTIAL = {70.0: 12.736, -70.0: -12.736, 45.0: 16.925}
"""Inertial periods (h) by latitude, negative where the current rotates counter-clockwise."""
BLOCKS = (
    (0, 0.217, -0.011, 0.168, 0.352), (0.765, 0.173, -0.052, 0.135, 0.373),
    (1.576, 0.017, -0.134, 0.143, 0.368), (2.339, 0.171, -0.104, 0.14, 0.368),
    (3.151, 0.056, -0.22, -0.357, 0.172), (3.964, -0.018, -0.271, -0.396, 0.036),
    (4.771, -0.077, 0.049, -0.395, -0.003), (5.603, -0.108, -0.141, -0.396, 0.016),
    (6.419, 0.048, -0.209, 0.022, -0.394), (7.242, 0.044, -0.166, -0.156, -0.366),
    (8.007, -0.112, -0.109, -0.149, -0.369), (8.766, -0.104, -0.096, -0.039, -0.397),
    (9.531, 0.024, 0.105, 0.397, -0.014), (10.312, 0.05, 0.081, 0.354, -0.17),
    (11.114, 0.161, 0.055, 0.375, -0.128), (11.879, 0.262, 0.045, 0.396, -0.012),
    (12.612, 0.092, -0.052, 0.143, 0.368), (13.369, 0.102, 0.022, 0.112, 0.38),
    (14.149, 0.224, -0.273, 0.062, 0.391), (14.919, 0.22, -0.019, -0.022, 0.392),
)  # fmt: skip
"""Time (h), current north and east, velocity through the water north and east (m/s) of the dives of a simulated mission
in an oscillation of 0.2 m/s and 12.7 h: four courses, each but the first flown in one block of time only."""
IN_TURN = np.resize([75.0, 165.0, 255.0, 345.0], 20)
DEVIATION = (0.0, 15.0, -15.0, 0.0, 0.0)
ROUNDS = range(12)


def legs(seed, headings, errors=(0.0,) * 5, latitude=70.0, amplitude=0.2, hours=0.65, scatter=0.04):
    """Legs through an inertial oscillation of random phase, their compass off by errors (5,) in degrees."""
    rng = np.random.default_rng(seed)
    phase, found = rng.uniform(0.0, 2.0 * np.pi), []
    for number, heading in enumerate(np.radians(headings)):
        motion = 0.38 * np.array([np.cos(heading), np.sin(heading)])
        angle = 2.0 * np.pi * number * hours / INERTIAL[latitude] + phase
        current = amplitude * np.array([np.cos(angle), np.sin(angle)]) + rng.normal(0.0, scatter, 2)
        found.append(leg(hours * number, current, motion, latitude, errors))
    return found


def verdicts(**of_legs):
    return [compass_findings(legs(seed, **of_legs), NO_TURNS, CHECKS)[1] for seed in ROUNDS]


def leg(hours, current, motion, latitude, errors=(0.0,) * 5):
    by_error = -np.outer([-motion[1], motion[0]], np.append(1.0, harmonics([np.arctan2(motion[1], motion[0])])[0]))
    return Leg(3600.0 * hours, np.array(current) + by_error @ np.radians(errors), by_error, -np.array(motion), latitude)


def blocks():
    """Legs of a compass without a deviation, each but one course flown in one block of time only."""
    return [leg(hours, (north, east), motion, 70.0) for hours, north, east, *motion in BLOCKS]


def test_an_oscillation_is_no_deviation_where_headings_were_flown_in_blocks():
    finding = compass_findings(blocks(), NO_TURNS, CHECKS)[1]
    assert finding.verdict is CheckVerdict.UNDETERMINED
    assert finding.remark.startswith("+18 ± 3.7 degree would explain these currents, and so would a current that rotat")
    assert finding.remark.endswith("the same headings at other times are needed to decide which")
    assert finding.suggestion == ""


def test_a_deviation_is_found_in_an_inertial_oscillation_where_headings_were_flown_in_turn():
    for latitude in (70.0, 45.0):
        quiet = verdicts(headings=IN_TURN, latitude=latitude, amplitude=0.05, scatter=0.02, errors=DEVIATION)
        assert sum(finding.found for finding in quiet) >= 10
    assert sum(finding.found for finding in verdicts(headings=IN_TURN)) == 0


def model(found):
    current, by_error, by_speed = (
        np.concatenate([[getattr(leg, name)[axis] for leg in found] for axis in (0, 1)])
        for name in ("current", "by_error", "by_speed")
    )
    time, latitude = (np.array([getattr(leg, name) for leg in found]) for name in ("time", "latitude"))
    return CurrentModel(
        time, latitude, current, by_error, by_speed, NO_TURNS.information, NO_TURNS.vector, np.radians(20.0)
    )


def test_the_columns_turn_as_the_earth_lets_a_free_current_turn():
    """Clockwise in the northern hemisphere once in 12 h / sin(latitude), of constant speed."""
    for latitude, period in INERTIAL.items():
        time = 3600.0 * np.linspace(0.0, abs(period), 5)
        north, east = np.split(rotating_columns(time, np.full(5, latitude))[:, -2], 2)
        expected = np.sign(period) * np.radians([0.0, 90.0, 180.0, 270.0, 360.0])
        np.testing.assert_allclose(north, np.cos(expected), atol=0.02)
        np.testing.assert_allclose(east, np.sin(expected), atol=0.02)


def test_without_a_latitude_or_near_the_equator_only_the_tide_rotates():
    time = 3600.0 * np.arange(8.0)
    assert rotating_columns(time, np.full(8, np.nan)).shape == (16, 4)
    assert rotating_columns(time, np.full(8, 2.0)).shape == (16, 4)
    assert rotating_columns(time, np.full(8, 40.0)).shape == (16, 6)


def test_turns_decide_between_a_deviation_and_a_rotation():
    """Turns that confirm the deviation are no information on currents."""
    legs_in_blocks = model(blocks())
    values = np.radians([0.0, 4.6, -10.1, 4.7, -14.4])
    tested = [1, 2, 3, 4]
    assert is_explained_by_rotation(legs_in_blocks, values, tested)
    information = np.diag([0.0, *[np.radians(1.0) ** -2] * 4])
    confirmed = replace(legs_in_blocks, information=information, vector=information @ values)
    assert not is_explained_by_rotation(confirmed, values, tested)
