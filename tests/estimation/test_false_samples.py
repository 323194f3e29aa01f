"""Isolated false samples are left out of fast records, and nothing else is."""

from dataclasses import replace

import numpy as np
import pytest

from gliderhpc.estimation.preparation import prepare_profile
from gliderhpc.estimation.profile import estimate_profile
from gliderhpc.estimation.quality import remarks
from gliderhpc.estimation.record_screening import without_false_controls, without_false_samples
from gliderhpc.estimation.resample import on_steps
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.flight.glider import Glider
from gliderhpc.observations.records import ProfileRecord
from gliderhpc.observations.series import describe_false_samples
from gliderhpc.platform import read_platform
from gliderhpc.simulator import load_scenario, simulate_profile

PETREL = read_platform("petrel-l")
SETTINGS = EstimationSettings(step=0.25)


def turning(n=200, interval=1.0):
    """Return a record that turns through north, with steps of a degree, and rolls for one sample in the middle."""
    time, nothing = interval * np.arange(n, dtype=float), np.zeros(n)
    heading = np.mod(np.radians(np.round(350.0 + 0.2 * time)), 2.0 * np.pi)
    return ProfileRecord(
        number=1, epoch=np.datetime64("2024-01-01", "ns"), time=time, roll=nothing.copy(), pitch=nothing - 0.4,
        heading=heading, depth=0.15 * time, battery_position=nothing, battery_rotation=nothing,
        ballast_volume=nothing, rudder=nothing,
    )  # fmt: skip


def with_false_samples(record, **changes):
    columns = {}
    for name, (rows, size) in changes.items():
        columns[name] = getattr(record, name).copy()
        columns[name][rows] += size
    return replace(record, **columns)


def test_an_isolated_sample_is_left_out_of_its_own_variable():
    record = turning()
    found, count = without_false_samples(
        with_false_samples(record, pitch=([50, 90], 0.3), depth=([120], 20.0), heading=([30], 2.0))
    )
    assert count == 4
    assert np.flatnonzero(np.isnan(found.pitch)).tolist() == [50, 90]
    assert np.flatnonzero(np.isnan(found.depth)).tolist() == [120]
    assert np.flatnonzero(np.isnan(found.heading)).tolist() == [30]
    np.testing.assert_array_equal(found.roll, record.roll)


@pytest.mark.parametrize(
    "record",
    [
        turning(),
        with_false_samples(turning(), roll=(slice(50, 53), 0.4)),
        with_false_samples(turning(), roll=(slice(50, None), 0.4)),
        with_false_samples(turning(), depth=([60], 2.0)),
        with_false_samples(turning(interval=20.0), roll=([50], 0.3)),
    ],
    ids=["north", "three samples", "step", "small", "slow"],
)
def test_jumps_lasting_changes_and_steering_are_not_false_samples(record):
    """Neither the jump at north, nor what lasts, nor a roll of one sample of a slow record, which is steering."""
    found, count = without_false_samples(record)
    assert (found, count) == (record, 0)


@pytest.mark.compiled
@pytest.mark.parametrize("name", ["calm", "impulses", "demo"])
def test_motion_is_no_false_sample(name):
    record, _ = simulate_profile(PETREL, load_scenario(name).replaced({"depth": 80.0, "depth_spread": 0.0}), 1)
    assert without_false_samples(record)[1] == 0


@pytest.mark.compiled
def test_a_record_with_false_samples_is_estimated_with_a_remark():
    """Two in a hundred in every variable; before, the filter refused the profile."""
    record, _ = simulate_profile(PETREL, load_scenario("impulses").replaced({"depth": 80.0, "depth_spread": 0.0}), 1)
    rng, changes = np.random.default_rng(5), {}
    for name, size in (("roll", 0.3), ("pitch", 0.3), ("heading", 0.3), ("depth", 8.0)):
        rows = np.flatnonzero(rng.random(len(record.time)) < 0.02)
        changes[name] = rows, size * rng.standard_normal(len(rows))
    profile = prepare_profile(Glider(PETREL), on_steps(with_false_samples(record, **changes), SETTINGS, PETREL))
    estimate = estimate_profile(profile, SETTINGS)
    assert estimate.filtered.rejected_fraction < 0.03
    assert any("isolated false samples are left out" in line for line in remarks(PETREL, estimate))


def steered(interval=4.0):
    """Return a record whose actuators move: the bladder at half the dive, the battery slowly, its rotation in turns."""
    record = turning(interval=interval)
    half = np.arange(len(record.time)) < len(record.time) // 2
    turn = np.zeros(len(record.time))
    turn[30:32] = turn[70:90] = np.radians(40.0)
    return replace(
        record, ballast_volume=np.where(half, -250e-6, 250e-6), battery_position=np.where(half, 0.02, -0.01),
        battery_rotation=turn,
    )  # fmt: skip


@pytest.mark.parametrize("interval", [1.0, 60.0])
def test_isolated_false_samples_of_actuators_are_left_out_and_named(interval):
    record = with_false_samples(
        steered(interval), ballast_volume=([0, 40, 120, 121], 9999e-6), battery_position=([150], 0.4)
    )
    found, texts = without_false_controls(record)
    assert np.flatnonzero(np.isnan(found.ballast_volume)).tolist() == [0, 40, 120, 121]
    assert np.flatnonzero(np.isnan(found.battery_position)).tolist() == [150]
    np.testing.assert_array_equal(found.battery_rotation, record.battery_rotation)
    position, ballast = texts
    assert position.startswith("1 isolated false sample of battery_position is left out, the first 0.39 m after ")
    assert ballast.startswith("4 isolated false samples of ballast_volume are left out, the first 9749 cm3 after 0 s")


@pytest.mark.parametrize(
    "record",
    [
        steered(),
        steered(60.0),
        with_false_samples(steered(60.0), battery_rotation=([50], 0.8)),
        with_false_samples(steered(), ballast_volume=(slice(50, 53), 9999e-6)),
        with_false_samples(steered(), ballast_volume=([50], 300e-6)),
        with_false_samples(turning(), battery_rotation=([50], 0.8), ballast_volume=([70, 71], 400e-6)),
    ],
    ids=["moved", "slow", "turn", "three samples", "small", "single movements"],
)
def test_movements_of_actuators_are_no_false_samples(record):
    assert without_false_controls(record) == (record, ())


@pytest.mark.compiled
def test_a_false_sample_of_an_actuator_does_not_disturb_the_estimate():
    record, _ = simulate_profile(PETREL, load_scenario("calm").replaced({"depth": 80.0, "depth_spread": 0.0}), 1)
    assert without_false_controls(record)[1] == ()
    false = with_false_samples(record, ballast_volume=([100], 9000e-6))
    series, expected = (on_steps(each, SETTINGS, PETREL) for each in (false, record))
    np.testing.assert_allclose(series.controls, expected.controls, atol=30e-6)
    assert len(describe_false_samples(series)) == 1
