"""Python functions and commands give the same results and messages."""

import hashlib
import json
import multiprocessing
import os
import shutil
import subprocess
import sys
import warnings
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from support import seaglider_files, slocum_files
from support.missions import archive_bytes, program
from support.repository import REPOSITORY

import gliderhpc as gh
from gliderhpc.api import missions
from gliderhpc.api.arguments import assignments_of, profiles_text
from gliderhpc.api.records import InspectedRecords
from gliderhpc.calibration import workflow
from gliderhpc.calibration.estimated_hulls import HullFromDives, HullFromGlides
from gliderhpc.estimation.priors import default_prior
from gliderhpc.mission.cluster import FileNotSharedError
from gliderhpc.observations.in_memory import opened_records, write_records
from gliderhpc.observations.profile_numbers import evenly_spaced
from gliderhpc.platform import read_platform
from gliderhpc.record_checks import CheckVerdict, Finding, Inspection
from gliderhpc.store_schema.location import group_at
from gliderhpc.wording import counted

pytestmark = pytest.mark.compiled

STATE = [0.0, -0.3, 0.0, 0.0, 0.0, 10.0, 0.3, 0.0, 0.0, 0.0, 0.0, 0.0]
CONTROL = [0.0, 0.0, -0.2, 0.0]

TIMED = ("run_seconds",)
"""Columns that tell how long a run took."""


@pytest.fixture(scope="module")
def records(swift):
    """The swift mission in memory, without any reference to its file."""
    loaded = gh.open_records(swift).load().copy(deep=True)
    loaded.encoding.clear()
    return loaded


@pytest.fixture(scope="module")
def dive(swift):
    """Its second profile, inverted from the file."""
    return gh.invert(swift, "petrel-l", profile=2)


@pytest.fixture(scope="module")
def mission(swift, tmp_path_factory):
    """Archive of a run on that profile alone, and the tree that the run returned."""
    store = tmp_path_factory.mktemp("mission") / "one.zarr"
    return store, gh.run_mission(swift, "petrel-l", store, profiles=2, workers=0)


def assert_same(one, other, leave_out=TIMED, attributes=True):
    """Compare two trees: groups, variables, types, bytes, units and attributes."""
    assert set(one.groups) == set(other.groups)
    for node in one.subtree:
        ours, theirs = node.to_dataset(inherit=False), other[node.path].to_dataset(inherit=False)
        assert set(ours.variables) == set(theirs.variables)
        assert dict(ours.sizes) == dict(theirs.sizes)
        if attributes:
            assert ours.attrs == theirs.attrs
        for name in set(map(str, ours.variables)) - set(leave_out):
            a, b = ours[name], theirs[name]
            assert a.dims == b.dims
            texts = {np.dtype(object), np.dtypes.StringDType()}
            assert a.dtype == b.dtype or {a.dtype, b.dtype} == texts, name
            same = (
                a.values.tolist() == b.values.tolist() if a.dtype in texts else a.values.tobytes() == b.values.tobytes()
            )
            assert same, (node.path, name)
            if attributes:
                assert a.attrs == b.attrs
                assert str(a.encoding.get("units")) == str(b.encoding.get("units"))


# Records


def test_records_have_the_units_of_the_format(swift):
    records = gh.open_records(swift)
    assert dict(records.sizes) == {"time": 607, "fix": 12}
    for name, variable in records.variables.items():
        assert np.issubdtype(variable.dtype, np.datetime64) or variable.attrs["units"], name
        assert variable.attrs["long_name"], name
    assert records["pitch"].attrs["standard_name"] == "platform_pitch_fore_up"
    assert records["profile"].attrs["units"] == "1"
    assert Path(records.encoding["source"]) == swift.resolve()


@pytest.mark.parametrize(
    ("corrupt", "message"),
    [
        (lambda r: r.drop_vars("pitch"), "records: required variable pitch is missing"),
        (lambda r: r.assign(pitch=r.pitch.assign_attrs(units="rad")), "records: pitch is in 'rad'; convert it to"),
        (lambda r: r.assign(depth=("fix", np.zeros(12), {"units": "m"})), "records: depth has dimensions"),
        (lambda r: r.isel(time=slice(None, None, -1)), "profile 2: time runs backwards at sample 200"),
        (lambda r: r.assign(depth=r.depth * 0.0).drop_vars("profile"), "records: has no profile"),
    ],
)  # fmt: skip
def test_a_dataset_is_checked_as_a_file_is(records, corrupt, message):
    with xr.set_options(keep_attrs=True), pytest.raises(gh.GliderhpcError, match=message):
        gh.invert(corrupt(records), "petrel-l", profile=2)


def test_a_missing_file_is_refused_by_name(tmp_path):
    with pytest.raises(gh.InputError, match=r"none\.nc: no such file"):
        gh.open_records(tmp_path / "none.nc")
    with pytest.raises(gh.InputError, match="is an address; download the file, and give its path"):
        gh.open_records("https://example.org/records.nc")


