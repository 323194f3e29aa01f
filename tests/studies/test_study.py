"""Common form of a study: table, files, registry and trend; groups of studies in an archive."""

import csv
import json
import time
from importlib import import_module
from io import StringIO
from pkgutil import iter_modules

import dask
import dask.array as da
import numpy as np
import pandas as pd
import pytest
import xarray as xr
import zarr
from distributed import Client, LocalCluster
from matplotlib.figure import Figure
from matplotlib.image import imread
from rich.console import Console
from support.archives import Content, put_table_rows, write_archive, write_profile
from support.missions import program

import gliderhpc as gh
import gliderhpc.report.studies
from gliderhpc.archive.mission import open_for_reading
from gliderhpc.errors import InputError
from gliderhpc.findings.comparison import (
    COLUMNS,
    NUMBER_COLUMNS,
    Comparison,
    comparison_from_json,
    comparison_table,
    comparisons_as_json,
)
from gliderhpc.findings.formatting import markdown, number
from gliderhpc.findings.results import Findings, archive_findings, as_plain, write_csv, write_findings, write_json
from gliderhpc.mission.executors import DaskExecutor, local_executor
from gliderhpc.report.studies import show_study, studies_in
from gliderhpc.store_schema import check_archive, create_study, finish_study, set_study_attributes, write_table_rows
from gliderhpc.store_schema.schema import STUDIES as GROUPS
from gliderhpc.studies.archived import (
    Provenance,
    column_medians,
    failed_profiles,
    outdated_input_remarks,
    provenance_of,
    study_table,
)
from gliderhpc.studies.library.trends import find_trend, mann_kendall
from gliderhpc.studies.registry import ALL_STUDIES, STUDIES, load_study, run_study
from gliderhpc.studies.request import Request, archive_on_disk, default_folder


@pytest.fixture
def archive(tmp_path):
    return write_archive(tmp_path / "twin.zarr", Content(1), Content(2), Content(5))


ROWS = [
    Comparison("yaw RMSE", "N m", 0.05, 0.15, (0.04, 0.06), remark="best"),
    Comparison("invariant", "1", 0.1, 0.0, paper_text="invariant"),
    Comparison("share", "1", 0.2, (0.1, 0.44)),
    Comparison("nothing", "m", np.nan, spread=(np.nan, 1.0)),
]


def test_the_ratio_is_to_the_value_or_to_the_range():
    assert Comparison("a", "m", 3.0, 2.0).ratio == pytest.approx(1.5)
    assert Comparison("a", "m", 3.0, (2.0, 4.0)).ratio == 1.0
    assert Comparison("a", "m", 1.0, (2.0, 4.0)).ratio == pytest.approx(0.5)
    assert Comparison("a", "m", 6.0, (2.0, 4.0)).ratio == pytest.approx(1.5)
    assert Comparison("a", "m", -0.2, (-0.8, -0.4)).ratio == pytest.approx(0.5)
    for row in (Comparison("a", "m", 3.0), Comparison("a", "m", 3.0, 0.0), Comparison("a", "m", np.nan, 1.0)):
        assert row.ratio is None


def test_a_row_as_text():
    assert ROWS[0].cells == ("yaw RMSE", "N m", "0.150", "0.0500", "0.0400 to 0.0600", "0.333", "best")
    assert ROWS[1].cells[2] == "invariant"
    assert ROWS[2].cells[2:6] == ("0.100 to 0.440", "0.200", "–", "1.00")
    assert ROWS[3].cells[2:6] == ("–", "–", "– to 1.00", "–")


def _printed(rows):
    console = Console(file=StringIO(), width=120)
    console.print(comparison_table(rows, "study [1]"))
    return console.file.getvalue()


def test_the_table_shows_spread_and_remark_only_where_there_is_one():
    text = _printed(ROWS)
    for part in (*ROWS[0].cells, "study [1]", "spread", "remark"):
        assert part in text
    plain = _printed(ROWS[2:3])
    assert "ratio" in plain
    assert "spread" not in plain
    assert "remark" not in plain


def test_markdown():
    lines = markdown(COLUMNS, [ROWS[0].cells], NUMBER_COLUMNS).splitlines()
    assert lines[1] == "| --- | --- | ---: | ---: | ---: | ---: | --- |"
    assert lines[2] == "| yaw RMSE | N m | 0.150 | 0.0500 | 0.0400 to 0.0600 | 0.333 | best |"
    assert markdown(("a", "b"), [("1", "2|3")], "b") == "| a | b |\n| --- | ---: |\n| 1 | 2\\|3 |"


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "–"), (np.nan, "–"), (0.0, "0.00"), (1.0, "1.00"), (26.64, "26.6"), (1234.0, "1234"),
        (7.5e-6, "7.50e-06"), (-0.0123, "-0.0123"), (2.5e5, "2.50e+05"),
    ],
)  # fmt: skip
def test_three_significant_digits(value, text):
    assert number(value) == text


