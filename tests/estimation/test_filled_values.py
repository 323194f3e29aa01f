"""Repeated and interpolated values are distinguished from measurements and from rounding, at even and uneven times."""

from dataclasses import fields, replace

import numpy as np
import pytest

from gliderhpc.estimation.filled_values import without_filled_values
from gliderhpc.estimation.preparation import prepare_profile
from gliderhpc.estimation.profile import estimate_profile
from gliderhpc.estimation.quality import remarks
from gliderhpc.estimation.resample import on_steps
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.flight.glider import Glider
from gliderhpc.observations.format import MEASURED
from gliderhpc.platform import read_platform
from gliderhpc.simulator import load_scenario, simulate_profile

pytestmark = pytest.mark.compiled

PETREL = read_platform("petrel-l")
ANGLES = ("roll", "pitch", "heading")


@pytest.fixture(scope="module")
def twins():
    """Records of four scenarios at 1 s: attitude rounded to 0.1 degree, which hardly changes in calm water."""
    return {
        name: simulate_profile(PETREL, load_scenario(name).replaced({"depth": 80.0, "depth_spread": 0.0}), 1)
        for name in ("calm", "impulses", "demo", "paper")
    }


def columns(record):
    return [one.name for one in fields(record) if np.shape(getattr(record, one.name)) == record.time.shape]


def take(record, rows):
    return replace(record, **{name: getattr(record, name)[rows] for name in columns(record)})


