"""Hull of a mission compared with the depth rate of its steady glides, in vertically moving water."""

from types import SimpleNamespace

import numpy as np
import pytest
from support.hull_dives import KEYS, PARAMETERS, dives

from gliderhpc.archive.mission import open_for_reading
from gliderhpc.archive.profile import done_profiles
from gliderhpc.estimation.steady_balance import MeasuredAttitude
from gliderhpc.mission_hull.estimate import HullPrior, solve_mission
from gliderhpc.platform import read_platform
from gliderhpc.report.page.surfacing_page import hull_blocks
from gliderhpc.studies import hull as study
from gliderhpc.studies.hull import MissionTerms, agreeing_terms
from gliderhpc.studies.library import depth_rate_check as module
from gliderhpc.studies.library.depth_rate_check import (
    MOVING,
    DepthRateCheck,
    GlideSamples,
    check_hull,
    compare,
    read_glides,
)
from gliderhpc.surfacing import recent_hull
from gliderhpc.surfacing.dive_results import surfacing_message

pytestmark = pytest.mark.compiled

HULL = read_platform("petrel-l")
COUNT, EACH = 8, 40
DRAG = KEYS.index("viscous.K_D0")
PRIOR = HullPrior.plausible(np.zeros(len(KEYS)))
NO_ERROR = {key: np.zeros(COUNT) for key in KEYS}
HONEST = dives(COUNT, NO_ERROR, information=300.0)
BIASED = dives(COUNT, {**NO_ERROR, "viscous.K_D0": np.full(COUNT, -1.4)}, information=300.0)


def glides(motion):
    """Samples of the hull's own glides at a pitch of 25 degrees, in water that rises and sinks every 20 minutes."""
    climbing = np.tile(np.repeat([False, True], EACH), COUNT)
    up = np.where(climbing, 1.0, -1.0)
    zero = np.zeros(len(up))
    attitude = MeasuredAttitude(zero, up * np.radians(25.0), zero, np.tile(np.linspace(10.0, 190.0, EACH), 2 * COUNT))
    volume = (HULL.buoyancy.neutral_volume + 300.0 * up) * 1e-6
    actuators = np.column_stack([zero, zero, volume, zero])
    samples = GlideSamples(np.repeat(np.arange(COUNT), 2 * EACH), climbing, attitude, actuators, None, zero)
    still = module._glide(samples, HULL, 0.0, 1.0).depth_rate
    assert np.isfinite(still).all()
    assert np.array_equal(still < 0.0, climbing)
    water = motion * np.sqrt(2.0) * np.sin(2.0 * np.pi * np.arange(len(up)) / (EACH / 2.0))
    return GlideSamples(samples.profile, climbing, attitude, actuators, None, still - water)


def checked(samples, terms):
    check = check_hull(samples, HULL, PARAMETERS, terms, solve_mission(terms, PRIOR))
    return tuple(
        terms if check is None or check.divisor == 1.0 else (one.weakened(check.divisor) for one in terms)
    ), check


@pytest.mark.parametrize("motion", [0.0, 0.0177])
def test_a_hull_that_agrees_with_its_glides_keeps_its_information(motion):
    terms, check = checked(glides(motion), HONEST)
    assert terms == HONEST
    assert check.divisor == 1.0
    assert not check.contradicts
    assert check.motion == pytest.approx(motion, abs=2e-3)
    assert check.warning.startswith("the water moves vertically") == (motion > MOVING)
    assert (f"{100.0 * check.motion:.1f} cm/s within" in check.warning) == (motion > MOVING)


@pytest.mark.parametrize("motion", [0.0, 0.0177])
def test_a_hull_that_contradicts_its_glides_has_wider_intervals_until_it_does_not(motion):
    """Drag that all dives put 1.4 plausible deviations too low, by a few hundredths of a deviation."""
    samples = glides(motion)
    before = solve_mission(BIASED, PRIOR).overall
    assert abs(before.mean[DRAG]) > 20.0 * before.std[DRAG]
    terms, check = checked(samples, BIASED)
    found = solve_mission(terms, PRIOR)
    assert check.divisor > 10.0
    assert abs(found.overall.mean[DRAG]) < 1.96 * found.overall.std[DRAG]
    assert not compare(samples, HULL, PARAMETERS, found).contradicts
    assert check.warning.startswith("the values of the hull that the profiles gave contradict the depth rate")
    assert f"divided by {check.divisor:.0f}" in check.warning
    np.testing.assert_allclose(terms[3].score, BIASED[3].score / check.divisor)
    np.testing.assert_allclose(terms[3].information, BIASED[3].information / check.divisor)


