"""Noise and rounding of the sensors, found in the record where they are larger than the platform file states."""

from dataclasses import replace

import numpy as np
import pytest

from gliderhpc.estimation.filter import run_filter
from gliderhpc.estimation.preparation import prepare_profile, stated_variance
from gliderhpc.estimation.profile import estimate_profile
from gliderhpc.estimation.quality import remarks
from gliderhpc.estimation.resample import on_steps
from gliderhpc.estimation.sensor_noise import noise_of_record, noisier_than_stated, sample_variance
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.estimation.smoother.iterate import run_smoother
from gliderhpc.flight.glider import Glider
from gliderhpc.platform import read_platform
from gliderhpc.simulator import load_scenario, simulate_profile

pytestmark = pytest.mark.compiled

PETREL = read_platform("petrel-l")
SETTINGS = EstimationSettings(step=0.25)
ANGLES = ("roll", "pitch", "heading")


def twin(name, seed=1):
    return simulate_profile(PETREL, load_scenario(name).replaced({"depth": 80.0, "depth_spread": 0.0}), seed)


def series(record):
    return on_steps(record, SETTINGS, PETREL)


def with_noise(record, degrees, metres=0.0):
    rng, n = np.random.default_rng(4), len(record.time)
    angles = {name: getattr(record, name) + np.radians(degrees) * rng.standard_normal(n) for name in ANGLES}
    return replace(record, **angles, depth=record.depth + metres * rng.standard_normal(n))


@pytest.mark.parametrize("name", ["calm", "impulses", "stratified", "demo", "paper", "harsh"])
def test_sensors_as_stated_have_the_noise_stated(name):
    """Motion is not noise: neither impulses, nor the roll that gusts cause from sample to sample."""
    record, _ = twin(name)
    np.testing.assert_array_equal(sample_variance(PETREL, series(record)), stated_variance(PETREL))


@pytest.mark.parametrize("name", ["calm", "impulses", "demo"])
@pytest.mark.parametrize("degrees", [0.1, 0.4])
def test_louder_noise_is_found(name, degrees):
    record, _ = twin(name)
    found = noisier_than_stated(PETREL, series(with_noise(record, degrees, 0.2)))
    assert [found[name] for name in ANGLES] == pytest.approx([degrees] * 3, rel=0.15)
    assert found["depth"] == pytest.approx(0.2, rel=0.15)


def test_values_that_are_all_noise_are_no_measurement():
    record, _ = twin("calm")
    junk = series(with_noise(record, 20.0))
    np.testing.assert_array_equal(sample_variance(PETREL, junk), stated_variance(PETREL))


@pytest.mark.parametrize("name", ["calm", "impulses"])
def test_coarser_angles_have_the_variance_of_their_rounding(name):
    record, _ = twin(name)
    quantum = np.radians(0.5)
    coarse = replace(record, **{name: quantum * np.round(getattr(record, name) / quantum) for name in ANGLES})
    found = noisier_than_stated(PETREL, series(coarse))
    assert found["pitch"] == pytest.approx(0.5 / np.sqrt(12.0), rel=0.05)
    assert "depth" not in found


def test_slow_and_short_records_do_not_show_noise():
    record, _ = twin("calm")
    loud = series(with_noise(record, 0.4))
    np.testing.assert_array_equal(noise_of_record(PETREL, replace(loud, sample_interval=4.0)), 0.0)
    np.testing.assert_array_equal(noise_of_record(PETREL, replace(loud, sample_index=loud.sample_index[:30])), 0.0)


@pytest.mark.parametrize("degrees", [0.1, 0.3])
def test_a_noisy_compass_does_not_change_the_speed(degrees):
    """With the noise stated, 0.1 degree moves the speed by 0.02 m/s, and 0.2 degree makes the filter refuse."""
    record, truth = twin("calm", 2)
    profile = prepare_profile(Glider(PETREL), series(with_noise(record, degrees)))
    found, time = run_smoother(profile, run_filter(profile, SETTINGS), SETTINGS), profile.series.time
    steady = ~profile.vibrating & (time > 60.0) & (time < truth.time[-1])
    error = found.states[:, 6] - np.interp(time, truth.time, truth.states[:, 6])
    assert np.sqrt(np.mean(error[steady] ** 2)) < 0.006


def test_the_profile_says_what_noise_it_has():
    record, _ = twin("calm")
    profile = prepare_profile(Glider(PETREL), series(with_noise(record, 0.3)))
    lines = remarks(PETREL, estimate_profile(profile, SETTINGS))
    (line,) = (line for line in lines if "noise taken from the record" in line)
    assert "pitch 0.3" in line
    assert "depth" not in line


def test_a_few_values_between_two_levels_are_no_resolution():
    """A pitch held at two values, with four others in the turn between, does not reveal its sensor's resolution."""
    record, _ = twin("calm")
    count = len(record.time)
    pitch = np.where(np.arange(count) < count // 2, -23.0, 23.0)
    pitch[count // 2 : count // 2 + 4] = [-9.7, 1.3, 12.9, 20.1]
    found = noisier_than_stated(PETREL, series(replace(record, pitch=np.radians(pitch))))
    assert "pitch" not in found
