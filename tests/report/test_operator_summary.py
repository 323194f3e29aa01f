"""First section of the mission's page: trend of the currents, trim, and shared remarks."""

import numpy as np
import pytest
from support.hull_dives import PARAMETERS, dives
from support.pages import DOCS

from gliderhpc.archive.mission import describe, open_for_reading
from gliderhpc.findings.formatting import with_deviation
from gliderhpc.platform import read_platform
from gliderhpc.report.page import operator_summary as module
from gliderhpc.report.page.content import Facts, Notice, Remarks
from gliderhpc.report.page.mission_table import MissionTable
from gliderhpc.report.page.operator_summary import common_remarks, operator_section
from gliderhpc.report.page.surfacing_page import dive_facts, hull_blocks
from gliderhpc.studies.hull import MissionTerms
from gliderhpc.surfacing import recent_hull as recent_hull_module
from gliderhpc.surfacing.dive_results import surfacing_message
from gliderhpc.surfacing.message import HullChange, Trim
from gliderhpc.surfacing.recent_hull import implausible_warning, recent_hull, trim_of

HULL = read_platform("petrel-l")


def _facts(blocks):
    found = {}
    for block in blocks:
        if isinstance(block, Facts):
            found |= block.rows
    return found


@pytest.mark.compiled
def test_the_page_begins_with_the_last_dive_and_the_mission(brief_store):
    summary = describe(brief_store)
    with open_for_reading(brief_store) as archive:
        section, message = operator_section(archive, summary), surfacing_message(archive, 3)
        table = MissionTable.of(archive)
    facts = _facts(section.blocks)
    for name, text in dive_facts(message).items():
        assert facts[f"{name} (dive 3)"] == text
        assert text != "unknown"
    north, east = (component.mean() for component in table.current)
    assert facts["mean current"].startswith(f"{np.hypot(north, east):.3f} m/s")
    assert "trend of the current" not in facts
    assert f"{np.nanmedian(table.current_std):.3f} m/s" in facts["uncertainty"]
    assert "the hull was not calibrated" in facts["uncertainty"]


def test_a_trend_and_its_error_are_those_of_a_straight_line():
    rng = np.random.default_rng(3)
    days = np.arange(40) / 4.0
    slopes = [module._trend(days, 0.1 + 0.02 * days + 0.05 * rng.standard_normal(40)) for _ in range(400)]
    found, stated = np.array(slopes).T
    assert found.mean() == pytest.approx(0.02, abs=3.0 * found.std() / 20.0)
    assert np.sqrt(np.mean(stated**2)) == pytest.approx(found.std(), rel=0.1)


def test_a_value_that_no_pilot_sets_warns_too():
    warning = implausible_warning({"viscous.K_L": -4.2, "buoyancy.neutral_volume": 1.0})
    assert "viscous.K_L by -4.2" in warning
    assert "neutral_volume" not in warning
    assert implausible_warning({"viscous.K_L": 2.9, "viscous.K_q": 4.2, "added_inertia.0": -6.0}) == ""


@pytest.fixture
def heavier(swift_store, monkeypatch):
    """Archive whose dives' information is that of a hull with 60 cm3 more of neutral volume and a wrong pitch."""
    volume, pitch = (next(p for p in PARAMETERS if p.key == key) for key in _MOVED)
    courses = {
        volume.key: np.full(8, 60.0 / volume.slope(HULL, 0.0)), pitch.key: np.full(8, 5.0),
    }  # fmt: skip
    every = dives(8, courses, seed=2, information=400.0)
    monkeypatch.setattr(recent_hull_module, "read_terms", lambda _, __: MissionTerms(HULL, PARAMETERS, every, ()))
    monkeypatch.setattr(recent_hull_module, "agreeing_terms", lambda _, mission, **__: (mission, None))
    with open_for_reading(swift_store) as archive:
        yield archive


_MOVED = ("buoyancy.neutral_volume", "sensors.pitch_offset")


