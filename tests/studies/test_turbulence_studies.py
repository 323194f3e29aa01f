"""Studies spectra, intermittency, nulls and events over an archive, and the simulations of the nulls."""

import csv
import json
import shutil

import numpy as np
import pytest
import xarray as xr
import zarr
from support.archives import put_profile, put_table_rows, put_whole
from support.missions import program
from support.shown import check_figure_follows, check_shown_as_left, shown, shown_after

from gliderhpc.archive.mission import open_mission
from gliderhpc.archive.profile import read_profile_data
from gliderhpc.errors import ProfileError
from gliderhpc.estimation.preparation import model_controls
from gliderhpc.findings.results import write_csv
from gliderhpc.flight.glider import Glider
from gliderhpc.mission.executors import local_executor
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.platform import read_platform
from gliderhpc.simulator.replay import record_of, replay
from gliderhpc.store_schema import check_archive, create_study, write_whole
from gliderhpc.studies.events import EventSettings
from gliderhpc.studies.library.turbulence.ensembles import null_floor
from gliderhpc.studies.library.turbulence.series import IntermittencySettings, bridge_gaps, channel_of, high_passed
from gliderhpc.studies.nulls import (
    NullSettings,
    Realisation,
    actuation_of,
    coefficient_names,
    fly_null,
    gaussian_disturbances,
    realisations,
)
from gliderhpc.studies.registry import missing_input
from gliderhpc.studies.request import Request
from gliderhpc.vocabulary import CHANNELS

PETREL = read_platform("petrel-l")
FEW = ("--set", "intermittency.surrogates=5", "--set", "intermittency.block_draws=50")
FAST = ("spectra", "intermittency", "nulls", "events")
"""Studies of the fast band."""

ONE_EACH = ("--set", "nulls.noise_only=1", "--set", "nulls.model_error=1", "--set", "nulls.gaussian=1")


@pytest.fixture(scope="session")
def own_copy(recommended, tmp_path_factory):
    """Copy of the twin mission's archive for these studies."""
    store = tmp_path_factory.mktemp("turbulence") / "twin.zarr"
    shutil.copytree(recommended, store)
    return store


@pytest.fixture(scope="session")
def studied(own_copy):
    """Archive after all four studies of two profiles, and the program's output each time."""
    common = ("--workers", 0, "--profiles", "1:2")
    return own_copy, {
        "spectra": program("analyze", own_copy, "spectra", *common, "--set", "spectra.draws=20"),
        "intermittency": program("analyze", own_copy, "intermittency", *common, *FEW),
        "nulls": program("analyze", own_copy, "nulls", *common, *ONE_EACH),
        "events": program("analyze", own_copy, "events", *common),
    }


@pytest.fixture(scope="module")
def profile(own_copy):
    """One profile of the archive."""
    with open_mission(own_copy) as archive:
        return read_profile_data(archive, 1)


def rows_of(archive, study, table, suffix=""):
    """Rows of a CSV file that a study left."""
    path = archive.with_name(f"{archive.stem}-studies") / f"{study}{suffix}" / f"{table}.csv"
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


@pytest.mark.compiled
def test_the_turbulence_studies_finish_and_the_archive_conforms_to_its_schema(studied):
    archive, answers = studied
    for name, answer in answers.items():
        assert answer.status == 0, f"{name}: {answer.err}"
    assert check_archive(archive) == []
    with xr.open_datatree(archive, engine="zarr") as tree:
        assert np.isfinite(tree["spectra"].ds["whole_beta"].sel(profile=[1, 2])).all()
        assert np.isnan(tree["spectra"].ds["whole_beta"].sel(profile=3))
        assert tree["intermittency"].ds["flatness"].sel(profile=1) > 3.0


@pytest.mark.compiled
def test_spectra_give_the_resolved_part_and_the_actuated_samples(studied):
    archive, answers = studied
    assert "the records resolve its part from 0.15 to 0.5 Hz" in " ".join(answers["spectra"].out.split())
    row = rows_of(archive, "spectra", "profiles")[0]
    assert float(row["nyquist"]) == pytest.approx(0.5)
    assert float(row["whole_beta_low"]) < float(row["whole_beta"]) < float(row["whole_beta_high"])
    for name in ("whole_beta_resolved", "shallow_beta", "deep_beta", "beta_all", "beta_resolved_all"):
        assert np.isfinite(float(row[name])), name
    text = (archive.with_name("twin-studies") / "spectra" / "table_1.md").read_text("utf-8")
    assert text.count("| shallow |") == 2


