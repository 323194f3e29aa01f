"""Study `hull`: sum, columns in the mission's group, verdict, and state of the archive after a failure."""

import math
import shutil
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from support.hull_dives import KEYS, PARAMETERS, START, dives
from support.missions import program
from support.shown import check_shown_as_left, shown

from gliderhpc.archive.mission import open_mission
from gliderhpc.archive.profile import done_profiles
from gliderhpc.errors import InputError
from gliderhpc.flight.hull_parameters import hull_parameters
from gliderhpc.mission_hull.estimate import ProfileTerm, solve_mission
from gliderhpc.platform import read_platform
from gliderhpc.report.studies import hull as shown_hull
from gliderhpc.store_schema import (
    check_archive,
    consolidate,
    create_archive,
    create_study,
    finish_study,
    restored_on_error,
    set_attributes,
)
from gliderhpc.store_schema.deep_check import damaged_chunks
from gliderhpc.store_schema.maintenance import grow_archive, mend_metadata
from gliderhpc.store_schema.schema import MISSION, STUDIES, group_called
from gliderhpc.studies.hull import JOINT, NAME, HullSettings, MissionTerms, combine_terms, mission_hull, read_terms
from gliderhpc.studies.study import Plan, Preparation
from gliderhpc.vocabulary import HULL_PARAMETERS

HULL = read_platform("petrel-l")
SIZES = {"sample": 4, "record": 3, "window": 2, "segment": 1}


def summed_up(terms, without=()):
    """Content of the group for some dives."""
    mission = MissionTerms(HULL, PARAMETERS, terms, without)
    settings = SimpleNamespace(robust=True, change=1.0)
    return mission, mission_hull(Plan(None, settings, (), {}, Preparation(inputs=mission), ()), {})


def history_of(mission, content):
    """The findings as the archive gives them back."""
    columns = {
        name: (("profile", "parameter"), np.array([row[name] for row in content.rows.values()]))
        for name in ("estimate", "estimate_std", "estimate_sequential", "estimate_sequential_std")
    }
    changes = {name: ("suspect", values) for name, values in content.variables.items()}
    coordinates = {"profile": list(content.rows), "parameter": list(HULL_PARAMETERS), **content.labels}
    days = np.array([(d.time - START) / np.timedelta64(1, "D") for d in mission.terms])
    return shown_hull.HullHistory(HULL, xr.Dataset({**columns, **changes}, coordinates, content.attributes), days)


def test_values_are_those_of_the_sum_in_the_units_of_the_platform_file():
    mission, content = summed_up(dives(6, {}), without=(9,))
    found = solve_mission(mission.terms, mission.prior)
    place = HULL_PARAMETERS.index("viscous.K_D0")
    drag = PARAMETERS[KEYS.index("viscous.K_D0")]
    eta, std = found.eta[3, KEYS.index("viscous.K_D0")], found.std[3, KEYS.index("viscous.K_D0")]
    row = content.rows[4]
    assert row["estimate"][place] == pytest.approx(HULL.viscous.K_D0 * np.exp(0.4 * eta), rel=1e-12)
    assert row["estimate_std"][place] == pytest.approx(drag.slope(HULL, eta) * std, rel=1e-12)
    assert content.rows[6]["estimate"][place] == content.rows[6]["estimate_sequential"][place]
    assert np.isnan(row["estimate"][HULL_PARAMETERS.index("buoyancy.compressibility")])
    assert np.isnan(row["change"][HULL_PARAMETERS.index("viscous.K_q")])
    assert content.rows[9]["message"].startswith("the smoother has no estimate of this profile")


@pytest.mark.parametrize(
    ("probability", "words"),
    [(0.79, "no change detected"), (0.9, "possibly changed"), (0.96, "calibrate those before")],
)
def test_a_change_is_named_as_certain_possible_or_not_shown(probability, words):
    mission, content = summed_up(dives(6, {}))
    content.variables["change_probability"][:] = probability
    assert all(words in line for line in shown_hull.verdict_lines(history_of(mission, content)))


