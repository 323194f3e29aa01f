"""Report of a fleet: a page and a row for each mission, a map of all, and faults confined to one archive."""

import csv
import shlex
import shutil
from dataclasses import replace
from pathlib import Path
from urllib.parse import unquote

import numpy as np
import pytest
import zarr
from matplotlib.quiver import Quiver
from support.archives import put_table_rows
from support.browser import DESKTOP, PHONE
from support.missions import program
from support.report_pages import read

import gliderhpc as gh
from gliderhpc.archive.mission import open_for_reading
from gliderhpc.errors import InputError
from gliderhpc.report.page.fleet import folder_names
from gliderhpc.report.page.fleet_map import FleetTrack, fleet_map
from gliderhpc.report.page.fleet_rows import read_state
from gliderhpc.report.page.mission_page import write_mission_page
from gliderhpc.report.studies.hull import StoredChange
from gliderhpc.store_schema import consolidate
from gliderhpc.surfacing.dive_results import surfacing_message

ODD_NAME = "b<i>&#?% $1$2"
"""Name of a folder that neither HTML, an address nor a figure may take for something else."""


@pytest.fixture(scope="module")
def archives(brief_store, swift_store, tmp_path_factory):
    """Two missions, one with an unusual name and with the study of the hull."""
    folder = tmp_path_factory.mktemp("fleet")
    one, other = folder / "one.zarr", folder / f"{ODD_NAME}.zarr"
    shutil.copytree(brief_store, one)
    shutil.copytree(swift_store, other)
    answer = program("analyze", other, "hull", "--workers", 0)
    assert answer.status == 0, answer.err
    root = zarr.open_group(other, mode="r+", use_consolidated=False)
    root.attrs["mission"] = "<b>swift</b> $x$"
    consolidate(other)
    return one, other


@pytest.fixture(scope="module")
def fleet(archives, tmp_path_factory):
    out = tmp_path_factory.mktemp("report") / "fleet"
    answer = program("report", *archives, "--out", out)
    assert answer.status == 0, answer.err
    assert answer.out.splitlines()[-1] == f"written to {out / 'index.html'}"
    return out


def rows_of(path):
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def damage(archive):
    path = archive / "windows" / "outcome" / "c.0.0"
    path.write_bytes(path.read_bytes()[:-5])


# The page


@pytest.mark.long
def test_every_mission_has_a_linked_page_of_its_own(fleet, archives):
    page = read(fleet / "index.html")
    links = [unquote(one) for one in page.references if one.endswith("/index.html")]
    assert links == ["one/index.html", f"{ODD_NAME}/index.html"]
    for link in links:
        assert (fleet / link).is_file()
        assert (fleet / link).with_name("profiles.csv").is_file()
    assert (
        shlex.join(["gliderhpc", "report", *map(str, archives), "--out", str(fleet)]) in page.sections["reproduction"]
    )


@pytest.mark.long
def test_a_mission_s_page_is_that_of_the_single_command(fleet, archives, tmp_path):
    written = write_mission_page(archives[0], tmp_path / "single")
    names = sorted(path.name for path in (fleet / "one").iterdir())
    assert sorted(path.name for path in written.page.parent.iterdir()) == names
    for name in names:
        if name != "index.html":
            assert (fleet / "one" / name).read_bytes() == (tmp_path / "single" / name).read_bytes(), name
    single, own = (
        text.replace(str(folder), "OUT").rpartition(" on ")[0]
        for folder in (tmp_path / "single", fleet / "one")
        for text in [(folder / "index.html").read_text("utf-8")]
    )
    assert own == single
    assert "roster" not in single.partition("</style>")[0]


def test_rows_are_those_of_the_message_of_the_last_surfacing(fleet, archives):
    rows = rows_of(fleet / "fleet.csv")
    text = read(fleet / "index.html").sections["fleet"]
    for archive, row in zip(archives, rows, strict=True):
        with open_for_reading(archive) as opened:
            message = surfacing_message(opened, 3)
        assert (row["archive"], row["platform"], row["done"], row["failed"]) == (str(archive), "petrel-l", "3", "0")
        assert row["current of profile"] == row["water of profile"] == "3"
        assert float(row["current north, m s-1"]) == pytest.approx(message.current.north, rel=1e-6)
        assert float(row["current east std, m s-1"]) == pytest.approx(message.current.east_std, rel=1e-6)
        assert float(row["speed through the water, m s-1"]) == pytest.approx(message.water.speed, rel=1e-6)
        assert f"{message.current.speed:.3f} m/s towards" in text
        assert f"± {message.current.ellipse.major:.3f} by {message.current.ellipse.minor:.3f}" in text
    assert "not studied" in text
    assert "drag at zero angle of attack: too few dives to detect a change" in text
    assert "no study was run" in text


