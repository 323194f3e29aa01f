"""Gaussianity of the disturbances: the test of the smoother's noise on known series, on twins and on archives."""

import numpy as np
import pandas as pd
import pytest
import scipy
import xarray as xr
from scipy.stats import binom

from benchmarks.known_series import cascade
from gliderhpc.archive.mission import open_mission
from gliderhpc.archive.profile import read_profile_data
from gliderhpc.estimation.preparation import prepare_profile
from gliderhpc.estimation.profile import estimate_profile
from gliderhpc.estimation.resample import on_steps
from gliderhpc.flight.glider import Glider
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.platform import read_platform
from gliderhpc.simulator import simulate_profile
from gliderhpc.studies.library.turbulence.contrast import FalsePositives
from gliderhpc.studies.library.turbulence.ensembles import ADDED_SETTINGS, Ensembles, is_comparable
from gliderhpc.studies.library.turbulence.gaussianity import (
    NO_ESTIMATE,
    REPEATED_ROLL,
    TOO_FEW,
    Noise,
    gaussianity_row,
    judged_gaussianity,
    kurtosis_score,
    moments_of,
    noise_moments,
    noise_of,
    noise_of_estimate,
    noise_rows,
    smallest_p,
)
from gliderhpc.studies.library.turbulence.series import ChannelSeries, IntermittencySettings
from gliderhpc.studies.library.turbulence.verdict import conclusion, judge
from gliderhpc.twins.cases import QUIET, world
from gliderhpc.vocabulary import CHANNELS, QUALITY

SETTINGS = IntermittencySettings()


def noise(values, quality=None, step=1.0):
    """Channel of such noise, settled from the first sample on."""
    flags = np.zeros(len(values), dtype=np.uint8) if quality is None else quality
    return ChannelSeries(100.0 + step * np.arange(len(values)), values, np.zeros(len(values)), flags, step, step)


def moments(values, quality=None, step=1.0, window=300.0):
    series = noise(values, quality, step)
    return noise_moments(series, series.counted(actuated=False), window)


def profile_of(values, roll=None, sampled=None):
    """Noise of a profile with the same noise in all channels, of another size in each."""
    count = len(values)
    channels = {name: noise((1.0 + at) * np.roll(values, 100 * at)) for at, name in enumerate(CHANNELS)}
    everywhere = np.ones(count, dtype=bool) if sampled is None else sampled
    return Noise(channels, everywhere, np.arange(count) * 0.1 if roll is None else roll)


def correlated(count, rho, rng):
    """Gaussian autoregressive series of unit variance."""
    start = rng.standard_normal()
    drawn = np.sqrt(1.0 - rho**2) * rng.standard_normal(count)
    return scipy.signal.lfilter([1.0], [1.0, -rho], drawn, zi=[rho * start])[0]


@pytest.mark.parametrize("count", [100, 1000, 20000])
def test_the_score_is_that_of_anscombe_and_glynn(count):
    """Anscombe and Glynn (1983), as scipy has it for whole numbers of independent values."""
    rng = np.random.default_rng(count)
    for values in (rng.standard_normal(count), rng.uniform(size=count), rng.standard_t(4, count)):
        expected = scipy.stats.kurtosistest(values).statistic
        assert kurtosis_score(scipy.stats.kurtosis(values, fisher=False), count) == pytest.approx(expected, rel=1e-9)


def test_correlated_values_count_as_fewer():
    """Lomnicki (1961): the sum of an autoregressive series' correlations to the fourth is (1 + rho^4) / (1 - rho^4)."""
    count, rho = 200_000, 0.9
    found = moments(correlated(count, rho, np.random.default_rng(1)), window=20_000.0)
    assert found.independent == pytest.approx(count * (1.0 - rho**4) / (1.0 + rho**4), rel=0.03)
    assert found.variance == pytest.approx(1.0, rel=0.05)