def test_comparisons_survive_json(tmp_path):
    content = {"rows": comparisons_as_json(ROWS), "array": np.array([1.0, np.inf]), "count": np.int64(3)}
    content = json.loads(write_json(tmp_path / "a.json", content).read_text("utf-8"))
    assert content["array"] == [1.0, None]
    assert content["count"] == 3
    assert list(content["rows"][0]) == [
        "quantity", "unit", "ours", "paper", "spread", "paper_text", "remark", "ratio"
    ]  # fmt: skip
    assert content["rows"][2]["paper"] == [0.1, 0.44]
    back = [comparison_from_json(row) for row in content["rows"]]
    assert back[:3] == ROWS[:3]
    assert back[3].cells == ROWS[3].cells
    of_an_earlier_version = {**content["rows"][2], "paper_said": "0.1 to 0.5"}
    del of_an_earlier_version["paper_text"]
    assert comparison_from_json(of_an_earlier_version).paper_text == "0.1 to 0.5"


def test_csv_has_every_column(tmp_path):
    path = write_csv(tmp_path / "a.csv", [{"a": 1, "b": 0.5}, {"a": 2, "c": float("nan")}])
    with path.open(encoding="utf-8") as file:
        assert list(csv.reader(file)) == [["a", "b", "c"], ["1", "0.5", ""], ["2", "", ""]]


def test_findings_are_written_the_same_way(tmp_path):
    figure = Figure(figsize=(2.0, 1.0), dpi=60)
    findings = Findings(
        comparisons={"study": ROWS},
        tables={"profiles": [{"profile": 1, "rmse": 0.25}]},
        figures={"figure_1": figure},
        content={"counts": np.array([1, 2])},
        documents={"budget.yaml": "a: 1\n"},
    )
    written = write_findings(findings, "study", tmp_path / "new" / "study")
    assert [path.name for path in written] == ["profiles.csv", "figure_1.png", "study.json", "budget.yaml"]
    assert pd.read_csv(written[0]).rmse.item() == 0.25
    assert imread(written[1]).shape[:2] == (60, 120)
    assert json.loads(written[2].read_text()) == {"counts": [1, 2]}
    assert written[3].read_text() == "a: 1\n"
    blocked = tmp_path / "file"
    blocked.write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        write_findings(findings, "study", blocked / "study")


def test_findings_of_an_archive(tmp_path):
    table = pd.DataFrame({"profile": [1, 2], "rmse": [0.25, np.nan]})
    findings = archive_findings(
        "study",
        comparisons=ROWS,
        tables={"profiles": table},
        figures={},
        facts={"missing": float("nan")},
        failed={3: "no fix"},
        remarks=("no truth",),
        captions={"profiles": "how they were made", "figure_1": "of what is not there"},
    )
    assert findings.comparisons == {"study": ROWS}
    csv_path, json_path = write_findings(findings, "study", tmp_path)
    assert csv_path.read_text().splitlines() == ["profile,rmse", "1,0.25", "2,"]
    content = json.loads(json_path.read_text())
    assert content["facts"] == {"missing": None}
    assert content["comparisons"][3]["ours"] is None
    assert content["failed"] == {"3": "no fix"}
    assert content["remarks"] == ["no truth"]
    assert default_folder("a/b.zarr", "study").as_posix() == "a/b-studies/study"
    assert default_folder("a/b.zarr", "study", "smoothed").as_posix() == "a/b-studies/study-smoothed"


def test_every_study_has_its_group_and_its_name():
    names = {group.name for group in GROUPS}
    for name in STUDIES:
        assert load_study(name).name == name
        assert name in names
    with pytest.raises(InputError, match="no such study"):
        load_study("nothing")


def test_a_figure_without_a_caption_is_refused():
    with pytest.raises(KeyError, match="profiles"):
        archive_findings(
            "study", comparisons=ROWS, tables={"profiles": pd.DataFrame()}, figures={}, facts={}, failed={}, captions={}
        )


MADE = Provenance((2, 5), ("profile", "elapsed_days", "pitch_rmse", "message"), "none", False, {"step": 0.1}, ("so",))


