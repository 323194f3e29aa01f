"""Currents: GPS displacement minus the glider's own motion (eqs. 39, 40), and the glide-angle method (eq. 15)."""

from dataclasses import replace

import numpy as np
import pytest
from geographiclib.geodesic import Geodesic
from hypothesis import given, settings
from hypothesis import strategies as st
from support.missions import glide_series, replaced

from gliderhpc.estimation.current_errors import (
    CALIBRATED,
    CurrentErrors,
    CurrentSettings,
    CurrentUncertainty,
    Drift,
    current_uncertainty,
)
from gliderhpc.estimation.currents import (
    MIN_CYCLE,
    current_from_displacement,
    cycles_of,
    depth_averaged_current,
    local_displacement,
    single_cycle,
    surface_drift,
    surface_variance,
    track_of,
    with_disagreement,
)
from gliderhpc.estimation.self_motion import (
    SelfMotion,
    angle_of_attack,
    bridge,
    glide_angle_motion,
    horizontal_speed,
    model_motion,
)
from gliderhpc.flight.glider import Glider
from gliderhpc.flight.hull_parameters import with_covariance
from gliderhpc.flight.steady_glide import least_glide_angle, steady_angle_of_attack, steady_glide
from gliderhpc.observations import Fix, ProfileRecord, ProfileSeries
from gliderhpc.platform import read_platform, shipped_platforms, with_overrides
from gliderhpc.platform_sections import CalibrationErrors

EPOCH = np.datetime64("2024-05-01T12:00:00", "ns")
PETREL = read_platform("petrel-l")
STEP = 0.1


def fix(seconds, latitude, longitude):
    return Fix(EPOCH + np.timedelta64(round(seconds * 1e9), "ns"), latitude, longitude)


def moved_fix(origin, seconds, north, east):
    """Return the fix (north, east) metres from another, along the geodesic (not with the method under test)."""
    azimuth, distance = np.degrees(np.arctan2(east, north)), np.hypot(north, east)
    point = Geodesic.WGS84.Direct(origin.latitude, origin.longitude, azimuth, distance)
    return fix(seconds, point["lat2"], point["lon2"])


def record_between(entry, exit_):
    nothing = np.zeros(2)
    return ProfileRecord(
        1, EPOCH, np.array([0.0, 1.0]), *([nothing] * 8), entry_fix=entry, exit_fix=exit_
    )  # fmt: skip


def series_of(depth, controls=None):
    n = len(depth) - 1
    measurements = np.zeros((n + 1, 4))
    measurements[:, 3] = depth
    return ProfileSeries(
        1, EPOCH, STEP, STEP * np.arange(n + 1), measurements, np.ones(n + 1),
        np.zeros((n, 4)) if controls is None else controls, 1.0, 0.0, np.arange(0, n + 1, 10),
    )  # fmt: skip


# Closure (eqs. 39 and 40)

ORIGIN = fix(-30.0, 18.0, 115.0)


@st.composite
def drifts(draw):
    """Draw a track through the water, the fixes about it and the cycles within it."""
    n = draw(st.integers(3, 400))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    steps = rng.normal(size=(n, 2)) * draw(st.floats(0.0, 1.0))
    boundaries = np.unique([0, n, *rng.integers(1, n, draw(st.integers(0, 5)))])
    entry = fix(-draw(st.floats(0.0, 900.0)), draw(st.floats(-80.0, 80.0)), draw(st.floats(-180.0, 180.0)))
    end = moved_fix(entry, n * STEP + draw(st.floats(0.0, 900.0)), *(rng.normal(size=2) * 3000.0))
    return steps, boundaries, entry, end


@given(drifts())
@settings(max_examples=200, deadline=None)
def test_the_segments_close_on_the_gps_residual(drift):
    steps, boundaries, entry, end = drift
    series = series_of(np.zeros(len(steps) + 1))
    record = record_between(entry, end)
    current = depth_averaged_current(record, track_of(series, SelfMotion(steps, 0.0), boundaries), CurrentErrors())
    clock = STEP * boundaries.astype(float)
    clock[0] = (entry.time - EPOCH) / np.timedelta64(1, "s")
    clock[-1] = (end.time - EPOCH) / np.timedelta64(1, "s")
    drifted = sum(s.velocity * dt for s, dt in zip(current.segments, np.diff(clock), strict=True))
    residual = local_displacement(entry, end) - steps.sum(axis=0)
    np.testing.assert_allclose(drifted, residual, atol=1e-9 * max(1.0, np.abs(residual).max()), rtol=0.0)
    np.testing.assert_allclose(current.velocity * (clock[-1] - clock[0]), residual, rtol=1e-9, atol=1e-8)
    assert [(s.start, s.stop) for s in current.segments] == list(
        zip(boundaries[:-1].tolist(), boundaries[1:].tolist(), strict=True)
    )


