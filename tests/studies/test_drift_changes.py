"""Change points of the drift study on synthetic tables: moments, the drag that both legs share, and equivalent drag."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from benchmarks import drift_series
from gliderhpc.platform import read_platform
from gliderhpc.report.studies.drift import drag_figure, figure_9
from gliderhpc.store_schema.columns import median_column
from gliderhpc.store_schema.schema import group_called
from gliderhpc.studies.library.drift import change_points
from gliderhpc.studies.library.drift.change_points import (
    find_changes,
    find_moment_changes,
    moment_per_degree,
)
from gliderhpc.studies.library.drift.change_rows import (
    change_rows,
    moment_rows,
    read_moment_changes,
    stored_moment_changes,
)
from gliderhpc.studies.library.drift.change_text import (
    describe_briefly,
    describe_change,
    drag_name,
    moment_lines,
    moment_name,
)
from gliderhpc.studies.library.drift.changes import MOMENTS, Changes
from gliderhpc.studies.library.drift.medians import PRIMARY, ChangeSettings, DriftSettings
from gliderhpc.studies.library.drift.verdict import find_drift, verdict_lines
from gliderhpc.vocabulary import PHASES

HULL = read_platform("petrel-l")
REFERENCE = HULL.viscous.K_D0
PER_DEGREE = moment_per_degree(HULL)
SETTINGS = ChangeSettings(resamples=100)


def stepped(length=14, first=8, drag=None, moments=None, scatter=0.01, seed=0):
    """Table of a mission of 14 dives whose medians step at a dive: K_D0 in parts of the hull's, moments in N m."""
    rng = np.random.default_rng(seed)
    numbers = np.arange(1.0, length + 1.0)
    later, planted = numbers >= first, moments or {}
    table = {"profile": numbers, "elapsed_days": 0.03 * numbers, "epoch": (numbers - 1.0) // 3}
    for phase, effect in zip(PHASES, (-2.5, 2.5), strict=True):
        table |= {f"weight_effect_{phase}": effect, f"heave_effect_{phase}": 0.3}
        drift = REFERENCE * ((drag or {}).get(phase, 0.0) * later + scatter * rng.standard_normal(length))
        own = {name: planted.get((name, phase), 0.0) * later + 0.005 * rng.standard_normal(length) for name in MOMENTS}
        for estimate in PRIMARY:
            noise = 0.001 * rng.standard_normal(length)
            table[median_column("K_D0", phase, estimate)] = drift + noise
            table[median_column("B_cu", phase, estimate)] = -0.1 * drift + noise
            table |= {median_column(name, phase, estimate): values + 0.1 * noise for name, values in own.items()}
    return pd.DataFrame(table)


def drag_changes(**planted):
    return find_changes(stepped(**planted), REFERENCE, SETTINGS, 0)


# Moments

ROLLED = {("B_cp", "dive"): 0.35, ("B_cp", "climb"): 0.34, ("B_cr", "dive"): -0.16, ("B_cr", "climb"): 0.14}


def test_a_step_of_the_rolling_moment_is_found_and_named():
    """As after a shift of weight to one side: the recorded roll changes, the drag does not."""
    table = stepped(moments=ROLLED)
    assert find_changes(table, REFERENCE, SETTINGS, 0).found == ()
    changes = find_moment_changes(table, HULL, SETTINGS, 0)
    (one,) = changes.found
    assert (one.kind, one.first, one.phases, one.moments) == ("step", 8, PHASES, ("B_cp", "B_cr"))
    assert one.size("B_cp", "dive").value == pytest.approx(0.35, abs=0.02)
    (line,) = moment_lines(changes, PER_DEGREE)
    assert line.startswith("a step: from profile 8 on (day 0.2), dives and climbs: rolling moment: +0.3")
    tilt = abs(one.size("B_cp", "dive").value) / PER_DEGREE
    assert f"enough to tilt the hull by {tilt:.1f} degrees; also the yawing moment: -0.1" in line
    assert "a lost wing, or a battery or payload that has shifted sideways" in line


def test_three_moments_that_change_at_once_may_be_a_lost_wing():
    """A lost wing tilts, rolls and turns the hull; one whose pitch alone changes has lost no wing."""
    wing = ROLLED | {("B_cq", "dive"): -0.3, ("B_cq", "climb"): -0.4}
    (line,) = moment_lines(find_moment_changes(stepped(moments=wing), HULL, SETTINGS, 0), PER_DEGREE)
    assert line.count("; also the ") == 2
    cause = "since all three moments change at the same profile, also with a lost or bent wing or fin"
    assert cause in line
    for other in (ROLLED, {("B_cq", "climb"): -0.36}):
        (line,) = moment_lines(find_moment_changes(stepped(moments=other), HULL, SETTINGS, 0), PER_DEGREE)
        assert "all three" not in line


def test_the_verdict_names_a_change_of_the_moments():
    table = stepped(moments=ROLLED)
    moments = find_moment_changes(table, HULL, SETTINGS, 0)
    found = find_drift(table, HULL, DriftSettings(resamples=200), changes=Changes(p=0.5), moments=moments)
    lines = verdict_lines(found.verdict, found.trends, 0.5)
    assert lines[0].startswith("verdict: a step of the rolling moment (from profile 8 on, dives and climbs); in addi")
    assert lines[1] == "no step, ramp or episode of drag or axial force was detected (p 0.500)"
    assert "rolling moment: +0.3" in lines[2]
    assert "these records do not prove a cause" in lines[-1]
    assert found.verdict.as_json(0.5)["moment_changes"]["found"][0]["moment"] == "rolling moment"


def test_no_line_is_drawn_through_a_step_and_no_legend_over_data():
    table = stepped(moments=ROLLED)
    moments = find_moment_changes(table, HULL, SETTINGS, 0)
    found = find_drift(table, HULL, DriftSettings(resamples=200), changes=Changes(p=0.5), moments=moments)
    figure = figure_9("mission", table, found.primary, (), moments.found)
    lines = {
        panel.get_title(loc="left")[4:]: [one for one in panel.lines if one.get_linestyle() != "None"]
        for panel in figure.axes
    }
    assert {name for name in (*MOMENTS, "B_cu") if not lines[name]} == {"B_cp", "B_cr"}
    (drag,) = drag_changes(drag={"dive": 0.2, "climb": 0.2}).found
    for one in (figure, drag_figure("mission", table, found.verdict.drags, (drag,))):
        assert not any(panel.get_legend() for panel in one.axes)
        names = [text.get_text() for text in one.legends[0].get_texts()]
        assert {"dive, adjoint", "climb, smoothed"} < set(names)
        assert len(names) == len(set(names))
    assert not any(one.get_linestyle() != "None" for panel in drag_figure(
        "mission", table, found.verdict.drags, (drag,)).axes for one in panel.lines)  # fmt: skip


def test_a_moment_on_one_leg_and_a_small_one():
    (one,) = find_moment_changes(stepped(moments={("B_cq", "climb"): -0.36}), HULL, SETTINGS, 0).found
    assert (one.phases, one.moments) == (("climb",), ("B_cq",))
    small = {("B_cq", phase): 0.2 * PER_DEGREE for phase in PHASES}
    changes = find_moment_changes(stepped(moments=small), HULL, SETTINGS, 0)
    assert changes.found == ()
    assert (
        "no step, ramp or episode of rolling, pitching or yawing moment was detected"
        in moment_lines(changes, PER_DEGREE)[0]
    )
    all_named = SETTINGS.model_copy(update={"smallest_tilt": 0.1})
    assert len(find_moment_changes(stepped(moments=small), HULL, all_named, 0).found) == 1


def test_calm_missions_show_no_change_of_the_moments():
    tables = [drift_series.drawn_medians(14, 0.4, np.random.default_rng(seed)) for seed in range(15)]
    assert sum(bool(find_moment_changes(one, HULL, SETTINGS, 0).found) for one in tables) <= 1


def test_both_searches_share_the_level():
    """A change with a probability between half of the level and the level is not named."""
    table = stepped(drag={"dive": 0.2, "climb": 0.2}, moments=ROLLED)
    for level, count in ((0.019, 0), (0.03, 1)):  # the least probability of 100 null series is 1 / 101
        settings = SETTINGS.model_copy(update={"level": level})
        assert len(find_changes(table, REFERENCE, settings, 0).found) == count
        assert len(find_moment_changes(table, HULL, settings, 0).found) == count


def test_the_most_probable_change_is_mentioned_although_it_is_not_significant(monkeypatch):
    """A rolling moment that began during a mission of 14 dives was passed over in silence at a probability of 0.015."""
    table = stepped(moments=ROLLED)
    changes = find_moment_changes(table, HULL, SETTINGS.model_copy(update={"level": 0.019}), 0)
    (significant,) = find_moment_changes(table, HULL, SETTINGS.model_copy(update={"level": 0.03}), 0).found
    assert changes.found == ()
    assert changes.next == describe_briefly(significant, moment_name)
    attributes = {"p_of_next_moment_change": changes.p, "next_moment_change": changes.next}
    names = {name: ("moment_change", values) for name, values in stored_moment_changes(Changes((significant,))).items()}
    empty = xr.Dataset(names, attrs=attributes).isel(moment_change=slice(0, 0))
    (line,) = moment_lines(read_moment_changes(xr.DataTree.from_dict({"drift": empty})), PER_DEGREE)
    since = f"from profile {significant.first} on, dives and climbs"
    assert line.endswith(f"; the most probable is a step of the rolling moment ({since})")
    monkeypatch.setattr(change_points, "MAX_NAMED_P", 0.5 * changes.p)
    probably_chance = find_moment_changes(table, HULL, SETTINGS.model_copy(update={"level": 0.019}), 0)
    assert (probably_chance.p, probably_chance.next) == (changes.p, "")


def test_changes_of_the_moments_are_read_back_as_they_were_left():
    changes = find_moment_changes(stepped(moments=ROLLED), HULL, SETTINGS, 0)
    left, group = stored_moment_changes(changes), group_called("drift")
    assert all(group[name].dims == ("moment_change",) and group[name].units for name in left)
    variables = {name: ("moment_change", values) for name, values in left.items()}
    stored = xr.Dataset(variables, attrs={"p_of_next_moment_change": 0.5})
    back = read_moment_changes(xr.DataTree.from_dict({"drift": stored}))
    pd.testing.assert_frame_equal(pd.DataFrame(moment_rows(back)), pd.DataFrame(moment_rows(changes)))
    assert moment_lines(back, PER_DEGREE) == moment_lines(changes, PER_DEGREE)
    assert back.p == 0.5
    assert stored_moment_changes(Changes()) == {}
    earlier = xr.DataTree.from_dict({"drift": xr.Dataset(attrs={"p_of_next_change": 0.5})})
    assert read_moment_changes(earlier).found == ()


# The drag that both legs share


def test_the_drag_is_the_mean_of_both_legs_and_its_interval_contains_the_hulls_part():
    """Errors of the hull that are constant, as of the pitch, move dives and climbs to opposite sides of the truth."""
    (one,) = drag_changes(drag={"dive": 0.21, "climb": 0.14}).found
    size = one.drag
    percent = [100.0 * end / REFERENCE for end in (size.value, size.low, size.high)]
    assert percent[0] == pytest.approx(17.5, abs=1.0)
    assert 12.0 < percent[1] < 14.5
    assert 20.5 < percent[2] < 23.0
    text = describe_change(one, REFERENCE)
    assert (
        f"dives and climbs: drag {percent[0]:+.0f} % at its maximum (95 % interval {percent[1]:+.0f} to "
        f"{percent[2]:+.0f} %), mean of dives (+"
    ) in text
    assert "equivalent" not in text
    row = next(row for row in change_rows(Changes((one,)), REFERENCE) if row["part"] == "together")
    assert (row["K_D0_change_low"], row["quantity"]) == (size.low, "drag")


@pytest.mark.parametrize(
    ("drag", "phases", "says"),
    [
        ({"climb": 0.14}, "climbs", "on one leg alone, so not a drag that dives and climbs share: ballast not as"),
        ({"dive": -0.18, "climb": 0.05}, "dives", "opposite on dives and climbs (climbs +"),
        ({"dive": -0.28, "climb": 0.26}, "dives and climbs", "opposite on dives and climbs, so not a change of the"),
    ],
)
def test_a_change_of_one_leg_or_of_opposite_signs_is_an_equivalent_drag(drag, phases, says):
    changes = drag_changes(drag=drag)
    (one,) = changes.found
    text = describe_change(one, REFERENCE)
    assert not one.is_drag
    assert drag_name(one) == "equivalent drag"
    assert f"{phases}: " in text
    assert "equivalent drag" in text
    assert ", drag " not in text
    assert says in text
    assert "vertical motion of the water" in text
    table = stepped(drag=drag)
    found = find_drift(table, HULL, DriftSettings(resamples=200), changes=changes)
    assert verdict_lines(found.verdict, found.trends, 0.5)[0].startswith("verdict: a step of the equivalent drag (from")


# Late changes, series without scatter, and few profiles outside an episode


@pytest.mark.parametrize("last", [3, 4, 6])
def test_a_step_in_the_last_profiles_is_not_an_episode_of_the_opposite_sign(last):
    changes = drag_changes(length=33, first=34 - last, drag={"dive": 0.3, "climb": 0.3}, scatter=0.02)
    (one,) = changes.found
    assert (one.kind, one.first, one.back) == ("step", 34 - last, None)
    assert one.size("K_D0", "dive").value == pytest.approx(0.3 * REFERENCE, rel=0.15)


@pytest.mark.parametrize("value", [0.0, 0.1])
def test_a_series_without_scatter_hides_no_change(value):
    table = stepped(moments=ROLLED)
    for estimate in PRIMARY:
        table[median_column("B_cq", "dive", estimate)] = value
    (one,) = find_moment_changes(table, HULL, SETTINGS, 0).found
    assert (one.kind, one.first) == ("step", 8)


def test_the_trend_outside_an_episode_does_not_contain_it():
    table = stepped(length=15, first=99, scatter=0.02)
    inside = table["profile"].between(6, 10)
    for estimate in PRIMARY:
        for phase in PHASES:
            table.loc[inside, median_column("K_D0", phase, estimate)] += 0.5 * REFERENCE
            table.loc[inside, median_column("B_cu", phase, estimate)] -= 0.05 * REFERENCE
    changes = find_changes(table, REFERENCE, SETTINGS, 0)
    assert [one.kind for one in changes.found] == ["episode"]
    found = find_drift(table, HULL, DriftSettings(resamples=200), changes=changes)
    low, high = found.verdict.interval
    assert -0.2 * REFERENCE < low < high < 0.2 * REFERENCE
    few = Changes((replace(changes.found[0], first=2, last=14),), changes.p)
    unknown = find_drift(table, HULL, DriftSettings(resamples=200), changes=few)
    lines = verdict_lines(unknown.verdict, unknown.primary, 0.5)
    assert "drag common to dive and climb: not known, since fewer than 4 profiles have a value" in lines
