"""Report: every section is present, all content comes from the archive, and a browser displays it fully."""

import csv
import re
import shlex
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
import zarr
from matplotlib.figure import Figure
from support.archives import Content, put_table_rows, write_archive
from support.browser import DESKTOP, PHONE
from support.missions import program
from support.report_pages import read

from gliderhpc.api.studies import analyze_archive
from gliderhpc.archive.mission import describe, open_for_reading
from gliderhpc.cli.demo import QUICK, run_demo
from gliderhpc.errors import InputError
from gliderhpc.findings import drawing
from gliderhpc.findings.comparison import Comparison, comparisons_as_json
from gliderhpc.findings.formatting import with_deviation
from gliderhpc.findings.results import write_csv, write_json
from gliderhpc.mission.executors import SerialExecutor
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.observations.truth import truth_path
from gliderhpc.platform import read_platform
from gliderhpc.report.maps import round_speed
from gliderhpc.report.page.content import FigureBlock
from gliderhpc.report.page.mission_figures import map_figure
from gliderhpc.report.page.mission_page import write_mission_page, write_profile_page
from gliderhpc.report.page.mission_table import MissionTable
from gliderhpc.report.page.overview import overview_section
from gliderhpc.report.page.rendering import cell
from gliderhpc.report.page.reproduction import run_command, study_command
from gliderhpc.simulator import load_scenario
from gliderhpc.store_schema import consolidate, create_archive
from gliderhpc.studies.registry import ALL_STUDIES
from gliderhpc.studies.request import Request

STUDIED = ("currents", "vertical")
"""Studies that the small archive holds."""


def rows_of(path):
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def studied(brief, brief_store, tmp_path_factory):
    """The brief mission with two studies, and its report."""
    store = tmp_path_factory.mktemp("studied") / "mission.zarr"
    shutil.copytree(brief_store, store)
    for study in STUDIED:
        answer = program("analyze", store, study, "--workers", 0)
        assert answer.status == 0, answer.err
    return store


@pytest.fixture(scope="module")
def report(studied, tmp_path_factory):
    out = tmp_path_factory.mktemp("report")
    answer = program("report", studied, "--out", out)
    assert answer.status == 0, answer.err
    assert answer.out.splitlines()[-1] == f"written to {out / 'index.html'}"
    return out


def test_the_overview_has_the_minus_sign_of_the_tables(report):
    """The median current had a hyphen."""
    page = (report / "index.html").read_text(encoding="utf-8")
    before, after = page.split("m/s north, ")
    median = before.rpartition(">")[-1] + after.partition("m/s east")[0]
    assert median
    assert "-" not in median


@pytest.fixture(scope="module")
def profile_report(studied, report):
    answer = program("report", studied, "--out", report, "--profile", 2)
    assert answer.status == 0, answer.err
    return report / "profile_2.html"


@pytest.fixture
def own_copy(studied, tmp_path):
    store = tmp_path / "mission.zarr"
    shutil.copytree(studied, store)
    return store


# What is on the page


def test_page_has_every_section(report):
    page = read(report / "index.html")
    first = ["answers", "overview", "representative", "published"]
    assert list(page.sections)[:4] == first
    assert set(page.sections) == {*first, *ALL_STUDIES, "windows", "provenance"}
    assert list(page.sections)[-1] == "provenance"
    for text in page.sections.values():
        assert len(text.split()) > 10


def test_page_needs_nothing_but_itself(report, profile_report):
    """Images are in the page; links lead into it or to files in its folder, which exist."""
    for path in (report / "index.html", profile_report):
        page = read(path)
        assert page.images
        for image in page.images:
            assert image["src"].startswith("data:image/")
            assert len(image["alt"]) > 20
        for reference in page.references:
            if not reference.startswith(("data:", "#")):
                assert (report / reference).is_file(), reference


def test_tables_and_figures_lie_next_to_the_page(report):
    for name in ("profiles.csv", "outcomes.csv", "settings.csv", "platform.csv", "currents_currents.csv"):
        assert rows_of(report / name), name
    pictures = sorted(path.stem for path in report.glob("*.png"))
    assert pictures == sorted(path.stem for path in report.glob("*.svg"))
    assert {"map", "profiles_over_time", "timing", "representative_profile", "vertical_vertical"} <= set(pictures)
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in report.glob("*.png"))