def test_equations_39_and_40_by_hand():
    """Each cycle has its fraction of the GPS displacement by time, minus its own displacement through the water."""
    steps = np.concatenate([np.tile([0.03, 0.0], (600, 1)), np.tile([0.0, 0.02], (400, 1))])
    entry, end = fix(0.0, 10.0, 20.0), None
    end = moved_fix(entry, 100.0, 30.0, 14.0)
    track = track_of(series_of(np.zeros(1001)), SelfMotion(steps, 0.0), np.array([0, 600, 1000]))
    current = depth_averaged_current(record_between(entry, end), track, CurrentErrors())
    first, second = (segment.velocity for segment in current.segments)
    np.testing.assert_allclose(first, [(30.0 * 0.6 - 18.0) / 60.0, 14.0 * 0.6 / 60.0], atol=1e-6)
    np.testing.assert_allclose(second, [30.0 * 0.4 / 40.0, (14.0 * 0.4 - 8.0) / 40.0], atol=1e-6)
    np.testing.assert_allclose(current.velocity, [0.12, 0.06], atol=1e-6)


def test_time_at_the_surface_counts_though_the_glider_rests():
    """Ten minutes of drift after the dive are part of the drift's time, but not of the glider's motion."""
    steps = np.tile([0.02, 0.0], (1000, 1))
    entry = fix(0.0, 10.0, 20.0)
    end = moved_fix(entry, 700.0, 20.0 + 0.1 * 700.0, 0.0)
    current = depth_averaged_current(
        record_between(entry, end), track_of(series_of(np.zeros(1001)), SelfMotion(steps, 0.0), np.array([0, 1000])),
        CurrentErrors(),
    )  # fmt: skip
    np.testing.assert_allclose(current.velocity, [0.1, 0.0], atol=1e-6)


CERTAIN = CurrentErrors(fix_error=0.0)
"""Fixes without error; their drift is used in full."""


def removed_drift(current):
    """Return the total time (s) and displacement (m) that are removed on both sides."""
    time = current.entry.drift_removed + current.exit.drift_removed
    return time, current.entry.displacement + current.exit.displacement


def record_with_surface_drifts(current, drift_before, drift_after, *, fixes_before=2, fixes_after=2):
    """Return record, series and motion of a dive of 2000 s in one current, with 300 s of drift before and 200 s after.

    The fixes before the dive span 120 s, and those after it 150 s.
    """
    steps = np.tile([0.03, -0.01], (round(2000.0 / STEP), 1))
    # On the equator, where the legs of a track add up like plane vectors.
    entry = fix(-300.0, 0.0, -125.0)
    leaves = moved_fix(entry, 0.0, *(300.0 * drift_before))
    surfaces = moved_fix(leaves, 2000.0, *(2000.0 * current + steps.sum(axis=0)))
    exit_ = moved_fix(surfaces, 2200.0, *(200.0 * drift_after))
    before = (moved_fix(entry, -420.0, *(-120.0 * drift_before)), entry)[-fixes_before:]
    after = (exit_, moved_fix(exit_, 2350.0, *(150.0 * drift_after)))[:fixes_after]
    record = replace(record_between(entry, exit_), surface_fixes_before=before, surface_fixes_after=after)
    return record, series_of(np.zeros(len(steps) + 1)), SelfMotion(steps, 0.0)


def test_the_surface_drift_is_removed_from_the_displacement_of_the_dive():
    current, before, after = np.array([0.1, -0.05]), np.array([-0.3, 0.4]), np.array([0.6, 0.2])
    record, series, motion = record_with_surface_drifts(current, before, after)
    boundaries = np.array([0, 8000, 20_000])
    found = depth_averaged_current(record, track_of(series, motion, boundaries), CERTAIN)
    np.testing.assert_allclose(found.velocity, current, atol=1e-6)
    np.testing.assert_allclose(removed_drift(found)[1], 300.0 * before + 200.0 * after, atol=1e-3)
    assert removed_drift(found)[0] == pytest.approx(500.0)
    for segment in found.segments:
        np.testing.assert_allclose(segment.velocity, current, atol=1e-6)


