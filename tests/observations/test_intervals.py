"""Sample intervals by time: rates that change with depth, gaps, bursts, and evenly sampled records."""

import numpy as np
import pytest
from support.missions import replaced
from support.records import record

from gliderhpc.estimation.preparation import fed_samples
from gliderhpc.estimation.resample import on_steps
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.observations.importing.workflow import median_interval
from gliderhpc.observations.intervals import local_intervals, usual_interval, without_gaps

SETTINGS = EstimationSettings.model_validate({"seawater": "depth_slope"})


def times(*stretches: tuple[float, float]) -> np.ndarray:
    """Return sample times over consecutive stretches of (interval, duration), s."""
    intervals = np.concatenate([np.full(round(duration / interval), interval) for interval, duration in stretches])
    return np.concatenate([[0.0], np.cumsum(intervals)])


CHANGING = ((5.0, 3000.0), (30.0, 9000.0), (5.0, 3000.0))


@pytest.mark.parametrize("interval", [0.5, 1.0, 4.0, 20.0, 30.0])
def test_an_even_record_has_its_interval_to_the_bit(interval):
    time = interval * np.arange(201)
    series = on_steps(record(time), SETTINGS)
    assert series.sample_interval == interval == float(np.median(np.diff(time)))
    assert series.gap_seconds == 0.0
    np.testing.assert_array_equal(local_intervals(np.diff(time)), interval)


def test_a_rate_that_changes_with_depth_makes_no_gap():
    """By samples the median is 5 s, and 30 s, in which most of the time passes, would be a row of gaps."""
    time = times(*CHANGING)
    assert np.median(np.diff(time)) == 5.0
    series = on_steps(record(time), SETTINGS)
    assert series.gap_seconds == 0.0
    assert series.sample_interval == 30.0
    nanoseconds = np.datetime64("2024-05-01", "ns") + (time * 1e9).astype("timedelta64[ns]")
    assert median_interval(nanoseconds, [(0, len(time))]) == 30.0


@pytest.mark.parametrize(("begin", "hole"), [(1000.0, 60.0), (6000.0, 400.0), (14000.0, 30.0), (2970.0, 700.0)])
def test_real_gaps_stay_masked_where_the_sampling_rate_changes(begin, hole):
    """In the fast part after what is no gap in the slow one; at a change of the rate too."""
    time = times(*CHANGING)
    time = time[(time <= begin) | (time >= begin + hole)]
    series = on_steps(record(time), SETTINGS)
    first, last = time[time <= begin][-1], time[time >= begin + hole][0]
    masked = series.time[series.weights == 0.0]
    assert masked[0] == pytest.approx(first + 0.1)
    assert masked[-1] == pytest.approx(last - 0.1)
    assert series.sample_interval == 30.0


def test_a_gap_longer_than_all_the_rest_does_not_become_the_interval():
    time = times((1.0, 600.0), (3000.0, 3000.0), (1.0, 600.0))
    series = on_steps(record(time), SETTINGS)
    assert series.sample_interval == 1.0
    assert series.gap_seconds == pytest.approx(3000.0, abs=0.2)


def test_pauses_between_bursts_are_the_record_s_way():
    time = times(*[(5.0, 15.0), (60.0, 60.0)] * 40)
    series = on_steps(record(time), SETTINGS)
    assert series.gap_seconds == 0.0
    assert series.sample_interval == 60.0


def test_a_set_limit_holds_everywhere():
    settings = SETTINGS.model_copy(update={"max_gap": 10.0})
    series = on_steps(record(times(*CHANGING)), settings)
    assert series.gap_seconds == pytest.approx(9000.0, rel=0.02)
    assert series.sample_interval == 5.0


def test_quantiles_by_time():
    intervals = np.array([1.0] * 60 + [20.0] * 2)
    assert usual_interval(intervals) == 1.0
    assert usual_interval(intervals, 0.9) == 20.0
    assert np.isnan(usual_interval([]))
    np.testing.assert_array_equal(without_gaps([7.0]), [7.0])
    assert len(without_gaps(np.append(np.ones(40), 12.0))) == 40


def test_the_filter_is_fed_what_each_stretch_knows():
    """Every feed weighs as much: six a second where the record has a sample in 5 s, one where it has one in 30 s."""
    series = on_steps(record(times(*CHANGING)), SETTINGS)
    fed = fed_samples(series, SETTINGS)
    assert fed[:30000].sum() == pytest.approx(6.0 * 3000.0, abs=2)
    assert fed[30000:120000].sum() == pytest.approx(9000.0, abs=2)
    even = replaced(series, sample_index=np.arange(0, len(series.time), 300))
    assert (np.flatnonzero(fed_samples(even, SETTINGS)) % 10 == 0).all()