@pytest.mark.parametrize("given", [None, 3, ["a.nc"]])
def test_other_things_than_paths_are_refused(given, swift, tmp_path):
    with pytest.raises(gh.InputError, match=f"records: give its path, not a {type(given).__name__}"):
        gh.open_records(given)
    with pytest.raises(gh.InputError, match=f"store: give its path, not a {type(given).__name__}"):
        gh.run_mission(swift, "petrel-l", given, workers=0)
    with pytest.raises(gh.InputError, match=f"out: give its path, not a {type(given).__name__}"):
        gh.report(tmp_path, given)
    with pytest.raises(gh.InputError, match="found: give what currents, invert, run_mission or open_mission returned"):
        gh.plot_currents(given)


def test_records_saved_by_xarray_are_the_same(records, dive, tmp_path):
    records.to_netcdf(tmp_path / "saved.nc")
    assert_same(gh.invert(tmp_path / "saved.nc", "petrel-l", 2), dive, attributes=False)


# Records of instruments


def write_seaglider(folder):
    for number in (1, 2, 3):
        seaglider_files.write_dive(folder, number, columns=True)


def write_og1(folder):
    seaglider_files.write_og1(folder / "sg099_delayed.nc")


def write_slocum(folder):
    slocum_files.write_netcdf(folder / "unit.nc", slocum_files.joined([slocum_files.flight(0), slocum_files.flight(1)]))


WRITERS = {"seaglider": write_seaglider, "og1": write_og1, "slocum": write_slocum}


@pytest.mark.parametrize("kind", list(WRITERS))
def test_records_are_imported_as_by_the_command(kind, tmp_path):
    folder = tmp_path / "raw"
    folder.mkdir()
    WRITERS[kind](folder)
    done = program("import", kind, folder, tmp_path / "theirs.nc")
    assert done.status == 0, done.err
    theirs = gh.open_records(tmp_path / "theirs.nc").load()
    for given in ({"files": folder}, {"files": sorted(folder.iterdir()), "kind": kind}):
        ours = gh.import_records(**given)
        assert ours.identical(theirs)
        assert "source" not in ours.encoding
        write_records(ours, tmp_path / f"ours{len(given)}.nc")
        assert (tmp_path / f"ours{len(given)}.nc").read_bytes() == (tmp_path / "theirs.nc").read_bytes()


def test_unusable_sources_and_options_are_refused_by_import_records(tmp_path, swift):
    with pytest.raises(gh.InputError, match="not recognised as a glider's records"):
        gh.import_records(tmp_path)
    with pytest.raises(gh.InputError, match=r"is already in the observation format"):
        gh.import_records(swift)
    with pytest.raises(gh.InputError, match="none: no such file or folder"):
        gh.import_records(tmp_path / "none")
    with pytest.raises(gh.InputError, match="kind='spray': give one of seaexplorer, slocum, seaglider, og1"):
        gh.import_records(tmp_path, "spray")
    with pytest.raises(gh.InputError, match="files: none given"):
        gh.import_records([])
    write_og1(tmp_path)
    with pytest.raises(
        gh.InputError, match="the import of og1 has no option 'linear_zero'; the options are declination"
    ):
        gh.import_records(tmp_path, linear_zero=3.0)
    write_seaglider(tmp_path / "more")
    with pytest.raises(gh.InputError, match=r"is of kind og1, .* of kind seaglider; give the files of one"):
        gh.import_records([tmp_path / "sg099_delayed.nc", tmp_path / "more"])


# One profile


def test_one_profile_is_what_the_archive_holds(dive, mission):
    store, returned = mission
    archive = xr.open_datatree(store, engine="zarr").drop_nodes("commits").load()
    assert_same(dive, archive)
    assert_same(dive, returned.drop_nodes("commits").load())
    groups = {"series", "prior", "state", "observed", "smoothed", "windows", "drift_current", "hull"}
    assert set(dive.children) == groups
    for node in dive.subtree:
        for name, variable in node.to_dataset(inherit=False).variables.items():
            assert (
                "units" in variable.attrs or "units" in variable.encoding or name in (*node.dims, "status", "message")
            )


def test_one_profile_is_that_of_the_whole_mission(dive, swift_store):
    """But for the filling after the profile's end: the mission's rows are as long as its longest profile."""
    whole = gh.open_mission(swift_store).drop_nodes("commits").sel(profile=[2]).load()
    cut = whole.isel({dim: slice(size) for dim, size in dive["series"].sizes.items() if dim != "profile"})
    for group in ("series", "prior"):
        for name in dive[group].data_vars:
            assert dive[group][name].values.tobytes() == cut[group][name].values.tobytes(), (group, name)


def test_a_dataset_in_memory_gives_the_same(dive, records):
    in_memory = gh.invert(records, gh.load_platform("petrel-l"), profile=2)
    assert_same(in_memory, dive, attributes=False)
    assert in_memory.attrs["observations"] == "records.nc"