def test_texts_of_archives_are_escaped(fleet):
    text = (fleet / "index.html").read_text("utf-8")
    assert "&lt;b&gt;swift&lt;/b&gt;" in text
    assert "b&lt;i&gt;&amp;#?%" in text
    assert "<b>swift" not in text
    assert "<i>" not in text


def test_page_needs_nothing_but_its_folder(fleet):
    page = read(fleet / "index.html")
    (image,) = page.images
    assert image["src"].startswith("data:image/")
    for reference in page.references:
        if not reference.startswith(("data:", "#")):
            assert (fleet / unquote(reference)).is_file(), reference


# Faults


@pytest.mark.usefixtures("undrawn")
def test_a_damaged_archive_does_not_affect_the_rest_of_the_fleet(archives, tmp_path):
    damaged, broken = tmp_path / "damaged.zarr", tmp_path / "broken.zarr"
    for copy in (damaged, broken):
        shutil.copytree(archives[0], copy)
    damage(damaged)
    (broken / "zarr.json").write_text("{", "utf-8")
    places = (damaged, archives[0], broken, tmp_path / "none.zarr")
    answer = program("report", *places, "--out", tmp_path / "out")
    assert answer.status == 1
    lines = answer.err.splitlines()
    assert [line.partition(".zarr")[0].rpartition("/")[2] for line in lines] == ["damaged", "broken", "none"]
    page = read(tmp_path / "out" / "index.html")
    assert [one for one in page.references if one.endswith("/index.html")] == ["one/index.html"]
    text = page.sections["fleet"]
    assert "no separate page: " in text
    assert "the chunk is damaged" in text
    assert f"{broken}: not an archive of gliderhpc" in text
    assert "no such archive" in text
    assert [bool(row["fault"]) for row in rows_of(tmp_path / "out" / "fleet.csv")] == [True, False, True, True]
    assert (tmp_path / "out" / "one" / "index.html").is_file()


def test_invalid_fleet_arguments_are_refused_in_one_line(archives, tmp_path):
    one, other = archives
    out = tmp_path / "out"
    twice = program("report", one, one.parent / "." / one.name, "--out", out)
    assert (twice.status, "given 2 times" in twice.line) == (2, True)
    for within in (one / "report", one):
        assert "would be written into" in program("report", one, other, "--out", within).line
    none = program("report", tmp_path / "a.zarr", tmp_path / "b.zarr", "--out", out)
    assert (none.status, "none of the 2 archives can be read" in none.line) == (2, True)
    for option in (("--profile", 1), ("--twins", tmp_path), ("--truth", tmp_path)):
        answer = program("report", one, other, "--out", out, *option)
        assert answer.status == 2
        assert "belong to one archive" in answer.err
    assert not out.exists()


def test_failed_and_poorly_converged_profiles_are_anomalies(swift_store, tmp_path):
    store = tmp_path / "m.zarr"
    shutil.copytree(swift_store, store)
    no_current = {f"dac_{axis}{by}": np.nan for axis in ("north", "east") for by in ("", "_smoothed")}
    failed = {"status": "failed", "message": "the record <ends> early", **no_current}
    put_table_rows(store, {1: failed, 2: {"converged_fraction": 0.4, **no_current}})
    state = read_state(store)
    assert state.anomalies == (
        "profile 2 failed: the record <ends> early", "less than 80% of the windows converged in profile 3",
        "no current for profile 3", "no study was run",
    )  # fmt: skip
    assert state.cells["dives"] == ("2 done", "1 failed")
    assert (state.current_of, state.water_of) == (1, 3)
    put_table_rows(store, {number: {"status": "pending"} for number in (0, 2)})
    state = read_state(store)
    assert state.anomalies[1] == "2 profiles still to be estimated"
    assert (state.cells["through the water"], state.cells["dives"][0]) == ((), "0 done")


def test_changes_of_the_hull_are_in_the_row(swift_store):
    drag = StoredChange("viscous.K_D0", "kg/m", 2.5, 0.3, 0.97, "drag: changed")
    state = replace(read_state(swift_store), hull=(drag,))
    assert state.cells["hull"] == ("drag: changed",)
    row = state.row()
    assert (row["change of drag, kg m-1"], row["change of drag std, kg m-1"]) == (2.5, 0.3)
    assert (row["probability that drag changed"], row["probability that neutral volume changed"]) == (0.97, None)


@pytest.mark.usefixtures("undrawn")
def test_a_mission_without_fixes_is_not_on_the_map(archives, swift_store, tmp_path):
    store = tmp_path / "m.zarr"
    shutil.copytree(swift_store, store)
    ends = [f"{end}_{axis}" for end in ("entry", "exit") for axis in ("latitude", "longitude")]
    put_table_rows(store, {index: dict.fromkeys(ends, np.nan) for index in range(3)})
    found = read_state(store).track(1, "m")
    assert len(found.fixes) == 0
    assert not found.has_current
    assert np.isfinite(found.current).all()
    gh.report([archives[0], store], tmp_path / "out")
    assert "Without fixes: 2." in read(tmp_path / "out" / "index.html").sections["map"]


