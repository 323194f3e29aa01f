"""Watch: each dive is reported once, whatever happens to files or process, and the archive equals that of a new run."""

import functools
import json
import os
import re
import shutil
from contextlib import ExitStack
from dataclasses import replace
from inspect import signature
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from support.missions import changed_observations, program
from support.seaglider_files import write_dive
from support.slocum_files import flight, write_binary

from gliderhpc.api.import_options import BY_KIND, FLAGS, FOLDERS, NUMBERS, check_option_values
from gliderhpc.api.records import IMPORTERS
from gliderhpc.archive.mission import open_for_reading
from gliderhpc.errors import InputError
from gliderhpc.estimation.currents import local_displacement
from gliderhpc.flight.glider import load_platform
from gliderhpc.mission import resume
from gliderhpc.mission.lock import locked
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.observations import joined, open_observations
from gliderhpc.observations.files.landing import CopiedFile, FileState, copy_file, list_files, older, unchanged
from gliderhpc.observations.joined import join_observations
from gliderhpc.observations.records import Fix
from gliderhpc.report.page.surfacing_page import write_surfacing_page
from gliderhpc.store_schema import SCHEMA_VERSION, set_attributes
from gliderhpc.surfacing.dive_results import error_ellipse, surfacing_message
from gliderhpc.surfacing.message import SurfacingMessage
from gliderhpc.surfacing.next_displacement import expected_displacement
from gliderhpc.surfacing.next_surfacing import dives_until, predict_surfacing, surface_offset
from gliderhpc.watch import inversion, watcher
from gliderhpc.watch import state as watch_state
from gliderhpc.watch.alerts import Box, Rules
from gliderhpc.watch.records import FileImport, is_candidate
from gliderhpc.watch.state import ReportedDive, WatchState
from gliderhpc.watch.versions import accept_or_restore, remove_backups
from gliderhpc.watch.watcher import Listener, WatchInputs, open_watch

pytestmark = pytest.mark.compiled


@pytest.fixture(scope="module")
def dives(swift, tmp_path_factory):
    """One observation file a dive of the swift mission, with the fixes up to its surfacing."""
    folder = tmp_path_factory.mktemp("dives")
    return [_dive(swift, folder / f"dive{number}.nc", number) for number in (1, 2, 3)]


def _dive(source: Path, out: Path, number: int, share: float = 1.0) -> Path:
    def change(content: xr.Dataset) -> xr.Dataset:
        profile, time, fix = (content[name].values for name in ("profile", "time", "fix_time"))
        own = np.flatnonzero(profile == number)
        before, after = time[profile < number], time[profile > number]
        first, last = max(before, default=-np.inf), min(after, default=np.inf)
        chosen = own[: max(2, round(share * len(own)))]
        # Every fix is in the file of the dive after which it was taken, those before the mission in the first.
        end = last if share == 1.0 else first
        fixes = (fix > (-np.inf if number == 1 else time[own[-1]])) & (fix < end)
        return content.isel(time=chosen, fix=np.flatnonzero(fixes) if fixes.any() else [0])

    return changed_observations(source, out, change)


class _Reports:
    def __init__(self) -> None:
        self.dives: list[SurfacingMessage] = []
        self.faults: list[tuple[str, str]] = []

    @property
    def numbers(self) -> list[tuple[int, int]]:
        return [(message.profile, message.revision) for message in self.dives]

    def listener(self) -> Listener:
        return Listener(lambda message, _: self.dives.append(message), lambda *fault: self.faults.append(fault))


def _watched(folder: Path) -> WatchInputs:
    (folder / "land").mkdir(exist_ok=True)
    hull, settings = load_platform("petrel-l"), MissionSettings()
    return WatchInputs(
        folder / "land", FileImport(None, {}), hull, settings, folder / "m.zarr", folder / "m-watch", workers=0
    )


def _once(folder: Path, **changes: object) -> _Reports:
    reports = _Reports()
    with open_watch(replace(_watched(folder), **changes), reports.listener()) as opened:
        opened.once(0.0)
    return reports


def _assert_as_fresh(store: Path, fresh: Path) -> None:
    """Check that two archives have equal values; computing times are not compared."""
    with xr.open_datatree(store, engine="zarr") as one, xr.open_datatree(fresh, engine="zarr") as other:
        assert set(one.children) == set(other.children)
        for node in other.subtree:
            if node.name != "commits":
                timed = ["run_seconds"] if "run_seconds" in node.variables else []
                found = one[node.path].to_dataset().drop_vars(timed).load()
                xr.testing.assert_equal(found, node.to_dataset().drop_vars(timed).load())