def test_a_dataset_of_a_file_goes_by_the_file(dive, swift):
    opened = gh.open_records(swift)
    assert_same(gh.invert(opened, "petrel-l", profile=2), dive)
    assert_same(gh.invert(opened.load(), "petrel-l", profile=2), dive)


def test_an_edited_dataset_is_what_is_inverted(dive, swift):
    edited = gh.open_records(swift).load()
    edited["ballast_volume"] = edited["ballast_volume"] + xr.where(edited["profile"] == 2, 20.0, 0.0)
    edited["ballast_volume"].attrs["units"] = "cm3"
    found = gh.invert(edited, "petrel-l", profile=2)
    assert found.attrs["observations"] == "swift.nc"
    assert found.attrs["observations_digest"] != dive.attrs["observations_digest"]
    assert float(abs(found["series"]["B_cw"] - dive["series"]["B_cw"]).median()) > 0.05


def test_settings_by_name_or_as_an_object(records, swift):
    by_name = gh.invert(swift, "petrel-l", 2, window={"length": 20.0}, engine="scipy")
    by_object = gh.invert(swift, "petrel-l", 2, settings=gh.MissionSettings(engine="scipy"), **{"window.length": 20.0})
    assert_same(by_name, by_object)
    assert by_name.attrs["settings"]["window"]["length"] == 20.0
    with pytest.raises(
        gh.InputError,
        match=r"^`window\.lenght`: no such setting, did you mean 'window\.length'\?; "
        r"the settings of window are [^;]*window\.length",
    ):
        gh.invert(swift, "petrel-l", 2, window={"lenght": 20.0})
    with pytest.raises(gh.InputError, match=r"^`window\.length`: .*greater than 0, not -1"):
        gh.invert(swift, "petrel-l", 2, window={"length": -1})
    with pytest.raises(gh.InputError, match="settings is of type dict; give MissionSettings"):
        gh.invert(swift, "petrel-l", 2, settings={})


def test_invalid_profile_and_hull_arguments_are_refused(swift, records):
    with pytest.raises(gh.InputError, match=r"profile: there are .* choose one"):
        gh.invert(swift, "petrel-l")
    with pytest.raises(gh.InputError, match="`profile=9`: no profile 9; the available ones are 1 to 3"):
        gh.invert(swift, "petrel-l", 9)
    with pytest.raises(gh.InputError, match="profile='two': give the number of a profile"):
        gh.invert(swift, "petrel-l", "two")
    with pytest.raises(gh.InputError, match="petrel-x"):
        gh.invert(swift, "petrel-x", 2)
    hull = gh.load_platform("petrel-l")
    top_heavy = hull.model_copy(update={"position": hull.position.model_copy(update={"hull": (0.0, 0.0, -0.01)})})
    with pytest.raises(gh.InputError, match="petrel-l has no stable steady dive"):
        gh.invert(swift, top_heavy, 2)


def test_a_profile_that_cannot_be_inverted_says_why(records):
    gone = records.assign(pitch=records.pitch.where(records.profile != 2))
    gone["pitch"].attrs.update(records.pitch.attrs)
    with pytest.raises(gh.ProfileError, match=r"profile 2: .*pitch"):
        gh.invert(gone, "petrel-l", 2)


def test_a_profile_is_drawn(dive, swift_store, swift):
    figure = gh.plot_profile(dive)
    assert [axes.get_label() for axes in figure.axes][:4] == ["roll", "pitch", "heading", "depth"]
    truth = swift.with_name("swift.truth.nc")
    assert gh.plot_profile(gh.open_mission(swift_store), 2, truth=truth).axes
    with pytest.raises(gh.InputError, match=r"profile: there are .* choose one"):
        gh.plot_profile(gh.open_mission(swift_store))
    with pytest.raises(gh.InputError, match="dive: give what invert"):
        gh.plot_profile(dive["series"].to_dataset())
    with pytest.raises(gh.InputError, match=r"select it by sel\(profile=\[2\]\), or give the whole mission"):
        gh.plot_profile(gh.open_mission(swift_store).sel(profile=2))


# A mission


def test_a_mission_is_the_archive_of_the_command(swift, records, swift_store, tmp_path):
    done = program("run-mission", swift, "--platform", "petrel-l", "--store", tmp_path / "a.zarr", "--workers", 0)
    assert done.status == 0, done.err
    returned = gh.run_mission(gh.open_records(swift), "petrel-l", tmp_path / "b.zarr", workers=0)
    assert archive_bytes(tmp_path / "a.zarr") == archive_bytes(tmp_path / "b.zarr")
    assert returned["series"].B_cr.sel(profile=2).chunks is not None
    assert set(returned.ds.status.values) == {"done"}