def test_overview_is_the_archives(report, studied):
    summary, text = describe(studied), read(report / "index.html").sections["overview"]
    for fact in ("petrel-l", "3 done", f"{summary.run_seconds:.0f} s", "brief.nc"):
        assert fact in text
    with open_for_reading(studied) as archive:
        table = archive.to_dataset().load()
    rows = rows_of(report / "profiles.csv")
    assert [int(row["profile"]) for row in rows] == table["profile"].values.tolist()
    written = [float(row["dac_north, m s-1"]) for row in rows]
    np.testing.assert_allclose(written, table["dac_north"].values, rtol=1e-7)
    taken = [(float(row["current_east, m s-1"]), row["current_by"]) for row in rows]
    assert taken == [(pytest.approx(value, rel=1e-7), "smoothed") for value in table["dac_east_smoothed"].values]
    assert "from the smoother" in text


@pytest.mark.usefixtures("undrawn")
def test_a_missing_study_is_named_with_the_command_that_makes_it(report, studied, own_copy, tmp_path):
    """The command is taken from the page and run; then the section is filled."""
    page = read(report / "index.html")
    for name in set(ALL_STUDIES) - set(STUDIED):
        verb = "validate" if name == "validation" else f"analyze .* {name}"
        assert re.search(f"This study is not in the archive.*gliderhpc {verb}", page.sections[name], re.DOTALL), name
    text = page.sections["reconstruction"]
    command = next(line for line in text.splitlines() if line.startswith("gliderhpc analyze"))
    answer = program(*shlex.split(command.replace(str(studied), str(own_copy)))[1:], "--workers", 0)
    assert answer.status == 0, answer.err
    write_mission_page(own_copy, tmp_path / "after")
    assert "does not hold" not in read(tmp_path / "after" / "index.html").sections["reconstruction"]
    assert (tmp_path / "after" / "reconstruction_figure_2.png").is_file()


@pytest.mark.usefixtures("undrawn")
@pytest.mark.damages_archive
def test_interrupted_and_outdated_studies_are_marked(own_copy, tmp_path):
    root = zarr.open_group(own_copy, mode="r+", use_consolidated=False)
    root["vertical"].attrs["complete"] = False
    root["currents"].attrs["outdated"] = "made before profiles were recomputed"
    consolidate(own_copy)
    write_mission_page(own_copy, tmp_path / "report")
    sections = read(tmp_path / "report" / "index.html").sections
    assert "this study was interrupted" in sections["vertical"]
    assert f"gliderhpc analyze {own_copy} vertical" in sections["vertical"]
    assert "made before profiles were recomputed" in sections["currents"]
    profile = read(write_profile_page(own_copy, 2, tmp_path / "profile").page).sections["currents"]
    assert "The depth-resolved current was made before profiles were recomputed; run the study again." in profile
    assert f"gliderhpc analyze {own_copy} currents" in sections["currents"]


def test_profile_page_has_everything_of_the_profile(profile_report, studied):
    page = read(profile_report)
    assert list(page.sections) == ["profile", "motion", "windows", "controls", "currents", "provenance"]
    with open_for_reading(studied) as archive:
        row = archive.to_dataset().sel(profile=2).load()
    folder = profile_report.parent
    shown = {entry["column"]: entry["value"] for entry in rows_of(folder / "profile_2_row.csv")}
    assert shown["window_count"] == str(int(row["window_count"]))
    assert shown["buoyancy"] == "depth slope"
    assert len(rows_of(folder / "profile_2_windows.csv")) == int(row["window_count"])
    assert rows_of(folder / "profile_2_vibration.csv")
    assert (folder / "profile_2_current_by_depth.png").is_file()


# Nothing is canned


def with_north(archive, value):
    """Set the smoother's current to the north of profile 2 in an archive."""
    put_table_rows(archive, {1: {"dac_north_smoothed": value}})


def arrows(archive):
    with open_for_reading(archive) as opened:
        figure = map_figure(MissionTable.of(opened))
    return next(
        one for one in figure.axes[0].collections if one.get_label() == "depth-averaged current, from the smoother"
    )


