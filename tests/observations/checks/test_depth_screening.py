"""Dropouts, spikes and noise in a depth record."""

import numpy as np
import pytest
from support.glides import Glide, mission

from gliderhpc.observations.checks.depth_screening import impossible_depths, noise_window, smoothed_depth


def _record(interval=4.0):
    records = mission(Glide(interval=interval))
    return (records["time"].values - records["time"].values[0]) / np.timedelta64(1, "s"), records["depth"].values


@pytest.mark.parametrize("interval", [1.0, 4.0, 20.0])
def test_nothing_is_found_in_a_clean_record(interval):
    assert not impossible_depths(*_record(interval)).any()


@pytest.mark.parametrize("interval", [1.0, 4.0, 20.0])
@pytest.mark.parametrize(("share", "offset"), [(0.003, None), (0.01, None), (0.01, 100.0), (0.05, None)])
def test_dropouts_and_spikes_are_found_and_nothing_else(interval, share, offset):
    time, depth = _record(interval)
    corrupted, bad = depth.copy(), np.random.default_rng(3).random(len(depth)) < share
    corrupted[bad] = 0.0 if offset is None else depth[bad] + offset
    found = impossible_depths(time, corrupted)
    far = bad & (np.abs(corrupted - depth) > 60.0)
    assert not (found & ~bad).any()
    # The first and the last sample, and one next to a run of others, may be missed.
    assert np.count_nonzero(far & ~found) <= 0.03 * np.count_nonzero(far)


@pytest.mark.parametrize("length", [2, 3, 5])
def test_a_short_run_is_found_whole(length):
    time, depth = _record()
    deepest = int(np.argmax(depth))
    run = slice(deepest - 200, deepest - 200 + length)
    depth[run] = 0.0
    assert np.flatnonzero(impossible_depths(time, depth)).tolist() == list(range(run.start, run.stop))


def test_missing_depths_and_short_records_are_accepted():
    time, depth = _record()
    depth[::7] = np.nan
    assert not impossible_depths(time, depth).any()
    assert not impossible_depths(time[:5], np.full(5, np.nan)).any()


def test_a_clean_record_needs_no_smoothing_and_a_noisy_one_does():
    """The window is (12 sigma**2 dt / 0.02**2)**(1/3): 49 s for 2 m at 1 Hz."""
    time, depth = _record(1.0)
    dive = depth > 5.0
    time, depth = time[dive][:6000], depth[dive][:6000]
    assert noise_window(time, depth) == 0.0
    noisy = depth + 2.0 * np.random.default_rng(1).standard_normal(len(depth))
    assert noise_window(time, noisy) == pytest.approx(49.3, rel=0.05)


def test_smoothing_leaves_a_straight_line_and_reduces_noise():
    time = np.cumsum(np.random.default_rng(2).uniform(0.5, 1.5, 2000))
    line = 10.0 + 0.15 * time
    line[500:510] = np.nan
    np.testing.assert_allclose(smoothed_depth(time, line, 49.0), line, atol=1e-6)
    noise = np.random.default_rng(3).standard_normal(len(time))
    left = smoothed_depth(time, line + noise, 49.0) - line
    assert np.nanstd(left[100:-100]) < 0.25
