"""Forward model compared with the records: results on known flights, and the command from file to archive."""

import json
import shutil

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from support.archives import put_table_rows
from support.missions import changed_observations, glide_series, program, replaced
from support.shown import check_figure_follows, check_shown_as_left, shown_after

from gliderhpc.estimation.preparation import vibration_set
from gliderhpc.estimation.self_motion import SelfMotion
from gliderhpc.flight.glider import Glider, load_platform
from gliderhpc.flight.steady_glide import glide_table
from gliderhpc.observations import ProfileRecord
from gliderhpc.platform import with_overrides
from gliderhpc.store_schema import check_archive
from gliderhpc.studies.validation import compared_samples, horizontal_errors, run_forward, vertical_errors

SECONDS = 300.0
PLATFORM = load_platform("petrel-l")


def steady_dive(step=0.1, until=SECONDS):
    """Record of an undisturbed steady dive of petrel-l at 22 degrees and 0.35 kg."""
    (glide,) = [g for g in glide_table(Glider(PLATFORM), (0.35,), (np.radians(22.0),), 0.0) if g.net_mass > 0.0]
    n = round(until / step)
    volume = PLATFORM.buoyancy.neutral_volume_m3 - glide.net_mass / PLATFORM.buoyancy.water_density
    controls = np.tile([glide.battery_position, 0.0, volume, 0.0], (n, 1))
    alpha = glide.angle_of_attack
    state = np.zeros(12)
    state[[1, 2, 5, 6, 8]] = glide.pitch, 1.0, 1.0, glide.speed * np.cos(alpha), glide.speed * np.sin(alpha)
    return glide_series(PLATFORM, state, controls, step)


@pytest.fixture(scope="module")
def dive():
    return steady_dive()


def nothing_vibrating(series):
    return np.zeros(len(series.time), dtype=bool)


@pytest.mark.compiled
def test_an_undisturbed_dive_is_flown_as_recorded(dive):
    series, states = dive
    flight = run_forward(Glider(PLATFORM), series)
    assert flight.surfaced == len(series.time)
    errors = vertical_errors(flight, series, compared_samples(flight, series, nothing_vibrating(series)))
    assert errors["pitch_rmse"] < 0.1
    assert errors["heading_rmse"] < 0.1
    assert errors["longitudinal_rmse"] < 0.005
    assert errors["depth_rmse"] < 0.5
    np.testing.assert_allclose(flight.states[-1, 3:5], states[-1, 3:5], atol=2.0)


@pytest.mark.compiled
def test_drag_that_the_model_does_not_know_shows_in_the_longitudinal_rmse(dive):
    series, _ = dive
    found = []
    for drag in ("8.86", "10.6", "13.3"):
        flight = run_forward(Glider(with_overrides(PLATFORM, {"viscous.K_D0": drag})), series)
        counted = compared_samples(flight, series, nothing_vibrating(series))
        found.append(vertical_errors(flight, series, counted)["longitudinal_rmse"])
    assert found[0] < 0.02 < found[1] < found[2]


@pytest.mark.compiled
def test_vertical_errors_follow_the_documented_formula(dive):
    series, _ = dive
    flight = run_forward(Glider(PLATFORM), series)
    counted = compared_samples(flight, series, nothing_vibrating(series))
    tilted = series.measurements * [1.0, 1.1, 1.0, 1.2]
    errors = vertical_errors(flight, replaced(series, measurements=tilted), counted)
    assert errors["longitudinal_rmse"] == pytest.approx(np.sqrt(0.5 * ((0.1 / 1.1) ** 2 + (0.2 / 1.2) ** 2)), rel=0.05)
    turned = replaced(series, measurements=series.measurements + np.array([0.0, 0.0, 2.0 * np.pi - 0.01, 0.0]))
    assert vertical_errors(flight, turned, counted)["heading_rmse"] == pytest.approx(np.degrees(0.01), rel=0.05)