@pytest.mark.long
def test_a_mission_in_memory_on_worker_processes(records, swift_store, tmp_path):
    store = tmp_path / "c.zarr"
    tree = gh.run_mission(records, "petrel-l", store, workers=2, profiles=[1, 3])
    whole = gh.open_mission(swift_store).sel(profile=[1, 3])
    for name in ("B_cu", "B_cr", "quality"):
        a, b = (t["series"][name].values for t in (tree, whole))
        assert a.tobytes() == b[:, : a.shape[1]].tobytes()
    assert tree.attrs["observations"] == "records.nc"
    with pytest.raises(gh.InputError, match=r"finish it with `resume=True` or start again with `overwrite=True`"):
        gh.run_mission(records, "petrel-l", store, workers=0)
    again = gh.run_mission(records, "petrel-l", store, workers=0, profiles="1,3", resume=True)
    assert again.ds.run_seconds.values.tobytes() == tree.ds.run_seconds.values.tobytes()
    assert again.attrs["observations_digest"] == gh.invert(records, "petrel-l", 1).attrs["observations_digest"]


def test_records_in_memory_that_a_clusters_worker_cannot_see(records, swift, tmp_path, monkeypatch):
    def blind(workers, cluster=None, needed=(), *rest):
        @contextmanager
        def opened():
            raise FileNotSharedError(needed[0].resolve(), "worker tcp://b:2 on b")
            yield

        return opened

    monkeypatch.setattr(missions, "executor_of", blind)
    store = tmp_path / "m.zarr"
    with pytest.raises(gh.InputError) as raised:
        gh.run_mission(records, "petrel-l", store, scheduler="tcp://nowhere:1")
    assert str(raised.value) == (
        "records: a Dataset that was made or changed in memory, which worker tcp://b:2 on b cannot see; save it to a "
        "file that the workers share, records.to_netcdf('m12.nc'), and give its path"
    )
    with pytest.raises(
        gh.InputError, match=r"swift\.nc: worker tcp://b:2 on b cannot see this file; put it on storage"
    ):
        gh.run_mission(swift, "petrel-l", store, scheduler="tcp://nowhere:1")


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"profiles": [1, 7]}, "`profiles=1,7`: no profile 7; the available ones are 1 to 3"),
        ({"profiles": []}, r"profiles=\[\]: give numbers"),
        ({"profiles": [1.5]}, r"profiles=\[1.5\]: give numbers"),
        ({"workers": -1}, "workers=-1: give a number of processes"),
        ({"workers": 2.5}, "workers=2.5: give a number of processes"),
        ({"workers": "2"}, "workers='2': give a number of processes"),
        ({"workers": 2, "scheduler": "tcp://nowhere:1"}, "workers=2: a running cluster has its own"),
        (
            {"overwrite": True, "resume": True},
            "`overwrite=True`, `resume=True` and `append=True` are mutually exclusive",
        ),
        ({"engine": "fast"}, "`engine`: .*'fast'"),
        ({"window": {"margin": 40.0}}, r"^`window\.margin=40`: must be shorter than the window"),
    ],
)
def test_wrong_arguments_of_a_mission(swift, tmp_path, wrong, message):
    with pytest.raises(gh.InputError, match=message):
        gh.run_mission(swift, "petrel-l", tmp_path / "m.zarr", **{"workers": 0, **wrong})
    assert not (tmp_path / "m.zarr").exists()


# Studies


@pytest.fixture
def store(swift_store, tmp_path):
    """A copy of the archive of the swift mission, to add studies to."""
    return Path(shutil.copytree(swift_store, tmp_path / "m.zarr"))


def test_a_study_is_that_of_the_command(store, tmp_path):
    found = gh.analyze(store, "reconstruction", workers=0)
    ours = archive_bytes(store / "reconstruction")
    done = program("analyze", store, "reconstruction", "--workers", 0, "--out", tmp_path / "theirs")
    assert done.status == 0, done.err
    assert archive_bytes(store / "reconstruction") == ours
    found.save(tmp_path / "ours")
    files = {path.name: path.read_bytes() for path in (tmp_path / "theirs").iterdir() if path.suffix != ".png"}
    assert {name: (tmp_path / "ours" / name).read_bytes() for name in files} == files
    assert {path.stem for path in (tmp_path / "theirs").glob("*.png")} == set(found.figures)
    assert all(isinstance(table, pd.DataFrame) and len(table) for table in found.tables.values())
    assert list(found.comparisons.columns[:4]) == ["quantity", "unit", "paper", "ours"]
    assert set(found.captions) == {*found.figures, *found.tables}
    assert found.failed == {}


def test_settings_of_a_study(store):
    gh.analyze(store, "currents", profiles=[1, 2], workers=0, bin=5.0)
    tree = gh.open_mission(store)
    assert tree["currents"].attrs["settings"]["bin"] == 5.0
    with pytest.raises(gh.InputError, match=r"^`bins`: no such setting"):
        gh.analyze(store, "currents", workers=0, bins=5.0)
    with pytest.raises(gh.InputError, match="study='current': there is no such study; give one of reconstruction"):
        gh.analyze(store, "current")
    with pytest.raises(gh.InputError, match="no such archive"):
        gh.analyze(store.with_name("none.zarr"), "drift")
    with pytest.raises(gh.InputError, match=r"model") as raised:
        gh.analyze(store, "reanalysis", workers=0)
    assert "--" not in str(raised.value)