def test_a_change_that_only_the_last_dive_shows_has_to_be_confirmed():
    """A single unusual dive is often an effect of the water; calibrating it alone would be of no use."""
    mission, content = summed_up(dives(6, {}))
    content.variables["change_probability"][:] = 0.97
    content.variables["onset"][:] = 6
    lines = shown_hull.verdict_lines(history_of(mission, content))
    assert all(line.endswith("the next dive must confirm it") and "calibrate" not in line for line in lines)
    joint = content.attributes[JOINT]
    joint |= {"probability": 0.97, "onset": 6}
    content.variables["change_probability"][:] = 0.1
    (line,) = shown_hull.joint_lines(history_of(mission, content))
    assert line.endswith("the next dive must confirm it")


def test_a_roll_that_changes_is_named_as_a_change_of_the_hull():
    """As after the loss of a wing: 5 mm of roll trim from profile 19 on."""
    roll_trim = PARAMETERS[KEYS.index("position.hull.1")]
    step = 0.005 / roll_trim.deviation(HULL)
    mission, content = summed_up(dives(30, {roll_trim.key: np.where(np.arange(30) < 18, 0.0, step)}))
    history = history_of(mission, content)
    lines = dict(zip([p.key for p in history.suspects], shown_hull.verdict_lines(history), strict=True))
    assert lines.pop(roll_trim.key).startswith("roll trim (hull's mass to starboard): changed abruptly at profile 19")
    assert all("no change detected" in line for line in lines.values())


def test_dives_without_information_on_the_roll_cannot_show_its_change():
    """Slow records leave the roll out."""
    seen = np.array([p.key != "position.hull.1" for p in PARAMETERS], dtype=float)
    terms = [
        replace(term, score=seen * term.score, information=np.outer(seen, seen) * term.information, others=())
        for term in dives(12, {})
    ]
    mission, content = summed_up(tuple(terms))
    history = history_of(mission, content)
    lines = dict(zip([p.key for p in history.suspects], shown_hull.verdict_lines(history), strict=True))
    assert lines.pop("position.hull.1") == (
        "roll trim (hull's mass to starboard): the dives cannot reveal a change (probability 0.50)"
    )
    assert all("no change detected" in line for line in lines.values())


def test_fouling_is_named_with_its_onset_and_the_rest_is_not():
    """A ramp of the drag from profile 14 on, +27 % at the end."""
    course = np.clip((np.arange(30) - 12) / 17.0, 0.0, 1.0) * 0.6
    mission, content = summed_up(dives(30, {"viscous.K_D0": course}))
    history = history_of(mission, content)
    lines = dict(zip([p.key for p in history.suspects], shown_hull.verdict_lines(history), strict=True))
    assert lines["viscous.K_D0"].startswith("drag at zero angle of attack: changed gradually from profile")
    others = [line for key, line in lines.items() if key != "viscous.K_D0"]
    assert len(others) == 4
    assert all("no change detected" in line for line in others)
    change = history.change("viscous.K_D0")
    assert change["onset_low"] <= 14 <= change["onset_high"]
    truth = HULL.viscous.K_D0 * (np.exp(0.4 * 0.6) - 1.0)
    assert abs(change["change_total"] - truth) < 2.5 * change["change_total_std"]
    table = shown_hull.change_table(history).set_index("parameter")
    assert table.loc["viscous.K_D0", "probability"] > 0.95
    drag, volume = sorted(shown_hull.notable_changes(history), key=lambda found: found.key, reverse=True)
    assert (drag.key, drag.unit, drag.sentence) == ("viscous.K_D0", "kg/m", lines["viscous.K_D0"])
    assert (drag.size, drag.std, drag.probability) == (
        change["change_total"], change["change_total_std"], change["change_probability"],
    )  # fmt: skip
    assert volume.key == "buoyancy.neutral_volume"
    assert volume.probability < 0.95


