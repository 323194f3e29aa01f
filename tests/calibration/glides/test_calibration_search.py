"""Search for the parameters that glides do not determine: which of them are held, and at which value."""

import numpy as np
import pytest

from gliderhpc.calibration.glides.search import PARAMETER_BOUND, CalibrationSearch, CalibrationVerdict, HeldParameter
from gliderhpc.flight.hull_parameters import PARAMETERS

SCALE = 0.02


class LinearErrors:
    """Errors of one parameter: noise of one scale, and a line through zero at `best`, both in units of the scale."""

    parameters = PARAMETERS[:1]

    def __init__(self, slope, best, noise=1.0, count=400):
        self.slope, self.best = slope, best
        self.noise = noise * np.where(np.arange(count) % 2 == 0, 1.0, -1.0)
        self.kind, self.leg, self.profile = np.zeros(count, dtype=np.int64), np.arange(count), np.arange(count)

    def __call__(self, steps):
        return SCALE * (self.noise + self.slope * (steps[0] - self.best))

    def jacobian(self, steps, _):
        return np.full((len(self.noise), 1), SCALE * self.slope)

    def parts(self):
        return [(np.ones(len(self.noise), dtype=bool), np.ones(1, dtype=bool))]

    def flatness(self, _):
        return 0.0


class ErrorsWithImpulses(LinearErrors):
    """The same errors of depth rate, and rates of turn in impulses of the water, hundreds of scales away."""

    def __init__(self, slope, best):
        super().__init__(slope, best, count=800)
        self.kind = np.repeat([0, 3], 400)
        self.noise[400:] *= 300.0

    def __call__(self, steps):
        return np.where(self.kind == 0, super().__call__(steps), SCALE * self.noise)

    def jacobian(self, steps, columns):
        return np.where(self.kind[:, None] == 0, super().jacobian(steps, columns), 0.0)


def search_over(errors):
    search = CalibrationSearch(errors, np.ones(1, dtype=bool), 1.0, lambda _: None)
    search.scales = np.full(4, SCALE)
    search._fit(prior=1.0)
    return search


@pytest.mark.parametrize(
    ("slope", "verdict"),
    [(0.1, CalibrationVerdict.UNDETERMINED), (1.0, CalibrationVerdict.REFUTED)],
    ids=["the cost hardly rises", "the cost rises much"],
)
def test_a_value_many_standard_errors_away_is_refuted_only_by_the_cost(slope, verdict):
    """A lift 3.9 plausible deviations off, with a cost lower by 2.5 of 434, made currents wrong by 0.08 m/s."""
    search = search_over(LinearErrors(slope, best=-3.5))
    standard_error = 1.0 / (slope * np.sqrt(400.0 / np.sqrt(2.0)))
    assert search.steps[0] < -3.0 * standard_error
    search._hold(HeldParameter(0, CalibrationVerdict.UNDETERMINED))
    assert search.held[0].verdict is verdict
    assert (search.steps[0] == 0.0) == (verdict is CalibrationVerdict.UNDETERMINED)


@pytest.mark.parametrize(
    ("slope", "verdict"),
    [(0.3, CalibrationVerdict.UNDETERMINED), (3.0, CalibrationVerdict.REFUTED)],
)
def test_errors_of_another_kind_do_not_hide_a_large_rise_of_the_cost(slope, verdict):
    """A neutral volume wrong by 500 cm3 was kept: in yaw impulses rates of turn were nine tenths of the cost."""
    search = search_over(ErrorsWithImpulses(slope, best=-3.5))
    search._hold(HeldParameter(0, CalibrationVerdict.UNDETERMINED))
    assert search.held[0].verdict is verdict


@pytest.mark.parametrize(
    ("best", "slope", "noise", "verdict", "value"),
    [
        (-9.0, 0.04, 1.0, CalibrationVerdict.UNDETERMINED, 0.0),
        (-5.0, 5.0, 0.1, CalibrationVerdict.IMPLAUSIBLE, -PARAMETER_BOUND),
    ],
    ids=["for a small gain", "for a large gain"],
)
def test_a_parameter_at_its_bound_is_held_there_only_for_a_large_gain(best, slope, noise, verdict, value):
    search = search_over(LinearErrors(slope, best, noise))
    search._fit(prior=0.0)
    assert search.steps[0] == pytest.approx(-PARAMETER_BOUND, abs=1e-3)
    search._hold(search._at_bound())
    assert search.held[0].verdict is verdict
    assert search.steps[0] == value


class SharedErrors(LinearErrors):
    """Errors of two parameters that act alike, the second a little less, and so only in their sum."""

    parameters = PARAMETERS[:2]

    def __call__(self, steps):
        return super().__call__(np.array([steps[0] + 0.9 * steps[1]]))

    def jacobian(self, _, columns):
        return np.outer(np.full(len(self.noise), SCALE * self.slope), np.array([1.0, 0.9])[list(columns)])

    def parts(self):
        return [(np.ones(len(self.noise), dtype=bool), np.ones(2, dtype=bool))]


def test_parameters_that_act_alike_are_refuted_together():
    """Alone, neither is refuted; at the platform's value one would drive the other far from its most probable value."""
    search = CalibrationSearch(SharedErrors(1.0, best=-3.0), np.ones(2, dtype=bool), 1.0, lambda _: None)
    search.scales = np.full(4, SCALE)
    search._fit(prior=1.0)
    probable = search.steps.copy()
    search._hold(HeldParameter(0, CalibrationVerdict.UNDETERMINED, confounded_with=(1,)))
    assert search.held[0].verdict is CalibrationVerdict.REFUTED
    np.testing.assert_allclose(search.steps, probable, atol=0.01)
    assert np.abs(probable).max() < 2.0
