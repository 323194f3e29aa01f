"""Rounds over the dives: errors of a hull and of its sensors, estimated from a synthetic mission."""

from dataclasses import replace

import numpy as np
import pytest
from support.missions import changed_observations, program

import gliderhpc as gh
from gliderhpc.calibration.dives.rounds import (
    CalibrationRounds,
    SmoothedProfile,
    SmoothingJob,
    bounded_step,
    pooled_factor,
    smoothed_profile,
)
from gliderhpc.calibration.estimated_hulls import HullFromGlides
from gliderhpc.calibration.glides.score import Errors
from gliderhpc.calibration.settings import CalibrateSettings, RoundSettings
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.estimation.steady_segments import steady_segments
from gliderhpc.flight.glider import Glider
from gliderhpc.flight.hull_parameters import hull_parameters, moved_platform, with_values
from gliderhpc.flight.steady_glide import glides_stably
from gliderhpc.mission_hull.estimate import prior_predictive_test
from gliderhpc.mission_hull.gaussian_chain import Gaussian
from gliderhpc.observations import open_observations
from gliderhpc.platform import read_platform
from gliderhpc.simulator import Scenario, simulate_mission
from gliderhpc.simulator.scenario import load_scenario

pytestmark = pytest.mark.compiled

PETREL = read_platform("petrel-l")
TRUE = with_values(PETREL, {"buoyancy.neutral_volume": 730.0, "viscous.K_D0": 10.0})
SCENARIO = Scenario().replaced(
    {
        "profiles": 4,
        "depth": 60.0,
        "steering": {"interval": 240.0},
        "disturbances": {"impulse_interval": None},
        "sensors": {"pitch_offset": 0.5},
    }
)
ROUNDS = {"rounds": {"most": 2}}


@pytest.fixture(scope="module")
def records(tmp_path_factory):
    path = tmp_path_factory.mktemp("rounds") / "mission.nc"
    simulate_mission(TRUE, path, scenario=SCENARIO, seed=3)
    return path


def segments_in(records, hull, numbers):
    settings = CalibrateSettings()
    with open_observations(records) as observations:
        return steady_segments(observations, hull, numbers, settings, settings.steady)


@pytest.fixture(scope="module")
def found(records):
    return gh.calibrate(records, "petrel-l", hold_out=4, workers=0, **ROUNDS)


def test_hull_and_sensors_are_found_within_their_deviations(found):
    table = found.table
    errors = {
        "buoyancy.neutral_volume": 730.0, "viscous.K_D0": 10.0, "viscous.K_L": PETREL.viscous.K_L,
        "sensors.pitch_offset": 0.5, "position.battery": PETREL.position.battery,
    }  # fmt: skip
    for key, value in errors.items():
        # Within twice the 95 % interval, because of a few dives at a single pitch and of the linearisation.
        middle, half = 0.5 * (table.low[key] + table.high[key]), 0.5 * (table.high[key] - table.low[key])
        assert abs(value - middle) < 2.0 * half, key
    assert table.remaining["buoyancy.neutral_volume"] < 0.2
    assert table.remaining["sensors.heading_deviation.0"] > 0.5


def test_the_covariance_is_of_the_parameters_found(found):
    stated = found.platform.calibration
    assert stated.parameters == tuple(found.table.index)
    assert np.linalg.eigvalsh(stated.correlation_matrix).min() > -1e-4
    half = 0.5 * (found.table.high - found.table.low)["buoyancy.neutral_volume"] / 1.96
    assert stated.deviation[stated.parameters.index("buoyancy.neutral_volume")] == pytest.approx(half, rel=1e-4)


def test_the_hull_from_rounds_fits_held_out_dives_better_than_the_platform(found):
    scores = found.scores
    assert (
        scores.loc[("held out", "after"), "depth rate, cm/s"] < scores.loc[("held out", "before"), "depth rate, cm/s"]
    )
    assert [number for number, *_ in found.dives.rounds.held_out] == [4]


@pytest.mark.long
def test_a_held_out_dive_does_not_affect_the_hull(records, tmp_path):
    """The hull is identical bit for bit if the dive held out is much rougher: its noise is not that of the mission."""

    def roughen(content):
        held = content["profile"].values == 4
        rough = np.random.default_rng(0).normal(0.0, 2.0, held.sum())
        content["roll"].values[held] += rough
        return content

    changed = changed_observations(records, tmp_path / "rough.nc", roughen)
    first, second = (
        gh.calibrate(each, "petrel-l", hold_out=4, workers=0, rounds={"most": 2}) for each in (records, changed)
    )
    assert second.platform.model_copy(update={"source": first.platform.source}) == first.platform
    scores = [each.dives.rounds.held_out for each in (first, second)]
    assert scores[0] != scores[1]