@pytest.mark.compiled
def test_a_model_that_comes_up_early_waits_at_the_surface(dive):
    series, _ = dive
    light = replaced(series, controls=series.controls + np.array([-2.0 * series.controls[0, 0], 0.0, 7e-4, 0.0]))
    flight = run_forward(Glider(PLATFORM), light)
    assert 0 < flight.surfaced < len(series.time)
    assert (flight.states[flight.surfaced :] == flight.states[-1]).all()
    assert not compared_samples(flight, light, nothing_vibrating(light))[flight.surfaced :].any()


@pytest.mark.compiled
def test_only_steady_glide_is_compared(dive):
    series, _ = dive
    flight = run_forward(Glider(PLATFORM), series)
    gap = series.weights.copy()
    gap[2000:2100] = 0.0
    moved = series.controls.copy()
    moved[1500:1600, 0] += np.linspace(0.0, 0.01, 100)
    changed = replaced(series, weights=gap, controls=moved)
    counted = compared_samples(flight, changed, vibration_set(PLATFORM, changed))
    assert not counted[:600].any()
    assert not counted[1460:1640].any()
    assert not counted[2000:2100].any()
    assert counted[700:1400].all()


@pytest.mark.compiled
def test_horizontal_errors(dive):
    series, _ = dive
    flight = run_forward(Glider(PLATFORM), series)
    steps = np.diff(flight.states[:, 3:5], axis=0)
    nothing = np.zeros(0)
    record = ProfileRecord(1, series.epoch, *[nothing] * 9)
    same = horizontal_errors(flight, series, record, SelfMotion(steps, 0.0))
    assert same["horizontal_error"] < 1e-9
    assert same["path_length"] == pytest.approx(np.linalg.norm(steps, axis=1).sum())
    assert "surfacing_error" not in same
    twice = horizontal_errors(flight, series, record, SelfMotion(2.0 * steps, 0.0))
    assert twice["horizontal_error_rate"] == pytest.approx(0.5, rel=1e-3)
    assert same["horizontal_error_on_course"] < 1.0


@pytest.fixture(scope="module")
def validated(brief, brief_store, tmp_path_factory):
    """Copy of the brief mission's archive, output of the command, and folder of its files."""
    folder = tmp_path_factory.mktemp("validated")
    store = folder / "brief.zarr"
    shutil.copytree(brief_store, store)
    answer = program("validate", brief, "--platform", "petrel-l", "--store", store, "--workers", 0)
    return store, answer, folder / "brief-studies" / "validation"