@pytest.mark.parametrize("known", ["before", "after", "neither"])
def test_an_end_without_consecutive_fixes_keeps_its_time_and_displacement(known):
    current, drift = np.array([0.1, -0.05]), np.array([-0.3, 0.4])
    record, series, motion = record_with_surface_drifts(
        current, drift, drift, fixes_before=1 + (known == "before"), fixes_after=1 + (known == "after")
    )
    found = depth_averaged_current(record, track_of(series, motion, np.array([0, 20_000])), CERTAIN)
    removed = {"before": 300.0, "after": 200.0, "neither": 0.0}[known]
    remaining = 500.0 - removed
    assert removed_drift(found)[0] == pytest.approx(removed)
    np.testing.assert_allclose(removed_drift(found)[1], removed * drift, atol=1e-3)
    np.testing.assert_allclose(found.velocity, (2000.0 * current + remaining * drift) / (2000.0 + remaining), atol=1e-6)


def test_an_uncertain_surface_drift_is_removed_in_part():
    """Drift errors of 7.07 m over 120 s and 150 s, compared with 0.1 m/s: the weighted mean with the current below."""
    current, drift = np.array([0.1, -0.05]), np.array([-0.3, 0.4])
    record, series, motion = record_with_surface_drifts(current, drift, drift)
    uncertain = CurrentErrors(fix_error=5.0, surface_shear=0.1)
    found = depth_averaged_current(record, track_of(series, motion, np.array([0, 20_000])), uncertain)
    shares = [1.0 / (1.0 + (np.sqrt(50.0) / lasts / 0.1) ** 2) for lasts in (120.0, 150.0)]
    unexplained = 300.0 * (1.0 - shares[0]) + 200.0 * (1.0 - shares[1])
    assert removed_drift(found)[0] == pytest.approx(500.0 - unexplained)
    # The balance: in the unexplained time the glider in fact drifted as at the surface.
    np.testing.assert_allclose(
        found.velocity, (2000.0 * current + unexplained * drift) / (2000.0 + unexplained), atol=1e-6
    )


def test_no_drift_is_removed_if_the_surface_current_equals_that_below():
    record, series, motion = record_with_surface_drifts(
        np.array([0.1, 0.0]), np.array([0.4, 0.0]), np.array([0.2, 0.0])
    )
    same = CurrentErrors(surface_shear=0.0)
    assert (
        removed_drift(depth_averaged_current(record, track_of(series, motion, np.array([0, 20_000])), same))[0] == 0.0
    )


def test_a_fix_kilometres_off_is_no_drift():
    record, series, motion = record_with_surface_drifts(
        np.array([0.1, 0.0]), np.array([3.5, 0.0]), np.array([0.2, 0.0])
    )
    found = depth_averaged_current(record, track_of(series, motion, np.array([0, 20_000])), CERTAIN)
    assert removed_drift(found)[0] == pytest.approx(200.0)
    assert surface_drift(record.surface_fixes_before) is None


@pytest.mark.parametrize("missing", ["entry", "exit"])
def test_no_fix_no_current(missing):
    record = record_between(None if missing == "entry" else ORIGIN, None if missing == "exit" else ORIGIN)
    motion = SelfMotion(np.zeros((100, 2)), 0.0)
    series = series_of(np.zeros(101))
    assert depth_averaged_current(record, track_of(series, motion, single_cycle(series)), CurrentErrors()) is None


# The current from the smoother's displacement

FIXES_ALONE = CurrentErrors(axial_error=0.0, relative_error=0.0, heading_error=0.0)
"""Errors of an instrument with exact speed and course."""


def test_the_smoothed_current_by_hand():
    """The own motion is 10 m north, the fixes are 80 m apart after 700 s, of which 200 s at the surface are unknown."""
    entry = fix(0.0, 10.0, 20.0)
    end = moved_fix(entry, 700.0, 80.0, -14.0)
    covariance = np.array([[9.0, 2.0], [2.0, 4.0]])
    current = current_from_displacement(
        record_between(entry, end), series_of(np.zeros(5001)).time, np.array([10.0, 0.0]), covariance,
        FIXES_ALONE.model_copy(update={"fix_error": 3.0, "surface_shear": 0.1}),
    )  # fmt: skip
    np.testing.assert_allclose(current.velocity, [0.1, -0.02], atol=1e-6)
    np.testing.assert_allclose(current.covariance, np.array([[427.0, 2.0], [2.0, 422.0]]) / 700.0**2)


