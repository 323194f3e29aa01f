"""Phases of a dive: stationary stretches, and ends of the record under water."""

import numpy as np
import pytest

from gliderhpc.observations.dive_phases import describe_rest, distance_to_surface, dive_notes, is_stationary
from gliderhpc.observations.series import ProfileSeries

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


def series_of(time, depth, weights=None):
    points = len(time)
    return ProfileSeries(
        1, np.datetime64("2024-01-01", "ns"), 1.0, time, np.column_stack([np.zeros((points, 3)), depth]),
        np.ones(points) if weights is None else weights, np.zeros((points - 1, 4)), 1.0, 0.0, np.arange(points),
    )  # fmt: skip


def test_a_rest_on_the_bottom_is_described():
    found = describe_rest(series_of(*dive(still=180.0)))
    assert found.startswith("the glider was at one depth, 100 m, for 18")


def test_the_turn_of_a_dive_is_no_rest():
    assert describe_rest(series_of(*dive(still=20.0))) == ""


def test_a_gap_is_no_rest():
    time, depth = dive(still=180.0)
    assert describe_rest(series_of(time, depth, (np.abs(depth - 100.0) > 1e-9).astype(float))) == ""


def test_a_gap_is_no_pause():
    """The depths before and after a gap about the deepest point are equal."""
    time, depth = dive()
    outside = np.abs(time - 100.0 / SPEED) > 400.0
    assert not is_stationary(time[outside], depth[outside]).any()
    assert not is_stationary(time, np.where(outside, depth, np.nan)).any()


def test_short_yos_at_depth_are_no_pause():
    """With a period of two minutes the depth is the same from one turn to the next."""
    time = np.arange(0.0, 3600.0)
    for period in (60.0, 120.0):
        yo = np.abs((time / period) % 1.0 - 0.5) * period
        assert not is_stationary(time, 10.0 + 2.0 * SPEED * yo).any()


def test_an_hour_without_samples_is_not_stationary():
    time, depth = dive(still=4000.0)
    middle = 100.0 / SPEED + 2000.0
    recorded = np.abs(time - middle) > 1900.0
    assert not is_stationary(time[recorded], depth[recorded]).any()


def test_a_glider_at_the_surface_is_not_stationary():
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
    assert found == pytest.approx(50.0 / np.tan(PITCH), rel=0.02)


def test_distance_is_limited_by_the_time_until_the_fix():
    found = distance_to_surface(*cut(52.0, climbing=True), 60.0, "end")
    assert found == pytest.approx(60.0 * SPEED / np.tan(PITCH), rel=0.02)


@pytest.mark.parametrize(("climbing", "lasts"), [(False, 900.0), (True, 4000.0)])
def test_a_glider_that_may_have_flown_all_the_time(climbing, lasts):
    found = distance_to_surface(*cut(52.0, climbing=climbing), lasts, "end")
    assert found == pytest.approx(lasts * SPEED / np.tan(PITCH), rel=0.02)


def test_a_late_fix_alone_is_no_way():
    """A glider that ends a record at the usual few metres, and transmits for half an hour."""
    found = distance_to_surface(*cut(4.0, climbing=True), 1800.0, "end")
    assert found == pytest.approx(2.0 / np.tan(PITCH), rel=0.1)


@pytest.mark.parametrize("interval", [1.0, 30.0, 100.0])
def test_the_distance_depends_on_neither_the_sampling_nor_the_noise(interval):
    time, depth = dive(interval=interval)
    stop = np.flatnonzero((depth <= 52.0) & (time > 100.0 / SPEED))[0] + 1
    noise = np.random.default_rng(2).normal(0.0, 0.1, stop)
    found = distance_to_surface(time[:stop], depth[:stop] + noise, np.full(stop, PITCH), 500.0, "end")
    assert found == pytest.approx((depth[stop - 1] - 2.0) / np.tan(PITCH), rel=0.04)


def test_a_pause_does_not_slow_the_glide():
    time, depth = dive(still=5000.0)
    stop = np.flatnonzero((depth <= 52.0) & (time > 6000.0))[0] + 1
    found = distance_to_surface(time[:stop], depth[:stop], np.full(stop, PITCH), 100.0, "end")
    assert found == pytest.approx(100.0 * SPEED / np.tan(PITCH), rel=0.05)


def test_the_start_is_the_mirror_image_of_the_end():
    time, depth, pitch = cut(40.0, climbing=True)
    mirrored = time[-1] - time[::-1], depth[::-1], pitch
    assert distance_to_surface(*mirrored, 700.0, "start") == pytest.approx(
        distance_to_surface(time, depth, pitch, 700.0, "end"), rel=1e-6
    )


def notes(time, depth, pitch=None):
    return list(dive_notes(time, depth, np.full(len(time), PITCH) if pitch is None else pitch))


def test_a_record_without_depth_or_pitch():
    time, depth, pitch = cut(40.0, climbing=True)
    nothing = np.full_like(depth, np.nan)
    assert distance_to_surface(time, nothing, pitch, 700.0, "end") == 0.0
    assert distance_to_surface(time, depth, nothing, 700.0, "end") == 0.0
    assert notes(time, nothing) == []
    assert notes(time, depth, nothing) == []


def test_notes():
    assert notes(*dive()) == []
    stationary = "stationary for 20 min at 100 m (parked, on the bottom, under ice or at a density step"
    stuck = "; or the pressure sensor is stuck, as the depth is the same to the last digit"
    time, depth, *others = dive(still=1200.0)
    assert notes(time, depth, *others) == [f"{stationary}{stuck})"]
    noise = 0.01 * np.random.default_rng(0).standard_normal(len(depth))
    assert notes(time, depth + noise, *others) == [f"{stationary})"]
    time, depth, _ = cut(65.0, climbing=True)
    unrecorded = "so the unrecorded distance adds to the current's error"
    assert notes(time, depth) == [f"the record ends at 65 m depth, {unrecorded}"]
    assert notes(time[100:], depth[100:]) == [f"the record begins at 15 m and ends at 65 m depth, {unrecorded}"]
    time, depth, _ = cut(10.0, climbing=True)
    assert notes(time, depth) == []


def test_a_record_ends_where_its_attitude_ends():
    time, depth = dive()
    pitch = np.where(time > 100.0 / SPEED + 300.0, np.nan, PITCH)
    (note,) = notes(time, depth, pitch)
    assert note.startswith("the record of the attitude ends at 55 m depth")


def test_pauses_in_parts_are_one_note():
    time, depth = dive(still=900.0)
    again = time[-1] + 1.0 + time
    (note,) = notes(np.concatenate([time, again]), np.concatenate([depth, depth]))
    assert "at 100 m, in 2 parts" in note


def test_pauses_at_different_depths_are_not_at_a_depth_between_them():
    first, second = dive(still=900.0), dive(deepest=60.0, still=900.0)
    time = np.concatenate([first[0], first[0][-1] + 1.0 + second[0]])
    (note,) = notes(time, np.concatenate([first[1], second[1]]))
    assert "at 60 to 100 m, in 2 parts" in note