@pytest.mark.long
def test_one_changed_value_changes_the_figures_data_and_the_table(report, own_copy, tmp_path):
    before = arrows(own_copy)
    with_north(own_copy, 0.75)
    after = arrows(own_copy)
    scale = after.V[1] / 0.75
    assert before.V[1] != after.V[1]
    assert after.V[0] == pytest.approx(before.V[0] / before.U[0] * after.U[0])
    assert scale == pytest.approx(after.V[0] / float(rows_of(report / "profiles.csv")[0]["current_north, m s-1"]))
    write_mission_page(own_copy, tmp_path / "changed")
    old, new = rows_of(report / "profiles.csv"), rows_of(tmp_path / "changed" / "profiles.csv")
    differences = [
        (index, name) for index, row in enumerate(old) for name in row if row[name] != new[index][name]
    ]  # fmt: skip
    assert differences == [(1, "current_north, m s-1"), (1, "dac_north_smoothed, m s-1")]
    assert new[1]["current_north, m s-1"] == "0.75"
    assert "0.750" in (tmp_path / "changed" / "index.html").read_text("utf-8")
    for name in ("map.svg", "profiles_over_time.svg"):
        assert (tmp_path / "changed" / name).read_bytes() != (report / name).read_bytes()
    assert (tmp_path / "changed" / "timing.svg").read_bytes() == (report / "timing.svg").read_bytes()


def test_figures_draw_the_tables_numbers(studied):
    with open_for_reading(studied) as archive:
        section = overview_section(archive, describe(studied))
        table = archive.to_dataset().load()
    pictures = {block.stem: block.figure for block in section.blocks if isinstance(block, FigureBlock)}
    depth, converged, *_ = pictures["profiles_over_time"].axes
    np.testing.assert_allclose(depth.lines[0].get_ydata(), table["max_depth"].values)
    np.testing.assert_allclose(converged.lines[0].get_ydata(), 100.0 * table["converged_fraction"].values)
    np.testing.assert_allclose(pictures["timing"].axes[0].lines[0].get_ydata(), table["run_seconds"].values)
    for figure in pictures.values():
        for axes in figure.axes:
            assert axes.get_ylabel()


# What cannot be shown


def test_unusable_archives_are_refused_in_one_line(tmp_path, own_copy):
    assert "no such archive" in program("report", tmp_path / "none.zarr", "--out", tmp_path / "out").line
    (tmp_path / "other.zarr").mkdir()
    (tmp_path / "other.zarr" / "zarr.json").write_text("{}")
    refused = program("report", tmp_path / "other.zarr", "--out", tmp_path / "out")
    assert refused.status == 2
    assert "not an archive of gliderhpc" in refused.line
    missing = program("report", own_copy, "--out", tmp_path / "out", "--profile", 7).line
    assert "no profile 7; the available ones are 1 to" in missing
    (tmp_path / "file").write_text("")
    assert "give another --out" in program("report", own_copy, "--out", tmp_path / "file" / "report").line


def test_a_wrong_folder_of_twins_is_refused_before_anything_is_drawn(studied, tmp_path, monkeypatch):
    monkeypatch.setattr("gliderhpc.findings.drawing.render_image", lambda figure, form: pytest.fail("drawn"))
    assert "twin windows" in program("report", studied, "--out", tmp_path, "--twins", tmp_path / "no").line


@pytest.mark.usefixtures("undrawn")
def test_a_damaged_table_is_read_from_the_commits(own_copy, studied, tmp_path):
    path = own_copy / "dac_north" / "c.0"
    path.write_bytes(path.read_bytes()[:-5])
    for store in (own_copy, studied):
        assert program("report", store, "--out", tmp_path / store.stem, "--profile", 1).status == 0
    rows = [rows_of(tmp_path / store.stem / "profile_1_row.csv") for store in (own_copy, studied)]
    assert rows[0] == rows[1]