def test_the_other_assumptions_are_weakened_too():
    (dive,) = dives(1, {})
    both = SimpleNamespace(others=((dive.score, dive.information),))
    weak = type(dive)(1, dive.time, dive.point, dive.score, dive.information, both.others).weakened(4.0)
    np.testing.assert_allclose(weak.others[0][0], dive.score / 4.0)
    np.testing.assert_allclose(weak.others[0][1], dive.information / 4.0)


def test_little_motion_calls_for_a_significant_contradiction():
    figures = {"dive": 0.01, "climb": -0.01, "dive_std": 0.01, "climb_std": 0.01, "chi_square": 4.0}
    assert DepthRateCheck(motion=0.008, **figures).contradicts
    assert not DepthRateCheck(motion=0.001, **figures).contradicts


def test_too_few_glides_give_no_comparison():
    samples = glides(0.0)
    few = module._part(samples, samples.profile < 3)
    assert compare(few, HULL, PARAMETERS, solve_mission(HONEST, PRIOR)) is None
    assert checked(few, BIASED) == (BIASED, None)


def test_glides_of_an_archive_agree_with_its_hull(brief_store, monkeypatch):
    """The brief mission has fewer dives than a comparison needs."""
    with open_for_reading(brief_store) as archive:
        numbers = done_profiles(archive)
        assert read_glides(archive, numbers, HULL) is None
        monkeypatch.setattr(module, "MIN_COMPARED", 1)
        samples = read_glides(archive, numbers, HULL)
    assert set(samples.profile.tolist()) <= set(range(len(numbers)))
    assert np.bincount(samples.profile).max() <= module._SAMPLES
    error = module._glide(samples, HULL, 0.0, 1.0).depth_rate - samples.depth_rate
    assert np.abs(np.median(error)) < 0.03
    assert np.abs(samples.depth_rate).min() > 0.05


def test_the_study_warns_first_and_stores_the_figures(brief_store, monkeypatch):
    monkeypatch.setattr(study, "read_glides", lambda *_: glides(0.0177))
    monkeypatch.setattr(study, "read_terms", lambda *_: MissionTerms(HULL, PARAMETERS, BIASED, ()))
    with open_for_reading(brief_store) as archive:
        request = SimpleNamespace(profiles=None)
        prepared = study.prepare(request, archive, (), study.HullSettings())
    assert prepared.remarks[0].startswith("the values of the hull")
    assert prepared.attributes["depth_rate_check"]["divisor"] > 10.0
    divided, *_ = study.combine_terms(prepared.inputs, study.HullSettings())
    whole, *_ = study.combine_terms(MissionTerms(HULL, PARAMETERS, BIASED, ()), study.HullSettings())
    drag = [p.key for p in PARAMETERS].index("viscous.K_D0")
    assert divided.std[-1, drag] > 2.0 * whole.std[-1, drag]


def test_a_surfacing_message_and_its_page_carry_the_warning(brief_store, monkeypatch):
    monkeypatch.setattr(study, "read_glides", lambda *_: glides(0.0177))
    monkeypatch.setattr(recent_hull, "read_terms", lambda *_: MissionTerms(HULL, PARAMETERS, BIASED, ()))
    with open_for_reading(brief_store) as archive:
        message = surfacing_message(archive, done_profiles(archive)[-1])
    assert message.hull_warning.startswith("the values of the hull")
    assert hull_blocks(message)[0].text == message.hull_warning
    quiet = message.model_copy(update={"hull_warning": ""})
    assert len(hull_blocks(quiet)) == len(hull_blocks(message)) - 1


def test_without_steady_glides_the_dives_stay_as_they_are(monkeypatch):
    monkeypatch.setattr(study, "read_glides", lambda *_: None)
    mission = MissionTerms(HULL, PARAMETERS, BIASED, ())
    assert agreeing_terms(None, mission, robust=True) == (mission, None)


def test_the_sum_of_the_dives_is_computed_once(monkeypatch):
    """The comparison computes it, and the search for changes uses it."""
    sums = []

    def counted(*args, **kwargs):
        sums.append(solve_mission(*args, **kwargs))
        return sums[-1]

    alone, changes, _ = study.combine_terms(MissionTerms(HULL, PARAMETERS, HONEST, ()), study.HullSettings())
    monkeypatch.setattr(study, "read_glides", lambda *_: glides(0.0))
    monkeypatch.setattr(study, "solve_mission", counted)
    monkeypatch.setattr(module, "solve_mission", counted)
    mission, _ = agreeing_terms(None, MissionTerms(HULL, PARAMETERS, HONEST, ()), robust=True)
    found, again, _ = study.combine_terms(mission, study.HullSettings())
    assert sums == [found]
    assert mission.undivided is found
    np.testing.assert_array_equal(found.eta, alone.eta)
    assert {i: vars(each) for i, each in again.items()} == {i: vars(each) for i, each in changes.items()}