def test_the_same_surface_drift_is_removed_from_the_smoothed_current():
    """For one dive with one displacement, the currents of the adjoint and of the smoother are equal."""
    record, series, motion = record_with_surface_drifts(
        np.array([0.1, -0.05]), np.array([-0.3, 0.4]), np.array([0.6, 0.2])
    )
    settings = CurrentErrors(fix_error=5.0, surface_shear=0.1)
    adjoint = depth_averaged_current(record, track_of(series, motion, np.array([0, 20_000])), settings)
    smoothed = current_from_displacement(record, series.time, motion.steps.sum(axis=0), np.zeros((2, 2)), settings)
    assert removed_drift(adjoint)[0] > 300.0
    np.testing.assert_allclose(smoothed.velocity, adjoint.velocity, atol=1e-12)


def test_a_difference_between_adjoint_and_smoother_widens_both_covariances():
    record, series, motion = record_with_surface_drifts(
        np.array([0.1, -0.05]), np.array([-0.3, 0.4]), np.array([0.6, 0.2])
    )
    adjoint = depth_averaged_current(record, track_of(series, motion, np.array([0, 20_000])), CERTAIN)
    smoothed = current_from_displacement(
        record, series.time, motion.total + np.array([40.0, 0.0]), np.zeros((2, 2)), CERTAIN
    )
    difference = adjoint.velocity - smoothed.velocity
    assert np.linalg.norm(difference) > 0.01
    for before, after in zip((adjoint, smoothed), with_disagreement(adjoint, smoothed, CERTAIN), strict=True):
        np.testing.assert_allclose(after.covariance - before.covariance, 0.5 * np.outer(difference, difference))
        np.testing.assert_array_equal(after.velocity, before.velocity)


def test_adjoint_with_the_covariance_of_the_smoother_is_uncertain_by_its_whole_departure_from_it():
    record, series, motion = record_with_surface_drifts(
        np.array([0.1, -0.05]), np.array([-0.3, 0.4]), np.array([0.6, 0.2])
    )
    track = track_of(series, motion, np.array([0, 20_000]))
    adjoint = depth_averaged_current(record, track, CERTAIN, np.diag([400.0, 300.0]))
    filtered = depth_averaged_current(record, track_of(series, motion, np.array([0, 20_000])), CERTAIN)
    total = motion.total + np.array([40.0, -10.0])
    smoothed = current_from_displacement(record, series.time, total, np.diag([400.0, 300.0]), CERTAIN, with_hull=True)
    first, second = with_disagreement(adjoint, smoothed, CERTAIN, filtered)
    own, other = adjoint.velocity - smoothed.velocity, filtered.velocity - smoothed.velocity
    np.testing.assert_allclose(
        first.covariance - adjoint.covariance, 0.5 * np.outer(other, other) + np.outer(own, own), atol=1e-15
    )
    np.testing.assert_allclose(second.covariance - smoothed.covariance, 0.5 * np.outer(other, other), atol=1e-15)
    alone, _ = with_disagreement(adjoint, smoothed, CERTAIN)
    np.testing.assert_allclose(alone.covariance - adjoint.covariance, 1.5 * np.outer(own, own), atol=1e-15)


@pytest.mark.parametrize("missing", ["entry", "exit"])
def test_no_fix_no_smoothed_current(missing):
    record = record_between(None if missing == "entry" else ORIGIN, None if missing == "exit" else ORIGIN)
    series = series_of(np.zeros(101))
    assert current_from_displacement(record, series.time, np.zeros(2), np.eye(2), CurrentErrors()) is None


@pytest.mark.long
@pytest.mark.parametrize("fixes", [1, 2])
@pytest.mark.parametrize(("latitude", "velocity"), [(10.0, [0.5, -0.1]), (70.0, [-0.1, 0.4])])
def test_the_smoothed_covariance_agrees_with_monte_carlo_draws(latitude, velocity, fixes):
    """The sample covariance of the current from 4000 draws agrees within its sampling error."""
    rng = np.random.default_rng(5)
    covariance = np.array([[900.0, -350.0], [-350.0, 400.0]])
    options = FIXES_ALONE.model_copy(update={"fix_error": 12.0, "surface_shear": 0.2})
    series, origin = series_of(np.zeros(5001)), fix(0.0, latitude, 20.0)

    def measured(seconds, place):
        return moved_fix(origin, seconds, *(place + rng.normal(0.0, 12.0, 2)))

    def drawn():
        """Return a draw with sixty seconds of drift on either side of the dive, and three minutes between two fixes."""
        before, after = velocity + rng.normal(0.0, 0.2, (2, 2))
        end = 500.0 * np.array(velocity)
        early = (measured(-240.0, -240.0 * before), measured(-60.0, -60.0 * before))[-fixes:]
        late = (measured(560.0, end + 60.0 * after), measured(740.0, end + 240.0 * after))[:fixes]
        return replace(record_between(early[-1], late[0]), surface_fixes_before=early, surface_fixes_after=late)

    expected = current_from_displacement(drawn(), series.time, np.zeros(2), covariance, options)
    draws = np.array([
        current_from_displacement(drawn(), series.time, moved, np.zeros((2, 2)), options).velocity
        for moved in rng.multivariate_normal(np.zeros(2), covariance, 4000)
    ])  # fmt: skip
    np.testing.assert_allclose(np.cov(draws.T), expected.covariance, atol=0.06 * expected.covariance.max())
    assert np.abs(draws.mean(axis=0) - velocity).max() < 4.0 * np.sqrt(expected.covariance.max() / 4000)


