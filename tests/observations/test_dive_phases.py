"""Phases of a dive: stationary stretches, and ends of the record under water."""

import numpy as np
import pytest

from gliderhpc.observations.dive_phases import distance_to_surface, dive_notes, is_stationary

PITCH = np.radians(25.0)
SPEED = 0.15


def dive(deepest=100.0, still=0.0, interval=1.0):
    """Times and depths of a dive and climb at `SPEED`, with a pause at the deepest point (s)."""
    turn = deepest / SPEED
    corners = [0.0, turn, turn + still, 2.0 * turn + still]
    time = np.arange(0.0, corners[-1], interval)
    return time, np.interp(time, corners, [0.0, deepest, deepest, 0.0])


@pytest.mark.parametrize("interval", [1.0, 4.0, 30.0])
def test_a_pause_is_found(interval):
    time, depth = dive(still=900.0, interval=interval)
    found = time[is_stationary(time, depth)]
    assert found[0] == pytest.approx(100.0 / SPEED, abs=90.0)
    assert found[-1] - found[0] == pytest.approx(900.0, abs=120.0)


def test_the_sensor_may_be_noisy():
    time, depth = dive(still=900.0)
    depth = np.round(depth + np.random.default_rng(1).normal(0.0, 0.1, len(depth)), 1)
    assert is_stationary(time, depth).sum() == pytest.approx(900, abs=120)


@pytest.mark.parametrize(("still", "deepest"), [(0.0, 100.0), (200.0, 100.0), (0.0, 12.0)])
def test_a_dive_without_a_long_pause_is_not_stationary(still, deepest):
    assert not is_stationary(*dive(deepest, still)).any()


def test_a_gap_is_no_pause():
    """The depths before and after a gap about the deepest point are equal."""
    time, depth = dive()
    outside = np.abs(time - 100.0 / SPEED) > 400.0
    assert not is_stationary(time[outside], depth[outside]).any()
    assert not is_stationary(time, np.where(outside, depth, np.nan)).any()


def test_afloat_is_not_stationary():
    time = np.arange(0.0, 2000.0)
    assert not is_stationary(time, np.full(2000, 0.5)).any()


def test_too_short_a_record():
    assert not is_stationary(np.arange(10.0), np.full(10, 50.0)).any()
    assert not is_stationary(np.arange(1000.0), np.full(1000, np.nan)).any()


def cut(stop_depth, *, climbing):
    """A record that ends at a depth on the climb or on the dive."""
    time, depth = dive()
    after_turn = time > 100.0 / SPEED
    wanted = (depth <= stop_depth) & after_turn if climbing else (depth >= stop_depth) & ~after_turn
    stop = np.flatnonzero(wanted)[0] + 1
    return time[:stop], depth[:stop], np.full(stop, PITCH)


def test_no_distance_from_the_surface():
    time, depth = dive()
    pitch = np.full(len(time), PITCH)
    assert distance_to_surface(time, depth, pitch, 300.0, "start") == 0.0
    assert distance_to_surface(time, depth, pitch, 300.0, "end") == 0.0


def test_distance_of_a_climb_that_is_cut_short():
    """The steepness of the glide gives the way from the depth of 2 m at which it surfaces."""
    found = distance_to_surface(*cut(52.0, climbing=True), 600.0, "end")
    assert found == pytest.approx(50.0 / np.tan(PITCH), rel=0.01)


def test_distance_is_limited_by_the_time_until_the_fix():
    found = distance_to_surface(*cut(52.0, climbing=True), 60.0, "end")
    assert found == pytest.approx(60.0 * SPEED / np.tan(PITCH), rel=0.01)


@pytest.mark.parametrize(("climbing", "lasts"), [(False, 900.0), (True, 4000.0)])
def test_a_glider_that_may_have_flown_all_the_time(climbing, lasts):
    found = distance_to_surface(*cut(52.0, climbing=climbing), lasts, "end")
    assert found == pytest.approx(lasts * SPEED / np.tan(PITCH), rel=0.01)


def test_the_start_is_the_mirror_image_of_the_end():
    time, depth, pitch = cut(40.0, climbing=True)
    mirrored = time[-1] - time[::-1], depth[::-1], pitch
    assert distance_to_surface(*mirrored, 700.0, "start") == pytest.approx(
        distance_to_surface(time, depth, pitch, 700.0, "end"), rel=1e-6
    )


def test_a_record_without_depth_or_pitch():
    time, depth, pitch = cut(40.0, climbing=True)
    assert distance_to_surface(time, np.full_like(depth, np.nan), pitch, 700.0, "end") == 0.0
    assert distance_to_surface(time, depth, np.full_like(pitch, np.nan), 700.0, "end") == 0.0
    assert list(dive_notes(time, np.full_like(depth, np.nan))) == []


def test_notes():
    assert list(dive_notes(*dive())) == []
    assert list(dive_notes(*dive(still=1200.0))) == [
        "stationary for 20 min at 100 m (parked, on the bottom or under ice)"
    ]
    time, depth, _ = cut(65.0, climbing=True)
    unrecorded = "and the unrecorded way is part of the current's error"
    assert list(dive_notes(time, depth)) == [f"the record ends at 65 m depth, {unrecorded}"]
    assert list(dive_notes(time[100:], depth[100:])) == [
        f"the record begins at 15 m and ends at 65 m depth, {unrecorded}"
    ]
    time, depth, _ = cut(10.0, climbing=True)
    assert list(dive_notes(time, depth)) == []