def test_each_dive_is_reported_once_and_the_archive_is_that_of_a_fresh_run(dives, swift_store, tmp_path):
    _watched(tmp_path)
    shutil.copy(dives[0], tmp_path / "land")
    assert _once(tmp_path).numbers == [(1, 0)]
    assert _once(tmp_path).numbers == []
    shutil.copy(dives[1], tmp_path / "land")
    # The same again under another name, and with another time of change.
    shutil.copy(dives[0], tmp_path / "land" / "again.nc")
    os.utime(tmp_path / "land" / dives[0].name, (1e9, 1e9))
    reports = _once(tmp_path)
    assert (reports.numbers, reports.faults) == ([(2, 0)], [])
    # Files that vanish are still in the archive.
    (tmp_path / "land" / dives[0].name).unlink()
    shutil.copy(dives[2], tmp_path / "land")
    (message,) = _once(tmp_path).dives
    _assert_as_fresh(tmp_path / "m.zarr", swift_store)
    with xr.open_zarr(swift_store) as table:
        row = table.sel(profile=3)
        assert message.current.north == float(row["dac_north_smoothed"])
        assert message.current.east_std == float(row["dac_east_smoothed_std"])
        assert message.surfacing.latitude == float(row["exit_latitude"])
        assert message.inversion.windows == int(row["window_count"])
    for ending in ("json", "html"):
        assert len(list((tmp_path / "m-watch").glob(f"dive-*.{ending}"))) == 3


def test_messages_equal_those_of_a_fresh_run_and_each_file_is_read_once(dives, tmp_path, monkeypatch):
    opened: list[str] = []
    read = joined._read_file

    @functools.wraps(read)
    def counted(path: Path) -> object:
        opened.append(path.name)
        return read(path)

    monkeypatch.setattr(joined, "_read_file", counted)
    grown, fresh = tmp_path / "grown", tmp_path / "fresh"
    for folder in (grown, fresh):
        folder.mkdir()
        _watched(folder)
    reported: list[SurfacingMessage] = []
    for dive in dives:
        shutil.copy(dive, grown / "land")
        reported += _once(grown).dives
    assert opened == [dive.name for dive in dives]
    for dive in dives[:2]:
        shutil.copy(dive, fresh / "land")
    assert reported[1].next_surfacing is not None
    assert _untimed(_once(fresh).dives[-1]) == _untimed(reported[1])


def _untimed(message: SurfacingMessage) -> SurfacingMessage:
    return message.model_copy(update={"inversion": message.inversion.model_copy(update={"seconds": None})})


def test_the_plan_of_the_next_dive_is_for_the_latest_dive_and_is_read_again_each_time(dives, tmp_path):
    _watched(tmp_path)
    plan = tmp_path / "plan.yaml"
    plan.write_text("heading: 90\nduration: 1800\n", "utf-8")
    for dive in dives[:2]:
        shutil.copy(dive, tmp_path / "land")
    first, second = _once(tmp_path, plan=plan).dives
    assert [each.next_surfacing.plan for each in (first, second)] == ["", "heading 090°, 30 min"]
    assert second.next_surfacing.longitude > second.surfacing.longitude
    plan.write_text("heading: 400\n", "utf-8")
    shutil.copy(dives[2], tmp_path / "land")
    reports = _once(tmp_path, plan=plan)
    assert reports.dives[0].next_surfacing.plan == ""
    ((name, why),) = reports.faults
    assert name == "plan.yaml"
    assert "heading is 400" in why
    assert "like the last" in why


def test_a_late_dive_goes_to_its_place(dives, swift_store, tmp_path):
    _watched(tmp_path)
    for dive in (dives[0], dives[2]):
        shutil.copy(dive, tmp_path / "land")
    assert _once(tmp_path).numbers == [(1, 0), (3, 0)]
    shutil.copy(dives[1], tmp_path / "land")
    assert _once(tmp_path).numbers == [(2, 0)]
    _assert_as_fresh(tmp_path / "m.zarr", swift_store)


def test_a_damaged_file_is_named_once_and_tried_again_when_it_changes(dives, tmp_path):
    _watched(tmp_path)
    shutil.copy(dives[0], tmp_path / "land")
    cut = tmp_path / "land" / dives[1].name
    cut.write_bytes(dives[1].read_bytes()[:9000])
    reports = _once(tmp_path)
    assert reports.numbers == [(1, 0)]
    ((name, why),) = reports.faults
    assert name == dives[1].name
    assert "\n" not in why
    assert _once(tmp_path).faults == []
    shutil.copy(dives[1], cut)
    reports = _once(tmp_path)
    assert (reports.numbers, reports.faults) == ([(2, 0)], [])


def test_a_dive_that_comes_in_pieces_is_revised_and_the_changes_are_listed(swift, dives, tmp_path):
    _watched(tmp_path)
    _dive(swift, tmp_path / "land" / "dive1.nc", 1, share=0.6)
    assert _once(tmp_path).numbers == [(1, 0)]
    shutil.copy(dives[0], tmp_path / "land" / "dive1.nc")
    (message,) = _once(tmp_path).dives
    assert (message.profile, message.revision) == (1, 1)
    assert any(change.startswith("samples: ") for change in message.changes)
    (path,) = (tmp_path / "m-watch").glob("dive-*.json")
    assert SurfacingMessage.model_validate_json(path.read_text("utf-8")) == message


def _without_fixes_after(file: Path, out: Path) -> None:
    """Write a dive's file without the fixes after the dive."""

    def change(content: xr.Dataset) -> xr.Dataset:
        return content.isel(fix=np.flatnonzero(content["fix_time"].values <= content["time"].values[-1]))

    changed_observations(file, out, change)


