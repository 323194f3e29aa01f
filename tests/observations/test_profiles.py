"""Detection of profiles and dive-climb cycles from depth alone."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gliderhpc.observations.profile_numbers import evenly_spaced
from gliderhpc.observations.profiles import cycle_boundaries, detect_profiles

YO = 600
"""Samples of one dive and climb."""


def yo(maximum: float, top: float = 0.0) -> np.ndarray:
    return top + (maximum - top) * (1.0 - np.abs(np.linspace(-1.0, 1.0, YO)))


def record(maxima: list[float], surface: int, level: float) -> np.ndarray:
    """Yos with `surface` samples at the surface before, between and after."""
    parts = [np.full(surface, level)]
    for maximum in maxima:
        parts += [yo(maximum, level), np.full(surface, level)]
    return np.concatenate(parts)


@given(
    maxima=st.lists(st.floats(30.0, 1000.0), min_size=1, max_size=5),
    level=st.floats(0.0, 3.0),
    noise=st.floats(0.0, 0.1),
    seed=st.integers(0, 1000),
)
def test_one_profile_from_surfacing_to_surfacing(maxima, level, noise, seed):
    clean = record(maxima, 300, level)
    depth = clean + noise * np.random.default_rng(seed).standard_normal(len(clean))
    numbers = detect_profiles(np.arange(len(depth), dtype=float), depth)
    assert numbers.max() == len(maxima)
    for index, maximum in enumerate(maxima, start=1):
        own = np.flatnonzero(numbers == index)
        assert np.all(np.diff(own) == 1)
        assert clean[own].max() == pytest.approx(maximum, rel=0.01)
        assert len(own) <= YO
    assert np.all(clean[numbers == 0] < level + 3.0)


def test_a_yo_that_turns_below_the_surface_continues_the_profile():
    depth = np.concatenate([np.zeros(200), yo(100.0), yo(120.0, 5.0)[1:], np.zeros(200)])
    numbers = detect_profiles(np.arange(len(depth), dtype=float), depth)
    assert set(numbers) == {0, 1}


def test_missing_samples_do_not_break_a_profile():
    depth = record([100.0, 80.0], 200, 1.0)
    depth[300:360] = np.nan
    numbers = detect_profiles(np.arange(len(depth), dtype=float), depth)
    assert numbers.max() == 2
    assert np.all(numbers[300:360] == 1)


def test_shallow_excursions_are_no_profiles():
    assert not np.any(detect_profiles(np.arange(1000.0), record([8.0], 200, 1.0)))
    assert not np.any(detect_profiles(np.arange(50.0), np.full(50, np.nan)))


@given(
    maxima=st.lists(st.floats(50.0, 200.0), min_size=1, max_size=5),
    noise=st.floats(0.0, 0.05),
    seed=st.integers(0, 1000),
)
def test_cycles_are_cut_at_five_per_cent_of_the_greatest_depth(maxima, noise, seed):
    clean = np.concatenate([yo(maximum) for maximum in maxima])
    depth = clean + noise * np.random.default_rng(seed).standard_normal(len(clean))
    boundaries = cycle_boundaries(depth)
    assert boundaries[0] == 0
    assert boundaries[-1] == len(depth) - 1
    assert len(boundaries) == len(maxima) + 1
    threshold = 0.05 * depth.max()
    for boundary in boundaries[1:-1]:
        # Crossed from below: deeper before, shallower at the boundary itself.
        assert depth[boundary] < threshold <= depth[boundary - 1]


def test_a_yo_that_turns_below_the_threshold_stays_in_one_cycle():
    depth = np.concatenate([yo(200.0), yo(200.0, 12.0)])
    depth[550:650] = np.maximum(depth[550:650], 12.0)
    np.testing.assert_array_equal(cycle_boundaries(depth), [0, len(depth) - 1])
    assert len(cycle_boundaries(depth, fraction=0.1)) == 3


def test_cycle_boundaries_skip_missing_samples():
    depth = np.concatenate([yo(100.0), yo(100.0)])
    depth[::7] = np.nan
    assert len(cycle_boundaries(depth)) == 3
    np.testing.assert_array_equal(cycle_boundaries(np.full(10, np.nan)), [0, 9])


def test_a_known_surface_level_separates_dives_of_a_drifting_depth_sensor():
    """A sensor that drifts by more than the margin joins two dives, unless its reading at the surface is given."""
    depth = np.concatenate(
        [np.zeros(200), yo(100.0)[: YO // 2], yo(100.0, 4.0)[YO // 2 :], np.full(300, 4.0), yo(80.0, 4.0)]
    )
    level = np.where(np.arange(len(depth)) < 200 + YO // 2, 0.0, 4.0)
    time = np.arange(len(depth), dtype=float)
    assert detect_profiles(time, depth).max() == 1
    numbers = detect_profiles(time, depth, surface_level=level)
    assert numbers.max() == 2
    assert depth[numbers == 2].min() > 6.0


@pytest.mark.parametrize("offset", [8.0, 10.13, 14.0])
def test_profiles_of_a_record_with_an_offset_of_depth(offset, caplog):
    depth = record([100.0, 80.0, 120.0], 300, 0.5)
    time = np.arange(len(depth), dtype=float)
    np.testing.assert_array_equal(detect_profiles(time, depth + offset), detect_profiles(time, depth))
    (message,) = caplog.messages
    assert f"depth is rarely less than {offset + 0.5:.1f} m" in message


@pytest.mark.parametrize(("turn", "stay"), [(10.0, 100), (20.0, 400)], ids=["short", "deep"])
def test_yos_that_turn_or_stay_below_the_surface_are_one_profile(turn, stay, caplog):
    parts = [np.concatenate([yo(maximum, turn), np.full(stay, turn)]) for maximum in (100.0, 80.0, 120.0)]
    depth = np.concatenate(parts)
    assert set(detect_profiles(np.arange(len(depth), dtype=float), depth)) == {1}
    assert caplog.messages == []


@pytest.mark.parametrize(("longest", "expected"), [(1000.0, 1), (800.0, 2)])
def test_a_long_pause_breaks_a_profile(longest, expected):
    depth = record([100.0], 200, 1.0)
    time = np.arange(len(depth), dtype=float)
    time[200 + YO // 2 :] += 900.0
    numbers = detect_profiles(time, depth, record_break=longest)
    assert numbers.max() == expected
    assert np.count_nonzero(numbers) == np.count_nonzero(detect_profiles(time, depth))


def test_chosen_numbers_are_spread_evenly_first_and_last_among_them():
    assert evenly_spaced([5], 3) == [5]
    assert evenly_spaced([3, 7, 9], 1) == [3]
    assert evenly_spaced([2, 4, 8, 16, 32], 3) == [2, 8, 32]
    assert evenly_spaced([2, 4, 8, 16, 32], 2) == [2, 32]
    assert evenly_spaced(list(range(10, 20)), 4) == [10, 13, 16, 19]
    assert evenly_spaced([2, 4, 8], 3) == evenly_spaced([2, 4, 8], 9) == [2, 4, 8]