def test_the_forward_model_against_the_records(store, swift, tmp_path, records):
    found = gh.validate(swift, "petrel-l", store, workers=0)
    ours = archive_bytes(store / "validation")
    done = program(
        "validate", swift, "--platform", "petrel-l", "--store", store, "--workers", 0, "--out", tmp_path / "theirs"
    )
    assert done.status == 0, done.err
    assert archive_bytes(store / "validation") == ours
    assert found.tables
    with pytest.raises(gh.InputError, match="was not made from"):
        gh.validate(records.isel(time=slice(0, 400)), "petrel-l", store, workers=0)


@pytest.mark.long
def test_an_archive_of_records_in_memory_is_validated_with_the_file_that_they_are_saved_to(records, tmp_path):
    """The file's bytes are others; the records of the profiles are the same."""
    store, saved, other = (tmp_path / name for name in ("m.zarr", "saved.nc", "other.nc"))
    gh.run_mission(records, "petrel-l", store, workers=0, profiles=[1, 2])
    records.to_netcdf(saved)
    assert gh.open_mission(store).attrs["observations_digest"] != hashlib.sha256(saved.read_bytes()).hexdigest()
    done = program("validate", saved, "--platform", "petrel-l", "--store", store, "--workers", 0)
    assert done.status == 0, done.err
    assert set(gh.validate(saved, "petrel-l", store, workers=0).tables)
    done = program("analyze", store, "reconstruction", "--quick", "--observations", saved, "--workers", 0)
    assert done.status == 0, done.err
    changed = records.assign(pitch=records.pitch.where(records.profile != 2, records.pitch + 0.1))
    changed["pitch"].attrs.update(records.pitch.attrs)
    changed.to_netcdf(other)
    with pytest.raises(gh.InputError, match="was not made from"):
        gh.validate(other, "petrel-l", store, workers=0)
    # Profile 1 alone is as it was.
    gh.validate(other, "petrel-l", store, workers=0, profiles=1)


@pytest.mark.usefixtures("undrawn")
def test_a_report(store, tmp_path):
    written = gh.report(store, tmp_path / "ours")
    assert written.page == tmp_path / "ours" / "index.html"
    done = program("report", store, "--out", tmp_path / "theirs")
    assert done.status == 0, done.err
    names = sorted(path.name for path in (tmp_path / "theirs").iterdir())
    assert sorted(path.name for path in (tmp_path / "ours").iterdir()) == names
    assert gh.report(store, tmp_path / "ours", profile=2).page.name == "profile_2.html"
    with pytest.raises(gh.InputError, match="twins belongs to the page of the mission"):
        gh.report(store, tmp_path / "ours", profile=2, twins=tmp_path)


# Hulls


@pytest.mark.long
def test_a_hull_is_calibrated_as_by_the_command(brief, tmp_path):
    found = gh.calibrate(brief, "petrel-l", profiles="1:3", calibration={"hold": ["K_L"]}, rounds={"most": 0})
    assert found.save(tmp_path / "ours.yaml") == tmp_path / "ours.yaml"
    done = program(
        "calibrate", brief, "--platform", "petrel-l", "--out", tmp_path / "theirs.yaml", "--profiles", "1:3", "--set",
        "calibration.hold=[K_L]", "--set", "rounds.most=0",
    )  # fmt: skip
    assert done.status == 0, done.err
    assert (tmp_path / "ours.yaml").read_text() == (tmp_path / "theirs.yaml").read_text()
    assert gh.load_platform(tmp_path / "ours.yaml") == found.platform
    assert {"unit", "before", "after", "low", "high", "remark"} <= set(found.table.columns)
    assert found.table.loc["buoyancy.neutral_volume", "unit"] == "cm3"
    assert len(found.scores)
    assert found.notes
    with pytest.raises(gh.InputError, match=r"ours\.yaml: this file exists; .*overwrite=True"):
        found.save(tmp_path / "ours.yaml")


@pytest.mark.long
def test_a_hull_is_calibrated_again_with_the_prior_tuned_on_it(brief, tmp_path):
    few = {"profiles": "1:3", "calibration": {"hold": ["K_L"]}, "rounds": {"most": 0}}
    tuning = {"max_rounds": 1, "longest": 190.0, "profiles": 1}
    alone = gh.calibrate(brief, "petrel-l", **few)
    tuned = gh.tune(brief, alone.platform, profiles=evenly_spaced(list(alone.fitted.profiles), 1), tuning=tuning)
    done = program(
        "calibrate", brief, "--platform", "petrel-l", "--out", tmp_path / "hull.yaml", "--profiles", "1:3", "--tune",
        "--set", "calibration.hold=[K_L]", "--set", "rounds.most=0",
        *(word for key, value in tuning.items() for word in ("--set", f"tuning.{key}={value}")),
    )  # fmt: skip
    assert done.status == 0, done.err
    hull = gh.load_platform(tmp_path / "hull.yaml")
    assert hull.prior == tuned.platform.prior
    assert hull.prior != gh.load_platform("petrel-l").prior
    assert hull.viscous == alone.platform.viscous  # The steady glides do not depend on the prior.
    assert "Disturbance prior tuned on profile" in hull.source