def test_gaussian_noise_is_rejected_at_the_level():
    """Correlated, and of a strength that doubles along the dive, which would raise the kurtosis of the whole."""
    rng, strength = np.random.default_rng(2), np.linspace(1.0, 2.0, 1500)
    scores = np.array([moments(strength * correlated(1500, 0.5, rng)).score for _ in range(600)])
    assert abs(scores.mean()) < 0.25
    rejected = int((scores > scipy.stats.norm.isf(0.05)).sum())
    assert binom.cdf(rejected, 600, 0.05) > 1e-3
    assert binom.sf(rejected - 1, 600, 0.05) > 1e-3
    assert scores.std() == pytest.approx(1.0, abs=0.12)


@pytest.mark.parametrize("every", [lambda i: i % 4 == 0, lambda i: np.where(i < 1200, i % 4 == 0, i % 5 == 0)])
def test_samples_slower_than_the_records_count_once_each(every):
    """White noise at samples 4 s apart, and at samples whose interval changes, on records of 1 s."""
    rng, at = np.random.default_rng(9), every(np.arange(2400))
    series = [noise(rng.standard_normal(2400)) for _ in range(200)]
    found = [noise_moments(one, at, 300.0) for one in series]
    assert np.mean([one.independent for one in found]) == pytest.approx(at.sum(), rel=0.05)
    scores = np.array([one.score for one in found])
    assert np.isfinite(scores).all()
    assert scores.std() == pytest.approx(1.0, abs=0.2)
    assert abs(scores.mean()) < 0.4


def test_the_local_root_mean_square_needs_values_within_its_window():
    values = np.random.default_rng(10).standard_normal(1500)
    assert np.isnan(moments(values, window=5.0).score)
    assert moments(values, window=40.0).kurtosis == pytest.approx(3.0, abs=0.35)


def test_cascades_are_rejected():
    rng = np.random.default_rng(3)
    scores = np.array([moments(np.diff(cascade(1500, rng))).score for _ in range(20)])
    assert np.mean(scores > scipy.stats.norm.isf(0.05)) > 0.9


def test_samples_that_do_not_count_have_no_part_in_it():
    rng = np.random.default_rng(4)
    values = correlated(1500, 0.3, rng)
    flags = np.zeros(1500, dtype=np.uint8)
    flags[500:520] = QUALITY.meanings["vibration"]
    corrupted = values.copy()
    corrupted[500:520] = 1e6
    corrupted[700:705] = np.nan
    known = np.full(1500, True)
    known[500:520] = known[700:705] = False
    found = moments(corrupted, flags)
    assert found == moments(np.where(known, corrupted, 7.0), np.where(known, 0, flags | QUALITY.meanings["vibration"]))
    assert found.score == pytest.approx(moments(values).score, abs=0.5)
    assert found.independent < 1475


def test_short_and_slow_records_are_not_tested():
    values = np.random.default_rng(5).standard_normal(1500)
    assert np.isnan(moments(values[:99]).variance)
    slow = moments(np.repeat(values[:20], 75))
    assert slow.independent < 100
    assert np.isnan(slow.score)
    assert np.isnan(moments(np.full(500, 3.0)).score)


def test_between_samples_the_noise_may_have_another_variance():
    """Records twice as frequent as the samples: half of the values are ten times larger, which is no intermittency."""
    values = np.random.default_rng(8).standard_normal(3000)
    sampled = np.arange(3000) % 2 == 0
    of_both = profile_of(np.where(sampled, values, 10.0 * values))
    of_samples = profile_of(np.where(sampled, values, 10.0 * values), sampled=sampled)
    assert gaussianity_row(of_both, SETTINGS)["gaussianity_p_value"] < 1e-6
    assert gaussianity_row(of_samples, SETTINGS)["gaussianity_p_value"] > 0.01