@pytest.mark.parametrize("chunk", ["series/B_cr/c.1.0", "windows/outcome/c.0.0"])
def test_a_damaged_archive_is_reported_in_one_line(own_copy, tmp_path, chunk):
    path = own_copy / chunk
    path.write_bytes(path.read_bytes()[:-5])
    profile = int(chunk.rpartition("/c.")[2].partition(".")[0]) + 1
    answer = program("report", own_copy, "--out", tmp_path / "out", "--profile", profile)
    assert answer.status == 2
    assert "--resume" in answer.line


def test_an_archive_without_a_finished_profile_says_so(tmp_path):
    sizes = {"sample": 10, "record": 5, "window": 2, "segment": 1}
    create_archive(tmp_path / "new.zarr", [1, 2], sizes, {"mission": "not begun"}, overwrite=True)
    answer = program("report", tmp_path / "new.zarr", "--out", tmp_path / "out")
    assert answer.status == 0, answer.err
    page = read(tmp_path / "out" / "index.html")
    assert "no profile is done yet" in page.sections["overview"]
    assert "representative" not in page.sections
    refused = program("report", tmp_path / "new.zarr", "--out", tmp_path / "out", "--profile", 1)
    assert refused.status == 2
    assert "profile 1 is pending" in refused.line


def test_failed_profiles_and_missing_fixes_are_reported(tmp_path):
    failed = Content(2, table={"status": "failed", "message": "the record <ends> early"})
    store = write_archive(tmp_path / "twin.zarr", Content(1), failed)
    write_mission_page(store, tmp_path / "out")
    text = (tmp_path / "out" / "index.html").read_text("utf-8")
    assert "profile 2 failed: the record &lt;ends&gt; early" in text
    assert "no profile has a fix before and after it" in text
    assert "<title>cost $1 and $2</title>" in text


# How to reproduce it


def tree(**attributes):
    return xr.DataTree(xr.Dataset(coords={"profile": [1, 2, 4]}, attrs=attributes))


def test_commands_spell_out_what_is_not_usual():
    settings = MissionSettings(preset="paper").model_copy(update={"slow_part": 90.0}).model_dump(mode="json")
    platform = read_platform("petrel-l")
    command = run_command(
        tree(settings=settings, platform=platform.model_dump(mode="json"), observations="a b.nc"), "m.zarr"
    )
    assert command == (
        "gliderhpc run-mission 'a b.nc' --platform petrel-l --store m.zarr --profiles 1:2,4 --preset paper "
        "--engine lanes --set slow_part=90.0"
    )


def test_the_command_of_a_study_has_the_options_that_it_was_run_with():
    made = xr.Dataset(attrs={"quick": True, "options": ["--profiles", "2:5", "--set", "spectra.groups=2"]})
    archive = xr.DataTree(xr.Dataset(), {"spectra": xr.DataTree(made)})
    expected = "gliderhpc analyze m.zarr spectra --quick --profiles 2:5 --set spectra.groups=2"
    assert study_command("spectra", archive, "m.zarr") == expected
    request = Request(
        Path("m.zarr"),
        SerialExecutor,
        "2:5",
        budget=Path("here/budget.nc"),
        assignments=("spectra.groups=2", "events.most=3"),
    )
    assert request.options("spectra") == ["--profiles", "2:5", "--budget", "budget.nc", "--set", "spectra.groups=2"]


@pytest.mark.usefixtures("undrawn")
def test_a_hull_that_is_not_shipped_is_left_next_to_the_page(own_copy, tmp_path):
    root = zarr.open_group(own_copy, mode="r+", use_consolidated=False)
    hull = dict(root.attrs["platform"])
    hull["mass"] = {**hull["mass"], "total": hull["mass"]["total"] + 0.01}
    root.attrs["platform"] = hull
    consolidate(own_copy)
    write_mission_page(own_copy, tmp_path / "out")
    assert "--platform platform.yaml" in read(tmp_path / "out" / "index.html").sections["provenance"]
    assert read_platform(tmp_path / "out" / "platform.yaml").mass.total == hull["mass"]["total"]


# Small parts


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.012345, "0.0123"), (-2.0, "−2"), (float("nan"), "–"), (None, "–"), (True, "yes"), (7, "7"), ("a", "a"),
     (np.datetime64("NaT", "ns"), "–"), (np.datetime64("2024-01-01T10:00:00"), "2024-01-01 10:00:00")],
)  # fmt: skip
def test_cells_are_readable(value, text):
    assert cell(value) == text


