"""Tuning: maximisation of the likelihood, a prior recovered on a twin drawn from it, and the command."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
import xarray as xr
from scipy.stats import chi2
from support.missions import changed_observations, program, samples_of

from gliderhpc import load_platform
from gliderhpc.calibration.estimated_hulls import TunedHull
from gliderhpc.calibration.prior.fisher_scoring import Expansion, maximise
from gliderhpc.calibration.prior.fit import TuneSettings, TuningVerdict, tune_prior
from gliderhpc.calibration.prior.likelihood import PriorLikelihood, tuning_profiles
from gliderhpc.calibration.prior.text import provenance, warnings
from gliderhpc.estimation.priors import default_prior
from gliderhpc.observations import open_observations
from gliderhpc.outcomes import Outcome
from gliderhpc.platform import DisturbancePrior, platform_yaml, read_platform
from gliderhpc.simulator import read_scenario, simulate_mission
from gliderhpc.store_schema import DISTURBANCE_PRIOR

pytestmark = pytest.mark.compiled

PETREL = read_platform("petrel-l")

# The climb


@dataclass
class Counts:
    """Poisson counts whose rates are exponentials of the parameters."""

    counts: np.ndarray

    def values(self, points):
        return [float(np.sum(self.counts * point - np.exp(point))) for point in points]

    def expanded(self, point, free):
        return Expansion(
            self.values([point])[0], (self.counts - np.exp(point))[free], np.diag(np.exp(point))[np.ix_(free, free)]
        )


def climbed(start, free=(True, True, True), low=(-5.0,) * 3, high=(5.0,) * 3, **options):
    choices = {"tolerance": 1e-10, "max_rounds": 50} | options
    return maximise(
        Counts(np.array([2.0, 7.0, 40.0])), np.array(start), np.array(free), (np.array(low), np.array(high)), **choices
    )


def test_fisher_scoring_reaches_the_maximum():
    found = climbed([0.0, 4.0, 0.0])
    np.testing.assert_allclose(found.point, np.log([2.0, 7.0, 40.0]), atol=1e-4)
    assert found.settled


def test_fisher_scoring_respects_bounds_and_held_parameters():
    found = climbed([0.0, 1.0, 0.0], free=[True, False, True], high=[5.0, 5.0, 3.0])
    np.testing.assert_allclose(found.point, [np.log(2.0), 1.0, 3.0], atol=1e-4)
    assert found.settled


def test_fisher_scoring_is_not_settled_after_too_few_rounds():
    reported = []
    found = climbed([0.0, 4.0, -4.0], max_rounds=1, on_round=reported.append)
    assert not found.settled
    assert found.rounds == 1
    assert reported[1] > reported[0]
    assert found.expansion.value == reported[1]


# A prior found again

TRUE = DisturbancePrior(
    deviation=(0.2, 0.2, 0.2, 0.05, 0.05, 0.4), correlation_time=(900.0, 300.0, 900.0, 300.0, 600.0, 25.0)
)
SETTINGS = TuneSettings.model_validate({"tuning": {"least_noise": 0.0}})
SWAY, HEAVE, YAW, SWAY_TIME, YAW_TIME = 1, 2, 5, 7, 11


def numbers(prior):
    return np.array([*prior.deviation, *prior.correlation_time])


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    """Mission of two short dives whose disturbance is drawn from a known prior."""
    scenario = read_scenario(
        {
            "name": "drawn", "profiles": 2, "depth": 60.0, "sensors": {"attitude": "white"},
            "disturbances": {"slow_rms": [0.0] * 6, "impulse_interval": None, "gauss_markov": TRUE.model_dump()},
        }
    )  # fmt: skip
    return simulate_mission(PETREL, tmp_path_factory.mktemp("drawn") / "drawn.nc", scenario=scenario, seed=5).path


@pytest.fixture(scope="module")
def requests(drawn):
    with open_observations(drawn) as opened:
        return tuning_profiles(opened, PETREL, opened.profile_numbers, SETTINGS.tuning.longest, SETTINGS)


@pytest.fixture(scope="module")
def tuned(requests):
    return tune_prior(PETREL, requests, SETTINGS)


def test_the_prior_is_found_again(tuned, requests):
    """Sway and yaw lie within three of their stated errors, all numbers together within 99.9 %.

    Short dives do not tell surge from heave, so either alone may be far off while both together are not.
    """
    error = np.abs(np.log(numbers(tuned.after) / numbers(TRUE))) / tuned.errors
    for number in (SWAY, SWAY_TIME, YAW, YAW_TIME):
        assert tuned.verdicts[number] is TuningVerdict.ESTIMATED
        assert error[number] < 3.0
    likelihood = PriorLikelihood(requests, SETTINGS, recovery=SETTINGS.tuning.recovery)
    at_truth = likelihood.evaluate([TRUE])[0].log_likelihood
    assert tuned.errors[YAW] < 0.15
    assert 2.0 * (tuned.evaluation_after.log_likelihood - at_truth) < chi2.isf(1e-3, 12)
    assert tuned.gain > 100.0
    assert tuned.settled


def test_prior_numbers_that_the_records_do_not_determine_are_held(tuned):
    held = np.array([verdict is TuningVerdict.HELD for verdict in tuned.verdicts])
    assert np.flatnonzero(held).tolist() == [HEAVE]
    np.testing.assert_array_equal(np.isnan(tuned.errors), held)
    np.testing.assert_array_equal(numbers(tuned.after)[held], numbers(default_prior(PETREL))[held])


def test_no_noise_is_tuned_below_that_of_the_untuned_prior(tuned, requests):
    """The drawn yawing moment has less, sway has more; sway is fitted with the untuned numbers of yaw."""
    found = tune_prior(PETREL, requests, TuneSettings())
    yaw = [YAW, YAW_TIME]
    assert [found.verdicts[number] for number in yaw] == [TuningVerdict.TOO_TIGHT] * 2
    np.testing.assert_array_equal(numbers(found.after)[yaw], numbers(default_prior(PETREL))[yaw])
    assert np.isnan(found.errors[yaw]).all()
    assert found.verdicts[SWAY] is TuningVerdict.ESTIMATED
    assert 0.0 < found.gain < tuned.gain
    noise, untuned = (np.square(each[:6]) / each[6:] for each in map(numbers, (found.after, default_prior(PETREL))))
    assert (noise > (1.0 - 1e-3) * untuned).all()


def test_noise_below_the_untuned_one_is_accepted_down_to_a_share(tuned, requests):
    wider = TuneSettings.model_validate({"tuning": {"least_noise": 0.01}})
    np.testing.assert_array_equal(numbers(tune_prior(PETREL, requests, wider).after), numbers(tuned.after))


def test_innovations_under_the_tuned_prior_are_white(tuned):
    """Under the platform's prior they are not, in heading; under the tuned one they are."""
    assert tuned.whiteness_before["heading"].portmanteau > 10.0
    for found in tuned.whiteness_after.values():
        assert found.portmanteau < 2.5
        assert found.variance == pytest.approx(1.0, abs=0.15)
    assert not tuned.interpolated


