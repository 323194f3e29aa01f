"""Exit statuses of the program, and one clear line for every invalid input."""

import errno
import io
import logging
import re
import subprocess
import sys
import warnings
from pathlib import Path

import click
import numpy as np
import pytest
import xarray as xr
from rich.console import Console
from support.missions import changed_observations, program, samples_of
from support.repository import REPOSITORY

from gliderhpc.archive.mission import open_mission
from gliderhpc.cli.console import progress
from gliderhpc.cli.main import SUMMARIES, VERBS
from gliderhpc.cli.main import program as verbs
from gliderhpc.cli.messages import print_left_out
from gliderhpc.cli.records import _print_findings
from gliderhpc.cli.run_mission import closing_line, summary_table
from gliderhpc.cli.studies import write_and_print
from gliderhpc.findings.results import Findings
from gliderhpc.mission import run as mission_run
from gliderhpc.mission.run import MissionResult
from gliderhpc.platform import platform_text
from gliderhpc.record_checks import Inspection
from gliderhpc.studies.registry import STUDIES
from gliderhpc.version import __version__

pytestmark = pytest.mark.compiled

PETREL = ("--platform", "petrel-l", "--workers", 0)


@pytest.fixture
def run(tmp_path):
    """Invert a file into a new archive; return the result of the run and the archive's path."""

    def run_mission(path, *arguments, platform=PETREL):
        store = tmp_path / "out.zarr"
        return program("run-mission", path, *platform, "--store", store, *arguments), store

    return run_mission


def table_of(store):
    with xr.open_datatree(store, engine="zarr") as tree:
        return tree.to_dataset().load()


# The program itself