def uneven(record):
    """Return samples 3 to 7 s apart, at times between those of the record's rows."""
    rows = np.cumsum(np.random.default_rng(5).integers(3, 8, len(record.time) // 5))
    shifted = take(record, rows[rows < len(record.time)])
    return replace(shifted, time=shifted.time + 0.37)


def filled(record, measured, how, names=MEASURED):
    """Return a record with values of some measured samples repeated or interpolated at its own times."""
    time, content = record.time, {}
    for name in names:
        values = np.unwrap(getattr(measured, name)) if name == "heading" else getattr(measured, name)
        before = np.clip(np.searchsorted(measured.time, time, side="right") - 1, 0, len(values) - 1)
        content[name] = values[before] if how == "repeated" else np.interp(time, measured.time, values)
    if "heading" in content:
        content["heading"] = np.mod(content["heading"], 2.0 * np.pi)
    return replace(record, **content)


@pytest.mark.parametrize("how", ["repeated", "interpolated"])
@pytest.mark.parametrize("every", [2, 4, 15])
@pytest.mark.parametrize("name", ["calm", "impulses"])
def test_values_filled_at_even_times_are_left_out(twins, name, every, how):
    record, _ = twins[name]
    rows = np.arange(0, len(record.time), every)
    found, names = without_filled_values(filled(record, take(record, rows), how))
    assert sorted(names) == sorted(MEASURED)
    for one in MEASURED:
        kept = np.flatnonzero(np.isfinite(getattr(found, one)))
        # The rows after the last measured one cannot be interpolated.
        assert np.isin(kept[kept <= rows[-1]], rows).all()
        assert len(kept) > 0.9 * len(rows)


@pytest.mark.parametrize("how", ["repeated", "interpolated"])
@pytest.mark.parametrize("name", ["impulses", "paper"])
def test_values_filled_at_uneven_times_are_left_out(twins, name, how):
    record, _ = twins[name]
    measured = uneven(record)
    with_filled = filled(record, measured, how)
    found, names = without_filled_values(with_filled)
    assert "depth" in names
    kept = np.isfinite(found.depth)
    assert abs(np.count_nonzero(kept) - len(measured.time)) < 0.1 * len(measured.time)
    # The rows kept are the nearest to the measured samples.
    distance = np.abs(record.time[kept][:, None] - measured.time).min(axis=1)
    assert np.quantile(distance, 0.9) <= 0.64


@pytest.mark.parametrize("how", ["repeated", "interpolated"])
@pytest.mark.parametrize("rates", [(4, 6), (5, 15), (4, 8)])
def test_the_rate_may_change_with_depth(twins, rates, how):
    """Taken for their common divisor, half of the filled values would remain."""
    record, _ = twins["impulses"]
    half = len(record.time) // 2
    rows = np.concatenate([np.arange(0, half, rates[0]), np.arange(half, len(record.time), rates[1])])
    found, _ = without_filled_values(filled(record, take(record, rows), how))
    for name in ("depth", "pitch"):
        kept = np.flatnonzero(np.isfinite(getattr(found, name)))
        assert len(rows) - 20 < len(kept) < 1.5 * len(rows)


@pytest.mark.parametrize("names", [ANGLES, ("depth",)])
def test_only_the_instrument_concerned_loses_values(twins, names):
    record, _ = twins["impulses"]
    with_filled = filled(record, take(record, np.arange(0, len(record.time), 4)), "interpolated", names)
    found, lost = without_filled_values(with_filled)
    assert lost == names
    for one in set(MEASURED) - set(names):
        assert getattr(found, one) is getattr(with_filled, one)


@pytest.mark.parametrize("quantum", [None, 0.5, 1.0])
@pytest.mark.parametrize("name", ["calm", "impulses", "demo", "paper"])
def test_measurements_are_kept_however_coarse(twins, name, quantum):
    record, _ = twins[name]
    if quantum is not None:
        content = {one: np.radians(quantum * np.round(np.degrees(getattr(record, one)) / quantum)) for one in ANGLES}
        record = replace(record, **content, depth=quantum * np.round(record.depth / quantum))
    rng = np.random.default_rng(3)
    uneven_times = replace(record, time=record.time + rng.uniform(-0.3, 0.3, len(record.time)))
    some = take(record, np.flatnonzero(rng.random(len(record.time)) < 0.7))
    bursts = take(record, np.flatnonzero((record.time // 20) % 2 == 0))
    slow = take(record, np.arange(0, len(record.time), 5))
    for one in (record, uneven_times, some, bursts, slow):
        assert without_filled_values(one) == (one, ())


def test_a_glide_without_noise_is_kept(twins):
    _, truth = twins["calm"]
    record, _ = twins["calm"]
    states = {
        name: np.interp(record.time, truth.time, truth.states[:, i])
        for name, i in zip(MEASURED, (0, 1, 2, 5), strict=True)
    }
    clean = replace(record, **states)
    assert without_filled_values(clean) == (clean, ())


@pytest.mark.parametrize(("speed", "quantum"), [(0.1, 0.3), (0.1, 0.5), (0.15, 0.3)])
def test_a_coarse_depth_at_a_constant_speed_is_kept(twins, speed, quantum):
    """Its steps have regular distances, but all are of one quantum."""
    record, _ = twins["impulses"]
    depth = speed * record.time + 0.02 * np.random.default_rng(1).standard_normal(len(record.time))
    coarse = replace(record, depth=quantum * np.round(depth / quantum))
    assert without_filled_values(coarse) == (coarse, ())


def test_nothing_is_left_out_without_common_times(twins):
    """Attitude measured between the samples of depth, both interpolated: there is no sample of all four."""
    record, _ = twins["impulses"]
    attitude, depth = np.arange(0, len(record.time), 4), np.arange(2, len(record.time), 4)
    with_filled = filled(record, take(record, attitude), "interpolated", ANGLES)
    with_filled = filled(with_filled, take(record, depth), "interpolated", ("depth",))
    assert without_filled_values(with_filled) == (with_filled, ())


def test_filled_values_do_not_change_the_speed_and_are_mentioned_in_the_message(twins):
    """Taken for measurements, these values gave a speed wrong by 0.02 m/s, five times its deviation."""
    record, truth = twins["calm"]
    with_filled = filled(record, take(record, np.arange(0, len(record.time), 4)), "interpolated")
    settings = EstimationSettings(step=0.25)
    estimate = estimate_profile(
        prepare_profile(Glider(PETREL), on_steps(with_filled, settings, PETREL)), settings, with_hull=True
    )
    records = slice(None, None, 4)
    time = estimate.series.time[records]
    steady = ~estimate.vibrating[records] & (time > 60.0) & (time < truth.time[-1])
    error = (estimate.smoothed.states[:, 6] - np.interp(time, truth.time, truth.states[:, 6]))[steady]
    assert np.sqrt(np.mean(error**2)) < 2.0 * np.nanmean(estimate.smoothed.states_std[steady, 6])
    (line,) = (line for line in remarks(PETREL, estimate) if "interpolated" in line)
    assert line == (
        "values of roll, pitch, heading, depth are repeated or interpolated between measurements; only the "
        "measurements are used, every 4 s"
    )