# Fixes on the ellipsoid


@pytest.mark.parametrize(
    ("latitude", "longitude"), [(18.0, 115.0), (5.0, 179.999), (-40.0, -179.9995), (84.5, 20.0), (-78.0, 170.0)]
)
@pytest.mark.parametrize(("north", "east"), [(1500.0, 400.0), (-800.0, 2500.0), (-10.0, -3.0), (0.0, 300.0)])
def test_displacement_anywhere_on_the_globe(latitude, longitude, north, east):
    start = fix(0.0, latitude, longitude)
    found = local_displacement(start, moved_fix(start, 1.0, north, east))
    np.testing.assert_allclose(found, [north, east], atol=1e-6)


def test_the_antimeridian_is_no_obstacle():
    north, east = local_displacement(fix(0.0, 0.0, 179.9999), fix(1.0, 0.0, -179.9999))
    assert abs(north) < 1e-6
    assert east == pytest.approx(2e-4 * np.pi / 180.0 * 6378137.0, rel=1e-6)


def test_the_same_fix_twice_is_no_displacement():
    np.testing.assert_array_equal(local_displacement(ORIGIN, ORIGIN), [0.0, 0.0])


def test_surface_drift():
    first = fix(0.0, 48.0, -123.0)
    track = (first, moved_fix(first, 100.0, 5.0, 90.0), moved_fix(first, 300.0, 30.0, -60.0))
    found = surface_drift(track)
    np.testing.assert_allclose(found.velocity, [0.1, -0.2], atol=1e-6)
    assert found.duration == pytest.approx(300.0)
    assert surface_drift(()) is None
    assert surface_drift(track[:1]) is None
    assert surface_drift((first, moved_fix(first, 20.0, 5.0, 5.0))) is None


# Dive-climb cycles


def test_several_cycles_between_two_fixes():
    time = np.arange(0.0, 3000.0 + STEP / 2.0, STEP)
    series = series_of(100.0 * np.abs(np.sin(np.pi * time / 1000.0)))
    boundaries = cycles_of(series)
    assert boundaries[0] == 0
    assert boundaries[-1] == len(time) - 1
    # The depth rises above 5 % of the greatest just before each turning point near the surface.
    before = 1000.0 * np.arcsin(0.05) / np.pi
    np.testing.assert_allclose(boundaries[1:-1] * STEP, [1000.0 - before, 2000.0 - before], atol=2.0 * STEP)


def test_a_cycle_too_short_belongs_to_its_neighbour():
    time = np.arange(0.0, 1000.0, STEP)
    period = 0.8 * MIN_CYCLE
    series = series_of(20.0 * np.abs(np.sin(np.pi * time / period)))
    lengths = np.diff(cycles_of(series)) * STEP
    assert (lengths >= MIN_CYCLE - STEP).all()
    assert len(lengths) > 3


def test_one_dive_is_one_cycle():
    depth = 50.0 * np.sin(np.linspace(0.0, np.pi, 3001))
    np.testing.assert_array_equal(cycles_of(series_of(depth)), [0, 3000])


# The vibration intervals, bridged


@pytest.mark.parametrize("intervals", [[(100, 160)], [(0, 40)], [(700, 800)], [(0, 30), (200, 210), (790, 800)]])
def test_a_steady_track_is_bridged_exactly(intervals):
    truth = np.tile([0.021, -0.013], (800, 1))
    vibrating = np.zeros(800, dtype=bool)
    corrupted = truth.copy()
    for begin, end in intervals:
        vibrating[begin:end] = True
        corrupted[begin:end] = 7.0
    np.testing.assert_allclose(bridge(corrupted, vibrating, 300), truth, atol=1e-15)