def test_a_prior_under_which_runs_refuse_profiles_is_warned_of(tuned):
    """On the screen and in the file; a prior that follows its records is not mentioned."""
    lost = replace(tuned, evaluation_after=replace(tuned.evaluation_after, rejected_fraction=(0.0, 0.9)))
    (warning,) = warnings(lost, SETTINGS)
    assert warning.startswith("a run refuses a profile with more than")
    assert "do not use this prior" in warning
    assert warning[1:] in provenance(lost, "drawn.nc", "0" * 64, [1, 2], SETTINGS, ())
    assert warnings(tuned, SETTINGS) == []
    assert TunedHull(platform=PETREL, tuned=lost, profiles=(1, 2), settings=SETTINGS).notes[-1] == warning


# Which records


def test_long_records_are_cut(drawn):
    with open_observations(drawn) as opened:
        (request,) = tuning_profiles(opened, PETREL, [2], 120.0, SETTINGS)
    series = request.series
    assert len(series.controls) == len(request.bodies) == 1200
    assert len(series.measurements) == len(request.vibrating) == len(series.time) == len(series.weights) == 1201
    assert series.sample_index[-1] <= 1200


# The verb

BRIEFLY = (
    "--profiles", "2", "--set", "tuning.longest=200", "--set", "tuning.max_rounds=2", "--set", "tuning.least_noise=0",
)  # fmt: skip


@pytest.fixture(scope="module")
def written(drawn):
    """Output of the program, and the file that it wrote."""
    out = drawn.with_name("tuned.yaml")
    return program("tune", drawn, "--platform", "petrel-l", "--out", out, *BRIEFLY), out


def test_the_file_is_the_platform_with_the_prior(written):
    answer, out = written
    assert answer.status == 0, answer.err
    platform = load_platform(out)
    assert platform.prior != default_prior(PETREL)
    assert platform.model_copy(update={"prior": None, "source": PETREL.source}) == PETREL
    assert platform.source.startswith(PETREL.source)
    for fragment in ("gliderhpc tune", "drawn.nc", "profile 2", "--set tuning.longest=200", "gain +", "B_cr deviation"):
        assert fragment in platform.source