@pytest.mark.parametrize(("speed", "shown"), [(0.0, 0.1), (0.13, 0.1), (0.17, 0.2), (0.4, 0.5), (0.9, 1.0), (3.0, 2.0)])
def test_scale_arrows_are_round(speed, shown):
    assert round_speed(speed) == pytest.approx(shown)


@pytest.mark.parametrize("name", ["mission.nc", "mission.zarr"])
def test_the_demo_leaves_a_mission_of_the_users_alone(tmp_path, name):
    """Users call their files so too."""
    place = tmp_path / name
    if name == "mission.nc":
        place.write_bytes(b"records")
    else:
        create_archive(place, [1], {"sample": 4, "record": 2, "window": 1, "segment": 1}, {})
    with pytest.raises(InputError, match=r"was not made by the demo.*give another --out"):
        run_demo(tmp_path, lambda _: None, lambda _: None)
    assert [entry.name for entry in tmp_path.iterdir()] == [name]


def test_demo_scenario_gives_trends_and_groups():
    scenario = load_scenario("demo")
    assert scenario.profiles >= 12
    days = scenario.profiles * 2 * np.mean(scenario.surface.half_interval) / 86_400.0
    assert 50.0 < days < 70.0
    assert scenario.fouling.profiles == scenario.profiles


# Twins and truth, which are not in the archive


def write_twins(folder):
    """Write the files of `twin windows`, with one comparison."""
    folder.mkdir()
    content = {"quick": True, "platforms": ["petrel-l"], "seeds": [1, 2]}
    compared = {"petrel-l, paper": comparisons_as_json([Comparison("yaw RMSE", "N m", 0.07, 0.15)])}
    write_json(folder / "windows.json", {**content, "comparisons": compared})
    write_csv(folder / "windows.csv", [{"sweep": "sliding", "value": 15.0, "seed": 1, "remark": None}])
    Figure(figsize=(2.0, 1.0)).savefig(folder / "windows.png", dpi=100)
    return folder


@pytest.mark.usefixtures("undrawn")
def test_the_twin_experiment_of_the_windows_is_shown_where_it_is_given(own_copy, tmp_path):
    twins = write_twins(tmp_path / "twins")
    write_mission_page(own_copy, tmp_path / "out", twins)
    page = read(tmp_path / "out" / "index.html")
    assert "petrel-l, 2 twins per setting" in page.sections["windows"]
    assert "a quick study" in page.sections["windows"]
    assert rows_of(tmp_path / "out" / "windows_comparison_0.csv")[0]["ours"] == "0.07"
    assert (tmp_path / "out" / "windows_windows.png").read_bytes() == (twins / "windows.png").read_bytes()
    assert f"--twins {twins}" in page.sections["provenance"]
    for text in ("{", "{}", "[]"):
        (twins / "windows.json").write_text(text, "utf-8")
        assert "run it again" in program("report", own_copy, "--out", tmp_path / "out", "--twins", twins).line


@pytest.mark.long
def test_the_truth_of_a_synthetic_mission_is_drawn(brief, studied, tmp_path):
    answer = program("report", studied, "--out", tmp_path, "--profile", 1, "--truth", truth_path(brief))
    assert answer.status == 0, answer.err
    assert "the truth of this synthetic mission" in read(tmp_path / "profile_1.html").sections["motion"]


SMALL = ("nulls.noise_only=1", "nulls.model_error=1", "nulls.gaussian=1", "intermittency.block_draws=50")
"""Settings of the studies in the demo that a test of its page can do with."""


@pytest.fixture(scope="module")
def tour(tmp_path_factory):
    """The demo's tour of a smaller mission with smaller ensembles, without the twins.

    Figures are PNG alone, and not laid out, which takes a third of the time: the studies' own tests do that.
    """
    scenario = load_scenario("demo").replaced({"profiles": 4, "depth": 60.0, "depth_spread": 5.0})
    drawn = drawing.render_image

    def sketched(figure, form):
        figure.set_layout_engine("none")
        return drawn(figure, form) if form == "png" else b""

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            "gliderhpc.cli.demo.analyze_archive",
            lambda name, request: analyze_archive(name, replace(request, assignments=SMALL)),
        )
        patch.setattr(drawing, "render_image", sketched)
        patch.setattr("gliderhpc.cli.demo.load_scenario", lambda _: scenario)
        patch.setattr("gliderhpc.cli.demo.default_workers", lambda: 0)
        return run_demo(tmp_path_factory.mktemp("tour"), lambda _: None, lambda _: None)