def test_the_hull_as_a_whole_is_named_as_changed_possibly_changed_or_not():
    """The sentence names the combination unless single parameters are found."""
    mission, content = summed_up(dives(8, {}))
    (line,) = shown_hull.joint_lines(history_of(mission, content))
    assert line.startswith("hull as a whole: no change detected (probability 0.")
    joint = content.attributes[JOINT]
    assert {part["parameter"] for part in joint["parts"]} == {mission.parameters[i].key for i in mission.suspects}
    joint |= {"probability": 0.9, "onset": 5, "onset_low": 3, "onset_high": 6, "step_probability": 0.2}
    joint["combination_probability"] = 0.4
    joint["parts"] = [
        {"parameter": "viscous.K_D0", "included": 0.9, "change": 2.0, "change_std": 0.5},
        {"parameter": "buoyancy.neutral_volume", "included": 0.5, "change": 14.0, "change_std": 4.0},
        {"parameter": "viscous.K_L", "included": 0.2},
    ]
    history = history_of(mission, content)
    (line,) = shown_hull.joint_lines(history)
    assert "something has possibly changed gradually from profile 5 (3 to 6) (probability 0.900)" in line
    first = float(history.series("estimate", "viscous.K_D0")[0])
    assert "the dives do not show which parameters (probability of each: drag at zero angle of attack 0.90, " in line
    assert f"combination is drag at zero angle of attack by +{200.0 / first:.1f} %" in line
    assert line.endswith("and neutral oil volume by +14.0 ± 4.0 cm3 (0.40)")
    assert "lift over angle of attack 0.20" in line
    assert shown_hull._shown_jointly(history) == ()
    joint["probability"] = 0.99
    history = history_of(mission, content)
    (line,) = shown_hull._shown_jointly(history)
    assert "something has changed gradually" in line
    assert line.endswith("calibrate the dives before and after separately")
    content.variables["change_probability"][:] = 0.97
    (line,) = shown_hull.joint_lines(history_of(mission, content))
    assert line.endswith("(probability 0.990), as found for single parameters")


def test_parameters_that_changed_together_may_differ_at_the_last_dive():
    """Drag and lift whose effects nearly cancel: neither is found alone, and the sum allows both to change."""
    course = np.clip((np.arange(24) - 11) / 12.0, 0.0, 1.0)
    first, second = KEYS.index("viscous.K_D0"), KEYS.index("viscous.K_L")
    terms = []
    for term, part in zip(dives(24, {}, information=5.0), course, strict=True):
        pair, apart = np.zeros(len(KEYS)), np.zeros(len(KEYS))
        pair[[first, second]], apart[[first, second]] = 1.0, (part, -part)
        like = 60.0 * np.outer(pair, pair)
        noise = np.sqrt(60.0) * np.random.default_rng(len(terms)).standard_normal() * pair
        score = term.score + like @ np.full(len(KEYS), 0.1) + (term.information + like) @ apart + noise
        terms.append(replace(term, score=score, information=term.information + like))
    mission = MissionTerms(HULL, PARAMETERS, tuple(terms), ())
    found, changes, joint = combine_terms(mission, HullSettings())
    assert joint.probability > 0.99
    assert set(joint.combination) == {first, second}
    assert max(change.probability for change in changes.values()) < 0.95
    last = found.smoothed[-1]
    for i, truth in ((first, 1.1), (second, -0.9)):
        assert abs(last.mean[i] - truth) < 2.5 * last.std[i]


def test_a_pilot_reads_grams_and_millimetres():
    """Neutral volume 60 cm3 and battery 6 mm off."""
    volume, battery = (PARAMETERS[KEYS.index(key)] for key in ("buoyancy.neutral_volume", "position.battery"))
    off = {"buoyancy.neutral_volume": np.full(8, 60.0 / volume.deviation(HULL)),
           "position.battery": np.full(8, 0.006 / battery.deviation(HULL))}  # fmt: skip
    mission, content = summed_up(dives(8, off, information=3e4))
    rows = {row.quantity: row for row in shown_hull.pilot_rows(history_of(mission, content))}
    assert rows["neutral oil volume, last dive minus platform file"].ours == pytest.approx(60.0, abs=3.0)
    ballast = rows["equivalent ballast to add"]
    assert ballast.ours == pytest.approx(-60.0 * HULL.buoyancy.water_density / 1e3, abs=3.0)
    assert ballast.spread[0] < ballast.ours < ballast.spread[1]
    assert rows["battery zero, last dive minus platform file"].ours == pytest.approx(6.0, abs=0.5)
    low, high = rows["battery zero, last dive minus platform file"].spread
    assert low < 6.0 < high