def test_a_change_of_velocity_is_bridged_by_a_straight_line():
    steps = np.zeros((300, 2))
    steps[:100], steps[200:] = [0.01, 0.0], [0.03, 0.02]
    vibrating = np.zeros(300, dtype=bool)
    vibrating[100:200] = True
    bridged = bridge(steps, vibrating, 50)
    np.testing.assert_allclose(bridged[100:200].mean(axis=0), [0.02, 0.01])
    assert (np.diff(bridged[99:201, 0]) > 0.0).all()
    np.testing.assert_array_equal(bridged[:100], steps[:100])


def test_bridging_without_a_usable_step_changes_nothing():
    steps = np.random.default_rng(0).normal(size=(50, 2))
    np.testing.assert_array_equal(bridge(steps, np.ones(50, dtype=bool), 10), steps)


def test_bridged_time_counts_and_its_share_is_reported():
    states = np.zeros((1001, 12))
    states[:, 3] = 0.03 * np.arange(1001)
    vibrating = np.zeros(1001, dtype=bool)
    vibrating[400:500] = True
    states[450:, 4] += 25.0
    motion = model_motion(states, vibrating, STEP)
    np.testing.assert_allclose(motion.total, [30.0, 0.0], atol=1e-9)
    assert motion.bridged == pytest.approx(3.0)


# Uncertainty

velocities = st.floats(-2.0, 2.0)


def drift_of(velocity, track, elapsed=1000.0, variance=0.0, bridged=0.0, covariance=((0.0, 0.0), (0.0, 0.0))):
    return Drift(np.array(velocity), np.array(track), elapsed, variance, bridged, np.array(covariance))


@given(velocities, velocities, velocities, velocities)
def test_the_covariance_is_symmetric_and_positive_semidefinite(north, east, along_north, along_east):
    drift = drift_of([north, east], [100.0 * along_north, 100.0 * along_east])
    covariance = current_uncertainty(drift, CurrentErrors()).covariance
    np.testing.assert_array_equal(covariance, covariance.T)
    assert np.linalg.eigvalsh(covariance).min() >= -1e-15


def test_the_covariance_by_hand():
    """Northward current, eastward track of 0.5 m/s: the course error is proportional to the track, not the current."""
    terms = CurrentErrors(axial_error=0.05, relative_error=0.2, heading_error=10.0, cross_track_error=0.01)
    found = current_uncertainty(drift_of([0.3, 0.0], [0.0, 500.0]), terms)
    across = (0.2 * 0.3) ** 2 + (np.radians(10.0) * 0.5) ** 2 + 0.01**2
    np.testing.assert_allclose(found.covariance, np.diag([across, 0.05**2]), atol=1e-15)
    assert found.heading == pytest.approx(np.radians(10.0) * 0.5)
    calm = current_uncertainty(drift_of([0.0, 0.0], [0.0, 500.0]), terms)
    assert calm.covariance[0, 0] == pytest.approx((np.radians(10.0) * 0.5) ** 2 + 0.01**2)


def test_errors_of_track_fixes_and_actuation_are_isotropic():
    exact = FIXES_ALONE.model_copy(update={"actuation_error": 0.2})
    drift = drift_of([0.1, 0.1], [300.0, 0.0], 1000.0, 800.0, 150.0, [[900.0, 100.0], [100.0, 400.0]])
    found = current_uncertainty(drift, exact)
    np.testing.assert_allclose(
        found.covariance, (np.array([[900.0, 100.0], [100.0, 400.0]]) + (800.0 + 30.0**2) * np.eye(2)) / 1000.0**2
    )


def test_a_compass_offset_of_the_stated_size_lies_on_the_ellipse():
    """The displacement is rotated by the stated error; even in calm water, the current is in error by one sigma."""
    record, series, motion = record_with_surface_drifts(
        np.array([0.0, 0.0]), np.array([0.0, 0.0]), np.array([0.0, 0.0])
    )
    terms = FIXES_ALONE.model_copy(update={"heading_error": 3.0, "fix_error": 0.0, "surface_shear": 0.0})
    angle = np.radians(3.0)
    turned = SelfMotion(motion.steps @ np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]), 0.0)
    tracks = (track_of(series, m, single_cycle(series)) for m in (motion, turned))
    right, wrong = (depth_averaged_current(record, track, terms) for track in tracks)
    error, across = wrong.velocity - right.velocity, right.covariance
    track = right.drift.track / np.linalg.norm(right.drift.track)
    starboard = np.array([-track[1], track[0]])
    assert abs(error @ starboard) == pytest.approx(np.sqrt(starboard @ across @ starboard), rel=1e-3)
    by_smoother = current_from_displacement(record, series.time, motion.total, np.zeros((2, 2)), terms)
    np.testing.assert_allclose(by_smoother.covariance, across, atol=1e-15)