@pytest.mark.compiled
def test_intermittency_has_surrogates_and_says_what_is_not_tested(studied):
    archive, answers = studied
    assert "run the study nulls" in answers["intermittency"].out
    assert "amplitudes above the null ceiling not tested" in " ".join(answers["intermittency"].out.split())
    row = rows_of(archive, "intermittency", "profiles")[0]
    assert float(row["surrogate_flatness_least"]) <= float(row["surrogate_flatness_most"])
    assert float(row["p_value"]) >= 1.0 / 6.0 - 1e-9
    assert float(row["surrogate_deviation_most"]) >= float(row["surrogate_deviation"])
    assert float(row["peak_all"]) >= 0.9 * float(row["peak"])
    assert len(rows_of(archive, "intermittency", "ranges")) == 2 * 5
    moments = rows_of(archive, "intermittency", "gaussianity")
    assert [(one["profile"], one["channel"]) for one in moments] == [(p, c) for p in ("1", "2") for c in CHANNELS]
    assert 0.0 <= float(row["repeated_roll"]) <= 1.0
    verdict = (archive.with_name("twin-studies") / "intermittency" / "verdict.md").read_text("utf-8")
    assert ("in which this can be tested" in verdict) == np.isfinite(float(row["gaussianity_score"] or "nan"))
    with xr.open_datatree(archive, engine="zarr") as tree:
        group = tree["intermittency"].ds.sel(profile=1)
        assert np.isnan(group["flatness_by_lag"].values[group["lag_time"].values < 1.0]).all()
        assert group["zeta"].values[2] == pytest.approx(1.0)
        assert (group["zeta_low"] <= group["zeta"] + 1e-9).all()
        assert np.isfinite(group["noise_variance"].values).all()
        own = group["noise_kurtosis"].sel(channel="B_cp")
        np.testing.assert_allclose(own, float(moments[3]["noise_kurtosis"]), rtol=1e-6)


@pytest.fixture(scope="module")
def slow(brief_store, tmp_path_factory):
    """Archive of records sampled every 20 s."""
    archive = shutil.copytree(brief_store, tmp_path_factory.mktemp("slow") / "slow.zarr")
    with open_mission(archive) as opened:
        sampled = opened["observed"]["sampled"].load().values
    for index, row in enumerate(sampled):
        every = np.where(np.arange(len(row)) % 20 == 0, np.nan_to_num(row), 0).astype(np.int8)
        put_profile(archive, index, "observed", {"sampled": every})
    return archive


@pytest.mark.compiled
@pytest.mark.parametrize("study", FAST)
def test_a_record_too_slow_for_the_band_is_refused_before_anything_is_done(slow, study):
    answer = program("analyze", slow, study, "--workers", 0)
    assert answer.status == 2
    assert answer.line.startswith(f"gliderhpc: {study}: samples 20 s apart resolve nothing above 0.025 Hz")
    assert "needs samples less than 3.3 s apart" in answer.line
    with open_mission(slow) as opened:
        assert study not in opened.children


@pytest.mark.long
@pytest.mark.compiled
@pytest.mark.usefixtures("undrawn_studies")
def test_with_all_studies_a_slow_record_skips_those_of_the_band(slow, tmp_path):
    answer = program("analyze", slow, "all", "--workers", 0, "--profiles", "1", "--out", tmp_path)
    assert answer.status == 0, answer.err
    for study in FAST:
        lines = [line for line in answer.err.splitlines() if line.startswith(f"{study} left out: ")]
        assert len(lines) == 1, study
        assert "samples 20 s apart" in lines[0]
        assert not (tmp_path / study).exists()
    assert (tmp_path / "reconstruction").is_dir()
    assert (tmp_path / "currents").is_dir()


def test_a_slower_band_can_be_asked_for(slow):
    request = Request(slow, lambda: local_executor(0), assignments=("spectra.band=[0.005,0.02]",))
    assert missing_input("spectra", request) is None
    assert "samples 20 s apart" in missing_input("events", request)