def test_the_history_has_every_dive_and_parameter(found):
    history = found.history
    assert sorted(history.profile.unique()) == [1, 2, 3]
    assert len(history) == 3 * len(found.table)
    last = history[history.profile == 3].set_index("parameter")
    np.testing.assert_allclose(last.estimate, last.estimate_sequential)
    first = history[history.profile == 1].set_index("parameter")
    assert (first.estimate_sequential_std["viscous.K_D0"]) > first.estimate_std["viscous.K_D0"]


def test_a_parameter_that_is_held_keeps_its_value(records):
    held = gh.calibrate(
        records, "petrel-l", hold_out=4, workers=0, rounds={"most": 1},
        calibration={"hold": ["K_D0", "pitch_offset"]},
    )  # fmt: skip
    assert held.platform.viscous.K_D0 == PETREL.viscous.K_D0
    assert held.platform.sensors.pitch_offset == 0.0
    assert "viscous.K_D0" not in held.table.index


def test_without_rounds_the_steady_glides_alone_count(records):
    found = gh.calibrate(records, "petrel-l", hold_out=4, rounds={"most": 0})
    assert isinstance(found, HullFromGlides)
    assert "scatter" in found.table.columns
    with pytest.raises(gh.InputError, match="history"):
        assert len(found.history)


def test_rounds_that_find_no_better_hull_leave_the_steady_glides(records, monkeypatch):
    def fail(*_, **__):
        raise gh.CalibrationError("calibration: worse")

    monkeypatch.setattr("gliderhpc.calibration.workflow.calibrate_on_dives", fail)
    found = gh.calibrate(records, "petrel-l", hold_out=4, workers=0, **ROUNDS)
    assert isinstance(found, HullFromGlides)
    assert found.notes[-1].startswith("fit of the steady glides alone, since the dives did not give a better")
    assert found.platform.source.endswith("calibration: worse.")
    assert "calibration" not in found.platform.model_fields_set


def test_rounds_that_the_steady_glides_contradict_are_refused(records, monkeypatch):
    """The dives lead to too large a drag: still better than the platform, but worse than the fit of the trim."""
    run = CalibrationRounds.run

    def misled(self, start, *limits):
        found = run(self, start, *limits)
        return replace(found, platform=with_values(found.platform, {"viscous.K_D0": 13.0}))

    monkeypatch.setattr(CalibrationRounds, "run", misled)
    found = gh.calibrate(records, "petrel-l", hold_out=4, workers=0, rounds={"most": 1})
    assert isinstance(found, HullFromGlides)
    assert "larger error of depth rate than the fit of its trim alone on the profiles fitted" in found.notes[-1]


def test_the_command_writes_platform_and_history(records, tmp_path):
    command = ("calibrate", records, "--platform", "petrel-l", "--out", tmp_path / "hull.yaml", "--hold-out", "4",
               "--workers", "0", "--history", tmp_path / "hull.csv")  # fmt: skip
    refused = program(*command, "--set", "rounds.most=0")
    assert refused.status == 2
    assert "add --set rounds.most=8" in refused.err
    done = program(*command, "--set", "rounds.most=1")
    assert done.status == 0, done.err
    assert (tmp_path / "hull.csv").read_text().startswith("profile,time,parameter,unit,estimate,")
    assert "sensors.pitch_offset" in gh.load_platform(tmp_path / "hull.yaml").calibration.parameters
    assert "held-out dives" in done.out
    assert "\nwarning: the hull was still changing in the last round" in done.out


def test_hulls_with_fast_sensors_have_rounds_by_default():
    assert RoundSettings().largest_number(PETREL) == 8
    assert RoundSettings().largest_number(gh.load_platform("slocum")) == 0
    assert RoundSettings(most=2).largest_number(gh.load_platform("slocum")) == 2
    assert RoundSettings(most=0).largest_number(PETREL) == 0