@pytest.mark.parametrize("command", ["import gliderhpc", "from gliderhpc.cli.main import main; main(['--help'])"])
def test_verbs_without_computation_import_no_numerical_library(command):
    code = f"""import sys\ntry:\n    {command}\nfinally:\n    print(*sys.modules)"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = set(done.stdout.splitlines()[-1].split())
    assert "gliderhpc" in loaded
    assert not loaded & {"numpy", "numba", "scipy", "xarray", "zarr", "matplotlib", "dask"}


def test_the_list_of_hulls_loads_neither_kernels_nor_archives():
    use = "from gliderhpc.cli.main import main; main(['platforms'])"
    code = f"import sys\ntry:\n    {use}\nfinally:\n    print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "petrel-l" in done.stdout
    assert not set(done.stdout.splitlines()[-1].split()) & {"numba", "xarray", "zarr", "pandas", "matplotlib", "dask"}


@pytest.mark.skipif(not (REPOSITORY / "cli").exists(), reason="the source archive holds no links")
@pytest.mark.parametrize("link", ["cli", "kernels", "store_schema"])
def test_a_link_at_the_top_of_the_repository_is_no_module(link):
    done = subprocess.run([sys.executable, "-c", f"import {link}"], cwd=REPOSITORY, capture_output=True, text=True)
    assert done.returncode == 1
    assert done.stderr.endswith(f"is a link into the package; import gliderhpc.{link}\n")


def test_a_run_loads_nothing_that_draws():
    modules = "gliderhpc.cli.run_mission, gliderhpc.mission.warm, gliderhpc.studies.currents"
    code = f"import sys, {modules}; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not set(done.stdout.split()) & {"matplotlib", "scipy.signal", "scipy.stats", "scipy.optimize", "dask"}


def test_help_lists_every_verb_and_each_shows_an_example():
    answer = program("--help")
    assert answer.status == 0
    assert list(SUMMARIES) == list(VERBS)
    for verb, summary in SUMMARIES.items():
        assert re.search(rf"^  {verb} +{re.escape(summary)}$", answer.out, re.M)
        own = program(verb, "--help")
        assert own.status == 0
        assert f"gliderhpc {verb}" in own.out.split("Example", 1)[1]


def test_help_of_analyze_names_every_study():
    words = program("analyze", "--help").out.replace(",", " ").replace(".", " ").split()
    assert set(STUDIES) <= set(words)


def test_version():
    answer = program("--version")
    assert answer.status == 0
    assert __version__ in answer.out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("fly",), "no such command 'fly'; commands are run-mission"),
        (("analyse", "a.zarr"), "no such command 'analyse', did you mean 'analyze'?"),
        (("run-mission",), "Missing argument 'OBSERVATIONS'"),
        (("run-mission", "a.nc", "--platform", "petrel-l"), "Missing option '--store'"),
        (("run-mission", "a.nc", "--platform", "p", "--store", "s", "--preset", "best"), "'best' is not one of"),
        (("run-mission", "a.nc", "--platform", "p", "--store", "s", "--workers", "-1"), "-1 is not in the range"),
        (("run-mission", "a.nc", "--platform", "p", "--store", "s", "--resume", "--overwrite"), "mutually exclusive"),
        (("simulate-mission", "a.nc"), "Missing option '--platform'"),
        (("run-mission", "a.nc", "--platform", "petrel-l", "--store", ""), "--store: is empty; give a value"),
        (("run-mission", "a.nc", "--platform=", "--store", "s"), "--platform: is empty; give a value"),
        (
            ("currents", "a.nc", "out.csv"),
            "out.csv: is written as netCDF, which .csv is not; give a name that ends in .nc",
        ),
        (("report", "", "--out", "x"), "the argument after report: is empty; give a value"),
        (("analyze", "a.zarr", "hul"), "events, hull, drift, all, did you mean 'hull'?"),
    ],
)
def test_wrong_usage_is_2(arguments, words):
    answer = program(*arguments)
    assert answer.status == 2
    assert words in answer.err
    assert "Traceback" not in answer.err
    assert answer.out == ""


def test_an_archive_of_results_given_as_records_is_called_so(brief, brief_store):
    answer = program("inspect", brief_store, "--platform", "petrel-l")
    assert answer.status == 2
    assert (
        f"is an archive of results, not a file of records; give the observations that it was made from ({brief.name})"
        in answer.err
    )


def test_a_complete_run_exits_with_0_and_reports_every_profile(brief_run):
    assert brief_run.status == 0
    assert "3 of 3 profiles done" in brief_run.out.splitlines()[-1]
    for number in (1, 2, 3):
        assert f"profile {number} done" in brief_run.err
    assert "Profiles" in brief_run.out
    assert "current N m/s" in brief_run.out


def test_an_interrupt_is_130(brief, run, monkeypatch):
    def interrupt(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(mission_run, "run_mission", interrupt)
    answer, _ = run(brief)
    assert answer.status == 130
    assert "interrupted; the archive is intact, finish it with --resume" in answer.err
    assert "Traceback" not in answer.err


def test_an_error_on_the_way_out_of_an_interrupt_is_130(brief, run, monkeypatch):
    """A signal that arrives while a lock is taken again, whose release then fails."""

    class Unlocked:
        def __enter__(self):
            return self

        def __exit__(self, *_):
            raise RuntimeError("release unlocked lock")

    def fail(*_, **__):
        with Unlocked():
            raise KeyboardInterrupt

    monkeypatch.setattr(mission_run, "run_mission", fail)
    answer, _ = run(brief)
    assert answer.status == 130
    assert "interrupted; the archive is intact, finish it with --resume" in answer.err


_INTO = ("--platform", "petrel-l", "--store", "a.zarr")


@pytest.mark.parametrize(
    ("verb", "arguments", "hint"),
    [
        ("run-mission", ("a.nc", *_INTO), "finish it with --resume"),
        ("simulate-mission", ("a.nc", *_INTO[:2]), "nothing was written, run it again"),
        ("validate", ("a.nc", *_INTO), "the archive is unchanged, run it again"),
        ("analyze", ("a.zarr", "reconstruction"), "still in the archive, run it again"),
        ("twin", ("windows", "--out", "twins", "--quick"), "nothing was written, run it again"),
        ("info", ("a.zarr",), "interrupted; run it again"),
    ],
)
def test_every_verb_says_how_to_go_on_after_an_interrupt(monkeypatch, verb, arguments, hint):
    def interrupt(*_, **__):
        raise KeyboardInterrupt

    command = verbs.get_command(click.Context(verbs), verb)
    command = command.commands[arguments[0]] if verb == "twin" else command
    monkeypatch.setattr(command, "callback", interrupt)
    answer = program(verb, *arguments)
    assert answer.status == 130
    assert hint in answer.err
    assert ("--resume" in answer.err) == (verb == "run-mission")
    assert "Traceback" not in answer.err


def test_a_full_disk_is_1(brief, run, monkeypatch):
    def fill(*_, **__):
        raise OSError(errno.ENOSPC, "No space left on device", "some.zarr")

    monkeypatch.setattr(mission_run, "run_mission", fill)
    answer, _ = run(brief)
    assert answer.status == 1
    assert "no space left to write some.zarr; free some space and finish it with --resume" in answer.line


def test_bugs_are_not_hidden(brief, run, monkeypatch, tmp_path):
    def slip(*_, **__):
        raise ZeroDivisionError

    monkeypatch.setattr(mission_run, "run_mission", slip)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    answer, _ = run(brief)
    assert answer.status == 1
    assert "unexpected error, ZeroDivisionError" in answer.err.splitlines()[-1]
    (left,) = tmp_path.glob("gliderhpc-error-*.txt")
    assert "raise ZeroDivisionError" in left.read_text("utf-8")


def test_the_log_goes_to_a_file_too(brief, run, tmp_path):
    log = tmp_path / "run.log"
    answer, _ = run(brief, "--profiles", "3", "--log-file", log)
    assert answer.status == 0
    text = log.read_text("utf-8")
    assert "INFO profile 3 done in" in text
    assert "windows" in text
    assert logging.getLogger("gliderhpc").handlers == []
    answer, _ = run(brief, "--overwrite", "--log-file", tmp_path / "absent" / "run.log")
    assert answer.status == 2
    assert "run.log: cannot be written" in answer.line


@pytest.mark.parametrize(
    "report",
    [
        print_left_out,
        lambda reasons: _print_findings(Inspection((), (1,), reasons)),
        lambda reasons: write_and_print(Findings({}, {}, {}, {}, failed=reasons), "drift", Path("drift")),
    ],
    ids=["export", "inspect", "analyze"],
)
def test_a_long_list_of_failures_says_how_many_more_there_are(report, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    report(dict.fromkeys(range(1, 14), "no depth"))
    lines = [line for line in capsys.readouterr().out.splitlines() if "left out" in line]
    assert lines == [*(f"profile {number} left out: no depth" for number in range(1, 11)), "3 more left out"]
    report(dict.fromkeys(range(1, 11), "no depth"))
    assert "more left out" not in capsys.readouterr().out


def test_progress_without_a_terminal_draws_nothing(capsys):
    with progress(2, "profiles") as advance:
        advance()
        advance()
    assert capsys.readouterr() == ("", "")


# Bad input of the whole file or of the call: exit status 2, one line, nothing written


def drop(name):
    return lambda content: content.drop_vars(name)


def in_decibars(content):
    content["depth"].attrs["units"] = "dbar"


def with_clock(content, clock):
    """The index of a dataset cannot be written to in place."""
    return content.assign_coords(time=("time", clock, content["time"].attrs))


def clock_back_between_profiles(content):
    clock = content["time"].values.copy()
    clock[samples_of(content, 2)[0] :] -= 3000.0
    return with_clock(content, clock)


FILES = [
    ("missing variable", drop("pitch"), ["required variable pitch is missing", "'degree'"]),
    ("missing control", drop("ballast_volume"), ["required variable ballast_volume is missing", "'cm3'"]),
    ("depth in decibars", in_decibars, ["depth is in 'dbar'", "'m'", "decibars is a pressure"]),
    ("clock back", clock_back_between_profiles, ["the clock was set back by", "correct the times"]),
]


@pytest.mark.parametrize(("change", "words"), [case[1:] for case in FILES], ids=[case[0] for case in FILES])
def test_a_file_that_cannot_be_used(brief, run, tmp_path, change, words):
    path = changed_observations(brief, tmp_path / "bad.nc", change)
    answer, store = run(path)
    assert answer.status == 2
    for word in ["bad.nc", *words]:
        assert word in answer.line
    assert not store.exists()


def test_a_file_that_is_no_netcdf(run, tmp_path):
    path = tmp_path / "notes.nc"
    path.write_text("depth: deep\n")
    answer, _ = run(path)
    assert answer.status == 2
    assert "notes.nc: is not a netCDF file" in answer.line


def test_a_file_that_is_not_there(run, tmp_path):
    answer, _ = run(tmp_path / "absent.nc")
    assert answer.status == 2
    assert "absent.nc: no such file" in answer.line


def test_a_platform_with_negative_drag(brief, run, tmp_path):
    path = tmp_path / "odd.yaml"
    path.write_text(platform_text("petrel-l").replace("K_D0: ", "K_D0: -"))
    answer, store = run(brief, platform=("--platform", path))
    assert answer.status == 2
    assert "odd.yaml" in answer.line
    assert "viscous.K_D0 is -" in answer.line
    assert "must be greater than 0" in answer.line
    assert not store.exists()
    answer, _ = run(brief, "--set", "platform.viscous.K_D0=-7")
    assert answer.status == 2
    assert "viscous.K_D0 is -7" in answer.line


def test_an_unknown_platform(brief, run):
    answer, _ = run(brief, platform=("--platform", "petrel"))
    assert answer.status == 2
    assert "unknown platform 'petrel', did you mean 'petrel-l'?" in answer.line


@pytest.mark.parametrize(
    ("assignment", "words"),
    [
        (
            "windw.length=30",
            "--set windw.length: no such setting, did you mean 'window.length'?; "
            "the settings of window are window.cost_threshold, window.length, window.margin; those of the hull",
        ),
        ("platform.buoyancy.neutral=3", "a platform has no key 'buoyancy.neutral'"),
        ("window.length=-5", "--set window.length: Input should be greater than 0, not -5"),
        ("window.length", "write it as KEY=VALUE"),
    ],
)
def test_an_unknown_setting(brief, run, assignment, words):
    answer, store = run(brief, "--set", assignment)
    assert answer.status == 2
    assert words in answer.line
    assert not store.exists()


def test_profiles_that_the_file_does_not_hold(brief, run):
    answer, _ = run(brief, "--profiles", "2:3,7")
    assert answer.status == 2
    assert "no profile 7; the available ones are 1 to 3 (3 profiles)" in answer.line


def test_an_archive_that_exists(brief, brief_store):
    answer = program("run-mission", brief, *PETREL, "--store", brief_store)
    assert answer.status == 2
    assert "brief.zarr: this archive exists; finish it with --resume or start again with --overwrite" in answer.line


@pytest.mark.parametrize("option", [(), ("--overwrite",), ("--resume",), ("--append",)])
def test_a_copy_of_results_is_named_as_such_and_left_unchanged(brief, brief_store, tmp_path, option):
    """With --resume it was only not an archive."""
    copy = tmp_path / "copy.zarr"
    with warnings.catch_warnings():
        # zarr's own remark that its consolidated metadata is not in the specification.
        warnings.simplefilter("ignore")
        open_mission(brief_store).to_zarr(copy)
    before = sorted(file.stat().st_mtime_ns for file in copy.rglob("*"))
    answer = program("run-mission", brief, *PETREL, "--store", copy, *option)
    assert answer.status == 2
    assert "a copy of results, such as of one dive, that xarray wrote (`to_zarr`), not an archive" in answer.line
    assert sorted(file.stat().st_mtime_ns for file in copy.rglob("*")) == before


def test_a_warning_is_printed_once_and_logged(brief, tmp_path):
    """Where stderr is no terminal, it was printed twice."""
    with xr.open_dataset(brief, decode_times=False) as records:
        records.isel(fix=slice(0)).to_netcdf(tmp_path / "m.nc")
    log = tmp_path / "run.log"
    command = (
        "run-mission",
        tmp_path / "m.nc",
        *PETREL,
        "--store",
        tmp_path / "m.zarr",
        "--dry-run",
        "--log-file",
        log,
    )
    answer = program(*command)
    assert answer.err.count("there is no usable GPS fix in the file") == 1
    assert "WARNING there is no usable GPS fix in the file" in log.read_text()


@pytest.mark.parametrize("option", [(), ("--overwrite",), ("--resume",)])
def test_a_folder_that_is_not_an_archive_is_refused_and_left_unchanged(brief, tmp_path, option):
    folder = tmp_path / "thesis"
    folder.mkdir()
    (folder / "chapter.txt").write_text("years of work")
    answer = program("run-mission", brief, *PETREL, "--store", folder, *option)
    assert answer.status == 2
    assert "not an archive of gliderhpc" in answer.line
    assert (folder / "chapter.txt").read_text() == "years of work"


def test_a_place_that_cannot_be_written(brief, tmp_path):
    (tmp_path / "file").write_text("")
    answer = program("run-mission", brief, *PETREL, "--store", tmp_path / "file" / "out.zarr")
    assert answer.status == 2
    assert "out.zarr: cannot be written" in answer.line


# Bad profiles: the others are inverted, exit status 1, the message stored


def heading_of_720(content):
    content["heading"].values[samples_of(content, 2)[40]] = 720.0


def pitch_all_missing(content):
    content["pitch"].values[samples_of(content, 2)] = np.nan


def only_20_samples(content):
    content["profile"].values[samples_of(content, 2)[20:]] = 0


def clock_back_within(content):
    rows, clock = samples_of(content, 2), content["time"].values.copy()
    clock[rows[100]] = clock[rows[90]]
    return with_clock(content, clock)


PROFILES = [
    ("heading 720", heading_of_720, ["heading is 720 degree at sample", "outside"]),
    ("all-NaN pitch", pitch_all_missing, ["pitch is missing (NaN) in all"]),
    ("20 samples", only_20_samples, ["only 20 samples, but at least 30 are needed"]),
    ("clock back", clock_back_within, ["time runs backwards at sample"]),
]


@pytest.mark.parametrize(("change", "words"), [case[1:] for case in PROFILES], ids=[case[0] for case in PROFILES])
def test_one_bad_profile_fails_alone(brief, brief_store, run, tmp_path, change, words):
    path = changed_observations(brief, tmp_path / "bad.nc", change)
    answer, store = run(path)
    assert answer.status == 1
    assert "2 of 3 profiles done; 1 failed: 2" in answer.out.splitlines()[-1]
    assert "Traceback" not in answer.err
    table = table_of(store)
    assert list(table["status"].values) == ["done", "failed", "done"]
    message = str(table["message"].sel(profile=2).values)
    assert message.startswith("profile 2: ")
    assert "\n" not in message
    for word in words:
        assert word in message
    assert f"({message})" in answer.err
    with xr.open_datatree(store, engine="zarr") as tree, xr.open_datatree(brief_store, engine="zarr") as clean:
        assert np.isnan(tree["series"].ds["B_cr"].sel(profile=2).values).all()
        for number in (1, 3):
            ours, theirs = (one["series"].ds["B_cr"].sel(profile=number).values for one in (tree, clean))
            length = min(len(ours), len(theirs))
            np.testing.assert_array_equal(ours[:length], theirs[:length])


def test_a_profile_that_the_filter_rejects_fails_alone(brief, run, tmp_path):
    """A tenth of the pitch record is junk, which only the filter can notice."""

    def junk(content):
        # Two at a time: a single one would be left out.
        for first in (0, 1):
            content["pitch"].values[samples_of(content, 2)[first::10]] += 40.0

    answer, store = run(changed_observations(brief, tmp_path / "junk.nc", junk))
    assert answer.status == 1
    table = table_of(store)
    assert list(table["status"].values) == ["done", "failed", "done"]
    assert "gated" in str(table["message"].sel(profile=2).values)
    assert "more than 5%" in str(table["message"].sel(profile=2).values)


def test_no_usable_profile_at_all_is_2(brief, run, tmp_path):
    answer, store = run(changed_observations(brief, tmp_path / "bad.nc", heading_of_720), "--profiles", "2")
    assert answer.status == 2
    assert "bad.nc: no usable profile; profile 2: heading is 720 degree at sample" in answer.line
    assert not store.exists()


# Without fixes


def no_fixes(content):
    return content.drop_dims("fix")


def no_fix_before_the_first(content):
    first = content["time"].values[samples_of(content, 1)[0]]
    return content.isel(fix=np.flatnonzero(content["fix_time"].values > first))


def test_a_file_without_fixes_is_accepted_with_a_warning(brief, run, tmp_path):
    answer, store = run(changed_observations(brief, tmp_path / "unfixed.nc", no_fixes))
    assert answer.status == 0
    warnings = [line for line in answer.err.splitlines() if line.startswith("warning: ")]
    assert warnings == [
        "warning: there is no usable GPS fix in the file (it lacks fix_time, fix_latitude, fix_longitude): profiles "
        "are inverted, but their currents will be NaN"
    ]
    table = table_of(store)
    assert list(table["status"].values) == ["done"] * 3
    for name in ("dac_north", "dac_east", "dac_north_std", "dac_north_glide_angle", "entry_latitude", "exit_time"):
        assert table[name].isnull().all()
    assert all("no GPS fix before or after the profile" in str(message) for message in table["message"].values)


def test_a_missing_fix_before_a_profile_is_stated_in_its_message(brief, run, tmp_path):
    answer, store = run(changed_observations(brief, tmp_path / "late.nc", no_fix_before_the_first))
    assert answer.status == 0
    assert "warning" not in answer.err
    table = table_of(store)
    assert "no GPS fix before the profile" in str(table["message"].sel(profile=1).values)
    assert np.isnan(table["dac_north"].sel(profile=1))
    assert np.isfinite(table["dac_north"].sel(profile=[2, 3])).all()
    assert np.isfinite(table["exit_latitude"].sel(profile=1))


# The other verbs


def test_simulate_then_estimate_then_look(tmp_path, run):
    """The README's walk: one profile of 30 m."""
    path = tmp_path / "small.nc"
    simulated = program("simulate-mission", path, "--platform", "petrel-l", "--profiles", 1, "--seed", 5, "--depth", 30)
    assert simulated.status == 0
    assert path.exists()
    assert (tmp_path / "small.truth.nc").exists()
    answer, store = run(path)
    assert answer.status == 0
    info = program("info", store)
    assert info.status == 0
    assert "1 done" in info.out
    assert "synthetic impulses, seed 5" in info.out


