"""Actuators that move while their record pauses are reported with values and remedy; others are not."""

import numpy as np
import pytest
from support.observation_files import SAMPLES, first_sample, mission, write

from gliderhpc.observations import open_observations
from gliderhpc.observations.checks.control_gaps import stuck_ballast, unlogged_movements

TIME = np.arange(1200.0)
RECORDED = np.ones(len(TIME), dtype=bool)
PUMP = (590.0, 610.0)
"""Begin and end of the movement (s)."""


def moved(before, after, samples=None):
    """Actuator that moves during `PUMP`, NaN but at the sample numbers given."""
    values = np.interp(TIME, PUMP, (before, after))
    if samples is not None:
        values[np.setdiff1d(np.arange(len(TIME)), samples)] = np.nan
    return values


def remark(ballast, position=None, rotation=None, attitude=RECORDED):
    still = np.zeros(len(TIME))
    controls = {
        "ballast_volume": ballast,
        "battery_position": still if position is None else position,
        "battery_rotation": still if rotation is None else rotation,
    }
    return unlogged_movements(TIME, attitude, controls)


def test_a_movement_logged_only_when_it_ends_is_reported():
    text = remark(moved(350.0, 950.0, [0, 610]), position=moved(-0.03, 0.03, [0, 610, 1199]))
    assert text == (
        "ballast_volume changes by 600 cm3 across 610 s without a value, battery_position changes by 0.06 m across "
        "610 s without a value, read as slow ramps: repeat the last value at every sample, or log every movement"
    )


def test_the_largest_of_several_changes_is_reported():
    rotation = np.full(len(TIME), np.nan)
    rotation[[0, 200, 300, 900]] = (0.0, 10.0, -20.0, -10.0)
    assert "battery_rotation changes by 30 degree across 100 s" in remark(moved(0.0, 0.0), rotation=rotation)


@pytest.mark.parametrize(
    "ballast",
    [
        moved(350.0, 950.0),
        moved(350.0, 350.0, [0, 610]),
        moved(350.0, 365.0, [0, 610]),
        moved(350.0, 950.0, np.arange(0, 1200, 60)),
        moved(350.0, 950.0, [0, 590, 610, 1199]),
    ],
    ids=["every sample", "no movement", "small", "every minute", "begin and end"],
)
def test_ballast_recorded_often_enough_gets_no_remark(ballast):
    assert remark(ballast) == ""


def test_a_long_movement_logged_at_begin_and_end_is_a_ramp():
    samples = [0, 500, 700, 1199]
    values = np.full(len(TIME), np.nan)
    values[samples] = (350.0, 350.0, 950.0, 950.0)
    assert remark(values) == ""
    values[0] = 600.0
    assert "changes by 600 cm3 across 200 s" in remark(values)


def test_a_pause_of_the_whole_record_is_not_the_actuators():
    apart = np.arange(0, 1200, 100)
    slow, pause = np.zeros_like(RECORDED), RECORDED.copy()
    slow[apart[:-1] + 90] = True
    pause[560:700] = False
    assert remark(moved(350.0, 950.0, apart), attitude=slow) == ""
    assert remark(moved(350.0, 950.0, np.flatnonzero(pause)), attitude=pause) == ""
    assert "across 100 s" in remark(moved(350.0, 950.0, apart))


def test_the_remark_is_a_note_of_the_profile(tmp_path):
    values = mission()["ballast_volume"].astype(float)
    first, last = first_sample(1), first_sample(1) + SAMPLES - 1
    values[first:last] = np.nan
    values[[first, last]] = (150.0, 250.0)
    with open_observations(write(tmp_path, ballast_volume=values)) as observations:
        found = {number: observations.profile(number).notes for number in observations.profile_numbers}
    assert "ballast_volume changes by 100 cm3" in found[1][0]
    assert found[2] == found[3] == ()


# A ballast that does not move


def test_a_ballast_that_stays_the_same_through_dive_and_climb_is_reported(tmp_path):
    stuck = np.where(mission()["profile"] == 2, -250.0, mission()["ballast_volume"])
    with open_observations(write(tmp_path, ballast_volume=stuck)) as observations:
        found = {number: observations.profile(number).notes for number in observations.profile_numbers}
    assert found[1] == found[3] == ()
    (text,) = found[2]
    assert text.startswith("ballast_volume stays at -250 cm3 although the glider dives by 49 m and climbs by 49 m")


@pytest.mark.parametrize(
    ("depth", "ballast"),
    [
        (np.linspace(0.0, 200.0, 400), np.full(400, 300.0)),
        (np.concatenate([np.linspace(0.0, 200.0, 200), np.linspace(200.0, 190.0, 200)]), np.full(400, 300.0)),
        (200.0 * np.sin(np.linspace(0.0, np.pi, 400)), np.repeat([300.0, 298.0], 200)),
        (200.0 * np.sin(np.linspace(0.0, np.pi, 400)), np.full(400, np.nan)),
    ],
    ids=["a dive alone", "no climb", "a small change", "unknown"],
)
def test_other_ballasts_are_not_called_stuck(depth, ballast):
    assert stuck_ballast(depth, ballast) == []


def test_a_ballast_known_during_the_dive_alone_and_a_false_depth_are_not_called_stuck():
    depth = 200.0 * np.sin(np.linspace(0.0, np.pi, 400))
    half = np.where(np.arange(400) < 190, 300.0, np.nan)
    assert stuck_ballast(depth, half) == []
    spike = np.linspace(0.0, 200.0, 400)
    spike[380] = 20.0
    assert stuck_ballast(spike, np.full(400, 300.0)) == []