def test_tune_prints_the_changed_prior_and_the_output_file(written):
    answer, out = written
    for fragment in ("B_cu", "correlation time", "portmanteau", "heading", "gain +", f"written to {out}"):
        assert fragment in answer.out
    assert "correlated by construction" not in answer.out
    assert not list(out.parent.glob("*.part"))


def test_runs_smooth_with_the_written_prior(drawn, written, tmp_path):
    """Yaw has a smaller deviation than with the platform's wider prior, where the dive does not determine its own."""
    _, out = written
    assert load_platform(out).prior.deviation[YAW] < 0.8 * default_prior(PETREL).deviation[YAW]
    widths = []
    for number, platform in enumerate(("petrel-l", out)):
        store = tmp_path / f"{number}.zarr"
        answer = program(
            "run-mission", drawn, "--platform", platform, "--store", store, "--profiles", 2, "--workers", 0,
            "--set", "smoother.adaptive=false", "--set", "smoother.hull=believed",
        )  # fmt: skip
        assert answer.status == 0, answer.err
        with xr.open_datatree(store, engine="zarr") as tree:
            smoothed = tree["smoothed"].ds.sel(profile=2).load()
            assert tree["disturbance_prior"].sel(profile=2) == DISTURBANCE_PRIOR.meanings["usual"]
        assert smoothed["outcome"] == Outcome.CONVERGED
        widths.append(float(smoothed["B_cr_std"].mean()))
    assert widths[1] < 0.9 * widths[0]


def test_a_file_that_exists_is_not_replaced_unasked(drawn, written):
    _, out = written
    before = out.read_bytes()
    answer = program("tune", drawn, "--platform", "petrel-l", "--out", out)
    assert answer.status == 2
    assert f"{out}: this file exists; give another --out or replace it with --overwrite" in answer.line
    assert out.read_bytes() == before


@pytest.mark.parametrize(
    ("arguments", "fragment"),
    [
        (("--set", "tuning.longst=60"), "--set tuning.longst: no such setting"),
        (("--set", "tuning.error_factor=0.5"), "--set tuning.error_factor"),
        (("--profiles", "9"), "--profiles 9: no profile 9"),
        (("--out", "nowhere/tuned.yaml"), "nowhere/tuned.yaml: the folder"),
    ],
)
def test_wrong_usage_is_reported_in_one_line(drawn, tmp_path, arguments, fragment):
    answer = program("tune", drawn, "--platform", "petrel-l", "--out", tmp_path / "tuned.yaml", *arguments)
    assert answer.status == 2
    assert fragment in answer.line
    assert not list(tmp_path.iterdir())


def test_a_missing_observation_file_is_reported_in_one_line(tmp_path):
    answer = program("tune", tmp_path / "no.nc", "--platform", "petrel-l", "--out", tmp_path / "tuned.yaml")
    assert answer.status == 2
    assert "no.nc" in answer.line


def test_a_mission_without_a_usable_profile_is_refused(drawn, tmp_path):
    def blinded(content):
        content["pitch"][samples_of(content, 2)] = np.nan

    blind = changed_observations(drawn, tmp_path / "blind.nc", blinded)
    answer = program("tune", blind, "--platform", "petrel-l", "--out", tmp_path / "tuned.yaml", "--profiles", 2)
    assert answer.status == 2
    assert "no profile to tune on can be used; profile 2" in answer.err
    assert not (tmp_path / "tuned.yaml").exists()


def test_records_that_determine_nothing_leave_the_prior_as_it_was(drawn, tmp_path):
    out = tmp_path / "tuned.yaml"
    answer = program("tune", drawn, "--platform", "petrel-l", "--out", out, "--set", "tuning.longest=0.1")
    assert answer.status == 0, answer.err
    assert load_platform(out).prior == default_prior(PETREL)


def test_a_slow_record_is_reported_as_interpolated(drawn, tmp_path):
    answer = program(
        "tune", drawn, "--platform", "petrel-l", "--out", tmp_path / "tuned.yaml", *BRIEFLY,
        "--set", "filter.slow_feed=0.5", "--set", "filter.feed_interval=0.5",
    )  # fmt: skip
    assert answer.status == 0, answer.err
    assert "correlated by construction" in answer.out
    assert "correlated by construction" in load_platform(tmp_path / "tuned.yaml").source


def test_platform_text_reads_back_as_the_platform(tmp_path):
    for name in ("petrel-l", "seaexplorer"):
        platform = read_platform(name)
        (tmp_path / "copy.yaml").write_text(platform_yaml(platform), "utf-8")
        assert read_platform(tmp_path / "copy.yaml") == platform