def test_a_current_that_becomes_known_with_the_next_file_is_reported(dives, tmp_path):
    """Many gliders send the fix of a surfacing with the next dive."""
    land = _watched(tmp_path).source
    _without_fixes_after(dives[0], land / "dive1.nc")
    (before,) = _once(tmp_path).dives
    assert before.current is None
    # As an earlier version of the program left it.
    state = tmp_path / "m-watch" / "state.json"
    content = json.loads(state.read_text("utf-8"))
    assert content["reported"][0].pop("current_known") is False
    state.write_text(json.dumps(content), "utf-8")
    with xr.open_dataset(dives[0], decode_times=False) as first, xr.open_dataset(dives[1], decode_times=False) as next_:
        late = first.isel(fix=np.flatnonzero(first["fix_time"].values > first["time"].values[-1]))
        fixes = [name for name, variable in first.variables.items() if variable.dims == ("fix",)]
        joined = xr.concat([late[fixes], next_[fixes]], "fix").drop_vars("fix", errors="ignore")
        changed_observations(dives[1], land / "dive2.nc", lambda content: content.drop_dims("fix").merge(joined))
    reports = _once(tmp_path)
    assert reports.numbers == [(1, 1), (2, 0)]
    assert reports.dives[0].current is not None
    assert any(change.startswith("current north, m/s: unknown to") for change in reports.dives[0].changes)
    rules = Rules(current_above=0.0, next_surfacing_outside=Box(south=-80.0, north=-79.0, west=0.0, east=1.0))
    late, new = (rules.violations(message) for message in reports.dives)
    assert [alert.partition(" ")[0] for alert in late] == ["current"]
    assert [alert.partition(" ")[0] for alert in new] == ["current", "next"]
    assert _once(tmp_path).numbers == []


def test_an_unreadable_message_is_replaced(swift, dives, tmp_path, caplog):
    _watched(tmp_path)
    _dive(swift, tmp_path / "land" / "dive1.nc", 1, share=0.6)
    _once(tmp_path)
    (path,) = (tmp_path / "m-watch").glob("dive-*.json")
    path.write_text(path.read_text("utf-8")[:200], "utf-8")
    shutil.copy(dives[0], tmp_path / "land" / "dive1.nc")
    (message,) = _once(tmp_path).dives
    assert (message.revision, message.changes) == (1, ())
    assert "is not a readable message" in caplog.text
    assert SurfacingMessage.model_validate_json(path.read_text("utf-8")) == message


def _cut_bytes(file: Path, _: Path) -> None:
    file.write_bytes(file.read_bytes()[:9000])


def _cut_record(file: Path, source: Path) -> None:
    _dive(source, file, 2, share=0.7)


def _annotate(file: Path, _: Path) -> None:
    changed = changed_observations(file, file.with_suffix(".new"), lambda content: content.assign_attrs(comment="x"))
    changed.replace(file)


@pytest.mark.long
@pytest.mark.parametrize(
    ("change", "words"),
    [(_cut_bytes, "cannot be used"), (_cut_record, "has fewer samples of dive 2"), (_annotate, None)],
)
def test_a_version_that_is_worth_less_does_not_replace_a_dive(change, words, swift, dives, swift_store, tmp_path):
    """A damaged or shorter file is named once; neither it nor an equal one loses the dive, and later ones are used."""
    _watched(tmp_path)
    for dive in dives:
        shutil.copy(dive, tmp_path / "land")
    assert len(_once(tmp_path).dives) == 3
    landed, earlier = tmp_path / "land" / dives[1].name, tmp_path / "m-watch" / "files" / "earlier"
    change(landed, swift)
    earlier.mkdir()
    (earlier / "left-by-a-kill").touch()
    reports = _once(tmp_path)
    assert reports.dives == []
    assert [name for name, _ in reports.faults] == ([landed.name] if words else [])
    for _, why in reports.faults:
        assert re.search(f"^the new version {words}.*; the earlier one remains in use$", why)
    assert [path.name for path in earlier.iterdir()] == ["left-by-a-kill"]
    _assert_as_fresh(tmp_path / "m.zarr", swift_store)
    assert _once(tmp_path).faults == []
    shutil.copy(dives[1], landed)
    reports = _once(tmp_path)
    assert (reports.dives, reports.faults) == ([], [])
    _assert_as_fresh(tmp_path / "m.zarr", swift_store)


def test_of_several_new_versions_only_those_with_fewer_samples_are_refused(swift, dives, tmp_path):
    """All files were processed again: the second one lost samples, the first one only a comment; the third one grew."""
    importing, copies, backups = FileImport(None, {}), tmp_path / "files", tmp_path / "files" / "earlier"
    backups.mkdir(parents=True)
    for dive in dives:
        shutil.copy(dive, backups)
        shutil.copy(dive, copies)
    _annotate(backups / dives[0].name, swift)
    _annotate(copies / dives[2].name, swift)
    records = tmp_path / "records.nc"
    importing.import_files([backups / dive.name for dive in dives], records)
    _cut_record(copies / dives[1].name, swift)
    state = WatchState()
    with open_observations(records) as observations:
        for number, span in observations.survey.spans.items():
            span = observations.survey.spans[number]
            start, end = str(span.start_time), str(span.end_time)
            entry = ReportedDive(
                profile=number, start=start, end=end, samples="", count=span.stop - span.start, revision=0, file=""
            )
            state.reported.append(entry)
    for dive in dives:
        state.add_file(dive.name, CopiedFile(FileState(1, 1), ""))
    importing.import_files([copies / dive.name for dive in dives], records)
    refused = accept_or_restore(copies, {}, records, state, importing)
    assert refused == {dives[1].name: "the new version has fewer samples of dive 2; the earlier one remains in use"}
    assert len(list(backups.iterdir())) == 3
    remove_backups(copies, refused)
    importing.import_files([copies / dive.name for dive in dives], records)
    assert accept_or_restore(copies, {}, records, state, importing) == {}
    assert list(backups.iterdir()) == []
    assert (copies / dives[1].name).read_bytes() == dives[1].read_bytes()