def test_the_probability_of_the_errors_found_is_that_of_missions_drawn():
    """Errors of missions drawn from the prior have the stated distribution, directions without information none."""
    rng, information = np.random.default_rng(7), np.diag([40.0, 3.0, 0.5, 0.0])
    covariance = np.linalg.inv(information + np.eye(4))
    draws = rng.multivariate_normal(np.zeros(4), np.eye(4) - covariance, 4000)
    found = np.array([prior_predictive_test(Gaussian(mean, covariance)) for mean in draws])
    assert found[:, 0].mean() == pytest.approx(found[0, 1], rel=0.05)
    for level in (0.01, 0.1, 0.5):
        assert (found[:, 2] < level).mean() == pytest.approx(level, rel=0.2, abs=0.006)
    assert prior_predictive_test(Gaussian(np.zeros(4), np.eye(4))) == (0.0, 0.0, 1.0)


@pytest.mark.long
def test_a_hull_far_beyond_its_plausible_deviations_is_refused(records, monkeypatch):
    """The steady glides are used, with a warning that names the parameter."""
    found = gh.calibrate(records, "petrel-l", hold_out=4, workers=0, rounds={"most": 1}).dives.rounds
    eta = np.zeros(len(found.parameters))
    eta[2] = 8.0
    monkeypatch.setattr(CalibrationRounds, "run", lambda *_: replace(found, eta=eta, full_step=np.zeros_like(eta)))
    refused = gh.calibrate(records, "petrel-l", hold_out=4, workers=0, rounds={"most": 1})
    assert isinstance(refused, HullFromGlides)
    assert f"{found.parameters[2].key} by +8.0 of them; chi-square 64" in refused.failure


def test_a_long_step_is_shortened_as_a_whole():
    """It is two plausible deviations at most, with the same direction: the errors are correlated."""
    parameters = hull_parameters(PETREL)
    wanted = np.linspace(-4.0, 1.0, len(parameters))
    step = bounded_step(PETREL, parameters, np.zeros(len(parameters)), wanted)
    assert np.abs(step).max() <= 2.0
    np.testing.assert_allclose(step / np.linalg.norm(step), wanted / np.linalg.norm(wanted), rtol=1e-12)
    near = 0.1 * wanted
    np.testing.assert_array_equal(bounded_step(PETREL, parameters, np.zeros(len(parameters)), near), near)


@pytest.mark.long
def test_a_hull_that_is_wrong_in_everything_comes_nearer(tmp_path):
    """All errors, including those of the records, are drawn; the yaw impulses do not follow the prior."""
    path, parameters = tmp_path / "wrong.nc", hull_parameters(PETREL)
    simulate_mission(PETREL, path, scenario=load_scenario("impulses").replaced({"profiles": 5, "depth": 80.0}), seed=3)
    believed = moved_platform(PETREL, parameters, np.random.default_rng(6).standard_normal(len(parameters)))
    assert glides_stably(Glider(believed))
    rounds = gh.calibrate(path, believed, hold_out=5, workers=0, rounds={"most": 3}).dives.rounds
    assert rounds.skipped == ()
    error = rounds.errors.mean - [p.steps(believed, p.value(PETREL)) for p in rounds.parameters]
    before = np.array([p.steps(PETREL, p.value(believed)) for p in parameters])
    assert np.sqrt(np.mean(error**2)) < 0.75 * np.sqrt(np.mean(before**2))
    assert np.mean(np.abs(error) < 2.0 * rounds.errors.std) > 0.85


def test_rounds_that_end_early_state_their_last_move(records):
    """After one round from a hull in error, the uncertainty in the platform file includes the last move."""
    rounds = gh.calibrate(records, "petrel-l", hold_out=4, workers=0, rounds={"most": 1}).dives.rounds
    grown = rounds.errors.covariance - rounds.mission.overall.covariance
    np.testing.assert_allclose(grown, np.outer(rounds.full_step, rounds.full_step), atol=1e-12)
    assert np.abs(rounds.full_step).max() >= rounds.moves[-1] > 0.1
    found = [p.steps(rounds.base, p.value(rounds.platform)) for p in rounds.parameters]
    np.testing.assert_allclose(rounds.errors.mean, found, atol=1e-9)