def test_the_defaults_are_the_papers_and_the_calibrated_hulls_those_measured():
    """The sources are section 5.5 of the paper, and docs/current-ellipses.md for a calibrated hull."""
    published = CurrentErrors()
    assert (published.axial_error, published.relative_error, published.heading_error) == (0.055, 0.26, 8.0)
    assert (published.fix_error, published.surface_shear, published.actuation_error) == (5.0, 0.2, 0.2)
    assert published.cross_track_error == 0.0
    assert CALIBRATED == {"axial_error": 0.017, "relative_error": 0.0, "heading_error": 2.5}


@pytest.mark.parametrize("azimuth", [0.0, 30.0, 90.0, 150.0])
def test_an_ellipses_axes_orientation_and_area_are_those_it_was_made_of(azimuth):
    """The semi-axes are 3 and 1 m/s, the longer one `azimuth` degrees clockwise from north."""
    along = np.array([np.cos(np.radians(azimuth)), np.sin(np.radians(azimuth))])
    across = np.array([-along[1], along[0]])
    covariance = 9.0 * np.outer(along, along) + np.outer(across, across)
    ellipse = CurrentUncertainty(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, covariance)
    assert ellipse.axes == pytest.approx((3.0, 1.0))
    assert (ellipse.orientation - azimuth + 90.0) % 180.0 == pytest.approx(90.0)
    assert 0.0 <= ellipse.orientation < 180.0
    assert ellipse.area == pytest.approx(3.0 * np.pi)


def test_an_ellipse_of_rounding_errors_has_no_size():
    """A covariance of rank one may have a slightly negative eigenvalue."""
    flat = CurrentUncertainty(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, np.array([[4.0, 0.0], [0.0, -1e-18]]))
    assert flat.axes == (2.0, 0.0)
    assert flat.area == 0.0


def test_the_terms_follow_the_hull_unless_given():
    shipped = read_platform("petrel-l")
    calibrated = with_covariance(shipped, CalibrationErrors(parameters=(), deviation=(), correlation=()))
    assert CurrentSettings().errors(shipped) == CurrentErrors()
    narrow = CurrentSettings().errors(calibrated)
    assert narrow.axial_error < CurrentErrors().axial_error
    assert narrow.heading_error < CurrentErrors().heading_error
    given = CurrentSettings(axial_error=0.1, fix_error=7.0).errors(calibrated)
    assert (given.axial_error, given.fix_error, given.heading_error) == (0.1, 7.0, narrow.heading_error)


def test_the_surface_s_variance_follows_from_what_the_archive_holds():
    record, series, motion = record_with_surface_drifts(
        np.array([0.1, -0.05]), np.array([-0.3, 0.4]), np.array([0.6, 0.2])
    )
    errors = CurrentErrors(fix_error=5.0, surface_shear=0.1)
    current = depth_averaged_current(record, track_of(series, motion, np.array([0, 20_000])), errors)
    for end in (current.entry, current.exit):
        assert surface_variance(end.duration, end.drift_removed, errors) == pytest.approx(end.variance, rel=1e-9)


# The glide angle (eq. 15)

HULLS = [*(read_platform(name) for name in shipped_platforms())]
HULLS.append(with_overrides(read_platform("seawing"), {"viscous.K_L0": "-4.0"}))
HULLS.append(with_overrides(read_platform("seawing"), {"viscous.K_L0": "3.0", "viscous.K_D": "40.0"}))


