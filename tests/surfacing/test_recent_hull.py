"""Changes of the hull in the message of a surfacing, and the alerts on them."""

from types import SimpleNamespace

import numpy as np
import pytest
from support.hull_dives import PARAMETERS, dives

from gliderhpc.archive.mission import open_for_reading
from gliderhpc.platform import read_platform
from gliderhpc.report.page.operator_summary import _changed_hull
from gliderhpc.report.page.surfacing_page import surfacing_page
from gliderhpc.report.studies import drift
from gliderhpc.studies.hull import MissionTerms
from gliderhpc.surfacing import recent_hull as module
from gliderhpc.surfacing.dive_results import surfacing_message
from gliderhpc.surfacing.message import HullChange, JointHullChange, JointPart
from gliderhpc.surfacing.recent_hull import hull_changes, joint_change, probability_above, recent_hull
from gliderhpc.watch.alerts import Rules

HULL = read_platform("petrel-l")
COUNT = 24


def _news_at(swift_store, monkeypatch, number, course):
    """News at a dive of a mission whose drag follows a course, by the archive's interface alone."""
    every = dives(COUNT, {"viscous.K_D0": course}, seed=4, information=60.0)

    def read(_, numbers):
        return MissionTerms(HULL, PARAMETERS, tuple(dive for dive in every if dive.number in numbers), ())

    monkeypatch.setattr(module, "read_terms", read)
    monkeypatch.setattr(module, "agreeing_terms", lambda _, mission, **__: (mission, None))
    monkeypatch.setattr(module, "done_profiles", lambda _: list(range(1, COUNT + 1)))
    with open_for_reading(swift_store) as archive:
        recent = recent_hull(archive, number)
    joint = joint_change(recent)
    assert (joint is None) == (len(recent.mission.terms) < 4)
    assert joint is None or joint.probability >= max(news.probability for news in hull_changes(recent))
    return {news.parameter: news for news in hull_changes(recent)}


@pytest.mark.compiled
def test_a_step_in_drag_of_a_third_is_detected_within_six_dives(swift_store, monkeypatch):
    """A step of the drag by 33 % at dive 13, seen as the dives come in."""
    course = np.where(np.arange(COUNT) >= 12, np.log(1.33) / 0.4, 0.0)
    before = _news_at(swift_store, monkeypatch, 12, course)["viscous.K_D0"]
    after = _news_at(swift_store, monkeypatch, 18, course)["viscous.K_D0"]
    assert before.probability < 0.95
    assert before.dives == 12
    assert after.probability > 0.99
    assert after.since == 13
    assert after.above_20_percent > 0.9 > 0.1 > probability_above(0.5 * after.first, after.change, after.change_std)
    others = _news_at(swift_store, monkeypatch, 18, course)
    assert max(news.probability for key, news in others.items() if key != "viscous.K_D0") < 0.95


@pytest.mark.compiled
def test_few_dives_bring_no_news(swift_store, monkeypatch):
    assert _news_at(swift_store, monkeypatch, 3, np.zeros(COUNT)) == {}


def test_probability_above_is_that_of_the_normal_distribution():
    assert probability_above(3.0, 3.0, 1.0) == pytest.approx(0.5)
    assert probability_above(2.0, 3.0, 1.0) == pytest.approx(0.841345, rel=1e-5)
    assert (probability_above(2.0, 3.0, 0.0), probability_above(3.0, 2.0, 0.0)) == (1.0, 0.0)


@pytest.mark.compiled
def test_a_changed_hull_alerts_and_is_on_the_page(swift_store):
    with open_for_reading(swift_store) as archive:
        message = surfacing_message(archive, 2)
    assert message.hull_changes == ()
    change = HullChange(
        parameter="viscous.K_D0", meaning="drag at zero angle of attack", unit="kg/m", first=8.9, probability=0.97,
        change=2.5, change_std=0.3, since=message.profile - 1, dives=12, above_20_percent=0.96,
    )  # fmt: skip
    changed = message.model_copy(update={"hull_changes": (change,)})
    assert Rules(hull_changed=0.98, drag_up_fifth=0.98).violations(changed) == ()
    (one, other) = Rules(hull_changed=0.95, drag_up_fifth=0.95).violations(changed)
    assert one.startswith("drag at zero angle of attack: changed since dive 1 by +2.5")
    assert other.startswith("drag up by more than 20 %")
    hull = next(section for section in surfacing_page(changed).sections if section.anchor == "hull")
    assert "probability 0.97" in str(hull.blocks)


JOINT = JointHullChange(
    probability=0.99, since=1, since_low=1, since_high=2, step_probability=0.1, combination_probability=0.5, dives=12,
    parts=(
        JointPart(parameter="viscous.K_D0", meaning="drag", included=0.9, size="+24.0 % (± 9.0 %)"),
        JointPart(parameter="buoyancy.neutral_volume", meaning="neutral oil volume", included=0.6, size=""),
    ),
)  # fmt: skip


@pytest.mark.compiled
def test_a_change_that_no_parameter_shows_alone_alerts_and_is_on_the_page(swift_store):
    with open_for_reading(swift_store) as archive:
        message = surfacing_message(archive, 2)
    assert message.hull_joint_change is None
    doubtful = HullChange(
        parameter="viscous.K_D0", meaning="drag", unit="kg/m", first=8.9, probability=0.9, change=2.5, change_std=0.3,
        since=1, dives=12, above_20_percent=0.9,
    )  # fmt: skip
    changed = message.model_copy(update={"hull_changes": (doubtful,), "hull_joint_change": JOINT})
    (alert,) = Rules(hull_changed=0.95).violations(changed)
    assert alert.startswith("hull as a whole: something has changed gradually from profile 1 (1 to 2)")
    assert "most probably drag by +24.0 % (± 9.0 %)" in alert
    found = doubtful.model_copy(update={"probability": 0.96})
    assert len(Rules(hull_changed=0.95).violations(changed.model_copy(update={"hull_changes": (found,)}))) == 1
    last = JOINT.model_copy(update={"since": message.profile})
    assert Rules(hull_changed=0.95).violations(changed.model_copy(update={"hull_joint_change": last})) == ()
    hull = next(section for section in surfacing_page(changed).sections if section.anchor == "hull")
    assert "something has changed gradually from profile 1" in str(hull.blocks)
    assert "must confirm" not in str(hull.blocks)
    (anomaly,) = _changed_hull(changed.model_copy(update={"hull_changes": ()}))
    assert anomaly.startswith("hull as a whole: something has changed")
    assert next(iter(_changed_hull(changed.model_copy(update={"hull_changes": (found,)})))).startswith("drag: changed")


@pytest.mark.parametrize(
    ("hull", "sentences"),
    [((True, ("drag: no change", "neutral volume: changed")), 1), ((False, ("drag: no change",)), 2)],
)
def test_studies_that_both_find_a_change_do_not_disagree(monkeypatch, hull, sentences):
    """Study `drift` found a change; that of the hull may be of another parameter than the drag."""
    monkeypatch.setattr(drift, "change_findings", lambda archive: hull)
    verdict = SimpleNamespace(cause="none", changes=SimpleNamespace(found=[object()]))
    lines = drift._by_information(None, SimpleNamespace(verdict=verdict))
    assert len(lines) == sentences
    assert "; ".join(hull[1]) in lines[0]