def test_a_value_no_hull_has_is_warned_of():
    """A scale of the pitch that is four plausible deviations off."""
    mission, content = summed_up(dives(8, {"sensors.pitch_scale": np.full(8, -4.0)}, information=3e3))
    (line,) = shown_hull.implausible_lines(shown_hull.parameter_table(history_of(mission, content)))
    assert "sensors.pitch_scale by -4.0" in line
    assert "do not use these values for ballasting" in line
    usual, content = summed_up(dives(8, {}, information=3e3))
    assert shown_hull.implausible_lines(shown_hull.parameter_table(history_of(usual, content))) == ()


# In an archive


def test_the_group_is_the_missions_and_the_studys():
    names = {variable.name for variable in group_called(NAME).variables}
    assert {"score", "information", "estimate", "estimate_std", "estimate_sequential"} <= names
    assert len(names) == len(MISSION[NAME].variables) + len(STUDIES[NAME].variables)


@pytest.fixture
def empty(tmp_path):
    """Archive of three profiles without any content."""
    create_archive(tmp_path / "a.zarr", [1, 2, 3], SIZES, {})
    return tmp_path / "a.zarr"


def test_an_interrupted_study_is_named_and_the_missions_group_stands(empty):
    assert check_archive(empty) == []
    create_study(empty, NAME, labels={"suspect": ["viscous.K_D0"]})
    assert check_archive(empty) == ["hull: the study was interrupted; run it again"]
    finish_study(empty, NAME, {})
    assert check_archive(empty) == []
    assert damaged_chunks(empty) == []


def test_a_failed_study_leaves_the_group_as_it_was(empty):
    before = {path: path.read_bytes() for path in sorted(empty.rglob("*")) if path.is_file()}

    def fail():
        create_study(empty, NAME, labels={"suspect": ["viscous.K_D0"]})
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), restored_on_error(empty, NAME):
        fail()
    assert {path: path.read_bytes() for path in sorted(empty.rglob("*")) if path.is_file()} == before


def test_the_archive_grows_with_the_study(empty):
    create_study(empty, NAME, labels={"suspect": ["viscous.K_D0"]})
    finish_study(empty, NAME, {})
    grow_archive(empty, [1, 2, 3, 4, 5], SIZES)
    assert check_archive(empty) == []
    with xr.open_datatree(empty, engine="zarr") as tree:
        assert tree[NAME].ds["estimate"].shape == (5, len(HULL_PARAMETERS))


def test_lost_metadata_of_the_study_are_mended(empty):
    assert mend_metadata(empty) == []
    create_study(empty, NAME, labels={"suspect": ["viscous.K_D0"]})
    finish_study(empty, NAME, {})
    (empty / NAME / "estimate" / "zarr.json").unlink()
    assert mend_metadata(empty) == ["hull/estimate"]


@pytest.fixture(scope="module")
def studied(brief_store, tmp_path_factory):
    """Copy of the brief mission's archive after the study, and the program's output."""
    store = tmp_path_factory.mktemp("hull") / "mission.zarr"
    shutil.copytree(brief_store, store)
    return store, program("analyze", store, "hull", "--workers", 0)


@pytest.mark.compiled
def test_the_program_studies_a_mission(brief_store, studied):
    store, answer = studied
    assert answer.status == 0, answer.err
    assert "too few dives to detect a change" in answer.out + answer.err
    assert check_archive(store) == []
    assert damaged_chunks(store) == []
    with xr.open_datatree(store, engine="zarr") as tree, xr.open_datatree(brief_store, engine="zarr") as before:
        group, root = tree[NAME].ds.load(), tree.attrs
        for name, variable in before[NAME].ds.variables.items():
            xr.testing.assert_identical(group.variables[name].load(), variable.load())
    known = np.isfinite(group["estimate"].values)
    acts = np.isin(HULL_PARAMETERS, KEYS)
    assert known[:, acts].all()
    assert not known[:, ~acts].any()
    assert (group["estimate_std"].values[known] > 0.0).all()
    assert root["platform"]["name"] == "petrel-l"
    folder = store.with_name("mission-studies") / "hull"
    assert {path.name for path in folder.iterdir()} == {
        "parameters.csv", "changes.csv", "profiles.csv", "hull.png", "hull.json",
    }  # fmt: skip


