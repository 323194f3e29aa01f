"""Profiles left out of a calibration, because they do not fit the hull of the others."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.steady_glides import glides

from gliderhpc.calibration.glides.disagreeing_profiles import disagreeing_profiles
from gliderhpc.calibration.glides.fit import calibrate_on_glides
from gliderhpc.calibration.glides.segment_errors import SegmentErrors
from gliderhpc.calibration.glides.text import notes
from gliderhpc.calibration.settings import CalibrationSettings
from gliderhpc.flight.hull_parameters import PARAMETERS, with_values
from gliderhpc.platform import read_platform

PETREL = read_platform("petrel-l")
TRUTH = with_values(PETREL, {"buoyancy.neutral_volume": 640.0, "viscous.K_D0": 10.0, "position.battery": 0.104})
HOLD = ("K_D", "K_L", "K_M", "K_M0", "position.reservoir.0", "depth_slope")
ZERO = np.zeros(len(PARAMETERS))


def stormy(segments, profiles, seed=3):
    """The same glides, in some profiles in water that lifts, tilts, rolls and turns the glider in each segment."""
    rng = np.random.default_rng(seed)
    storm = np.isin(segments.profile, profiles)
    rate, pitch, roll, turn = rng.standard_normal((4, len(segments))) * storm
    return replace(
        segments,
        depth_rate=segments.depth_rate * (1.0 + 0.4 * storm + 0.2 * rate),
        pitch=segments.pitch + math.radians(4.0) * pitch,
        roll=math.radians(5.0) * roll,
        turn_rate=math.radians(2.0) * turn,
    )


def errors_of(segments, hull=TRUTH):
    return SegmentErrors(hull, PARAMETERS, segments)


def test_profiles_in_a_storm_disagree_with_the_others():
    found = disagreeing_profiles(errors_of(stormy(glides(TRUTH, PETREL, profiles=9), (4, 7))), ZERO)
    assert [profile.number for profile in found] == [4, 7]
    assert all(profile.ratio > 8.0 for profile in found)


@pytest.mark.parametrize("count", [3, 4])
def test_no_more_than_a_third_is_left_out(count):
    segments = stormy(glides(TRUTH, PETREL, profiles=9), range(1, count + 1))
    assert len(disagreeing_profiles(errors_of(segments), ZERO)) == (count if count == 3 else 0)


def test_a_fit_needs_enough_profiles_that_are_left():
    assert not disagreeing_profiles(errors_of(stormy(glides(TRUTH, PETREL, profiles=3), (2,))), ZERO)


def test_profiles_in_which_only_impulses_turn_the_glider_agree():
    """Yaw impulses change the rate of turn alone."""
    segments = glides(TRUTH, PETREL, profiles=9)
    rng = np.random.default_rng(4)
    impulses = np.isin(segments.profile, (4, 7)) * rng.standard_normal(len(segments))
    turned = replace(segments, turn_rate=segments.turn_rate + math.radians(0.1) * impulses)
    assert not disagreeing_profiles(errors_of(turned), ZERO)


def test_calm_profiles_of_a_wrong_hull_agree():
    """The whole error of an uncalibrated hull is in every profile."""
    assert not disagreeing_profiles(errors_of(glides(TRUTH, PETREL, profiles=9), PETREL), ZERO)


def test_a_storm_does_not_move_the_hull_of_the_other_dives():
    segments = stormy(glides(TRUTH, PETREL, profiles=9), (4, 7, 8))
    lines = []
    found = calibrate_on_glides(PETREL, segments, segments.empty(), CalibrationSettings(hold=HOLD), lines.append)
    after = {p.parameter.key: p.after for p in found.parameters}
    assert after["buoyancy.neutral_volume"] == pytest.approx(640.0, abs=2.0)
    assert after["viscous.K_D0"] == pytest.approx(10.0, rel=0.01)
    assert [profile.number for profile in found.left_out] == [4, 7, 8]
    assert found.fitted.profiles == (1, 2, 3, 5, 6, 9)
    (note,) = [line for line in notes(found) if "left out" in line]
    assert "profile 4 (its " in note
    assert any(line.startswith("profile 4 is left out: its ") for line in lines)