def test_a_prior_that_a_run_would_refuse_is_not_written(monkeypatch, caplog):
    """The hull of the first calibration is, and its notes and the log say why."""
    hull, reason = gh.load_platform("petrel-l"), "a run refuses a profile with more than 5% of its samples rejected"
    first = HullFromGlides(platform=hull, calibration=None, caution="calibrated before")
    monkeypatch.setattr(HullFromGlides, "fitted", SimpleNamespace(profiles=(1, 2, 3)))
    monkeypatch.setattr(workflow, "calibrate_open", lambda *_: first)
    monkeypatch.setattr(workflow, "tune_open", lambda *_: SimpleNamespace(tuned=None, notes=["log-likelihood"]))
    monkeypatch.setattr(workflow.prior_text, "refusal", lambda *_: reason)
    found = workflow.calibrate_and_tune(workflow.CalibrationInputs(None, hull, workflow.CalibrateSettings()), None)
    assert found.platform.prior == hull.prior
    assert found.caution.startswith("calibrated before; the prior was tuned but is not used, since a run refuses")
    assert "the prior was tuned but is not used" in caplog.text


@pytest.mark.parametrize("raised", [True, False])
def test_a_prior_with_which_the_dives_give_no_hull_is_not_written(raised, monkeypatch):
    """The second calibration fails, or only its rounds over the dives do."""
    hull, reason = gh.load_platform("petrel-l"), "no dive could be smoothed"
    first = HullFromDives(platform=hull, dives=SimpleNamespace())

    def calibrated(inputs, *_):
        platform = inputs.platform
        if platform.prior is None:
            return first
        if raised:
            raise gh.CalibrationError(reason)
        return HullFromGlides(platform=platform, calibration=None, failure=reason)

    with_prior = hull.model_copy(update={"prior": default_prior(hull)})
    monkeypatch.setattr(HullFromDives, "fitted", SimpleNamespace(profiles=(1, 2, 3)))
    monkeypatch.setattr(workflow, "calibrate_open", calibrated)
    monkeypatch.setattr(
        workflow, "tune_open", lambda *_: SimpleNamespace(tuned=None, notes=["log-likelihood"], platform=with_prior)
    )
    monkeypatch.setattr(workflow.prior_text, "refusal", lambda *_: "")
    found = workflow.calibrate_and_tune(workflow.CalibrationInputs(None, hull, workflow.CalibrateSettings()), None)
    assert found.platform is hull
    assert found.dives is first.dives
    found_none = "no hull was found" if raised else "the dives gave no hull"
    assert found.caution.startswith(f"the prior was tuned but is not used, since {found_none} with it ({reason})")


def test_a_prior_is_tuned_as_by_the_command(swift, tmp_path):
    found = gh.tune(swift, "petrel-l", profiles=1, tuning={"max_rounds": 1, "longest": 190.0})
    found.save(tmp_path / "ours.yaml")
    done = program(
        "tune", swift, "--platform", "petrel-l", "--out", tmp_path / "theirs.yaml", "--profiles", 1, "--set",
        "tuning.max_rounds=1", "--set", "tuning.longest=190.0",
    )  # fmt: skip
    assert done.status == 0, done.err
    assert (tmp_path / "ours.yaml").read_text() == (tmp_path / "theirs.yaml").read_text()
    assert found.table.loc[("deviation", "B_cr"), "unit"] == "N m"
    assert found.table.loc[("correlation time", "B_cu"), "unit"] == "s"
    assert found.profiles == (1,)
    assert found.notes


def test_records_are_inspected(brief, tmp_path):
    found = gh.inspect(gh.open_records(brief), "petrel-l")
    done = program("inspect", brief, "--platform", "petrel-l", "--out", tmp_path / "found.json")
    assert done.status == 0, done.err
    theirs = pd.DataFrame(json.loads((tmp_path / "found.json").read_text())["findings"])
    assert found.table["quantity"].tolist() == theirs["quantity"].tolist()
    assert found.table["size"].tolist() == pytest.approx(
        theirs["size"].astype(float).tolist(), rel=0, abs=0, nan_ok=True
    )
    assert found.left_out == {}
    assert isinstance(found.suggestions, dict)


def test_suggestions_of_inspect_are_python_settings():
    suggestions = ("`records.pitch_offset=2.50`", "`records.heading_deviation=[1.0, 0.5]` (times sin, cos)")
    findings = [
        Finding("check", name, "degree", 2.5, 0.1, 0.5, CheckVerdict.FOUND, text)
        for name, text in zip(("pitch", "heading"), suggestions, strict=True)
    ]
    found = InspectedRecords(Inspection(tuple(findings), (1,), {}))
    words = ["records.pitch_offset=2.50", "records.heading_deviation=[1.0, 0.5] (times sin, cos)"]
    assert list(found.suggestions.values()) == words
    assert found.table["suggestion"].tolist() == words