@pytest.mark.compiled
def test_ballast_and_trim_are_those_of_the_dives(heavier):
    found = {one.quantity: one for one in trim_of(recent_hull(heavier, 3))}
    volume = found["neutral oil volume, last dive minus platform file"]
    assert abs(volume.difference - 60.0) < 3.0 * volume.difference_std < 30.0
    ballast = found["equivalent ballast to add"]
    assert ballast.unit == "g"
    assert ballast.difference == pytest.approx(-1e-3 * HULL.buoyancy.water_density * volume.difference)
    assert ballast.difference_std > 0.0
    assert found["offset of the pitch, last dive minus platform file"].steps == pytest.approx(5.0, abs=0.2)


@pytest.mark.compiled
def test_a_trim_that_is_too_far_is_not_to_be_ballasted_by(heavier):
    message = surfacing_message(heavier, 3)
    assert {one.parameter for one in message.trim} >= set(_MOVED)
    (warning,) = (block for block in hull_blocks(message) if isinstance(block, Notice))
    assert "sensors.pitch_offset" in warning.text
    assert "do not use these values for ballasting" in warning.text
    assert warning.text == message.hull_warning
    assert message.hull_warning.startswith("too far from the platform file")  # The page puts "Attention" before it.
    near = message.model_copy(update={"hull_warning": ""})
    assert not [block for block in hull_blocks(near) if isinstance(block, Notice)]
    (one, *_) = near.trim
    assert _facts(hull_blocks(near))[one.quantity] == (
        f"{with_deviation(one.difference, one.difference_std)} {one.unit}"
    )


def test_a_quantity_that_the_dives_do_not_determine_is_left_out(swift_store, monkeypatch):
    vague = dives(4, {}, information=1e-3)
    monkeypatch.setattr(recent_hull_module, "read_terms", lambda _, __: MissionTerms(HULL, PARAMETERS, vague, ()))
    monkeypatch.setattr(recent_hull_module, "agreeing_terms", lambda _, mission, **__: (mission, None))
    with open_for_reading(swift_store) as archive:
        assert list(trim_of(recent_hull(archive, 3))) == []


@pytest.mark.compiled
def test_remarks_that_many_profiles_share_are_listed_once(brief_store):
    summary = describe(brief_store)
    messages = {
        1: ("done", "12 s of gaps; only the first"), 2: ("done", "7.5 s of gaps; calm"), 3: ("failed", "12 s of gaps"),
    }  # fmt: skip
    object.__setattr__(summary, "messages", messages)
    with open_for_reading(brief_store) as archive:
        table = MissionTable.of(archive)
        assert list(common_remarks(summary, table)) == ["in 2 of 3 profiles: 12 s of gaps (values of the first)"]
        (anomalies,) = (block for block in operator_section(archive, summary).blocks if isinstance(block, Remarks))
    assert "in 2 of 3 profiles" in " ".join(anomalies.texts)


@pytest.mark.compiled
def test_a_changed_hull_and_an_unsmoothed_dive_are_listed_as_anomalies(brief_store, monkeypatch):
    summary = describe(brief_store)
    with open_for_reading(brief_store) as archive:
        message = surfacing_message(archive, 3)
        change = HullChange(
            parameter="viscous.K_L", meaning="lift", unit="kg/m", first=440.0, probability=0.97, change=-130.0,
            change_std=20.0, since=2, dives=9, above_20_percent=0.0,
        )  # fmt: skip
        less_probable = [change.model_copy(update={"probability": probability}) for probability in (0.9, 0.79)]
        changed = message.model_copy(update={"hull_changes": (change, *less_probable)})
        monkeypatch.setattr(module, "surfacing_message", lambda *_: changed)
        monkeypatch.setattr(module, "filter_fallbacks", lambda *_: [2])
        (anomalies,) = (block for block in operator_section(archive, summary).blocks if isinstance(block, Remarks))
    assert anomalies.texts[:3] == (
        "lift: changed since profile 2, by −130 ± 20 kg/m (probability 0.97)",
        "lift: possibly changed since profile 2, by −130 ± 20 kg/m (probability 0.90)",
        "the smoother has no estimate for profile 2",
    )


def test_every_field_of_a_trim_has_its_unit_in_the_schema():
    assert all(field.description for field in Trim.model_fields.values())
    assert (DOCS / "report.md").read_text("utf-8").count("ballast") >= 1
