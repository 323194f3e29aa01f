"""Lateral terms in the fit of steady glides: held unless turns confirm them, then without effect on the rest."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from support.steady_glides import glides

from gliderhpc.calibration.glides import covariance
from gliderhpc.calibration.glides import fit as fit_module
from gliderhpc.calibration.glides.covariance import is_better_held, reason_to_hold
from gliderhpc.calibration.glides.fit import calibrate_on_glides
from gliderhpc.calibration.glides.search import CalibrationVerdict
from gliderhpc.calibration.glides.segment_errors import LATERAL, TURNING, SegmentErrors
from gliderhpc.calibration.settings import CalibrationSettings
from gliderhpc.flight.hull_parameters import PARAMETERS, with_values
from gliderhpc.platform import read_platform

PETREL = read_platform("petrel-l")
TRUTH = with_values(PETREL, {"buoyancy.neutral_volume": 640.0, "viscous.K_D0": 10.0, "position.battery": 0.104})
KEYS = [parameter.key for parameter in PARAMETERS]


def turned(segments, seed=5):
    """The same glides in water that rolls and turns the glider."""
    rng = np.random.default_rng(seed)
    roll, rate = (rng.standard_normal(len(segments)) for _ in range(2))
    return replace(segments, roll=math.radians(2.0) * roll, turn_rate=math.radians(0.7) * rate)


def test_errors_of_turns_apart_do_not_inform_the_other_parameters():
    """Within each part the derivatives are those of all errors together."""
    together = SegmentErrors(PETREL, PARAMETERS, turned(glides(TRUTH, PETREL)))
    apart, steps = together.with_separate_turns(), np.full(len(KEYS), 0.1)
    every = range(len(KEYS))
    whole, parted = together.jacobian(steps, every), apart.jacobian(steps, every)
    turning = np.isin(KEYS, TURNING)
    (straight_rows, _), (turn_rows, _) = apart.parts()
    assert not parted[np.ix_(straight_rows, turning)].any()
    assert not parted[np.ix_(turn_rows, ~turning)].any()
    assert whole[np.ix_(turn_rows, ~turning)].any()
    for rows, columns in apart.parts():
        np.testing.assert_array_equal(parted[np.ix_(rows, columns)], whole[np.ix_(rows, columns)])


def test_water_that_turns_the_glider_does_not_move_its_drag(monkeypatch):
    """With the lateral terms held, drag, volume and trim are those of glides in still water."""
    why = CalibrationVerdict.IMPLAUSIBLE_TURNS
    monkeypatch.setattr(fit_module, "reason_to_hold", lambda *_, **__: why)
    monkeypatch.setattr(fit_module, "is_better_held", lambda *_: True)
    settings = CalibrationSettings(hold=("K_D", "K_L", "K_M", "K_M0", "position.reservoir.0", "depth_slope"))
    calm = glides(TRUTH, PETREL)
    found = calibrate_on_glides(PETREL, turned(calm), calm.empty(), settings)
    of = {p.parameter.key: p for p in found.parameters}
    assert of["viscous.K_D0"].after == pytest.approx(10.0, rel=0.02)
    assert of["buoyancy.neutral_volume"].after == pytest.approx(640.0, abs=5.0)
    assert {key for key, p in of.items() if p.verdict is why} == set(LATERAL)


def fit(steps, sizes=(1.0,) * 4, *, free=(), variance=0.0, steep=0.0, start_sizes=(1.0,) * 4):
    """A finished fit with steps of its parameters, sizes of the four errors, and excess of its flattest pitch."""
    search = SimpleNamespace(steps=np.array(steps), free=np.isin(np.arange(len(steps)), free), cost_of=np.sum)
    start = np.full(len(steps), np.inf)
    errors = SimpleNamespace(
        trimmed=lambda at: np.array(start_sizes if at is start else sizes), flatness=lambda _, margin: steep
    )
    return SimpleNamespace(errors=errors, search=search, start=start, largest_variance=variance)


@pytest.fixture
def sizes_of_fits(monkeypatch):
    """The sizes of errors are those given to `fit`."""
    monkeypatch.setattr(
        covariance,
        "score",
        lambda errors, steps: SimpleNamespace(errors_after=SimpleNamespace(trimmed=errors.trimmed(steps))),
    )


@pytest.mark.usefixtures("sizes_of_fits")
def test_lateral_terms_are_in_doubt_far_from_the_platform_or_badly_known():
    lateral = np.array([False, True])
    assert reason_to_hold(fit([4.0, 0.5]), lateral, stable=True) is None
    assert reason_to_hold(fit([0.0, -3.5]), lateral, stable=True) is CalibrationVerdict.IMPLAUSIBLE_TURNS
    vague = fit([0.0, 0.5], free=(1,), variance=1.2)
    assert reason_to_hold(vague, lateral, stable=True) is CalibrationVerdict.CONFOUNDED
    assert reason_to_hold(vague, lateral, stable=False) is CalibrationVerdict.UNSTABLE
    steep = fit([0.0, 0.5], steep=0.1)
    assert reason_to_hold(steep, lateral, stable=True) is CalibrationVerdict.TOO_STEEP
    assert is_better_held(CalibrationVerdict.TOO_STEEP, steep, fit([0.0, 0.0], [9.0] * 4))


@pytest.mark.usefixtures("sizes_of_fits")
@pytest.mark.parametrize(
    ("sizes", "reason"),
    [
        ([4.0, 1.0, 1.0, 1.0], CalibrationVerdict.GLIDE_MISSED),
        ([1.0, 4.0, 1.0, 1.0], CalibrationVerdict.GLIDE_MISSED),
        ([2.0, 2.0, 1.0, 1.0], None),
        ([1.0, 1.0, 4.0, 4.0], None),
    ],
)
def test_lateral_terms_are_in_doubt_if_the_fit_misses_the_glides_that_its_start_follows(sizes, reason):
    """Depth rate and pitch decide; roll and rate of turn scatter with the water."""
    missed = fit([0.0, 0.5], sizes)
    assert reason_to_hold(missed, np.array([False, True]), stable=True) is reason
    if reason is not None:
        assert is_better_held(reason, missed, fit([0.0, 0.0], [1.0, 1.0, 9.0, 9.0]))
        assert not is_better_held(reason, missed, fit([0.0, 0.0], [5.0, 5.0, 1.0, 1.0]))


@pytest.mark.usefixtures("sizes_of_fits")
@pytest.mark.parametrize(
    ("sizes", "held"),
    [([1.0, 30.0, 1.5, 1.5], True), ([1, 1, 1, 2.5], False), ([1, 1, 2.5, 1], False), ([2.5, 1, 1, 1], False)],
)
def test_implausible_terms_are_kept_only_where_the_glides_prove_them(sizes, held):
    """If held terms double the errors of depth rate or turns, the free ones stand; pitch is no measure."""
    assert is_better_held(CalibrationVerdict.IMPLAUSIBLE_TURNS, fit([4.0]), fit([0.0], sizes)) is held


def test_flatness_is_positive_for_a_hull_that_cannot_glide_as_flat_as_flown():
    """The margin of the flattest pitch is for the fit; without it, the true hull has no excess."""
    segments = glides(TRUTH, TRUTH)
    errors = SegmentErrors(TRUTH, PARAMETERS, segments)
    steps = np.zeros(len(KEYS))
    assert errors.flatness(steps, margin=1.0) == 0.0
    steps[KEYS.index("viscous.K_D0")] = 4.0
    steps[KEYS.index("viscous.K_L")] = -4.0
    assert errors.flatness(steps, margin=1.0) > math.radians(1.0)
