"""Resampling: exact for linear signals, unaffected by wrapped headings, correct in gaps."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.records import EPOCH, record

from gliderhpc.errors import ProfileError
from gliderhpc.estimation.resample import on_steps, resample, sampling_intervals
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.observations.series import averages_between

intervals = st.lists(st.floats(0.2, 5.0), min_size=5, max_size=60)


@given(intervals=intervals, step=st.sampled_from([0.05, 0.1, 0.25, 1.0]))
def test_linear_signals_are_exact(intervals, step):
    time = np.concatenate(([0.0], np.cumsum(intervals)))
    series = resample(record(time), step, max_gap=10.0)
    steps = int(np.floor(time[-1] / step + 1e-6))
    assert series.time.shape == (steps + 1,)
    assert series.controls.shape == (steps, 4)
    middle = series.time[:-1] + 0.5 * step
    # Past the last sample there is nothing to interpolate, so the very last midpoint may hold the last value.
    expected = [0.1 + 1e-3 * series.time, -0.3 + 2e-4 * series.time, 6.0 + 0.01 * series.time, 1.0 + 0.15 * series.time]
    np.testing.assert_allclose(series.measurements, np.column_stack(expected), atol=1e-6)
    np.testing.assert_allclose(series.controls[:, 0], 0.01 + 1e-5 * middle, atol=1e-9)
    np.testing.assert_allclose(series.controls[:, 2], -2e-4 + 1e-7 * middle, atol=1e-11)
    assert series.gap_seconds == 0.0
    assert np.all(series.weights == 1.0)


@given(start=st.floats(-np.pi, np.pi), rate=st.floats(-0.5, 0.5))
def test_heading_turns_through_north_without_a_jump(start, rate):
    time = np.arange(0.0, 60.0)
    wrapped = np.mod(start + rate * time, 2.0 * np.pi)
    heading = resample(record(time, heading=wrapped), 0.1, 10.0).measurements[:, 2]
    assert np.max(np.abs(np.diff(heading))) <= abs(rate) * 0.1 + 1e-9
    turned = heading - (start + rate * np.arange(len(heading)) * 0.1)
    np.testing.assert_allclose(turned - turned[0], 0.0, atol=1e-8)
    assert np.cos(turned[0]) == pytest.approx(1.0)


def test_missing_samples_are_bridged_variable_by_variable():
    time = np.arange(0.0, 101.0)
    pitch = record(time).pitch.copy()
    pitch[40:44] = np.nan
    series = resample(record(time, pitch=pitch), 0.5, max_gap=5.0)
    np.testing.assert_allclose(series.measurements[:, 1], -0.3 + 2e-4 * series.time, atol=1e-12)
    assert series.gap_seconds == 0.0


def test_an_output_interval_that_leaves_no_record_fails_the_profile():
    """Studies had stopped with an error of NumPy on an archive of such a run."""
    flown = record(np.arange(0.0, 101.0))
    with pytest.raises(ProfileError, match=r"an output_interval of 60 s leaves only 2 records of the 100 s, but 3 are"):
        on_steps(flown, EstimationSettings(output_interval=60.0))
    assert len(on_steps(flown, EstimationSettings(output_interval=50.0)).time) == 1001


def test_a_long_gap_of_any_measurement_weighs_nothing():
    time = np.arange(0.0, 101.0)
    pitch = record(time).pitch.copy()
    pitch[40:50] = np.nan
    series = resample(record(time, pitch=pitch), 0.5, max_gap=5.0)
    masked = series.time[series.weights == 0.0]
    assert masked[0] == pytest.approx(39.5)
    assert masked[-1] == pytest.approx(49.5)
    assert series.gap_seconds == pytest.approx(0.5 * len(masked))
    assert 45 * 2 not in series.sample_index
    np.testing.assert_array_equal(series.partial, [(2 * row, column) for column in (0, 2, 3) for row in range(40, 50)])


def test_a_gap_as_long_as_allowed_is_bridged():
    series = resample(record(np.array([0.0, 10.0, 20.0, 30.0, 40.0, 70.0])), 1.0, max_gap=30.0)
    assert series.gap_seconds == 0.0
    assert series.sample_interval == pytest.approx(10.0)
    np.testing.assert_array_equal(series.sample_index, [0, 10, 20, 30, 40, 70])


def test_a_gap_of_a_control_costs_no_weight():
    time = np.arange(0.0, 101.0)
    ballast = record(time).ballast_volume.copy()
    ballast[20:80] = np.nan
    series = resample(record(time, ballast_volume=ballast), 0.5, max_gap=5.0)
    assert series.gap_seconds == 0.0
    assert np.all(np.isfinite(series.controls))


def test_the_grid_spans_what_all_measurements_share():
    time = np.arange(0.0, 101.0)
    depth, roll = record(time).depth.copy(), record(time).roll.copy()
    depth[:3], roll[95:] = np.nan, np.nan
    series = resample(record(time, depth=depth, roll=roll), 0.5, max_gap=5.0)
    assert series.time[0] == 3.0
    assert series.time[-1] == 94.0
    assert series.epoch == EPOCH
    assert series.measurements[0, 3] == pytest.approx(1.45)


def test_too_little_to_interpolate():
    time = np.arange(0.0, 50.0)
    with pytest.raises(ProfileError, match="profile 7: pitch has 0 samples, but at least 2 are needed"):
        resample(record(time, pitch=np.full(50, np.nan)), 0.1, 5.0)
    early, late = np.full(50, np.nan), np.full(50, np.nan)
    early[:10], late[20:] = 0.1, 0.1
    with pytest.raises(ProfileError, match="have no time in common"):
        resample(record(time, roll=early, pitch=late), 0.1, 5.0)


def test_step_must_be_positive():
    with pytest.raises(ValueError, match="step must be positive"):
        resample(record(np.arange(50.0)), 0.0, 5.0)


def test_the_sample_interval_is_that_of_whole_samples():
    time = np.arange(0.0, 41.0)
    roll = np.where(np.arange(41) % 4 == 0, 0.1, np.nan)
    assert resample(record(time), 0.1, 10.0).sample_interval == 1.0
    assert resample(record(time, roll=roll), 0.1, 20.0).sample_interval == 4.0
    assert (sampling_intervals(record(time, roll=roll)) == 4.0).all()
    with pytest.raises(ProfileError, match="never measured together"):
        sampling_intervals(
            record(time, roll=np.where(time < 3.0, 0.1, np.nan), depth=np.where(time > 3.0, 5.0, np.nan))
        )


def test_averages_over_other_steps_are_exact():
    values = np.array([[1.0, -2.0], [3.0, 4.0], [5.0, 0.0]])
    edges = np.array([0.0, 1.0, 1.5, 4.0])
    np.testing.assert_allclose(averages_between(values, edges, edges), values, rtol=1e-14)
    wanted = np.array([0.5, 1.25, 2.0, 4.0])
    expected = [[(0.5 + 0.75) / 0.75, (-1.0 + 1.0) / 0.75], [(0.75 + 2.5) / 0.75, 1.0 / 0.75], [5.0, 0.0]]
    np.testing.assert_allclose(averages_between(values, edges, wanted), expected, atol=1e-14)


def test_actuators_that_lag_act_later_than_recorded():
    """A pump that starts at 20 s by the record starts a second later with a lag of a second; before, it holds still."""
    time = np.arange(50.0)
    pumped = record(time, ballast_volume=1e-6 * np.clip(time - 20.0, 0.0, 10.0))
    prompt, late, early = (resample(pumped, 0.5, max_gap=5.0, actuator_lag=lag).controls[:, 2] for lag in (0, 1, -1))
    np.testing.assert_allclose(late[2:], prompt[:-2], atol=1e-15)
    np.testing.assert_allclose(early[:-2], prompt[2:], atol=1e-15)
    assert late[20 * 2 + 1] == 0.0 < prompt[20 * 2 + 1]
