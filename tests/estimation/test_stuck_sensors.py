"""Headings or depths that are stuck are refused; steady glides, coarse sensors and the surface are not."""

from dataclasses import replace

import numpy as np
import pytest

from gliderhpc.errors import ProfileError
from gliderhpc.estimation.record_screening import check_sensors
from gliderhpc.estimation.resample import on_steps
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.platform import read_platform
from gliderhpc.simulator import load_scenario, simulate_profile

pytestmark = pytest.mark.compiled

PETREL = read_platform("petrel-l")
ANGLES = ("roll", "pitch", "heading")


def twin(name, seed=1):
    return simulate_profile(PETREL, load_scenario(name).replaced({"depth": 120.0, "depth_spread": 0.0}), seed)[0]


def stopped(record, name, first, last):
    values = getattr(record, name).copy()
    values[int(first * len(values)) : int(last * len(values))] = values[int(first * len(values))]
    return replace(record, **{name: values})


def with_noise(record, degrees=0.2):
    rng = np.random.default_rng(2)
    noise = np.radians(degrees) * rng.standard_normal((3, len(record.time)))
    return replace(record, **{name: getattr(record, name) + one for name, one in zip(ANGLES, noise, strict=True)})


@pytest.mark.parametrize(("first", "last"), [(0.2, 0.5), (0.5, 1.0), (0.0, 1.0)])
def test_a_depth_that_stopped_is_refused(first, last):
    """Before, the speed was wrong by 0.37 m/s, at a deviation of 0.01."""
    with pytest.raises(
        ProfileError, match=r"profile 1: the depth stays at [\d.]+ m for \d+ minutes, from \d+ s on, at"
    ):
        on_steps(stopped(twin("impulses"), "depth", first, last), EstimationSettings(), PETREL)


@pytest.mark.parametrize(("first", "last"), [(0.2, 0.6), (0.0, 1.0)])
def test_a_heading_that_stopped_is_refused(first, last):
    with pytest.raises(ProfileError, match="heading is constant over"):
        check_sensors(stopped(with_noise(twin("impulses")), "heading", first, last))


@pytest.mark.parametrize("quantum", [0.1, 1.0])
@pytest.mark.parametrize("name", ["calm", "impulses", "stratified", "demo", "paper", "harsh"])
def test_coarsely_rounded_sensors_are_not_taken_for_stuck_ones(name, quantum):
    """In calm water a heading rounded to a degree stays the same for most of the dive."""
    record = twin(name)
    angles = {one: np.radians(quantum * np.round(np.degrees(getattr(record, one)) / quantum)) for one in ANGLES}
    check_sensors(replace(record, **angles, depth=quantum * np.round(record.depth / quantum)))


def test_depth_may_stay_the_same_at_the_surface():
    record = twin("calm")
    interval = np.median(np.diff(record.time))
    before = np.arange(-1000.0, 0.0) * interval + record.time[0]
    columns = {
        name: np.concatenate([np.full(len(before), getattr(record, name)[0]), getattr(record, name)])
        for name in (*ANGLES, "battery_position", "battery_rotation", "ballast_volume", "rudder", "depth")
    }
    check_sensors(replace(record, time=np.concatenate([before, record.time]), **columns))
