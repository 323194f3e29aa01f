"""Profiles of a SeaExplorer mission, from the states and depths of its navigation rows."""

import numpy as np
import pytest

from gliderhpc.observations.importing.rows import Rows
from gliderhpc.observations.instruments.seaexplorer_legs import (
    CLIMBING,
    DIVING,
    INFLECTING_DOWN,
    SURFACING,
    TRANSMITTING,
    find_legs,
    is_gliding,
)

START = np.datetime64("2023-07-05T10:00:00")
PROFILE = [(DIVING, depth) for depth in (0.5, 5.0, 20.0, 30.0)] + [(CLIMBING, depth) for depth in (20.0, 5.0, 0.5)]
"""States and depths of a dive to 30 m and the climb, from above the level at which the hull floats."""


def rows(states, *, parts=None, seconds=None):
    """Navigation rows of the given states and depths, 20 s apart, of cycle 5."""
    state, depth = (np.array(values, float) for values in zip(*states, strict=True))
    seconds = 20 * np.arange(len(states)) if seconds is None else np.array(seconds)
    parts = np.full(len(states), 5) if parts is None else np.array(parts)
    return Rows(START + seconds * np.timedelta64(1, "s"), parts.astype(np.int64), {"NavState": state, "Depth": depth})


def extents(found):
    return [(leg.number, leg.start, leg.stop) for leg in found]


def test_the_surfacing_manoeuvre_is_no_gliding_unless_asked_for():
    states = np.array([DIVING, INFLECTING_DOWN, CLIMBING, SURFACING, TRANSMITTING], float)
    assert is_gliding(states).tolist() == [True, True, True, False, False]
    assert is_gliding(states, include_surfacing=True).tolist() == [True, True, True, True, False]


def test_a_record_may_begin_below_the_surface():
    legs, without = find_legs(rows([(DIVING, 20.0), *PROFILE[2:], (TRANSMITTING, 0.0)]))
    assert extents(legs) == [(5, 0, 5)]
    assert without == {}


@pytest.mark.parametrize(("pause", "broken"), [(900, False), (901, True)])
def test_a_pause_of_more_than_a_quarter_of_an_hour_breaks_a_record(pause, broken):
    seconds = np.cumsum([0, 20, 20, pause, 20, 20, 20])
    legs, _ = find_legs(rows([(DIVING, 2.0), (DIVING, 15.0), (DIVING, 20.0), *PROFILE[3:]], seconds=seconds))
    assert extents(legs) == [(5, 0, 3 if broken else 6)]


@pytest.mark.parametrize(("then", "broken"), [(6, False), (7, True)])
def test_a_missing_file_breaks_a_record(then, broken):
    states = [(DIVING, 2.0), (DIVING, 20.0), (DIVING, 30.0), (CLIMBING, 20.0)]
    legs, _ = find_legs(rows(states, parts=[5, 5, 5, then]))
    assert extents(legs) == [(5, 0, 3 if broken else 4)]


@pytest.mark.parametrize(
    ("states", "reason"),
    [
        ([(DIVING, 2.0), (DIVING, 11.5)], "too shallow: dives 10 m, but at least 10 m are needed"),
        ([(DIVING, 2.0), (DIVING, 3.0)], "too shallow: dives 1 m, but at least 10 m are needed"),
        ([(INFLECTING_DOWN, 2.0), (INFLECTING_DOWN, 2.9)], None),
        ([(CLIMBING, 2.0), (CLIMBING, 6.0)], None),
    ],
    ids=["nearly", "a-metre", "at_surface", "climb-before"],
)
def test_shallow_dives_are_reported_unlike_surface_records_and_ends_of_climbs(states, reason):
    legs, without = find_legs(rows([(TRANSMITTING, 0.0), *states, (TRANSMITTING, 0.0)]))
    assert legs == []
    assert without == {5: reason or "only a surface record"}


def test_a_dive_of_just_ten_metres_is_a_profile():
    legs, _ = find_legs(rows([(TRANSMITTING, 0.0), (DIVING, 2.0), (DIVING, 12.0), (CLIMBING, 2.0)]))
    assert extents(legs) == [(5, 1, 4)]


@pytest.mark.parametrize(
    ("before", "after", "start"),
    [
        # The sensor reads 3 m at the surface before the dive: what is above 4 m is cut off.
        ([(TRANSMITTING, 3.0)] * 3, [(TRANSMITTING, 0.0)], 2),
        # Nothing was recorded at the surface before: the surfacing afterwards says where the hull floats.
        ([], [(TRANSMITTING, 3.0)] * 3, 2),
        # No row at the surface at all: the hull floats at zero.
        ([], [], 1),
    ],
    ids=["before", "after", "never"],
)
def test_rows_at_the_surface_are_cut_off_by_the_level_at_which_the_hull_floats(before, after, start):
    dive = [(DIVING, 0.9), (DIVING, 3.5), (DIVING, 20.0), (DIVING, 40.0), (CLIMBING, 20.0)]
    legs, _ = find_legs(rows([*before, *dive, *after]))
    assert extents(legs) == [(5, len(before) + start, len(before) + len(dive))]


def test_a_pause_of_the_record_is_not_called_a_second_dive():
    states = [(TRANSMITTING, 0.0), *PROFILE, (TRANSMITTING, 0.0)]
    seconds = 20 * np.arange(len(states)) + np.where(np.arange(len(states)) > 4, 3600, 0)
    legs, without = find_legs(rows([*states], seconds=seconds))
    assert extents(legs) == [(5, 2, 5)]
    assert without[5].startswith("the record pauses for 60 min after 2023-07-05T10:01:20, or the clock was set forward")


def test_only_the_last_surface_rows_say_where_the_hull_floats():
    surface = [(TRANSMITTING, 9.0)] * 30 + [(TRANSMITTING, 1.0)] * 10
    legs, _ = find_legs(rows([*surface, (DIVING, 1.5), (DIVING, 3.0), (DIVING, 20.0)]))
    assert extents(legs) == [(5, 41, 43)]


def test_two_dives_within_one_file_are_one_profile_and_a_reason():
    legs, without = find_legs(rows([*PROFILE, (TRANSMITTING, 0.0), *PROFILE]))
    assert extents(legs) == [(5, 1, 6)]
    assert without == {5: "dives twice between surfacings within one file: only the first dive is used"}


def test_a_cycle_says_why_it_has_no_profile():
    states = [(TRANSMITTING, 0.0), *PROFILE[1:], (TRANSMITTING, 0.0)]
    parts = [5] * 7 + [8]
    _, without = find_legs(rows(states, parts=parts))
    assert list(without) == [6, 7, 8]
    assert without[6] == without[7] == "its navigation file is missing"


def test_a_missing_depth_at_the_surface_trims_a_dive_all_the_same():
    at_surface = [(TRANSMITTING, 1.0)] * 4
    dive = [(DIVING, 1.5), (DIVING, 20.0), (CLIMBING, 12.0), (CLIMBING, 1.5)]
    whole, _ = find_legs(rows([*at_surface, *dive, *at_surface]))
    found, _ = find_legs(rows([*at_surface[:-1], (TRANSMITTING, np.nan), *dive, *at_surface]))
    assert [(leg.start, leg.stop) for leg in found] == [(leg.start, leg.stop) for leg in whole]