class EarlierArchive:
    """An archive whose group `hull` lacks parameters that a later version has added."""

    def __init__(self, archive, later):
        self.archive = archive
        self.group = archive[NAME].to_dataset().load().drop_sel(parameter=later, other_parameter=later)

    def __getattr__(self, name):
        return getattr(self.archive, name)

    def __getitem__(self, name):
        return SimpleNamespace(to_dataset=lambda: self.group) if name == NAME else self.archive[name]


@pytest.mark.compiled
def test_an_archive_of_an_earlier_version_has_fewer_parameters(studied):
    """The sum is over the parameters that the archive has, at the places where it has them, and is shown."""
    store, _ = studied
    later = ["viscous.K_q", "sensors.actuator_lag"]
    with open_mission(store) as archive:
        earlier, numbers = EarlierArchive(archive, later), done_profiles(archive)
        whole, found = read_terms(archive, numbers), read_terms(earlier, numbers)
        history = shown_hull.read_history(earlier, numbers)
    left = [p.key not in later for p in whole.parameters]
    assert found.parameters == tuple(np.array(whole.parameters)[left])
    assert history.parameters == found.parameters
    for one, other in zip(whole.terms, found.terms, strict=True):
        np.testing.assert_array_equal(other.score, one.score[left])
        np.testing.assert_array_equal(other.information, one.information[np.ix_(left, left)])
    plan = Plan(None, SimpleNamespace(robust=True, change=1.0), (), {}, Preparation(inputs=found), ())
    row = mission_hull(plan, {}).rows[numbers[0]]
    known = np.isfinite(row["estimate"])
    assert len(known) == len(HULL_PARAMETERS) - len(later)
    assert [key for key, is_known in zip(found.labels, known, strict=True) if is_known] == sorted(
        (p.key for p in found.parameters), key=found.labels.index
    )


@pytest.mark.compiled
@pytest.mark.damages_archive
def test_an_archive_with_a_part_of_the_information_is_reported_and_not_summed(studied, tmp_path):
    """An earlier schema lacks the terms of the other noise: a study made then is shown, but not repeated."""
    earlier = shutil.copytree(studied[0], tmp_path / "earlier.zarr")
    set_attributes(earlier, {"schema_version": "1.7"})
    for name in ("score_other", "information_other"):
        shutil.rmtree(earlier / NAME / name)
    consolidate(earlier)
    assert "parameters" in shown(earlier, NAME).tables
    answer = program("analyze", earlier, "hull", "--workers", 0)
    assert answer.status == 2
    assert "made without the smoother's information on the hull; run the mission again" in answer.err


@pytest.mark.compiled
def test_the_study_is_shown_from_the_archive_alone(studied, tmp_path):
    store, _ = studied
    check_shown_as_left(store, NAME, store.with_name("mission-studies") / NAME, tmp_path / "out")


@pytest.mark.compiled
def test_a_study_that_was_not_run_is_not_shown(brief_store):
    with pytest.raises(InputError, match="does not contain the study hull"):
        shown(brief_store, NAME)


@pytest.mark.parametrize("gradual", [True, False])
def test_the_battery_s_zero_may_move_with_the_weight(gradual):
    """Added weight has a position: trim changes with weight, in a step or gradually, and its interval holds."""
    hull = read_platform("slocum")
    parameters = hull_parameters(hull)
    keys, count = [p.key for p in parameters], 24
    volume, battery = keys.index("buoyancy.neutral_volume"), keys.index("position.battery")
    off = []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        eta, dives = 0.7 * rng.standard_normal(len(keys)), []
        for i in range(count):
            part = max(0, i - 7) / (count - 8) if gradual else float(i >= 8)
            now = eta.copy()
            now[volume] += 0.8 * part
            now[battery] -= 0.6 * part
            rows = math.sqrt(60.0) * rng.standard_normal((20, len(keys)))
            score = rows.T @ (rows @ now + rng.standard_normal(20))
            time = np.datetime64("2024-01-01") + np.timedelta64(12 * i, "h")
            dives.append(ProfileTerm(i + 1, time, np.zeros(len(keys)), score, rows.T @ rows))
        found, changes, _ = combine_terms(MissionTerms(hull, parameters, tuple(dives), ()), HullSettings())
        assert changes[volume].probability > 0.9
        last = found.smoothed[-1]
        off.append((last.mean - now)[battery] / last.std[battery])
    assert np.abs(off).max() < 4.0