@pytest.mark.parametrize("platform", HULLS, ids=lambda p: f"{p.name} {p.viscous.K_L0:g}")
@pytest.mark.parametrize("direction", [-1.0, 1.0], ids=["dive", "climb"])
def test_drag_balances_lift_along_the_path(platform, direction):
    """The balance is ``D = -L tan(xi)`` with ``xi = theta - alpha``, and the root is the smaller one of eq. 15."""
    pitch = direction * np.radians(np.arange(1.0, 80.0, 0.5))
    alpha = angle_of_attack(platform, pitch)
    flown = np.isfinite(alpha)
    assert flown.sum() > 80
    pitch, alpha = pitch[flown], alpha[flown]
    viscous = platform.viscous
    xi = pitch - alpha
    drag = viscous.K_D0 + viscous.K_D * alpha**2
    lift = viscous.K_L0 + viscous.K_L * alpha
    np.testing.assert_allclose(drag, -lift * np.tan(xi), rtol=1e-9)
    # Lift is upward on the dive (alpha above that of zero lift) and downward on the climb.
    assert (np.sign(lift) == -direction).all()
    assert (np.abs(alpha + viscous.K_L0 / viscous.K_L) < np.radians(25.0)).all()
    cotangent = 1.0 / np.tan(xi)
    constant = viscous.K_D0 * cotangent + viscous.K_L0
    root = np.sqrt(1.0 - 4.0 * viscous.K_D / viscous.K_L**2 * cotangent * constant)
    eq15 = viscous.K_L / (2.0 * viscous.K_D) * np.tan(xi) * (root - 1.0)
    np.testing.assert_allclose(alpha, eq15, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("platform", HULLS, ids=lambda p: f"{p.name} {p.viscous.K_L0:g}")
def test_angle_of_attack_agrees_with_the_steady_glide(platform):
    """The same pitches can be flown, at the same angle, as in the balance that `steady_glide` finds by scanning."""
    for heavy in (True, False):
        pitch = np.radians(np.arange(2.0, 60.0, 1.0)) * (-1.0 if heavy else 1.0)
        expected = [steady_angle_of_attack(platform, float(one), heavy=heavy) for one in pitch]
        np.testing.assert_allclose(
            angle_of_attack(platform, pitch), [np.nan if one is None else one for one in expected], atol=1e-9
        )


@pytest.mark.parametrize("platform", HULLS, ids=lambda p: f"{p.name} {p.viscous.K_L0:g}")
def test_no_path_is_flatter_than_the_least_glide_angle(platform):
    for heavy in (True, False):
        pitch = np.radians(np.linspace(0.01, 45.0, 400)) * (-1.0 if heavy else 1.0)
        alpha = angle_of_attack(platform, pitch)
        path = np.abs(pitch - alpha)
        least = least_glide_angle(platform, heavy=heavy)
        assert (path[np.isfinite(path)] >= least - 1e-9).all()
        # Flat pitches have no angle of attack, all steep ones have one, and the flattest of these is flown at the least
        # glide angle (unless the hull glides level and flatter).
        first = np.flatnonzero(np.isfinite(alpha))[0]
        assert np.isfinite(alpha[first:]).all()
        assert first == 0 or path[first] == pytest.approx(least, abs=np.radians(0.15))


def test_petrels_least_path_is_about_15_degrees():
    pitch = np.radians(np.arange(1.0, 30.0, 0.01))
    path = np.degrees(pitch - angle_of_attack(PETREL, pitch))
    assert np.nanmin(path) == pytest.approx(15.0, abs=0.5)


def test_angle_of_attack_is_nan_for_nan_or_zero_pitch():
    assert np.isnan(angle_of_attack(PETREL, [np.nan, 0.0])).all()
    assert angle_of_attack(PETREL, -0.4).shape == ()


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_horizontal_speed_of_a_steady_glide(direction):
    glide = steady_glide(Glider(PETREL), direction * 0.4, -direction * np.radians(25.0), 0.0)
    speed = horizontal_speed(PETREL, glide.pitch, glide.depth_rate)
    assert speed == pytest.approx(glide.speed * np.cos(glide.glide_angle), rel=1e-9)
    assert speed > 0.0


@pytest.mark.compiled
def test_the_glide_angle_track_of_a_flown_record():
    """One minute at heading 60 degrees cannot be solved; its time is bridged, and its fraction is reported."""
    glide = steady_glide(Glider(PETREL), 0.4, np.radians(-23.0), 50.0)
    state = glide.state
    state[2] = np.radians(60.0)
    volume = PETREL.buoyancy.neutral_volume_m3 - glide.net_mass / PETREL.buoyancy.water_density
    series, states = glide_series(PETREL, state, np.tile([glide.battery_position, 0.0, volume, 0.0], (3000, 1)))
    truth = states[-1, 3:5] - states[0, 3:5]
    vibrating = np.zeros(3001, dtype=bool)
    motion = glide_angle_motion(PETREL, series, vibrating)
    np.testing.assert_allclose(motion.total, truth, rtol=0.02)
    assert motion.masked_fraction == 0.0
    flat = series.measurements.copy()
    flat[1000:1600, 1] = np.radians(-2.0)
    masked = glide_angle_motion(PETREL, replaced(series, measurements=flat), vibrating)
    assert masked.masked_fraction == pytest.approx(0.2)
    np.testing.assert_allclose(masked.total, motion.total, rtol=0.01)
    assert masked.bridged == pytest.approx(0.2 * np.linalg.norm(truth), rel=0.05)