def test_sway_and_roll_are_tested():
    found = profile_of(np.random.default_rng(6).standard_normal(1500))
    row = noise_rows(found, SETTINGS)
    assert np.isfinite(row["noise_score"]).all()
    largest = row["noise_score"][[1, 3]].max()
    assert row["gaussianity_score"] == largest
    assert row["gaussianity_p_value"] == pytest.approx(min(1.0, 2.0 * scipy.stats.norm.sf(largest)))
    assert gaussianity_row(found, SETTINGS) == {k: row[k] for k in ("gaussianity_score", "gaussianity_p_value")}
    assert noise_rows(None, SETTINGS) == {}
    assert np.isnan(gaussianity_row(None, SETTINGS)["gaussianity_score"])


def test_a_roll_that_is_only_rounding_is_not_tested():
    values = np.random.default_rng(6).standard_normal(1000)
    for changes, tested in ((400, True), (200, False)):
        roll = 0.1 * np.minimum(np.arange(1000), changes)
        row = noise_rows(profile_of(values, roll), SETTINGS)
        assert row["repeated_roll"] == pytest.approx(1.0 - changes / 999)
        assert np.isfinite(row["gaussianity_score"]) == tested
        assert np.isfinite(row["noise_score"]).all()
    still = profile_of(values, np.full(1000, np.nan))
    assert still.repeated == 1.0


def test_a_profile_that_is_not_tested_has_a_message():
    values = np.random.default_rng(6).standard_normal(1000)
    assert noise_rows(profile_of(values), SETTINGS)["gaussianity_message"] == ""
    rounded = noise_rows(profile_of(values, np.full(1000, 0.1)), SETTINGS)
    assert rounded["gaussianity_message"] == REPEATED_ROLL
    assert noise_rows(profile_of(values[:50]), SETTINGS)["gaussianity_message"] == TOO_FEW
    # As of a dive with a burst of gusts that the smoother has no estimate of.
    assert noise_rows(profile_of(np.full(1000, np.nan)), SETTINGS)["gaussianity_message"] == NO_ESTIMATE


def test_the_verdict_counts_profiles_that_are_not_tested():
    rows = [with_score(MEASURED, score) | {"profile": at} for at, score in enumerate([5.0, 6.0, np.nan, np.nan], 6)]
    for row, message in zip(rows, (np.nan, np.nan, NO_ESTIMATE, REPEATED_ROLL), strict=True):
        row["gaussianity_message"] = message
    verdict = judge(Ensembles(pd.DataFrame(rows), pd.DataFrame(), SETTINGS))
    assert verdict.gaussianity.untested == {NO_ESTIMATE: (8,), REPEATED_ROLL: (9,)}
    text = conclusion(verdict)[0]
    assert "not Gaussian in 2 of the 2 profiles in which this can be tested (at 5% each); 2 of 4 not tested (" in text
    assert f"profile 8, since {NO_ESTIMATE}; profile 9, since {REPEATED_ROLL})" in text
    none = judge(Ensembles(pd.DataFrame(rows[2:]), pd.DataFrame(), SETTINGS))
    assert "lateral disturbances are Gaussian; 2 of 2 not tested (profile 8, since" in conclusion(none)[0]


def test_p_of_the_largest_score():
    assert smallest_p(1.6448536, 1) == pytest.approx(0.05)
    assert smallest_p(1.6448536, 3) == pytest.approx(0.15)
    assert smallest_p(-3.0, 3) == 1.0


# Twins and archives


@pytest.fixture(scope="module")
def estimates():
    """Estimates of two dives in gusts of the same spectrum, intermittent and Gaussian, and of one in still water."""
    platform, settings = read_platform("petrel-l"), MissionSettings()
    found = {}
    for kind in ("cascade", "gaussian", "none"):
        gusts = {"kind": kind, "rms": 0.064, "outer": 128.0, "inner": 0.25}
        water = world(120.0, disturbances=QUIET).replaced({"gusts": gusts, "current": {"speed": [0.0, 0.0]}})
        record, _ = simulate_profile(platform, water, 21)
        profile = prepare_profile(Glider(platform), on_steps(record, settings))
        found[kind] = noise_of_estimate(estimate_profile(profile, settings), settings.steps_per_record)
    return found