def nulls_of(peak, estimate="adjoint"):
    """Archive that holds nulls with such largest magnitudes."""
    family = ["noise_only"] * len(peak)
    group = xr.Dataset(
        {name: ("null", np.array(values)) for name, values in {
            "family": family, "peak": peak, "rms": 0.3 * np.array(peak), "message": [""] * len(peak),
        }.items()},
        attrs={"complete": True, "estimate": estimate,
               "settings": {"statistics": IntermittencySettings().model_dump(mode="json")}},
    )  # fmt: skip
    return xr.DataTree.from_dict({"nulls": group})


def test_events_ask_for_nulls_only_where_there_are_none():
    floor, remarks = null_floor(nulls_of([0.4] * 9 + [0.5]), "adjoint", EventSettings())
    assert (floor.ceiling, remarks) == (0.5, ())
    floor, (remark,) = null_floor(nulls_of([np.nan, np.nan]), "adjoint", EventSettings())
    assert floor is None
    assert "none of the archive's nulls has statistics" in remark
    assert "run the study" not in remark
    for archive in (nulls_of([0.4], "smoothed"), xr.DataTree()):
        floor, (remark,) = null_floor(archive, "adjoint", EventSettings())
        assert floor is None
        assert "run the study nulls" in remark


def test_events_are_not_judged_by_the_ceiling_of_few_nulls():
    """As after ``nulls --quick``: two nulls each of sensor noise and of wrong coefficients."""
    floor, (remark,) = null_floor(nulls_of([0.4] * 3 + [0.5]), "adjoint", EventSettings())
    assert (floor.ceiling, floor.nulls, floor.decides) == (0.5, 4, False)
    assert "the events cannot be judged: the ceiling is that of 4 nulls" in remark
    assert "without `quick`" in remark


@pytest.mark.compiled
def test_nulls_are_stored_with_their_draws(studied):
    archive, answers = studied
    assert "verdict over 2 profiles" in answers["nulls"].out
    with xr.open_datatree(archive, engine="zarr") as tree:
        nulls = tree["nulls"].ds.load()
    assert nulls["family"].values.tolist() == ["noise_only", "model_error", "gaussian"]
    drawn = nulls["factor"].values[1]
    known = np.isfinite(drawn)
    assert known.sum() >= 15
    assert (np.abs(drawn[known] - 1.0) <= 0.15).all()
    assert np.ptp(drawn[known]) > 0.1
    np.testing.assert_allclose(nulls["factor"].values[[0, 2]][:, known], 1.0, rtol=1e-12)
    assert np.isfinite(nulls["peak"]).all()
    assert np.isnan(nulls["gaussianity_p_value"].values[0])
    assert nulls["peak"].values[0] < nulls["peak"].values[2]
    assert len(set(nulls["realisation_seed"].values.tolist())) == 3
    content = json.loads((archive.with_name("twin-studies") / "nulls" / "nulls.json").read_text("utf-8"))
    assert content["facts"]["ceiling"] == pytest.approx(nulls["peak"].values[:2].max())
    # The statistics were those of the measured profiles, so that they can go in one table.
    assert content["facts"]["settings"]["statistics"]["surrogates"] == 5


@pytest.mark.compiled
def test_events_stand_above_the_ceiling_with_time_and_place(studied):
    archive, answers = studied
    assert "noise floor" not in answers["events"].out
    with xr.open_datatree(archive, engine="zarr") as tree:
        events, root = tree["events"].ds.load(), tree.to_dataset().load()
        ceiling = float(tree["nulls"].ds["peak"][:2].max())
    magnitude = np.abs(events["amplitude"].values)
    assert len(magnitude) > 5
    assert (np.diff(magnitude) <= 0.0).all()
    assert (magnitude >= ceiling - 1e-9).all()
    np.testing.assert_allclose(events["over_ceiling"], magnitude / ceiling)
    assert set(events["source_profile"].values.tolist()) == {1.0, 2.0}
    first = events.isel(event=0)
    number = int(first["source_profile"])
    start = root["start_time"].sel(profile=number).values
    assert start < first["time"].values < start + np.timedelta64(2, "h")
    assert float(first["latitude"]) == pytest.approx(float(root["entry_latitude"].sel(profile=number)), abs=0.05)
    assert 0.0 < float(first["depth"]) < 210.0
    assert (events["quality"].values & 17 == 0).all()
    assert len(rows_of(archive, "events", "events")) == len(magnitude)
    assert len(rows_of(archive, "events", "strongest")) == min(12, len(magnitude))