def test_rounds_without_a_stable_glide_ahead_have_not_converged(records, monkeypatch):
    """They end at once, and the warning gives the distance to the best fit."""
    monkeypatch.setattr("gliderhpc.calibration.dives.rounds.bounded_step", lambda base, parameters, eta, target: eta)
    found = gh.calibrate(records, "petrel-l", hold_out=4, workers=0, rounds={"most": 3})
    assert found.dives.rounds.moves == (0.0,)
    (warning,) = [note for note in found.notes if "has no stable glide" in note]
    assert f"ended {np.abs(found.dives.rounds.full_step).max():.1f} plausible deviations" in warning


def test_a_hull_from_whole_dives_has_the_warnings_of_a_steady_fit(found):
    assert not [note for note in found.notes if "still in error" in note]
    wrong = replace(found.dives.fitted, errors_after=Errors(np.full(4, 0.2), np.full(4, 0.2)))
    corrupted = replace(found, dives=replace(found.dives, fitted=wrong))
    assert sum("still in error" in note for note in corrupted.notes) == 4


def test_both_hulls_are_judged_by_the_same_segments(records, found):
    segments = [
        segments_in(records, hull, found.dives.fitted.profiles)
        for hull in (gh.load_platform("petrel-l"), found.platform)
    ]
    shared = segments[0].shared_with(segments[1], 30.0)
    assert 0 < len(shared) <= min(map(len, segments))
    assert found.dives.fitted.segments == len(segments[1].shared_with(segments[0], 30.0))
    late = replace(segments[0], time=segments[0].time + np.timedelta64(31, "s"))
    assert len(late.shared_with(late, 30.0)) == len(late)
    assert len(segments[0].select(np.arange(len(segments[0])) == 0).shared_with(late, 30.0)) == 0


def test_starting_from_a_calibrated_hull_is_mentioned_in_notes_and_source(records, found):
    again = gh.calibrate(records, found.platform, hold_out=4, workers=0, rounds={"most": 1})
    assert not any("calibrated before" in note for note in found.notes)
    assert any("has been calibrated before: its stated errors are not used" in note for note in again.notes)
    assert "has been calibrated before" in again.platform.source


def test_errors_that_all_dives_share_limit_what_they_say(records, found):
    """``1 + misfit n`` divides the information of three dives; without it, the deviations are too small."""
    assert found.dives.rounds.divisor == pytest.approx(1.0 + 1.0 * 3)
    believed = gh.calibrate(records, "petrel-l", hold_out=4, workers=0, rounds={"most": 2, "misfit": 0.0})
    assert believed.dives.rounds.divisor == 1.0
    std, wider = (each.dives.rounds.mission.overall.std for each in (believed, found))
    assert np.median(wider / std) > 1.1


def test_the_side_force_of_a_dive_in_gusts_does_not_count(rough, brief):
    """It has another prior there, to which the mission's factor does not apply."""
    for path, gusty in ((rough, True), (brief, False)):
        with open_observations(path) as opened:
            job = SmoothingJob(opened.path, opened.survey, PETREL, 1, (), EstimationSettings(), np.ones(6))
            found = smoothed_profile(job)
        assert ((found.noise > 0.0).all(axis=0) == [True, not gusty, True, True, True, True]).all()


def test_the_noise_follows_all_dives_together():
    """One channel is quieter and one louder than the prior; a dive without an estimate is not used."""
    spent, resolved = np.full(6, 50.0), np.full(6, 50.0)
    spent[0], spent[5] = 5.0, 500.0
    dives = [SmoothedProfile(i, np.datetime64("2024-01-01"), noise=np.array([spent, resolved])) for i in (1, 2)]
    dives.append(SmoothedProfile(3, np.datetime64("NaT", "ns"), message="no attitude"))
    np.testing.assert_allclose(pooled_factor(dives), [11 / 101, 1.0, 1.0, 1.0, 1.0, 1001 / 101])


def test_the_steady_glide_fit_is_returned_if_no_dive_can_be_smoothed(records, monkeypatch):
    def fail(job):
        return SmoothedProfile(job.number, np.datetime64("NaT", "ns"), message="no attitude")

    monkeypatch.setattr("gliderhpc.calibration.dives.rounds.smoothed_profile", fail)
    found = gh.calibrate(records, "petrel-l", hold_out=4, workers=0, **ROUNDS)
    assert isinstance(found, HullFromGlides)
    assert "no dive could be smoothed, the first because no attitude" in found.notes[-1]


def test_settings_of_the_rounds_have_bounds():
    with pytest.raises(ValueError, match="step"):
        CalibrateSettings(rounds={"step": 0.5})