# The flight model


def test_the_glider_takes_a_hull_in_every_form(tmp_path):
    platform = read_platform("petrel-l")
    rates = [gh.Glider(hull).rhs(STATE, CONTROL, np.zeros(6)) for hull in (platform, "petrel-l")]
    assert rates[0].shape == (12,)
    assert rates[0].tobytes() == rates[1].tobytes()
    with pytest.raises(gh.InputError, match="no-such-hull"):
        gh.Glider("no-such-hull")


def test_shapes_of_the_flight_model():
    glider, n = gh.Glider("petrel-l"), 20
    controls, disturbances = np.tile(CONTROL, (n, 1)), np.zeros((n, 6))
    states = glider.simulate(STATE, controls, disturbances, 0.1)
    assert glider.jacobian(STATE, CONTROL).shape == (12, 12)
    assert states.shape == (n + 1, 12)
    measurements = states[:, [0, 1, 2, 5]] + 0.01
    cost, gradient = glider.tracking_cost(STATE, controls, disturbances, measurements, 0.1)
    assert isinstance(cost, float)
    assert cost > 0.0
    assert gradient.shape == (n, 6)
    moved = disturbances.copy()
    moved[3, 0] = 1e-4
    difference = (glider.tracking_cost(STATE, controls, moved, measurements, 0.1)[0] - cost) / 1e-4
    assert difference == pytest.approx(gradient[3, 0], rel=1e-3)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda g: g.rhs(STATE[:6], CONTROL, np.zeros(6)), r"state has shape \(6,\); it must be \(12\)"),
        (lambda g: g.rhs(STATE, CONTROL[:3], np.zeros(6)), r"control has shape \(3,\); it must be \(4,\)"),
        (lambda g: g.rhs(STATE, CONTROL, [np.nan] * 6), r"disturbance\[0\] is nan"),
        (lambda g: g.simulate(STATE, CONTROL, np.zeros((1, 6)), 0.1), r"controls has shape \(4,\)"),
        (lambda g: g.simulate(STATE, [CONTROL], np.zeros((2, 6)), 0.1), r"disturbances has shape \(2, 6\)"),
        (lambda g: g.simulate(STATE, [CONTROL], np.zeros((1, 6)), float("inf")), "step is inf; it must be finite"),
        (lambda g: g.tracking_cost(STATE, [CONTROL], np.zeros((1, 6)), np.zeros((1, 4)), 0.1), "measurements has"),
        (lambda g: g.rhs([STATE, 1.0], CONTROL, np.zeros(6)), "^state is not an array of numbers: .*inhomogeneous"),
        (lambda g: g.rhs(STATE, [CONTROL, 1.0], np.zeros(6)), "^control is not an array of numbers"),
        (lambda g: g.rhs(STATE, CONTROL, ["calm"] * 6), "^disturbance is not an array of numbers: .*'calm'"),
        (lambda g: g.rhs(STATE, CONTROL, [1j] * 6), "^disturbance is not an array of numbers: "),
        (lambda g: g.bodies([CONTROL, CONTROL[:2]]), "^controls is not an array of numbers"),
        (lambda g: g.simulate(STATE, [CONTROL], {}, 0.1), "^disturbances is not an array of numbers"),
        (lambda g: g.simulate(STATE, [CONTROL], np.zeros((1, 6)), "0.1"), "^step is '0.1'; it must be a number"),
        (lambda g: g.tracking_cost(STATE, [CONTROL], np.zeros((1, 6)), [[1.0], []], 0.1), "^measurements is not an"),
    ],
)  # fmt: skip
def test_wrong_arrays_are_named(call, message):
    with pytest.raises(gh.InputError, match=message):
        call(gh.Glider("petrel-l"))


# The door itself


def test_every_name_is_there():
    assert set(gh.__all__) <= set(dir(gh))
    for name in gh.__all__:
        assert getattr(gh, name) is not None
    import gliderhpc.report.page

    assert gh.report is gliderhpc.report
    assert callable(gh.report)
    with pytest.raises(AttributeError, match="no attribute 'invent'"):
        _ = gh.invent
    assert issubclass(gh.InputError, gh.GliderhpcError)


def test_importing_it_loads_no_library_of_numbers():
    code = (
        "import sys, gliderhpc\n"
        "print([name for name in ('numpy', 'numba', 'xarray', 'pandas', 'matplotlib') if name in sys.modules])\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True,
        env={**os.environ, "PYTHONPATH": str(REPOSITORY)},
    )  # fmt: skip
    assert done.stdout.strip() == "[]"


def test_numbers_of_things():
    assert [counted(count, "profile") for count in (0, 1, 2)] == ["0 profiles", "1 profile", "2 profiles"]
    assert [counted(count, "fix", "fixes") for count in (1, 3)] == ["1 fix", "3 fixes"]