def test_info_of_nothing_is_2(tmp_path):
    answer = program("info", tmp_path / "absent.zarr")
    assert answer.status == 2
    assert "no such archive" in answer.line


def test_platforms_are_listed_and_shown():
    listed = program("platforms")
    assert listed.status == 0
    for name in ("petrel-l", "seawing", "slocum", "seaexplorer", "seaglider"):
        assert name in listed.out
    assert program("platforms", "petrel-l").status == 0
    assert program("platforms", "whale").status == 2


def test_import_of_nothing_is_2(tmp_path):
    answer = program("import", "seaexplorer", tmp_path, tmp_path / "out.nc")
    assert answer.status == 2
    assert answer.line.startswith("gliderhpc: ")
    assert not (tmp_path / "out.nc").exists()


# The closing summary


def test_the_summary_shows_messages_as_they_are():
    """Brackets in a message are not markup, and missing values are shown as a dash."""
    result = MissionResult({3: {"status": "failed", "message": "pitch [deg] is missing", "run_seconds": 0.1}})
    console = Console(width=200, record=True, file=io.StringIO())
    console.print(summary_table(result))
    text = console.export_text()
    assert "pitch [deg] is missing" in text
    assert " - " in text
    assert closing_line(result, "a.zarr") == "0 of 1 profile done; 1 failed: 3; 0.0 s; a.zarr"