@pytest.mark.compiled
def test_an_intermittent_gust_is_distinguished_from_a_gaussian_one(estimates):
    rows = {kind: gaussianity_row(of_kind, SETTINGS) for kind, of_kind in estimates.items()}
    assert rows["cascade"]["gaussianity_p_value"] < 1e-3
    assert rows["gaussian"]["gaussianity_p_value"] > 0.05
    assert np.isnan(rows["none"]["gaussianity_p_value"])


@pytest.mark.compiled
def test_noise_of_a_gust_has_the_strength_that_the_smoother_states(estimates):
    """The noise of roll is fitted to the dive; its variance is 1 but for the spectrum, which is not the prior's."""
    assert 0.3 < moments_of(estimates["gaussian"], SETTINGS)["B_cp"].variance < 1.5
    assert moments_of(estimates["none"], SETTINGS)["B_cp"].variance < 0.06
    assert estimates["gaussian"].repeated < 0.2 < 0.9 < estimates["none"].repeated


@pytest.mark.compiled
def test_an_archive_has_the_noise_of_its_estimate(recommended):
    with open_mission(recommended) as archive:
        data = read_profile_data(archive, 1)
        of_archive = noise_of(archive, data)
        stored = archive["smoothed"].to_dataset().sel(profile=1)["B_cp_noise"].values
    assert list(of_archive.channels) == list(CHANNELS)
    assert of_archive.sampled.mean() > 0.9
    np.testing.assert_array_equal(of_archive.roll, data.measured[:, 0])
    assert 0.0 < of_archive.repeated < 1.0
    series = of_archive.channels["B_cp"]
    np.testing.assert_array_equal(series.values, stored[: len(data.record_time)])
    assert np.isfinite(series.values[:-1]).all()
    flagged = QUALITY.meanings["vibration"]
    vibrating = data.on_records(data.flagged("vibration"))
    np.testing.assert_array_equal((series.quality & np.uint8(flagged)) != 0, vibrating)


@pytest.mark.compiled
def test_an_archive_of_an_earlier_version_has_no_noise(recommended):
    with open_mission(recommended) as archive:
        data = read_profile_data(archive, 1)
        group = archive["smoothed"].to_dataset()
        old = xr.DataTree.from_dict({"smoothed": group.drop_vars([f"{name}_noise" for name in CHANNELS])})
        assert noise_of(old, data) is None
    assert noise_of(xr.DataTree(), data) is None


# The verdict

MEASURED = {
    "profile": 1, "flatness": 50.0, "zeta_ratio": 1.78, "kurtosis": 60.0, "peak": 1.0, "rms": 0.1, "p_value": 0.025,
}  # fmt: skip
NULL = {"flatness": 50.0, "zeta_ratio": 1.2, "peak": 0.2, "rms": 0.01, "p_value": 0.5}


def with_score(row, score):
    """Row of a profile or null with such a score of one tested channel."""
    return row | {"gaussianity_score": score, "gaussianity_p_value": smallest_p(score, 1) if score == score else score}


def judged(scores, gaussian=(), others=()):
    """Verdict on profiles of such scores, with Gaussian and other nulls of such scores."""
    nulls = [with_score(NULL | {"family": "gaussian"}, score) for score in gaussian]
    nulls += [with_score(NULL | {"family": "noise_only"}, score) for score in others]
    return judge(
        Ensembles(pd.DataFrame([with_score(MEASURED, score) for score in scores]), pd.DataFrame(nulls), SETTINGS)
    )


