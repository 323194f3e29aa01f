"""Expected displacement of the next dive: constant headings, courses in turn, headings corrected for the current."""

import numpy as np
import pytest

from gliderhpc.surfacing.next_displacement import expected_displacement

DURATION = 20_000.0
DURATIONS = np.full(40, DURATION)


def mission(gain: float, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Displacements and currents of dives that follow the module's equation with a gain and a scatter of 100 m."""
    rng = np.random.default_rng(seed)
    currents = np.cumsum(rng.normal(0.0, 0.03, (len(DURATIONS), 2)), axis=0)
    changes = np.cumsum(rng.normal(0.0, 100.0, currents.shape), axis=0)
    displacements = np.array([4000.0, 0.0]) + changes
    displacements[1:] -= gain * DURATION * (currents[:-1] - currents[0])
    return displacements, currents


def expected_after(displacements: np.ndarray, currents: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    return expected_displacement(displacements[:count], currents[:count], DURATIONS[:count])


@pytest.mark.parametrize("gain", [0.4, 1.0])
def test_the_change_follows_the_equation_of_the_module(gain):
    displacements, currents = mission(gain)
    expected, covariance = expected_after(displacements, currents, len(displacements))
    last = -DURATION * (currents[-1] - currents[-2])
    np.testing.assert_allclose(expected - displacements[-1], gain * last, rtol=0.2)
    _, uncorrected = expected_after(displacements, np.zeros_like(currents), len(displacements))
    assert np.trace(covariance) < 0.8 * np.trace(uncorrected)


def test_a_constant_heading_is_hardly_changed():
    displacements, currents = mission(0.0)
    largest = np.abs(DURATION * np.diff(currents, axis=0)).max()
    for count in range(3, len(displacements)):
        expected, _ = expected_after(displacements, currents, count)
        assert np.abs(expected - displacements[count - 1]).max() < 0.15 * largest


def test_displacements_that_follow_the_current_are_not_taken_for_a_correction():
    """A course with the current, or errors of displacement and current in common: the gain is never below zero."""
    displacements, currents = mission(-0.5)
    expected, _ = expected_after(displacements, currents, len(displacements))
    np.testing.assert_allclose(expected, displacements[-1], atol=1.0)


def test_before_any_difference_a_dive_like_the_last_one_is_expected():
    """Within a tenth of its length if it is like the last one, and with a small probability anywhere."""
    displacements, currents = (values[:1] for values in mission(1.0))
    expected, covariance = expected_after(displacements, currents, 1)
    like, anywhere = 0.85 / 0.88, 0.03 / 0.88
    np.testing.assert_allclose(expected, (like + 0.5 * anywhere) * displacements[0])
    square = float(displacements[0] @ displacements[0])
    between = like * anywhere * 0.25 * square
    assert np.trace(covariance) == pytest.approx((0.01 * like + anywhere) * square + between, rel=1e-9)


def test_a_glider_that_does_not_move_expects_no_displacement():
    still = np.zeros((4, 2))
    expected, covariance = expected_displacement(still, still, DURATIONS[:4])
    np.testing.assert_array_equal(expected, still[0])
    assert np.sqrt(np.trace(covariance)) < 1e-3 * DURATION


def courses_in_turn(courses: list[float], count: int, seed: int = 1) -> np.ndarray:
    """Displacements of 4 km on courses in turn, with a scatter of 100 m."""
    angle = np.radians(np.resize(courses, count))
    scatter = np.random.default_rng(seed).normal(0.0, 100.0, (count, 2))
    return 4000.0 * np.column_stack([np.cos(angle), np.sin(angle)]) + scatter


@pytest.mark.parametrize(
    "courses",
    [[0.0, 90.0], [30.0, 210.0], [0.0, 0.0, 140.0], [60.0, 150.0, 240.0, 330.0], [10.0, 10.0, 100.0, 100.0]],
)
def test_courses_steered_in_turn_are_expected_to_go_on(courses):
    """From the second round on, the next course is the one whose turn it is."""
    period = len(courses)
    for count in range(2 * period, 4 * period):
        flown = courses_in_turn(courses, count + 1)
        expected, covariance = expected_after(flown, np.zeros_like(flown), count)
        miss = flown[count] - expected
        assert np.hypot(*miss) < 0.15 * 4000.0
        assert miss @ np.linalg.solve(covariance, miss) < 9.0
        assert np.sqrt(np.trace(covariance)) < 0.35 * 4000.0


def test_turns_that_are_all_alike_are_expected_to_go_on_from_the_third_dive():
    flown = courses_in_turn([0.0, 70.0, 140.0, 210.0, 280.0, 350.0], 4)
    expected, _ = expected_after(flown, np.zeros_like(flown), 3)
    assert np.hypot(*(flown[3] - expected)) < 0.1 * 4000.0


@pytest.mark.parametrize("seed", [5, 6, 7, 8])
def test_courses_without_a_pattern_may_lead_anywhere(seed):
    """The covariance is that of all displacements, and no dive is expected to be like another."""
    rng = np.random.default_rng(seed)
    flown = courses_in_turn(list(rng.uniform(0.0, 360.0, 40)), 40)
    for count in (20, 30):
        expected, covariance = expected_after(flown, np.zeros_like(flown), count)
        assert np.hypot(*expected) < 0.7 * 4000.0
        assert np.sqrt(np.linalg.eigvalsh(covariance)[0]) > 0.4 * 4000.0


def test_one_turn_among_straight_dives_does_not_make_a_pattern():
    """After a turn the new course is expected to be kept, and the covariance contains another turn."""
    flown = courses_in_turn([0.0] * 12 + [90.0] * 2, 14)
    expected, covariance = expected_after(flown, np.zeros_like(flown), 14)
    assert np.hypot(*(flown[-1] - expected)) < 0.15 * 4000.0
    assert np.sqrt(np.trace(covariance)) > 0.2 * 4000.0


def test_a_dive_of_another_duration_is_expected_to_last_as_long_as_the_last_one():
    """A pattern of courses and speeds does not depend on the durations of the dives."""
    durations = np.resize([2000.0, 6000.0, 4000.0, 9000.0, 3000.0], 12)
    flown = 0.2 * durations[:, None] * np.resize([[1.0, 0.0], [0.0, 1.0]], (12, 2))
    expected, _ = expected_displacement(flown, np.zeros_like(flown), durations)
    np.testing.assert_allclose(expected, [0.2 * durations[-1], 0.0], atol=0.01 * 0.2 * durations[-1])