def left_by(archive, name):
    return archive.with_name(f"{archive.stem}-studies") / name


@pytest.mark.compiled
def test_spectra_are_shown_from_the_archive_alone(studied, tmp_path):
    archive, _ = studied
    before = check_shown_as_left(archive, "spectra", left_by(archive, "spectra"), tmp_path / "out")

    def change(copy):
        put_table_rows(copy, {0: {"whole_beta": 9.0}}, "spectra")
        with open_mission(copy) as opened:
            density = opened["spectra"].to_dataset()["density"].values[0]
        put_profile(copy, 0, "spectra", {"density": density * np.linspace(1.0, 2.0, len(density))})

    after = shown_after(archive, "spectra", tmp_path, change)
    assert [row["whole_beta"] == 9.0 for row in after.tables["profiles"]] == [True, False]
    assert "| 9.00 |" in after.documents["table_1.md"]
    check_figure_follows(before, after, "figure_4")


@pytest.mark.compiled
def test_intermittency_is_shown_with_the_nulls_that_the_archive_has_since(studied, tmp_path):
    archive, _ = studied
    before = shown(archive, "intermittency")
    for table in ("profiles", "ranges"):
        written = write_csv(tmp_path / f"{table}.csv", before.tables[table])
        assert written.read_bytes() == (left_by(archive, "intermittency") / f"{table}.csv").read_bytes()
    assert [row["ensemble"] for row in before.tables["table_3"]][3:] == ["noise_only", "model_error", "gaussian"]

    def change(copy):
        put_table_rows(copy, {0: {"kurtosis": 77.0, "range_zeta_ratio": np.full(5, 1.5)}}, "intermittency")
        put_profile(copy, 0, "intermittency", {"flatness_by_lag": np.full(3, 50.0)})

    after = shown_after(archive, "intermittency", tmp_path, change)
    assert after.tables["profiles"][0]["kurtosis"] == 77.0
    assert [row["zeta_ratio"] == 1.5 for row in after.tables["ranges"]] == [True] * 5 + [False] * 5
    assert after.tables["table_3"][0]["kurtosis_most"] == max(77.0, before.tables["profiles"][1]["kurtosis"])
    check_figure_follows(before, after, "figure_6")


@pytest.mark.compiled
def test_nulls_and_events_are_shown_from_the_archive_alone(studied, tmp_path):
    archive, _ = studied
    nulls, events = (
        check_shown_as_left(archive, name, left_by(archive, name), tmp_path / name) for name in ("nulls", "events")
    )

    def change(copy):
        with open_mission(copy) as opened:
            peak = opened["nulls"].to_dataset()["peak"].values
            amplitude = opened["events"].to_dataset()["amplitude"].values
        put_whole(copy, "nulls", {"peak": 3.0 * peak})
        put_whole(copy, "events", {"amplitude": 2.0 * amplitude})

    after = shown_after(archive, "nulls", tmp_path, change)
    assert after.content["facts"]["ceiling"] == pytest.approx(3.0 * nulls.content["facts"]["ceiling"])
    check_figure_follows(nulls, after, "nulls")
    after = shown(tmp_path / f"changed-{archive.name}", "events")
    assert after.tables["strongest"][0]["amplitude"] == 2.0 * events.tables["strongest"][0]["amplitude"]
    # What ranked them is the ceiling of then, whatever the nulls are now.
    assert after.comparisons["events"][0] == events.comparisons["events"][0]
    check_figure_follows(events, after, "events")


@pytest.mark.long
@pytest.mark.compiled
@pytest.mark.usefixtures("undrawn_studies")
def test_the_smoothers_estimate_is_studied_on_its_records(studied, tmp_path):
    store = tmp_path / "twin.zarr"
    shutil.copytree(studied[0], store)
    common = ("--workers", 0, "--profiles", "1", "--estimate", "smoothed")
    spectra = program("analyze", store, "spectra", *common, "--set", "spectra.draws=5")
    assert spectra.status == 0, spectra.err
    assert "no exponent is given on the whole band" in " ".join(spectra.out.split())
    row = rows_of(store, "spectra", "profiles", "-smoothed")[0]
    assert row["whole_beta"] == ""
    assert np.isfinite(float(row["whole_beta_resolved"]))
    increments = program("analyze", store, "intermittency", *common, *FEW)
    assert increments.status == 0, increments.err
    assert "nulls are of the adjoint estimate" in " ".join(increments.out.split())
    nulls = program("analyze", store, "nulls", *common, "--set", "nulls.noise_only=1", "--set", "nulls.model_error=0",
                    "--set", "nulls.gaussian=0")  # fmt: skip
    assert nulls.status == 0, nulls.err
    events = program("analyze", store, "events", *common)
    assert events.status == 0, events.err
    with xr.open_datatree(store, engine="zarr") as tree:
        assert tree["nulls"].attrs["estimate"] == "smoothed"
        assert np.isfinite(tree["nulls"].ds["peak"]).all()
    assert check_archive(store) == []