# From Python


@pytest.mark.long
@pytest.mark.usefixtures("undrawn")
def test_python_takes_a_list_too(archives, tmp_path):
    written = gh.report(list(archives), tmp_path / "out")
    assert written.page == tmp_path / "out" / "index.html"
    assert [path.name for path in written.tables] == ["fleet.csv"]
    assert written.failed == ()
    single = gh.report([archives[0]], tmp_path / "single")
    assert (tmp_path / "single" / "profiles.csv") in single.tables
    with pytest.raises(InputError, match="belong to one archive"):
        gh.report(archives, tmp_path / "out", profile=1)
    with pytest.raises(InputError, match="no archive is given"):
        gh.report([], tmp_path / "out")


# Folders


@pytest.mark.parametrize(
    ("places", "names"),
    [
        (("/a/m12.zarr", "/a/m13.zarr"), ["m12", "m13"]),
        (("/a/m.zarr", "/b/m.zarr", "/a/n"), ["a-m", "b-m", "n"]),
        (("/x/a/m.zarr", "/y/a/M.zarr"), ["x-a-m", "y-a-M"]),
        (("/a/m.zarr", "/a/m"), ["a-m", "a-m-2"]),
        (("/a-b/m.zarr", "/a/b-m.zarr", "/b/m.zarr"), ["a-b-m", "a-b-m-2", "b-m"]),
        (("/a/index.html", "s3://bucket/2019/m.zarr"), ["a-index.html", "m"]),
        (("/a/.zarr", "s3://bucket/m.zarr"), [".zarr", "m"]),
    ],
)
def test_archives_with_equal_names_get_different_folders(places, names):
    found = folder_names([place if "://" in place else Path(place) for place in places])
    assert len({name.casefold() for name in found}) == len(places)
    assert found == names


# The map


def track(number, fixes, place=(np.nan, np.nan), current=(np.nan, np.nan), deviations=(np.nan,) * 3):
    points = np.array(fixes, dtype=float).reshape(-1, 2)
    return FleetTrack(number, f"_{number} $a$", points, *map(np.array, (place, current, deviations)))


def test_currents_point_their_way_with_their_ellipses():
    """North-east at 60 degrees north, half as much as the faster one; its error is three times as large to the east."""
    one = track(1, [(0.0, 60.0), (0.2, 60.1)], (0.1, 60.05), (0.1, 0.1), (0.01, 0.03, 0.0))
    other = track(2, [(0.3, 60.0), (0.4, 60.0)], (0.35, 60.0), (0.0, 0.2 * np.sqrt(2.0)), (0.01, 0.01, 0.0))
    axes = fleet_map([one, other, track(3, [])]).axes[0]
    arrows = next(item for item in axes.collections if isinstance(item, Quiver))
    shrink = np.cos(np.radians(60.05))
    east, north = np.asarray(arrows.U) * shrink, np.asarray(arrows.V)
    assert np.degrees(np.arctan2(east, north)) == pytest.approx([45.0, 0.0])
    assert np.hypot(east, north)[1] == pytest.approx(2.0 * np.hypot(east, north)[0])
    widths = np.ptp(axes.patches[0].get_xy(), axis=0) / 2.0 * [shrink, 1.0] / (north[0] / 0.1)
    assert widths == pytest.approx(1.5096 * np.array([0.03, 0.01]), rel=5e-3)
    assert [text.get_text() for text in axes.figure.legends[0].get_texts()] == ["1  _1 $a$", "2  _2 $a$"]


def test_a_fleet_across_the_date_line_lies_together():
    axes = fleet_map([track(1, [(179.9, 10.0), (180.1, 10.0)]), track(2, [(-179.8, 10.0), (-179.7, 10.1)])]).axes[0]
    low, high = axes.get_xlim()
    assert 179.0 < low < high < 181.0


def test_names_in_the_legend_are_short_and_printable():
    one = replace(track(1, [(0.0, 1.0)]), name="glider\n" + 60 * "x")
    (text,) = fleet_map([one, track(2, [])]).legends[0].get_texts()
    assert text.get_text() == f"1  glider {29 * 'x'} ..."


def test_without_a_fix_there_is_no_map():
    assert fleet_map([track(1, [])]) is None


# In a browser


@pytest.mark.parametrize("size", [PHONE, DESKTOP])
def test_a_browser_shows_the_page_whole(tab, fleet, size):
    seen = tab.open(fleet / "index.html", size)
    assert seen.errors == ()
    assert (seen.width, seen.scroll_width <= size[0]) == (size[0], True)
    assert [alternative for alternative, width in seen.images if not width] == []
    assert (seen.dangling, seen.doubled) == ((), ())