@pytest.mark.long
def test_a_watch_that_is_killed_at_any_write_loses_nothing(dives, swift_store, tmp_path, monkeypatch):
    """Before or after every file that it writes in turn, and between message and list."""
    _watched(tmp_path)
    for dive in dives:
        shutil.copy(dive, tmp_path / "land")
    steps = iter(range(1_000_000))
    limit = [0]
    write = watch_state.write_text

    class Killed(BaseException):
        pass

    def fragile(*arguments: object, **named: object) -> None:
        if next(steps) >= limit[0]:
            raise Killed
        write(*arguments, **named)
        if next(steps) >= limit[0]:
            raise Killed

    for module in (watcher, watch_state):
        monkeypatch.setattr(module, "write_text", fragile)
    reported, kills = [], 0
    while True:
        steps, limit[0] = iter(range(1_000_000)), 1 + 2 * kills
        reports = _Reports()
        try:
            with open_watch(_watched(tmp_path), reports.listener()) as opened:
                opened.once(0.0)
        except Killed:
            kills += 1
            reported += reports.numbers
        else:
            reported += reports.numbers
            break
    assert kills >= 4
    assert sorted(set(reported)) == [(1, 0), (2, 0), (3, 0)]
    state = json.loads((tmp_path / "m-watch" / "state.json").read_text("utf-8"))
    assert [entry["profile"] for entry in state["reported"]] == [1, 2, 3]
    assert len(list((tmp_path / "m-watch").glob("dive-*.json"))) == 3
    assert not list((tmp_path / "m-watch").rglob("*.partial"))
    _assert_as_fresh(tmp_path / "m.zarr", swift_store)