def test_the_summary_lists_failed_profiles_as_the_option_profiles_takes_them():
    """A thousand of them filled several screens."""
    result = MissionResult({number: {"status": "failed"} for number in (*range(1, 1000), 1001)})
    assert closing_line(result, "a.zarr") == "0 of 1000 profiles done; 1000 failed: 1:999,1001; 0.0 s; a.zarr"


def test_a_margin_as_long_as_the_default_window_is_refused(brief, tmp_path):
    """The window follows the sensors when it is not set, so only the plan can see this."""
    done = program(
        "run-mission", brief, "--platform", "petrel-l", "--store", tmp_path / "a.zarr", "--set", "window.margin=40"
    )
    assert done.status == 2
    assert "window.margin=40: must be shorter than the window, 30 s here" in done.err


# What cannot be


def with_fix_off(source, path):
    """Copy a mission with the first fix of its second surfacing 27 degrees off."""
    with xr.open_dataset(source, decode_times=False) as dataset:
        changed = dataset.load()
    at_surface = np.flatnonzero(changed["profile"].values == 1)[-1]
    index = int(np.searchsorted(changed["fix_time"].values, changed["time"].values[at_surface]))
    latitude = changed["fix_latitude"].values.copy()
    surfacing = slice(index, index + int(np.count_nonzero(np.diff(changed["fix_time"].values[index:]) < 300.0)))
    latitude[surfacing] += 27.0
    changed = changed.assign(fix_latitude=("fix", latitude, changed["fix_latitude"].attrs))
    changed.to_netcdf(path)
    return path


def test_no_current_comes_of_an_impossible_fix(brief, tmp_path):
    """It had been 998 m/s, done, without a message."""
    path = with_fix_off(brief, tmp_path / "off.nc")
    store = tmp_path / "off.zarr"
    answer = program("run-mission", path, "--platform", "petrel-l", "--workers", 0, "--store", store, "--profiles", "1")
    assert answer.status == 0
    with open_mission(store) as archive:
        row = archive.to_dataset().sel(profile=1).load()
    assert str(row["status"].values) == "done"
    assert not np.isfinite(row["dac_north"].values) or float(np.hypot(row["dac_north"], row["dac_east"])) < 1.0
    assert "m/s over ground (glider and current together reach at most 4 m/s)" in str(row["message"].values)
    assert "left out: " in answer.err
