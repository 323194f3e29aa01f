"""Expected displacement of the next dive: constant headings, and headings corrected for the current."""

import numpy as np
import pytest

from gliderhpc.surfacing.next_displacement import displacement_scatter, expected_displacements

DURATION = 20_000.0
DURATIONS = np.full(40, DURATION)


def mission(gain: float, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Displacements and currents of dives that follow the module's equation with a gain and a scatter of 100 m."""
    rng = np.random.default_rng(seed)
    currents = np.cumsum(rng.normal(0.0, 0.03, (len(DURATIONS), 2)), axis=0)
    displacements = np.tile([4000.0, 0.0], (len(DURATIONS), 1)) + rng.normal(0.0, 100.0, currents.shape)
    displacements[1:] -= gain * DURATION * (currents[:-1] - currents[0])
    return displacements, currents


@pytest.mark.parametrize("gain", [0.4, 1.0])
def test_the_change_follows_the_equation_of_the_module(gain):
    displacements, currents = mission(gain)
    expected = expected_displacements(displacements, currents, DURATIONS)
    last = -DURATION * (currents[-1] - currents[-2])
    np.testing.assert_allclose(expected[-1] - displacements[-1], gain * last, rtol=0.2)
    corrected = displacement_scatter(displacements, expected)
    uncorrected = displacement_scatter(displacements, displacements)
    assert np.trace(corrected) < 0.8 * np.trace(uncorrected)


def test_a_constant_heading_is_hardly_changed():
    displacements, currents = mission(0.0)
    changes = expected_displacements(displacements, currents, DURATIONS) - displacements
    assert np.abs(changes).max() < 0.15 * np.abs(DURATION * np.diff(currents, axis=0)).max()


def test_displacements_that_follow_the_current_are_not_taken_for_a_correction():
    """A course with the current, or errors of displacement and current in common: the gain is never below zero."""
    displacements, currents = mission(-0.5)
    np.testing.assert_array_equal(expected_displacements(displacements, currents, DURATIONS), displacements)


@pytest.mark.parametrize("count", [1, 2])
def test_without_earlier_changes_the_last_displacement_is_expected(count):
    displacements, currents = (values[:count] for values in mission(1.0))
    np.testing.assert_array_equal(expected_displacements(displacements, currents, DURATIONS[:count]), displacements)


def test_a_glider_that_does_not_move_expects_no_displacement():
    still = np.zeros((4, 2))
    np.testing.assert_array_equal(expected_displacements(still, still, DURATIONS[:4]), still)


def test_differences_between_successive_displacements_widen_the_scatter():
    alike = np.tile([300.0, 0.0], (6, 1))
    turned = np.array([[300.0, 0.0], [0.0, 300.0]] * 3)
    assert np.trace(displacement_scatter(turned, turned)) > 10.0 * np.trace(displacement_scatter(alike, alike))
    # After one turn, three more of one and a half times its mean square, in any direction.
    np.testing.assert_allclose(
        np.linalg.eigvalsh(displacement_scatter(turned[:2], turned[:2])), 180_000.0 * np.array([2.25, 3.25]) / 4.0
    )
    # Before any difference is known, a tenth of the displacement.
    assert np.sqrt(np.trace(displacement_scatter(alike[:1], alike[:1]))) == pytest.approx(30.0)