def test_values_changed_in_place_are_what_is_inverted(swift, tmp_path):
    path = Path(shutil.copy(swift, tmp_path / "m.nc"))
    with gh.open_records(path) as records:
        records.pitch.values[:] += 0.5
        with opened_records(records) as observations:
            assert observations.path != path
            assert observations.profile(1).pitch[0] == pytest.approx(np.radians(records.pitch.values[0]))
    # Closed: another library may write it.
    records.load().drop_attrs(deep=False).to_netcdf(tmp_path / "other.nc")
    shutil.move(tmp_path / "other.nc", path)


def test_attributes_and_variables_that_a_file_cannot_hold(records):
    edited = records.assign_attrs(note=None, tested=True, more={"a": 1}, history="edited").drop_vars("fix_time")
    edited["reference_mass"] = 60.0
    with opened_records(edited) as observations:
        assert observations.profile_numbers == [1, 2, 3]
        assert "there is no usable GPS fix in the file" in observations.warnings[0]


def test_an_error_in_a_dataset_names_no_temporary_file(records):
    with pytest.raises(gh.InputError) as raised, opened_records(records.assign_attrs(note="x")):
        raise gh.InputError("records.nc: bad")
    assert "gliderhpc-records" not in str(raised.value)


@pytest.mark.parametrize("study", ["vertical", "reconstruction", "reanalysis"])
def test_a_study_without_settings_refuses_any(study, swift_store):
    given = {"models": "none.nc"} if study == "reanalysis" else {}
    with pytest.raises(gh.InputError, match=rf"{study}: has no settings, and was given quik"):
        gh.analyze(swift_store, study, workers=0, quik=True, **given)


def test_a_mission_without_a_finished_profile_has_none_to_plot(mission):
    _, archive = mission
    with pytest.raises(gh.InputError, match="profile: none is available"):
        gh.plot_profile(archive.isel(profile=slice(0, 0)))


def test_values_in_pythons_own_types():
    assert gh.load_platform("petrel-l", {"viscous.K_D0": 10.0}).viscous.K_D0 == 10.0
    assert profiles_text(xr.DataArray([1, 3])) == "1,3"
    assert profiles_text(np.int64(2)) == "2"
    with pytest.raises(gh.InputError, match=r"profiles=3\.0"):
        profiles_text(3.0)
    assert assignments_of({"scaling": (np.float64(2.0), 20)}) == ("scaling=[2.0, 20]",)


def test_a_gap_of_no_weight_may_hold_anything():
    glider, n = gh.Glider("petrel-l"), 5
    arguments = (STATE, np.tile(CONTROL, (n, 1)), np.zeros((n, 6)))
    measured, weights = np.zeros((n + 1, 4)), np.ones(n + 1)
    weights[3] = 0.0
    cost, gradient = glider.tracking_cost(*arguments, measured, 0.1, weights=weights)
    measured[3], measured[0] = np.nan, np.nan
    again, same = glider.tracking_cost(*arguments, measured, 0.1, weights=weights)
    assert again == cost
    np.testing.assert_array_equal(same, gradient)
    measured[4, 1] = np.nan
    with pytest.raises(gh.InputError, match=r"measurements\[4, 1\] is nan"):
        glider.tracking_cost(*arguments, measured, 0.1, weights=weights)


@pytest.mark.parametrize("use", [
    lambda tree: gh.invert(tree, "petrel-l"),
    lambda tree: gh.currents(tree),
    lambda tree: gh.open_mission(tree),
    lambda tree: gh.analyze(tree, "spectra"),
    lambda tree: gh.load_platform(tree),
])  # fmt: skip
def test_an_object_of_another_kind_is_named(use):
    with pytest.raises(gh.GliderhpcError, match="DataTree"):
        use(xr.DataTree())


def test_a_forked_process_inverts_too(records):
    """The threads of the parent's libraries, which do not exist in the child, are not waited for."""
    gh.invert(records, "petrel-l", profile=1)
    process = multiprocessing.get_context("fork").Process(
        target=lambda: gh.invert(records, "petrel-l", profile=2), daemon=True
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # Python 3.12 warns of a fork beside threads.
        process.start()
    process.join(120.0)
    assert process.exitcode == 0


def test_archives_are_refused_without_assertions(swift_store, monkeypatch):
    """Under ``python -O``, zarr reads no archive, and each would seem to be damaged."""
    monkeypatch.setattr("sys.flags", SimpleNamespace(optimize=1))
    with pytest.raises(gh.GliderhpcError, match="unset PYTHONOPTIMIZE"):
        group_at(swift_store)


def test_times_with_a_zone_are_refused():
    time = pd.date_range("2024-01-01", periods=3, freq="s", tz="UTC")
    with pytest.raises(gh.GliderhpcError, match="time: has a time zone"):
        gh.inspect(xr.Dataset(coords={"time": time}), "petrel-l")