@pytest.mark.compiled
def test_slow_records_give_reasons_and_no_numbers(recommended, tmp_path):
    store = tmp_path / "slow.zarr"
    shutil.copytree(recommended, store)
    sampled = zarr.open_group(str(store), mode="r+")["observed/sampled"]
    content = np.asarray(sampled[:])
    content[:, np.arange(content.shape[1]) % 20 != 0] = 0
    for index, row in enumerate(content):
        put_profile(store, index, "observed", {"sampled": row})
    for study in ("spectra", "intermittency", "events"):
        answer = program("analyze", store, study, "--workers", 0, "--profiles", "1")
        assert answer.status == 2
        assert "samples 20 s apart resolve nothing above 0.025 Hz" in answer.line
        assert not (tmp_path / "slow-studies" / study).exists()
        with xr.open_datatree(store, engine="zarr") as tree:
            assert study not in tree.children


@pytest.mark.compiled
def test_without_nulls_events_are_ranked_by_the_noise_floor(recommended, tmp_path):
    store = tmp_path / "twin.zarr"
    shutil.copytree(recommended, store)
    answer = program("analyze", store, "events", "--workers", 0, "--profiles", "1", "--set", "events.sigma=20")
    assert answer.status == 0, answer.err
    assert "own noise floor" in answer.out
    events = rows_of(store, "events", "events")
    assert events
    assert all(float(row["sigma"]) >= 20.0 for row in events)
    nothing = program("analyze", store, "events", "--workers", 0, "--profiles", "1", "--set", "events.threshold=1e6")
    assert nothing.status == 0, nothing.err
    assert check_archive(store) == []


def test_settings_that_make_no_sense_are_refused(own_copy):
    for assignment, fragment in (
        ("spectra.band=[0.8, 0.1]", "lower one first"),
        ("intermittency.scaling=[0, 5]", "lower one first"),
        ("nulls.statistics.bands=[1, 2]", "no such setting"),
        ("spectra.channel=B_cx", "channel"),
    ):
        study = assignment.partition(".")[0]
        answer = program("analyze", own_copy, study, "--workers", 0, "--set", assignment)
        assert answer.status == 2
        assert fragment in answer.err
    none = program("analyze", own_copy, "nulls", "--workers", 0, "--profiles", "1", "--set", "nulls.noise_only=0",
                   "--set", "nulls.model_error=0", "--set", "nulls.gaussian=0")  # fmt: skip
    assert none.status == 2
    assert "no realisation" in none.err


def test_every_kind_of_null_takes_the_profiles_in_turn():
    planned = realisations(NullSettings(noise_only=3, model_error=2, gaussian=0), (5, 7))
    assert [(one.family, one.profile) for one in planned] == [
        ("noise_only", 5), ("noise_only", 7), ("noise_only", 5), ("model_error", 5), ("model_error", 7),
    ]  # fmt: skip
    assert len({one.seed for one in planned}) == 5
    spread = realisations(NullSettings(noise_only=2, model_error=0, gaussian=0), (1, 2, 3, 4))
    assert [one.profile for one in spread] == [1, 3]