def test_an_archive_lists_its_studies_and_outdated_ones(archive):
    put_table_rows(archive, {index: {"elapsed_days": 0.5 * index} for index in range(3)})
    create_study(archive, "validation")
    with open_for_reading(archive) as opened:
        assert studies_in(opened) == []
        with pytest.raises(InputError, match="does not contain the study validation"):
            show_study("validation", opened)
        with pytest.raises(InputError, match="not a study"):
            show_study("nothing", opened)
    write_table_rows(archive, {1: {"pitch_rmse": 1.5}, 2: {"message": "no fix"}}, "validation")
    finish_study(archive, "validation", {"trend": 0.1})
    with open_for_reading(archive) as opened:
        assert studies_in(opened) == ["validation"]
        with pytest.raises(InputError, match=r"does not record its profiles.*run it again"):
            show_study("validation", opened)
    finish_study(archive, "validation", as_plain(MADE.attributes()))
    with open_for_reading(archive) as opened:
        assert provenance_of(opened, "validation") == MADE
        table = study_table(opened, "validation")
    assert list(table) == list(MADE.columns)
    assert table["elapsed_days"].tolist() == [0.5, 1.0]
    failed, flown = failed_profiles(table)
    assert failed == {5: "no fix"}
    assert flown[["profile", "pitch_rmse"]].to_numpy().tolist() == [[2, 1.5]]
    assert column_medians(table) == {"pitch_rmse": 1.5}
    set_study_attributes(archive, "validation", {"outdated": "made before 1 profile was added"})
    with open_for_reading(archive) as opened:
        assert provenance_of(opened, "validation").remarks[1:] == (
            "this study was made before 1 profile was added; run it again",
        )
        (remark,) = outdated_input_remarks(opened, "validation", "currents")
        assert remark == (
            "this study uses the study validation, which was made before 1 profile was added; run validation again, "
            "and then this study"
        )


def test_every_study_that_an_archive_may_hold_is_shown():
    assert {group.name for group in GROUPS} == set(ALL_STUDIES)
    assert all(load_study(name).title for name in ALL_STUDIES)
    # A study without figures of its own has no module here (docs/how-to/study.md).
    modules = {module.name for module in iter_modules(gliderhpc.report.studies.__path__)}
    with_figures = {name for name in modules if hasattr(import_module(f"gliderhpc.report.studies.{name}"), "show")}
    assert with_figures - set(ALL_STUDIES) == set()
    assert len(with_figures) == 11


def test_a_study_needs_a_finished_profile(tmp_path):
    archive = write_archive(tmp_path / "a.zarr", Content(1, table={"status": "pending"}))
    with pytest.raises(InputError, match="nothing to study"):
        run_study("reconstruction", Request(archive, lambda: local_executor(0)))


def test_mann_kendall_on_known_values():
    assert mann_kendall(np.arange(10.0)) == (1.0, pytest.approx(8.3e-5, rel=0.02))
    tau, p = mann_kendall(np.array([1.0, 1.0, 1.0]))
    assert (tau, p) == (0.0, 1.0)
    # Ties: S = 7, variance (5 4 15 - 2 1 9) / 18, worked by hand.
    tau, p = mann_kendall(np.array([1.0, 2.0, 2.0, 3.0, 2.5]))
    assert tau == pytest.approx(0.7)
    assert p == pytest.approx(0.1296, abs=2e-4)


def test_trend_of_a_line_with_outliers():
    days = np.linspace(0.0, 60.0, 61)
    values = 0.048 + (0.080 - 0.048) / 60.0 * days
    values[[7, 30]] = 5.0
    values[11] = np.nan
    trend = find_trend(days, values)
    assert (trend.begin, trend.end) == (days[0], days[-1])
    holed = find_trend(days, np.where((days > days[5]) & (days < days[-3]), values, np.nan))
    assert (holed.begin, holed.end) == (days[6], days[-4])
    assert holed.last - holed.first == pytest.approx(holed.slope * (holed.end - holed.begin))
    assert trend.count == 60
    assert trend.first == pytest.approx(0.048, rel=0.03)
    assert trend.last == pytest.approx(0.080, rel=0.03)
    assert trend.change == pytest.approx(0.66, abs=0.06)
    assert trend.low <= trend.slope <= trend.high
    assert trend.p < 1e-6
    assert trend.change_text.endswith(" %")
    from_nothing = find_trend(days, np.abs(np.random.default_rng(4).normal(0.0, 0.01, 61)) + 1e-3 * days - 0.0085)
    assert from_nothing.first < 0.01
    assert np.isnan(from_nothing.change)
    assert "not distinguishable from zero" in from_nothing.change_text
    assert np.isnan(find_trend([1.0, 2.0], [1.0, 2.0]).slope)