def test_the_loop_takes_a_file_after_two_equal_looks(dives, tmp_path):
    _watched(tmp_path)
    landing = tmp_path / "land" / "dive1.nc"
    content, reports, looks = dives[0].read_bytes(), _Reports(), []

    class StoppedError(Exception):
        pass

    def sleep(seconds: float) -> None:
        looks.append(len(reports.dives))
        if len(looks) == 4:
            raise StoppedError
        if len(looks) <= 2:
            landing.write_bytes(content[: len(content) * len(looks) // 2])

    with open_watch(_watched(tmp_path), reports.listener()) as opened, pytest.raises(StoppedError):
        opened.forever(5.0, sleep)
    assert looks == [0, 0, 0, 1]
    assert reports.faults == []


def test_the_loop_goes_on_when_the_folder_is_out_of_reach_for_a_while(dives, tmp_path, caplog):
    _watched(tmp_path)
    land, away, reports, looks = tmp_path / "land", tmp_path / "away", _Reports(), []
    shutil.copy(dives[0], land)

    class StoppedError(Exception):
        pass

    def sleep(seconds: float) -> None:
        looks.append(len(reports.dives))
        if len(looks) == 1:
            land.rename(away)
        elif len(looks) == 2:
            away.rename(land)
        elif len(looks) == 5:
            raise StoppedError

    with open_watch(_watched(tmp_path), reports.listener()) as opened, pytest.raises(StoppedError):
        opened.forever(5.0, sleep)
    assert looks == [0, 0, 0, 1, 1]
    assert sum("trying again" in record.getMessage() for record in caplog.records) == 1


def test_new_dives_wait_while_another_run_writes_the_archive(dives, tmp_path, caplog):
    """A study holds the archive's lock for minutes."""
    watched, reports, looks = _watched(tmp_path), _Reports(), []
    shutil.copy(dives[0], tmp_path / "land")
    study = ExitStack()

    class StoppedError(Exception):
        pass

    def sleep(seconds: float) -> None:
        looks.append(len(reports.dives))
        if len(looks) == 4:
            study.close()
        elif len(looks) == 5:
            raise StoppedError

    study.enter_context(locked(watched.store))
    with open_watch(watched, reports.listener()) as opened, pytest.raises(StoppedError):
        opened.forever(5.0, sleep)
    assert looks == [0, 0, 0, 0, 1]
    waits = [
        record for record in caplog.records if "the new dives are added once that run has ended" in record.getMessage()
    ]
    assert len(waits) == 1


def test_a_second_watch_of_the_same_folder_is_refused_and_changes_nothing(dives, tmp_path):
    """As when cron starts ``--once`` again before the first has ended."""
    watched = _watched(tmp_path)
    shutil.copy(dives[0], tmp_path / "land")
    with locked(watched.out):
        answer = program(
            "watch", tmp_path / "land", "--platform", "petrel-l", "--store", watched.store, "--once", "--settle", 0
        )
    assert answer.status == 2
    assert "another run is writing it" in answer.line
    assert not watched.store.exists()
    assert _once(tmp_path).numbers == [(1, 0)]


def test_a_file_that_may_not_be_read_is_named_once_and_the_others_are_taken(dives, tmp_path, monkeypatch):
    _watched(tmp_path)
    for dive in dives[:2]:
        shutil.copy(dive, tmp_path / "land")
    opened = Path.open

    def refuse(path: Path, *arguments: object, **named: object) -> object:
        if path == tmp_path / "land" / dives[1].name:
            raise PermissionError(13, "Permission denied")
        return opened(path, *arguments, **named)

    with monkeypatch.context() as patched:
        patched.setattr(Path, "open", refuse)
        reports = _once(tmp_path)
        assert (reports.numbers, [name for name, _ in reports.faults]) == ([(1, 0)], [dives[1].name])
        assert "Permission denied" in reports.faults[0][1]
        assert _once(tmp_path).faults == []
    assert _once(tmp_path).numbers == [(2, 0)]


@pytest.mark.long
def test_a_replay_reports_every_dive_and_ends_in_the_archive_of_a_fresh_run(swift, swift_store, tmp_path):
    options = ("--platform", "petrel-l", "--store", tmp_path / "m.zarr", "--replay")
    answer = program("watch", swift, *options)
    assert answer.status == 0, answer.err
    lines = answer.out.splitlines()
    assert [line.split(";")[0] for line in lines] == ["dive 1", "dive 2", "dive 3"]
    assert all("m/s towards" in line for line in lines)
    _assert_as_fresh(tmp_path / "m.zarr", swift_store)
    assert program("watch", swift, *options).out == ""


@pytest.mark.parametrize("there", [(), ("notes.txt", "dive.nc.part")])
def test_a_source_without_a_glider_file_is_named(there, tmp_path, caplog):
    _watched(tmp_path)
    for name in there:
        (tmp_path / "land" / name).write_text(name)
    assert (_once(tmp_path).numbers, [record.getMessage() for record in caplog.records]) == (
        [], [f"{tmp_path / 'land'}: no complete file of a glider yet"],
    )  # fmt: skip


@pytest.mark.parametrize(
    ("kind", "taken"),
    [
        (None, {"p2490001.nc", "sea035.12.gli.sub.36", "unit-2024-1-0-0.dbd"}),
        ("observations", {"p2490001.nc", "dive.nc"}),
        ("seaglider", {"p2490001.nc"}),
        ("slocum", {"unit-2024-1-0-0.dbd", "dive.nc"}),
        ("og1", {"dive.nc"}),
    ],
)
def test_files_are_chosen_by_name_and_kind(kind, taken):
    names = ("p2490001.nc", "sea035.12.gli.sub.36", "unit-2024-1-0-0.dbd", "dive.nc", "notes.txt")
    assert {name for name in names if is_candidate(Path(name), kind, named=True)} == taken
    assert is_candidate(Path("dive.nc"), None, named=False)


def test_a_slocums_cache_files_are_found_where_its_files_land(tmp_path):
    pytest.importorskip("dbdreader")
    (tmp_path / "land" / "cac").mkdir(parents=True)
    (tmp_path / "taken").mkdir()
    name = "unit-2024-100-0-0"
    path = write_binary(tmp_path / "taken" / f"{name}.dbd", flight(0), name=name, factored=True)
    (tmp_path / "taken" / "0badcafe.cac").rename(tmp_path / "0badcafe.cac")
    importing = FileImport(None, {}, tmp_path / "land")
    before = importing.digest({path.name: "digest"})
    (why,) = importing.import_files([path], tmp_path / "out.nc").values()
    assert "its cache file 0badcafe.cac is not in" in why
    (tmp_path / "0badcafe.cac").rename(tmp_path / "land" / "cac" / "0badcafe.cac")
    # The import is tried again, although no file of the glider has changed.
    assert importing.digest({path.name: "digest"}) != before
    assert importing.import_files([path], tmp_path / "out.nc") == {}


def test_another_hull_makes_the_archive_again_and_reports_nothing_twice(dives, tmp_path):
    watched = _watched(tmp_path)
    shutil.copy(dives[0], tmp_path / "land")
    assert _once(tmp_path).numbers == [(1, 0)]
    reports, hull = _Reports(), watched.platform.model_copy(update={"name": "other"})
    with open_watch(replace(watched, platform=hull), reports.listener()) as opened:
        opened.once(0.0)
    assert reports.numbers == []
    with open_for_reading(tmp_path / "m.zarr") as archive:
        assert archive.attrs["platform"]["name"] == "other"


def test_an_archive_of_another_schema_is_made_again(dives, swift_store, tmp_path, caplog):
    """A program installed during the mission may have another schema, and cannot add to the archive."""
    _watched(tmp_path)
    shutil.copy(dives[0], tmp_path / "land")
    assert _once(tmp_path).numbers == [(1, 0)]
    set_attributes(tmp_path / "m.zarr", {"schema_version": "1.8"})
    for dive in dives[1:]:
        shutil.copy(dive, tmp_path / "land")
    assert _once(tmp_path).numbers == [(2, 0), (3, 0)]
    assert f"it has schema version 1.8, and this program's is {SCHEMA_VERSION}; the archive is rebuilt" in caplog.text
    _assert_as_fresh(tmp_path / "m.zarr", swift_store)


@pytest.mark.long
def test_only_the_last_dives_are_searched_for_damage(dives, tmp_path, monkeypatch):
    _watched(tmp_path)
    looked: list[list[int]] = []
    damages = resume.damages

    def spied(place: object, commits: dict[int, object]) -> list[object]:
        looked.append(list(commits))
        return damages(place, commits)

    monkeypatch.setattr(resume, "damages", spied)
    monkeypatch.setattr(inversion, "_CHECKED", 2)
    for dive in dives:
        shutil.copy(dive, tmp_path / "land")
        _once(tmp_path)
    # The second landing looks at the first dive, the third at the second.
    assert looked == [[0], [1]]


def test_two_watches_into_one_folder_and_another_missions_archive_are_refused(dives, swift_store, tmp_path):
    with open_watch(_watched(tmp_path), _Reports().listener()), pytest.raises(InputError, match="m-watch"):
        _once(tmp_path)
    with (
        pytest.raises(InputError, match="is the folder being watched"),
        open_watch(replace(_watched(tmp_path), out=tmp_path / "land"), _Reports().listener()),
    ):
        pass
    with (
        pytest.raises(InputError, match="is an archive; give the folder in which"),
        open_watch(replace(_watched(tmp_path), source=swift_store), _Reports().listener()),
    ):
        pass
    shutil.copytree(swift_store, tmp_path / "m.zarr")
    shutil.copy(dives[0], tmp_path / "land")
    with pytest.raises(InputError, match="contains profile 2, which is not in the source"):
        _once(tmp_path)


def test_the_schema_is_that_of_the_messages():
    answer = program("watch", "--schema")
    assert answer.status == 0
    schema = json.loads(answer.out)
    assert set(schema["properties"]) == set(SurfacingMessage.model_fields)
    assert "(m s-1)" in schema["$defs"]["Current"]["properties"]["north"]["description"]


def test_a_damaged_seaglider_dive_is_left_out(tmp_path):
    paths = [write_dive(tmp_path / "sg", dive, columns=True) for dive in (1, 2, 3)]
    paths[1].write_bytes(paths[1].read_bytes()[:5000])
    faults = FileImport(None, {}).import_files(paths[:1] + paths[2:], tmp_path / "good.nc")
    assert faults == {}
    faults = FileImport("seaglider", {}).import_files(paths, tmp_path / "all.nc")
    assert list(faults) == ["dive 2"]
    assert (tmp_path / "good.nc").read_bytes()
    with xr.open_dataset(tmp_path / "all.nc") as records:
        assert set(np.unique(records["profile"])) - {0} == {1, 3}


@pytest.mark.parametrize(
    ("importing", "words"),
    [
        (("torpedo", {}), "give one of observations"),
        (("seaglider", {"x": 1}), "'x'"),
        (("seaglider", {"reads": 1}), "'reads'"),
    ],
)
def test_an_unknown_kind_or_option_is_refused(importing, words, tmp_path):
    path = write_dive(tmp_path / "sg", 1, columns=True)
    with pytest.raises(InputError, match=words):
        FileImport(*importing).import_files([path], tmp_path / "out.nc")


@pytest.mark.parametrize(
    ("option", "words"),
    [
        ("declination=x", "declination='x': it must be a number from -180 to 180 degree"),
        ("declination=400", "declination=400: it must be a number from -180 to 180"),
        ("declination=.nan", "declination=nan: it must be a number"),
        ("declination=yes", "declination=True: it must be a number"),
        ("linear-scale=3", "linear_scale=3: it must be a number from -1 to 1 m per unit of LinPos"),
        ("linear_zero=", "linear_zero=None: it must be a number from -1000000 to 1000000"),
        ("battery_zero=[1]", "it must be a number from -10 to 10 m"),
        ("include_surfacing=1", "include_surfacing=1: it must be true or false"),
        ("cache=5", "cache=5: it must be the name of a folder"),
        ("colour=red", "no importer has an option 'colour'; the options are linear_scale"),
    ],
)
def test_an_import_option_that_cannot_be_used_is_refused_in_one_line(option, words, tmp_path):
    (tmp_path / "land").mkdir()
    arguments = ("--platform", "petrel-l", "--store", tmp_path / "w.zarr", "--once", "--settle", 0, "--import", option)
    answer = program("watch", tmp_path / "land", *arguments)
    assert answer.status == 2
    assert words in answer.line
    assert [path.name for path in tmp_path.iterdir()] == ["land"]


def test_options_are_those_of_the_importers():
    for kind, importer in IMPORTERS.items():
        parameters, common = set(signature(importer).parameters), {"sources", "out", "overwrite", "reads"}
        assert common <= parameters
        own = parameters - common
        assert set(BY_KIND[kind]) == own <= {*NUMBERS, *FLAGS, *FOLDERS}
    check_option_values(
        {"declination": None, "cache": None, "linear_zero": np.float32(60.0), "include_surfacing": True}
    )
    with pytest.raises(InputError, match="the import of seaglider has no option 'cache'; the options are declination"):
        FileImport("seaglider", {"cache": None})


def test_an_empty_folder_has_no_records_of_any_kind(tmp_path):
    for kind in (None, "observations", "slocum"):
        assert FileImport(kind, {}).import_files([], tmp_path / "records.nc") == {}
    assert not (tmp_path / "records.nc").exists()


def test_joined_files_are_the_file_that_they_were_cut_from(swift, dives, tmp_path):
    assert join_observations(dives[::-1], tmp_path / "joined.nc") == {}
    with xr.open_dataset(swift) as whole, xr.open_dataset(tmp_path / "joined.nc") as found:
        chosen = whole["profile"].values > 0
        np.testing.assert_array_equal(found["depth"].values, whole["depth"].values[chosen])
        np.testing.assert_array_equal(found["fix_time"].values, whole["fix_time"].values)
    shutil.copy(dives[0], tmp_path / "other.nc")
    left_out = join_observations([dives[0], tmp_path / "other.nc"], tmp_path / "joined.nc")
    assert list(left_out) == ["other.nc"]
    assert "overlaps dive1.nc in time" in left_out["other.nc"]


def test_variables_that_are_not_of_the_format_are_left_out_of_joined_files(dives, tmp_path):
    for path in dives[:2]:
        with xr.open_dataset(path, decode_times=False) as records:
            further = records.load().assign(crs=0, spectrum=(("time", "band"), np.ones((records.sizes["time"], 2))))
        further.to_netcdf(tmp_path / path.name)
    assert join_observations([tmp_path / path.name for path in dives[:2]], tmp_path / "joined.nc") == {}
    with xr.open_dataset(tmp_path / "joined.nc") as found:
        assert not {"crs", "spectrum"} & set(found.variables)
        assert set(np.unique(found["profile"].values)) >= {1, 2}


@pytest.mark.long
@pytest.mark.parametrize("full_first", [False, True])
def test_a_decimated_record_gives_way_to_the_full_one(dives, tmp_path, full_first):
    """The dive is reported from the decimated file, and again with its changes when the full one has come."""
    inputs = _watched(tmp_path)
    decimated = changed_observations(
        dives[0], tmp_path / "decimated.nc", lambda content: content.isel(time=slice(None, None, 4))
    )
    for path in (dives[0], decimated) if full_first else (decimated, dives[0]):
        shutil.copy(path, tmp_path / "land" / path.name)
        landed = _once(tmp_path)
        assert landed.faults == []
    assert landed.numbers == ([] if full_first else [(1, 1)])
    (path,) = inputs.out.glob("dive-*.json")
    message = SurfacingMessage.model_validate_json(path.read_text("utf-8"))
    with xr.open_dataset(dives[0]) as records:
        assert message.samples == records.sizes["time"]
    assert bool(message.changes) is not full_first


@pytest.mark.long
def test_a_new_file_that_overlaps_a_reported_dive_is_the_one_left_out(dives, tmp_path):
    """Its clock is wrong: it begins before the dive in the archive, and has the number of the next one."""
    (tmp_path / "land").mkdir()
    shutil.copy(dives[0], tmp_path / "land" / "b.nc")
    assert _once(tmp_path).numbers == [(1, 0)]
    with xr.open_dataset(dives[0], decode_times=False) as records:
        early = records["time"].values[0] - 60.0
    with xr.open_dataset(dives[1], decode_times=False) as records:
        wrong = records.load()
    times = wrong["time"].values - wrong["time"].values[0] + early
    wrong.assign_coords(time=("time", times, wrong["time"].attrs)).to_netcdf(tmp_path / "land" / "a.nc")
    wrong = _once(tmp_path)
    assert wrong.numbers == []
    assert "overlaps b.nc in time" in dict(wrong.faults)["a.nc"]
    shutil.copy(dives[1], tmp_path / "land" / "c.nc")
    assert _once(tmp_path).numbers == [(2, 0)]


def test_files_are_looked_at_and_copied_whole_or_not_at_all(tmp_path):
    for name in ("a.nc", ".hidden.nc", "b.nc.part"):
        (tmp_path / name).write_text(name)
    files = list_files(tmp_path)
    assert [path.name for path in files] == ["a.nc"] == [path.name for path in list_files(f"{tmp_path}/*.nc")]
    (path,) = files
    assert unchanged(files, {}) == []
    assert unchanged(files, files) == [path]
    (state,) = files.values()
    assert older(files, 10.0, now=state.modified / 1e9 + 9.0) == []
    assert older(files, 10.0, now=state.modified / 1e9 + 10.5) == [path]
    (tmp_path / "copies").mkdir()
    assert copy_file(path, FileState(state.size + 1, state.modified), tmp_path / "copies") is None
    assert list((tmp_path / "copies").iterdir()) == []
    assert copy_file(path, state, tmp_path / "copies").state == state
    with pytest.raises(InputError, match="no such file or folder"):
        list_files(tmp_path / "missing")


def test_the_ellipse_holds_its_part_of_draws():
    covariance = np.array([[4.0, 1.5], [1.5, 1.0]])
    ellipse = error_ellipse(covariance)
    draws = np.random.default_rng(1).multivariate_normal(np.zeros(2), covariance, 20_000)
    angle = np.radians(ellipse.direction)
    along = draws @ [np.cos(angle), np.sin(angle)]
    across = draws @ [-np.sin(angle), np.cos(angle)]
    inside = (along / ellipse.major) ** 2 + (across / ellipse.minor) ** 2 <= 1.0
    # Three standard deviations of a binomial share.
    assert abs(inside.mean() - ellipse.probability) < 3.0 * np.sqrt(0.68 * 0.32 / 20_000)


def test_the_next_surfacing_is_where_the_water_takes_a_dive_like_the_last(swift_store):
    with open_for_reading(swift_store) as archive:
        table, smoothed = archive.to_dataset(), archive["smoothed"].to_dataset()
        found = predict_surfacing(archive, 2)
        row, moves = table.sel(profile=2), smoothed.sel(profile=2)
        start = Fix(row["exit_time"].values, float(row["exit_latitude"]), float(row["exit_longitude"]))
        way = local_displacement(start, Fix(found.time, found.latitude, found.longitude))
        elapsed = (found.time - start.time) / np.timedelta64(1, "s")
        # A cycle is the stay at the surface before the dive, and the time between the fixes around it.
        cycle = (row["exit_time"] - table.sel(profile=1)["exit_time"]).values / np.timedelta64(1, "s")
        assert elapsed == pytest.approx(cycle, abs=1.0)
        own = np.array([float(moves["displacement_north"]), float(moves["displacement_east"])])
        dives = dives_until(archive, 2)
        offset, _ = surface_offset(dives, archive.attrs["settings"]["current"]["surface_shear"])
        surface_drift = (cycle - float(row["duration"])) * offset
        flown, currents = (
            np.column_stack([dives[columns.format(side)] for side in ("north", "east")])
            for columns in ("displacement_{}", "dac_{}_smoothed")
        )
        through, scatter = expected_displacement(flown, currents, dives["duration"].values)
        # Two dives do not yet rule out that the next one is on any course: it is like the last within its scatter.
        assert (through - own) @ np.linalg.solve(scatter, through - own) < 0.1
        np.testing.assert_allclose(way, through + elapsed * found.current + surface_drift, atol=0.01)
        assert found.dives == 2
        assert np.all(np.linalg.eigvalsh(found.covariance) > 0.0)
        message = surfacing_message(archive, 2)
        assert message.next_surfacing.ellipse == error_ellipse(found.covariance)
        assert "; next 00:" in message.line


def test_a_dive_without_a_current_is_no_time_at_the_surface(swift_store):
    """The dive before the last one lost its current; the cycle remains that of the last dive."""
    with open_for_reading(swift_store) as archive:
        whole = predict_surfacing(archive, 3)
        table = archive.to_dataset().load()
        column = table["dac_north_smoothed"].values.copy()
        column[1] = np.nan
        lost = predict_surfacing(archive.with_columns({"dac_north_smoothed": column}), 3)
    assert lost.dives == whole.dives - 1
    assert lost.time == whole.time


def test_the_page_answers_first_fetches_nothing_and_obeys_no_name(swift_store, tmp_path):
    with open_for_reading(swift_store) as archive:
        message = surfacing_message(archive, 2)
    hostile = {"mission": "<script>alert(1)</script>", "odd": ("<b>odd</b>",)}
    page = write_surfacing_page(message.model_copy(update=hostile), tmp_path, "dive.html").page
    assert [path.name for path in tmp_path.iterdir()] == ["dive.html"]
    text = page.read_text("utf-8")
    assert "<script>alert" not in text
    assert "&lt;b&gt;odd" in text
    assert not re.search(r"(src|href)=.(https?:)?//", text)
    places = [text.index(words) for words in ("current</", "next surfacing</", "Anomalies</h", "Hull and trim</h")]
    assert places == sorted(places)
    assert f"{message.current.speed:.3f} m/s towards" in text
    assert f"{message.next_surfacing.latitude:.4f}" in text
    lost = {"current": None, "next_surfacing": None, "water": None, "hull": ()}
    page = write_surfacing_page(message.model_copy(update=lost), tmp_path, "lost.html").page
    assert page.read_text("utf-8").count("unknown") >= 3


def test_only_the_first_of_two_files_with_the_same_name_is_used(dives, tmp_path):
    """A pattern can match several folders; their files would take turns in one copy."""
    for folder, dive in zip(("a", "b"), dives, strict=False):
        (tmp_path / "land" / folder).mkdir(parents=True)
        shutil.copy(dive, tmp_path / "land" / folder / "dive.nc")
    watched = replace(_watched(tmp_path), source=str(tmp_path / "land" / "*" / "dive.nc"))
    for dive, faults in (([(1, 0)], [str(tmp_path / "land" / "b" / "dive.nc")]), ([], [])):
        reports = _Reports()
        with open_watch(watched, reports.listener()) as opened:
            opened.once(0.0)
        assert (reports.numbers, [name for name, _ in reports.faults]) == (dive, faults)