@pytest.mark.long
@pytest.mark.compiled
def test_the_demo_fills_the_section_of_every_study(tour):
    sections = read(tour.report.page).sections
    for name in ALL_STUDIES:
        assert "This study is not in the archive" not in sections[name], name
        assert "cannot be shown" not in sections[name], name
        assert any(path.stem.startswith(f"{name}_") for path in tour.report.figures), name
        assert any(path.stem.startswith(f"{name}_") for path in tour.report.tables), name
    for name in QUICK:
        assert "a quick study" in sections[name], name
    published = [path.stem for path in tour.report.tables if "_table_" in path.stem]
    assert sorted({stem.rpartition("_")[2] for stem in published}) == ["1", "3", "4", "5", "6"]


# In a browser


@pytest.mark.parametrize("size", [PHONE, DESKTOP])
@pytest.mark.parametrize("page", ["index.html", "profile_2.html"])
def test_a_browser_shows_the_page_whole(tab, report, profile_report, page, size):
    seen = tab.open(report / page, size)
    assert seen.errors == ()
    assert seen.width == size[0]
    assert seen.scroll_width <= size[0]
    assert len(seen.images) >= 4
    assert [alternative for alternative, width in seen.images if not width] == []
    assert (seen.dangling, seen.doubled) == ((), ())


def test_the_browser_check_detects_each_fault(tab, tmp_path):
    """Each fault is detected on a page that has it, as the test above requires."""
    wide = '<p style="width: 500px" id="a">wide</p><p id="a"><a href="#gone">x</a></p>'
    script = "<script>console.error('bad'); throw new Error('worse')</script>"
    page = tmp_path / "bad.html"
    page.write_text(f'<meta name="viewport" content="width=device-width">{wide}<img src="none.png" alt="none">{script}')
    seen = tab.open(page, PHONE)
    assert max(seen.width, seen.scroll_width) > PHONE[0]
    assert seen.images == (("none", 0),)
    assert (seen.dangling, seen.doubled) == (("gone",), ("a",))
    assert any("bad" in error for error in seen.errors)
    assert any("worse" in error for error in seen.errors)


def test_no_page_is_written_into_an_archive(own_copy):
    for folder in (own_copy, own_copy / "smoothed"):
        assert "a page would be written into" in program("report", own_copy, "--out", folder).line
    assert not (own_copy / "index.html").exists()


def test_a_file_that_is_no_truth_or_another_missions_is_refused(brief, own_copy, tmp_path):
    arguments = ("report", own_copy, "--out", tmp_path / "out", "--profile", 1, "--truth")
    assert "is not the truth of a synthetic mission, as it has no variable" in program(*arguments, brief).line
    with xr.open_dataset(truth_path(brief)) as content:
        other = content.load().assign_attrs(mission="another")
    other.to_netcdf(tmp_path / "other.truth.nc")
    assert "the truth is that of mission 'another'" in program(*arguments, tmp_path / "other.truth.nc").line


@pytest.mark.parametrize(
    ("value", "deviation", "text"),
    [(-239.2, 171.0, "−239 ± 171"), (0.12345, 0.0123, "+0.123 ± 0.012"), (12.0, 3.4, "+12.0 ± 3.4"),
     (1.5e-6, 2e-7, "+1.5e−06 ± 2e-07"), (1.0, float("nan"), "+1 ± nan")],
)  # fmt: skip
def test_a_value_and_its_deviation_end_at_the_same_decimal(value, deviation, text):
    assert with_deviation(value, deviation) == text


@pytest.mark.parametrize(("column", "text"), [("entry_longitude", "115.1235"), ("longitude, degree", "115.1235"),
                                              ("displacement_north", "115")])  # fmt: skip
def test_positions_are_shown_to_ten_metres(column, text):
    assert cell(115.12345, column) == text
