"""Rests at one depth, as on the bottom, that the model does not follow: they are left out."""

import numpy as np
import pytest
from support.missions import glide_series, replaced

from gliderhpc.errors import ProfileError
from gliderhpc.estimation.filter import run_filter
from gliderhpc.estimation.preparation import prepare_profile
from gliderhpc.estimation.profile import estimate_profile, estimate_profiles
from gliderhpc.estimation.quality import remarks
from gliderhpc.estimation.rests import describe_rests, run_filters_around_rests
from gliderhpc.estimation.self_motion import glide_angle_motion
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.flight.glider import Glider
from gliderhpc.flight.steady_glide import steady_glide
from gliderhpc.observations.dive_phases import find_rests
from gliderhpc.platform import read_platform

pytestmark = pytest.mark.compiled

PETREL = read_platform("petrel-l")
GLIDER = Glider(PETREL)
SETTINGS = EstimationSettings()


def glide_with_rest(rest, glide=240.0):
    """A profile in steady descent that lies on the ground, level, for `rest` seconds, and descends again after that."""
    step = SETTINGS.step
    before, resting = round(glide / step), round(rest / step)
    steady = steady_glide(GLIDER, 0.4, -np.radians(23.0), 100.0)
    volume = PETREL.buoyancy.neutral_volume_m3 - steady.net_mass / PETREL.buoyancy.water_density
    controls = np.tile([steady.battery_position, 0.0, volume, 0.0], (2 * before, 1))
    series, _ = glide_series(PETREL, steady.state, controls)
    landed = np.tile(series.measurements[before], (resting, 1))
    landed[:, :2] = np.radians([4.0, 1.0])
    measurements = np.vstack([series.measurements[:before], landed, series.measurements[before:]])
    points = len(measurements)
    series = replaced(
        series, time=step * np.arange(points), measurements=measurements, weights=np.ones(points),
        controls=np.tile(controls[0], (points - 1, 1)), sample_index=np.arange(0, points, round(1.0 / step)),
    )  # fmt: skip
    return prepare_profile(GLIDER, series)


@pytest.fixture(scope="module")
def landed():
    return glide_with_rest(120.0)


def test_a_profile_with_a_rest_is_inverted_without_it(landed):
    with pytest.raises(ProfileError, match="at one depth"):
        run_filter(landed, SETTINGS)
    estimate = estimate_profile(landed, SETTINGS)
    ((begin, stop),) = estimate.series.rests
    assert (stop - begin) * SETTINGS.step == pytest.approx(120.0, abs=25.0)
    assert estimate.filtered.rejected_fraction < 0.02
    usable = [window.outcome.usable for window in estimate.solution.windows]
    assert np.mean(usable) > 0.7
    (line,) = [line for line in remarks(PETREL, estimate) if line.startswith("left out")]
    assert "did not glide" in line


def test_in_the_rest_the_glider_does_not_move(landed):
    estimate = estimate_profile(landed, SETTINGS)
    ((begin, stop),) = estimate.series.rests
    flown = np.linalg.norm(np.diff(estimate.solution.states[:, 3:5], axis=0), axis=1)
    # The model coasts for some metres after landing; a glide would take it 40 m.
    assert flown[begin:stop].sum() < 20.0
    conventional = glide_angle_motion(PETREL, estimate.series, estimate.vibrating)
    assert not conventional.steps[begin : stop - 1].any()
    assert abs(estimate.solution.states[stop, 5] - landed.series.measurements[stop, 3]) < 2.0


def test_profiles_without_rests_are_not_changed(landed):
    profiles = [("rest", landed), ("glide", glide_with_rest(0.0))]
    used, estimates = run_filters_around_rests(profiles, SETTINGS)
    assert used[1][1] is profiles[1][1]
    alone = run_filter(profiles[1][1], SETTINGS)
    assert np.array_equal(estimates[1].states, alone.states)
    together = dict(estimate_profiles(profiles, SETTINGS))
    assert together["rest"].series.rests
    assert not together["glide"].series.rests


def test_a_refusal_stays_that_of_the_whole_record():
    """Where the hull does not fit, a rest is not the reason."""
    task = glide_with_rest(90.0)
    wrong = task.series.measurements.copy()
    wrong[:, 1] += np.radians(25.0) * np.sign(np.sin(np.arange(len(wrong)) / 40.0))
    task = prepare_profile(GLIDER, replaced(task.series, measurements=wrong))
    with pytest.raises(ProfileError) as whole:
        run_filter(task, SETTINGS)
    used, (error,) = run_filters_around_rests([(1, task)], SETTINGS)
    assert str(error) == str(whole.value)
    assert used[0][1] is task


def test_a_hovering_glider_rests_and_a_slow_record_of_a_turn_does_not():
    hovering = glide_with_rest(180.0).series
    depth = hovering.measurements[:, 3]
    begin = 2400
    depth[begin : begin + 1800] += 0.8 * np.sin(np.arange(1800) / 150.0)
    ((first, last),) = find_rests(hovering)
    assert (first, last) == (pytest.approx(begin, abs=150), pytest.approx(begin + 1800, abs=150))
    turn = 100.0 - np.abs(np.arange(6001) - 3000) * 0.015
    slow = replaced(hovering, measurements=np.column_stack([np.zeros((6001, 3)), turn]), weights=np.ones(6001))
    slow = replaced(slow, time=0.1 * np.arange(6001), sample_interval=60.0)
    assert find_rests(slow) == []


def test_rests_at_different_depths_are_described_by_both():
    """All of them had been at the depth of the longest."""
    series = glide_with_rest(120.0).series
    depth = series.measurements[:, 3]
    rests = tuple(
        (int(np.argmin(np.abs(depth - at))), int(np.argmin(np.abs(depth - at))) + 300) for at in (110.0, 170.0)
    )
    (line,) = describe_rests(replaced(series, rests=rests))
    low, high = (float(np.median(depth[begin:stop])) for begin, stop in rests)
    assert f" at {low:.0f} to {high:.0f} m, in 2 parts, " in line
    assert "is up to " in line