def test_an_archive_is_sound_with_and_without_a_study(archive):
    assert check_archive(archive) == []
    create_study(archive, "validation")
    assert check_archive(archive) == ["validation: the study was interrupted; run it again"]
    write_profile(archive, 2, "validation", {"pitch": np.full(4, -22.5)})
    write_table_rows(archive, {2: {"pitch_rmse": 1.5, "message": "so"}}, "validation")
    finish_study(archive, "validation", {"trend": {"p": None}})
    assert check_archive(archive) == []
    with xr.open_datatree(archive, engine="zarr") as tree:
        group = tree["validation"]
        assert group.attrs["trend"] == {"p": None}
        assert group.ds.pitch_rmse.sel(profile=5).item() == 1.5
        assert np.isnan(group.ds.pitch_rmse.sel(profile=1).item())
        assert group.ds.pitch.sel(profile=5).values[:5].tolist() == pytest.approx([-22.5] * 4 + [np.nan], nan_ok=True)
        assert group.ds.pitch.sizes["record"] == tree["state"].ds.sizes["record"]


def test_a_study_run_again_replaces_its_group(archive):
    for value in (1.0, 2.0):
        create_study(archive, "vertical")
        write_table_rows(archive, {0: {"mean_dive": value}}, "vertical")
        finish_study(archive, "vertical", {})
    write_table_rows(archive, {}, "vertical")
    with xr.open_datatree(archive, engine="zarr") as tree:
        values = tree["vertical"].ds.mean_dive.values
    np.testing.assert_array_equal(values, [2.0, np.nan, np.nan])


@pytest.mark.damages_archive
def test_check_detects_changed_metadata_of_a_study(archive):
    create_study(archive, "validation")
    finish_study(archive, "validation", {})
    zarr.open_group(str(archive), mode="r+")["validation/pitch_rmse"].attrs["units"] = "radian"
    assert check_archive(archive) == [
        "validation/pitch_rmse: attribute units is 'radian', not 'degree'",
        "validation/pitch_rmse: the consolidated metadata differs from its own",
    ]


def test_an_unknown_study_has_no_group(archive):
    with pytest.raises(KeyError, match="no group 'nothing'"):
        create_study(archive, "nothing")


def _sum_and_scheduler(array):
    return float(array.sum().compute()), dask.config.get("scheduler")


def _part_after_part(folder):
    """Give a part, and the next one when the first has been seen."""
    yield "first"
    while not (folder / "seen").exists():
        time.sleep(0.01)
    yield "second"


def test_parts_of_a_job_come_before_it_ends(tmp_path):
    with (
        dask.config.set({"distributed.admin.system-monitor.gil.enabled": False}),
        LocalCluster(n_workers=1, threads_per_worker=1, processes=False, dashboard_address=":0") as cluster,
        Client(cluster) as client,
    ):
        parts = DaskExecutor(client).stream(_part_after_part, [tmp_path])
        assert next(parts).result == "first"
        (tmp_path / "seen").touch()
        assert {part.result for part in parts} == {"first", "second"}


def test_a_job_on_a_worker_computes_what_it_reads_itself():
    lazy = da.arange(5, chunks=2)
    with (
        dask.config.set({"distributed.admin.system-monitor.gil.enabled": False}),
        LocalCluster(n_workers=1, threads_per_worker=1, processes=False, dashboard_address=":0") as cluster,
        Client(cluster) as client,
    ):
        assert list(DaskExecutor(client).run(_sum_and_scheduler, [lazy])) == [(10.0, "synchronous")]


@pytest.mark.parametrize("words", [("analyze", "vertical"), ("validate", "--platform", "petrel-l")])
def test_an_archive_in_an_object_store_is_to_be_copied_first(words, brief):
    address = "s3://bucket/mission.zarr"
    place = (brief, "--store", address) if words[0] == "validate" else (address,)
    answer = program(words[0], *place, *words[1:])
    assert answer.status == 2
    assert answer.line.startswith(f"gliderhpc: {address}: studies require the archive on a local disk")


def test_python_refuses_an_archive_in_an_object_store_too(brief):
    for call in (
        lambda: gh.analyze("s3://bucket/a.zarr", "vertical"),
        lambda: gh.validate(brief, "petrel-l", "s3://b/a"),
    ):
        with pytest.raises(InputError, match="copy it from the object store first"):
            call()


def test_an_archive_named_by_a_dot_has_a_folder_of_results_beside_it(brief_store, monkeypatch):
    monkeypatch.chdir(brief_store)
    assert default_folder(archive_on_disk("."), "currents").parent == brief_store.with_name(
        f"{brief_store.stem}-studies"
    )