def test_profiles_are_compared_with_gaussian_nulls():
    found = judged([4.0, 5.0, np.nan, 6.0], [0.1, -0.3, 2.0, np.nan], [np.nan] * 5).gaussianity
    assert (found.profiles, found.tested, found.rejected) == (4, 3, 3)
    assert found.nulls == FalsePositives(1, 3, 0.05)
    assert (found.contrast.profiles, found.contrast.nulls, found.contrast.larger) == (3, 3, 1.0)
    assert found.rejects_gaussian
    assert found.count_p_value == pytest.approx(0.05**3)


def test_scores_that_the_pipeline_biases_settle_nothing():
    """Gaussian profiles whose scores are all too large, like those of their nulls: the comparison keeps its level."""
    rng = np.random.default_rng(7)
    p = np.ones(12)
    rejections = [
        judged_gaussianity(
            pd.DataFrame({"gaussianity_score": 2.0 + rng.standard_normal(9), "gaussianity_p_value": p[:9]}),
            pd.DataFrame({"gaussianity_score": 2.0 + rng.standard_normal(12), "gaussianity_p_value": p}),
        ).rejects_gaussian
        for _ in range(400)
    ]
    assert np.mean(rejections) == pytest.approx(0.05, abs=0.033)


def test_the_verdict_says_whether_lateral_disturbances_are_gaussian():
    verdict = judged([5.0, 6.0, 4.0, 5.5], np.linspace(-1.0, 1.0, 9), [np.nan] * 9)
    found, sure, settle = conclusion(verdict)
    assert "lateral disturbances that are not Gaussian in 4 of the 4 profiles in which this can be tested" in found
    assert "4 profiles of Gaussian lateral disturbances would exceed the kurtosis of 9 nulls" in sure
    assert "rejects 0 of these nulls, consistent with the test's level" in sure
    assert (
        "rejected at the 5% level; to exclude trains of impulses, false samples, actuators that move unrecorded"
        in settle
    )
    assert verdict.as_json()["gaussianity"]["contrast"]["larger"] == 1.0


def test_without_tested_nulls_nothing_is_settled():
    for verdict in (judged([5.0, 6.0]), judged([5.0, 6.0], [np.nan] * 9, [np.nan] * 9)):
        found, sure, settle = conclusion(verdict)
        assert "not Gaussian in 2 of the 2 profiles" in found
        assert "this many detections would occur by chance with p = 0.00250" in sure
        assert "of these nulls" not in sure
        assert "actuators that move unrecorded" not in settle


def test_gaussian_and_untested_profiles_are_not_reported_as_non_gaussian():
    calm = conclusion(judged([0.3, -0.4, 0.9], np.linspace(-1.0, 1.0, 9)))
    assert "not Gaussian in 0 of the 3 profiles" in calm[0]
    assert "settled" not in calm[2]
    still = judged([np.nan, np.nan], np.linspace(-1.0, 1.0, 9))
    assert "no profile in which it can be tested" in conclusion(still)[0]
    assert "lateral" not in conclusion(still)[1]
    assert np.isnan(still.gaussianity.count_p_value)


def test_a_test_that_rejects_too_many_nulls_leaves_the_comparison():
    verdict = judged([5.0, 6.0, 7.0, 8.0], [2.0] * 9)
    assert not verdict.gaussianity.nulls.holds
    expected = "rejects 9 of these nulls, more than the test's level allows, so rely on the comparison"
    assert expected in conclusion(verdict)[1]


def test_studies_of_an_earlier_version_have_no_test():
    rows = pd.DataFrame([MEASURED] * 3)
    verdict = judge(Ensembles(rows, pd.DataFrame([NULL | {"family": "gaussian"}] * 3), SETTINGS))
    assert verdict.gaussianity is None
    assert "lateral" not in " ".join(conclusion(verdict))
    old = {name: value for name, value in SETTINGS.model_dump(mode="json").items() if name not in ADDED_SETTINGS}
    assert is_comparable(old, SETTINGS)
    assert not is_comparable(old | {"cutoff": 0.1}, SETTINGS)
    assert not is_comparable(old | {"noise_window": 100.0}, SETTINGS)