@pytest.mark.compiled
def test_a_replay_is_the_models_own_flight_and_is_read_when_the_sensors_were(profile):
    actuation = actuation_of(profile, PETREL)
    bodies = Glider(PETREL).bodies(model_controls(PETREL, actuation.at(actuation.times)))
    flight = replay(PETREL, actuation, bodies, np.zeros((len(bodies), 6)))
    assert flight.step == pytest.approx(0.05)
    # The estimator's own scheme, at twice the step, over five minutes.
    n = 3000
    coarse = Glider(PETREL).simulate(
        actuation.state, model_controls(PETREL, actuation.at(0.1 * (np.arange(n) + 0.5))), np.zeros((n, 6)), 0.1
    )
    np.testing.assert_allclose(flight.states[2 * n, [0, 1, 5]], coarse[n, [0, 1, 5]], atol=2e-3)
    record = record_of(flight, actuation, PETREL, np.random.default_rng(0))
    sampled = actuation.sampled[: len(flight.commands)]
    assert len(record.time) == np.count_nonzero(sampled)
    true = np.interp(record.time, 0.05 * np.arange(len(flight.states)), flight.states[:, 5])
    assert np.std(record.depth - true) == pytest.approx(PETREL.sensors.depth_noise, rel=0.1)
    assert flight.states[:, 5].min() > -0.6
    with pytest.raises(ProfileError, match="leaves the model's domain"):
        replay(PETREL, actuation, bodies, np.full((len(bodies), 6), 1e200))


@pytest.mark.compiled
def test_gaussian_disturbances_have_the_measured_spectra_and_other_phases(profile):
    series = {name: channel_of(profile, name, PETREL) for name in CHANNELS}
    times = series["B_cr"].time
    drawn = gaussian_disturbances(profile, PETREL, NullSettings(), times, np.random.default_rng(1))
    fast = {
        name: high_passed(bridge_gaps(one.values, one.counted(actuated=False)), one.step)
        for name, one in series.items()
    }
    for column, name in enumerate(CHANNELS):
        if name not in ("B_cv", "B_cp", "B_cr"):
            np.testing.assert_array_equal(drawn[:, column], 0.0)
            continue
        # Gaussian disturbances have no gaps; the measured ones are bridged there.
        drawn[:, column] *= np.sqrt(series[name].counted(actuated=False).mean())
        of_both = [np.abs(np.fft.rfft(one))[1:-1] for one in (drawn[:, column], fast[name])]
        np.testing.assert_allclose(*of_both, rtol=1e-6, atol=1e-6)
        assert abs(np.corrcoef(drawn[:, column], fast[name])[0, 1]) < 0.2
    # The same phases in all channels leave what is common to them.
    np.testing.assert_allclose(
        np.mean(drawn[:, 1] * drawn[:, 5]), np.mean(fast["B_cv"] * fast["B_cr"]), rtol=1e-3, atol=1e-9
    )
    kurtosis = [np.mean(one**4) / np.mean(one**2) ** 2 for one in (drawn[:, 5], fast["B_cr"])]
    assert kurtosis[0] < 4.0 < kurtosis[1]


@pytest.mark.compiled
def test_a_null_follows_from_its_seed(own_copy):
    with open_mission(own_copy) as archive:
        flown = [
            fly_null(
                archive, Realisation(0, "model_error", seed, 1), PETREL, MissionSettings(), NullSettings(), "adjoint"
            )
            for seed in (3, 3, 4)
        ]
    same, again, other = (task.series.measurements for task, _, _ in flown)
    factors = [drawn for _, _, drawn in flown]
    np.testing.assert_array_equal(same, again)
    assert not np.array_equal(same[: len(other)], other[: len(same)])
    assert len(coefficient_names(PETREL)) == len(factors[0])
    assert not np.array_equal(factors[0], factors[2])


@pytest.mark.damages_archive
def test_variables_without_a_profile_dimension_are_written_in_one_piece(own_copy, tmp_path):
    store = tmp_path / "twin.zarr"
    shutil.copytree(own_copy, store)
    create_study(store, "nulls", {"null": 2}, labels={"coefficient": ["K_D", "K_L"]})
    write_whole(store, "nulls", {"family": ["noise_only", "gaussian"], "peak": [0.1, 0.2], "zeta_ratio": []})
    with xr.open_datatree(store, engine="zarr") as tree:
        assert tree["nulls"].ds["family"].values.tolist() == ["noise_only", "gaussian"]
        assert np.isnan(tree["nulls"].ds["zeta_ratio"]).all()
    with pytest.raises(ValueError, match="do not fit"):
        write_whole(store, "nulls", {"peak": [1.0]})
    with pytest.raises(KeyError):
        write_whole(store, "nulls", {"height": [1.0, 2.0]})
    with pytest.raises(ValueError, match="belongs to profiles"):
        write_whole(store, "events", {"noise": [1.0]})