@pytest.mark.compiled
def test_the_verb_leaves_group_files_and_table(validated):
    store, answer, files = validated
    assert answer.status == 0, answer.err
    assert check_archive(store) == []
    assert sorted(path.name for path in files.iterdir()) == ["figure_1.png", "profiles.csv", "validation.json"]
    assert "longitudinal RMSE" in answer.out
    assert "0.0480" in answer.out
    table = pd.read_csv(files / "profiles.csv")
    with xr.open_datatree(store, engine="zarr") as tree:
        group = tree["validation"]
        np.testing.assert_allclose(group.ds.pitch_rmse.values, table.pitch_rmse, rtol=1e-5)
        modelled, measured = group.ds.pitch.sel(profile=2), tree["observed"].ds.pitch.sel(profile=2)
        assert np.isfinite(modelled).sum() == np.isfinite(measured).sum()
        assert float(np.sqrt(((modelled - measured) ** 2).mean())) < 5.0
        assert group.attrs["platform"]["name"] == "petrel-l"
    content = json.loads((files / "validation.json").read_text())
    assert content["facts"]["trend"]["count"] == 3
    assert content["facts"]["medians"]["longitudinal_rmse"] < 0.2
    assert (files / "figure_1.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.compiled
def test_the_study_is_shown_from_the_archive_alone(validated, tmp_path):
    store, _, files = validated
    before = check_shown_as_left(store, "validation", files, tmp_path / "out")
    changed = {"longitudinal_rmse": 0.5}
    after = shown_after(
        store, "validation", tmp_path, lambda copy: put_table_rows(copy, {1: changed}, "validation")
    )  # fmt: skip
    assert [row["longitudinal_rmse"] == 0.5 for row in after.tables["profiles"]] == [False, True, False]
    check_figure_follows(before, after, "figure_1")


@pytest.mark.compiled
def test_without_steady_glide_the_panel_says_so(validated, tmp_path):
    rows = {index: {"longitudinal_rmse": np.nan} for index in range(3)}
    after = shown_after(
        validated[0], "validation", tmp_path, lambda copy: put_table_rows(copy, rows, "validation")
    )  # fmt: skip
    texts = [text.get_text() for axes in after.figures["figure_1"].axes for text in axes.texts]
    assert any(text.startswith("no steady glide") for text in texts), texts


@pytest.mark.compiled
def test_some_profiles_and_another_hull(validated, brief, tmp_path):
    store = tmp_path / "brief.zarr"
    shutil.copytree(validated[0], store)
    put_table_rows(store, {1: {"status": "failed"}})  # without an estimate it can be flown all the same
    answer = program(
        "validate", brief, "--platform", "petrel-l", "--store", store, "--workers", 0, "--profiles", "2", "--quick",
        "--set", "platform.viscous.K_D0=12", "--out", tmp_path / "out",
    )  # fmt: skip
    assert answer.status == 0, answer.err
    with xr.open_datatree(store, engine="zarr") as tree, xr.open_datatree(validated[0], engine="zarr") as before:
        values, nominal = (t["validation"].ds.longitudinal_rmse.values for t in (tree, before))
        assert [bool(t["validation"].attrs["quick"]) for t in (tree, before)] == [True, False]
    assert np.isnan(values[[0, 2]]).all()
    assert values[1] > 1.5 * nominal[1]
    assert (tmp_path / "out" / "validation.json").exists()


@pytest.mark.compiled
@pytest.mark.parametrize("failing", [[1, 2, 3], [1]])
def test_profiles_that_could_not_be_inverted_are_flown_and_drawn_without_records(failing, swift, tmp_path):
    """All of them, as with a hull that is another's, or the first."""
    store, records = tmp_path / "failed.zarr", tmp_path / "failed.nc"

    def corrupt(content: xr.Dataset) -> xr.Dataset:
        wrong = np.isin(content["profile"].values, failing) & (np.arange(content.sizes["time"]) % 3 == 0)
        return content.assign(pitch=content["pitch"] + 30.0 * wrong)

    changed_observations(swift, records, corrupt)
    inverted = program("run-mission", records, "--platform", "petrel-l", "--store", store, "--workers", 0)
    assert inverted.status == 1
    answer = program("validate", records, "--platform", "petrel-l", "--store", store, "--workers", 0)
    with xr.open_datatree(store, engine="zarr") as tree:
        assert (tree.ds["status"].values == "failed").tolist() == [number in failing for number in (1, 2, 3)]
        assert np.isfinite(tree["validation"].ds["pitch"]).any("record").all()
    assert answer.status == 0, answer.err
    assert (tmp_path / "failed-studies" / "validation" / "figure_1.png").is_file()


@pytest.mark.long
@pytest.mark.compiled
def test_workers_find_the_same(validated, brief, tmp_path):
    store = tmp_path / "brief.zarr"
    shutil.copytree(validated[0], store)
    answer = program("validate", brief, "--platform", "petrel-l", "--store", store, "--workers", 2)
    assert answer.status == 0, answer.err
    csv = "brief-studies/validation/profiles.csv"
    assert (tmp_path / csv).read_text() == (validated[0].parent / csv).read_text()


@pytest.mark.compiled
def test_records_hull_and_archive_that_do_not_match_are_refused(validated, brief, twin, tmp_path):
    store = validated[0]
    wrong = program("validate", twin, "--platform", "petrel-l", "--store", store)
    assert wrong.status == 2
    assert "was not made from" in wrong.line
    axis = program("validate", brief, "--platform", "petrel-l", "--store", store, "--set", "step=0.2")
    assert axis.status == 2
    assert "the archive's value is 0.1 s" in axis.line
    absent = program("validate", brief, "--platform", "petrel-l", "--store", tmp_path / "no.zarr")
    assert absent.status == 2
    assert "no such archive" in absent.line
