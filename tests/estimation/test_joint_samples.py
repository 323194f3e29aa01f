"""Records whose depth and attitude are in different rows."""

from dataclasses import replace

import numpy as np
from support.records import record

from gliderhpc.estimation.glide_currents import on_points
from gliderhpc.estimation.record_screening import jointly_sampled
from gliderhpc.estimation.resample import on_steps
from gliderhpc.estimation.settings import EstimationSettings

TIME = np.arange(0.0, 400.0, 2.0)
ANGLES = ("roll", "pitch", "heading")


def only(rows, values):
    return np.where(rows, values, np.nan)


def in_turns(first):
    """Depth in the rows of a mask, attitude in the others."""
    whole = record(TIME)
    return replace(whole, depth=only(first, whole.depth), **{n: only(~first, getattr(whole, n)) for n in ANGLES})


def test_each_sample_of_the_attitude_is_moved_once_to_the_nearest_depth():
    turns = in_turns(np.arange(len(TIME)) % 4 == 0)
    found = jointly_sampled(turns)
    np.testing.assert_array_equal(found.depth, turns.depth)
    for name in ANGLES:
        before, after = getattr(turns, name), getattr(found, name)
        known = np.isfinite(after)
        assert set(after[known]) <= set(before[np.isfinite(before)])
        assert known.sum() == np.isfinite(before).sum()
        assert known[::4][1:-1].all()
        assert (np.abs(after - getattr(record(TIME), name))[known] <= 0.021).all(), "two seconds at most"


def test_the_record_is_that_of_the_depths():
    turns = in_turns(np.arange(len(TIME)) % 2 == 0)
    whole = record(TIME)
    for series in (on_steps(turns, EstimationSettings()), on_points(turns)):
        assert series.sample_interval == 4.0
        assert (series.weights == 1.0).all()
        np.testing.assert_allclose(series.measurements[:, 1], np.interp(series.time, TIME, whole.pitch), atol=5e-4)


def test_records_with_samples_of_everything_are_left_alone():
    whole = record(TIME)
    assert jointly_sampled(whole) is whole
    thin = replace(whole, depth=only(np.arange(len(TIME)) % 5 == 0, whole.depth))
    assert jointly_sampled(thin) is thin


def test_an_attitude_far_from_every_depth_is_not_moved():
    early = in_turns(TIME < 200.0)
    found = jointly_sampled(early)
    assert np.count_nonzero(np.isfinite(found.depth) & np.isfinite(found.pitch)) <= 1
