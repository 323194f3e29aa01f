"""The common form of a study: the table, the files, the registry, the trend; and studies' groups in an archive."""

import json
from io import StringIO

import numpy as np
import pandas as pd
import pytest
import xarray as xr
import zarr
from archives import Content, write_archive
from matplotlib.figure import Figure
from rich.console import Console

from gliderhpc.analysis.comparison import Comparison, comparison_markdown, comparison_table, significant
from gliderhpc.analysis.registry import STUDIES, load_study, run_study
from gliderhpc.analysis.study import Findings, Request, default_folder, write_findings
from gliderhpc.analysis.trend import find_trend, mann_kendall
from gliderhpc.errors import InputError
from gliderhpc.mission.executors import local_executor
from gliderhpc.store_schema import check_archive, create_study, finish_study, write_profile, write_table_rows
from gliderhpc.store_schema.studies import STUDIES as GROUPS


@pytest.fixture
def archive(tmp_path):
    return write_archive(tmp_path / "twin.zarr", Content(1), Content(2), Content(5))


def test_the_ratio_is_to_the_value_or_to_the_range():
    assert Comparison("a", "m", 2.0, 3.0).ratio == pytest.approx(1.5)
    assert Comparison("a", "m", (2.0, 4.0), 3.0).ratio == 1.0
    assert Comparison("a", "m", (2.0, 4.0), 1.0).ratio == pytest.approx(0.5)
    assert Comparison("a", "m", (2.0, 4.0), 6.0).ratio == pytest.approx(1.5)
    for row in (Comparison("a", "m", None, 3.0), Comparison("a", "m", 0.0, 3.0), Comparison("a", "m", 1.0, np.nan)):
        assert np.isnan(row.ratio)


def test_the_table_shows_paper_ours_and_ratio():
    rows = [
        Comparison("roll", "degree", 2.4, 1.2, "k_z = 0"),
        Comparison("share", "1", (0.1, 0.44), 0.2),
        Comparison("lag", "s", None, np.nan),
    ]
    console = Console(file=StringIO(), width=120)
    console.print(comparison_table(rows, "study"))
    text = console.file.getvalue()
    for part in ("roll", "degree", "2.40", "1.20", "0.50", "k_z = 0", "0.100 to 0.440", "1.00"):
        assert part in text
    lines = comparison_markdown(rows).splitlines()
    assert lines[2] == "| roll | degree | 2.40 | 1.20 | 0.50 | k_z = 0 |"
    assert lines[4] == "| lag | s | – | – | – |  |"


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0, "0.00"), (1.0, "1.00"), (26.64, "26.6"), (1234.0, "1234"), (7.5e-6, "7.50e-06"), (-0.0123, "-0.0123")],
)
def test_three_significant_digits(value, text):
    assert significant(value) == text


def test_findings_are_written_the_same_way(tmp_path):
    findings = Findings(
        comparisons=(Comparison("roll", "degree", 2.4, np.nan),),
        tables={"profiles": pd.DataFrame({"profile": [1], "rmse": [0.25]})},
        figures={"figure_1": Figure()},
        facts={"counts": np.array([1, 2]), "missing": float("nan")},
        failed={3: "no fix"},
    )
    written = write_findings(findings, "study", tmp_path / "new" / "study")
    assert [path.name for path in written] == ["profiles.csv", "figure_1.png", "study.json"]
    content = json.loads(written[-1].read_text())
    assert content["facts"] == {"counts": [1, 2], "missing": None}
    assert content["comparisons"][0]["ours"] is None
    assert content["failed"] == {"3": "no fix"}
    assert pd.read_csv(written[0]).rmse.item() == 0.25
    assert default_folder("a/b.zarr", "study").as_posix() == "a/b-studies/study"
    blocked = tmp_path / "file"
    blocked.write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        write_findings(findings, "study", blocked / "study")


def test_every_study_has_its_group_and_its_name():
    names = {group.name for group in GROUPS}
    for name in STUDIES:
        assert load_study(name).name == name
        assert name in names
    with pytest.raises(InputError, match="no such study"):
        load_study("nothing")


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
    assert trend.count == 60
    assert trend.first == pytest.approx(0.048, rel=0.03)
    assert trend.last == pytest.approx(0.080, rel=0.03)
    assert trend.change == pytest.approx(0.66, abs=0.06)
    assert trend.low <= trend.slope <= trend.high
    assert trend.p < 1e-6
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
        create_study(archive, "reconstruction")
        write_table_rows(archive, {0: {"steady_roll": value}}, "reconstruction")
        finish_study(archive, "reconstruction", {})
    write_table_rows(archive, {}, "reconstruction")
    with xr.open_datatree(archive, engine="zarr") as tree:
        values = tree["reconstruction"].ds.steady_roll.values
    np.testing.assert_array_equal(values, [2.0, np.nan, np.nan])


def test_a_changed_study_is_found_out(archive):
    create_study(archive, "validation")
    finish_study(archive, "validation", {})
    zarr.open_group(str(archive), mode="r+")["validation/pitch_rmse"].attrs["units"] = "radian"
    assert check_archive(archive) == ["validation/pitch_rmse: attribute units is 'radian', not 'degree'"]


def test_an_unknown_study_has_no_group(archive):
    with pytest.raises(KeyError, match="no group 'nothing'"):
        create_study(archive, "nothing")
