"""Accuracy of a known disturbance and a known current on a synthetic mission (the paper's Table 2).

Scores are computed here, from the archive and the truth file alone: medians over profiles, over the samples outside the
vibration set and after the filter's first minute.
"""

import numpy as np
import pytest
import xarray as xr
from scipy.signal import correlate
from support.missions import CHANNELS, SETTLING

from gliderhpc.observations.truth import read_profile_truth, truth_path
from gliderhpc.vocabulary import QUALITY

pytestmark = pytest.mark.compiled

PROFILES = (1, 2, 3, 4)
SURGE, PITCH_MOMENT, YAW_MOMENT = (CHANNELS.index(name) for name in ("B_cu", "B_cq", "B_cr"))


class Scored:
    """One profile's estimate and its truth, on the steps.

    Attributes
    ----------
    truth, adjoint, prior : (n, 6)
        Disturbances, N and N m.
    steady : (n,)
        Outside the vibration set, after the first minute.
    """

    def __init__(self, tree, truth_file, number):
        series, prior = (tree[group].ds.sel(profile=number) for group in ("series", "prior"))
        self.truth_set = read_profile_truth(truth_file, number)
        self.truth = np.column_stack([self.truth_set[name].values for name in CHANNELS])
        n = len(self.truth)
        self.adjoint, self.prior = (
            np.column_stack([group[name].values[:n] for name in CHANNELS]).astype(float) for group in (series, prior)
        )
        self.quality = np.nan_to_num(series["quality"].values[:n]).astype(int)
        self.step = float(tree.attrs["step"])
        self.steady = (self.quality & QUALITY.meanings["vibration"] == 0) & (np.arange(n) * self.step >= SETTLING)
        self.row = tree.to_dataset().sel(profile=number).load()
        self._record = [tree[group].ds.sel(profile=number).load() for group in ("state", "observed")]

    def rmse(self, estimate, channel):
        return np.sqrt(np.mean((estimate - self.truth)[self.steady, channel] ** 2))

    def correlation(self, estimate, channel):
        return np.corrcoef(estimate[self.steady, channel], self.truth[self.steady, channel])[0, 1]

    def tracking(self, name):
        """RMSE of the reconstruction about the measurements, degree or m."""
        state, observed = (group[name].values for group in self._record)
        every = round(1.0 / self.step)
        steady = self.steady[::every]
        error = (state - observed)[: len(steady)][steady]
        error = np.mod(error + 180.0, 360.0) - 180.0 if name == "heading" else error
        assert np.isfinite(error).mean() > 0.99
        return np.sqrt(np.nanmean(error**2))

    def current_error(self, suffix=""):
        return np.hypot(
            self.row[f"dac_north{suffix}"] - self.truth_set["current_north"],
            self.row[f"dac_east{suffix}"] - self.truth_set["current_east"],
        )

    def lag(self, estimate, channel):
        """Delay (s) at which an estimate of a channel correlates best with the truth."""
        a, b = (np.where(self.steady, values[:, channel], 0.0) for values in (estimate, self.truth))
        correlation = correlate(a, b, "full", method="fft")
        lags = np.arange(1 - len(b), len(a))
        near = np.abs(lags) * self.step <= 10.0
        return lags[near][np.argmax(correlation[near])] * self.step

    def impulse_gains(self, estimate):
        """Estimate of the yaw moment at the peak of every lonely impulse of a steady glide, over its amplitude."""
        since = self.truth_set["impulse_time"].values - self.truth_set["truth_time"].values[0]
        peaks = np.rint(since / np.timedelta64(1, "ns") * 1e-9 / self.step).astype(int)
        gains = []
        for peak in peaks:
            around = slice(max(0, peak - 80), peak + 80)
            alone = np.sum(np.abs(peaks - peak) * self.step < 15.0) == 1
            if alone and peak < len(self.truth) and self.steady[around].all():
                gains.append(estimate[peak, YAW_MOMENT] / self.truth[peak, YAW_MOMENT])
        return gains


def _scored(store, twin):
    with xr.open_datatree(store, engine="zarr") as tree:
        return [Scored(tree, truth_path(twin), number) for number in PROFILES]


@pytest.fixture(scope="module")
def by_paper(paper, twin):
    return _scored(paper, twin)


@pytest.fixture(scope="module")
def by_recommended(recommended, twin):
    return _scored(recommended, twin)


def median(scored, score):
    return float(np.median([score(profile) for profile in scored]))


def test_the_scored_twin_has_long_glides_and_strong_impulses(by_recommended):
    """Four profiles of at least 40 minutes, mostly steady glide, with impulses as large as on real missions."""
    assert len(by_recommended) >= 4
    for profile in by_recommended:
        assert len(profile.truth) * profile.step >= 2400.0
        assert 0.8 < profile.steady.mean() < 1.0
        amplitudes = np.abs(profile.truth_set["impulse_amplitude"].values)
        assert len(amplitudes) >= 10
        assert (amplitudes >= 0.6).all()
        assert (amplitudes <= 3.0).all()
        assert profile.truth[:, SURGE].std() > 0.05


def test_paper_reaches_table_2(by_paper):
    assert median(by_paper, lambda p: p.rmse(p.adjoint, YAW_MOMENT)) <= 0.10
    assert median(by_paper, lambda p: p.correlation(p.adjoint, YAW_MOMENT)) >= 0.95


@pytest.mark.parametrize(("name", "most"), [("roll", 0.10), ("pitch", 0.35), ("heading", 0.20), ("depth", 0.03)])
def test_paper_tracks_the_record(by_paper, name, most):
    assert median(by_paper, lambda p: p.tracking(name)) <= most


@pytest.mark.parametrize(
    ("channel", "most", "least"),
    [(YAW_MOMENT, 0.07, 0.98), (SURGE, 0.06, 0.9), (PITCH_MOMENT, 0.02, 0.9)],
    ids=["yaw", "surge", "pitch"],
)
def test_recommended_recovers_the_disturbance(by_recommended, channel, most, least):
    assert median(by_recommended, lambda p: p.rmse(p.adjoint, channel)) <= most
    assert median(by_recommended, lambda p: p.correlation(p.adjoint, channel)) >= least


@pytest.mark.parametrize(("name", "most"), [("roll", 0.05), ("pitch", 0.05), ("heading", 0.12), ("depth", 0.03)])
def test_recommended_tracks_the_record(by_recommended, name, most):
    assert median(by_recommended, lambda p: p.tracking(name)) <= most


def test_recommended_beats_the_paper_where_it_claims_to(by_paper, by_recommended):
    """The control-variable transform improves the channels that are noise at unit scale."""
    for channel in (SURGE, PITCH_MOMENT, YAW_MOMENT):
        ours = np.median([profile.rmse(profile.adjoint, channel) for profile in by_recommended])
        theirs = np.median([profile.rmse(profile.adjoint, channel) for profile in by_paper])
        assert ours < theirs


@pytest.mark.parametrize("preset", ["by_paper", "by_recommended"])
def test_the_current_comes_back(preset, request):
    scored = request.getfixturevalue(preset)
    assert median(scored, lambda p: p.current_error()) <= 0.01
    assert median(scored, lambda p: p.current_error("_glide_angle")) <= 0.02
    speeds = [np.hypot(p.truth_set["current_north"], p.truth_set["current_east"]) for p in scored]
    assert np.median(speeds) > 0.05, "a current as small as the error would prove nothing"


@pytest.mark.parametrize("preset", ["by_paper", "by_recommended"])
def test_the_filter_alone_lags_the_impulses(preset, request):
    """Being causal, the filter shows an impulse late and attenuated; the adjoint shows it in time."""
    scored = request.getfixturevalue(preset)
    assert median(scored, lambda p: p.lag(p.prior, YAW_MOMENT)) >= 0.5
    assert median(scored, lambda p: abs(p.lag(p.adjoint, YAW_MOMENT))) <= 0.2
    prior_gains, adjoint_gains = (
        np.concatenate([profile.impulse_gains(getattr(profile, name)) for profile in scored])
        for name in ("prior", "adjoint")
    )
    assert len(prior_gains) > 20
    assert np.median(prior_gains) < 0.75
    assert np.median(adjoint_gains) > np.median(prior_gains) + 0.05
    ours, theirs = (np.median([p.rmse(getattr(p, name), YAW_MOMENT) for p in scored]) for name in ("adjoint", "prior"))
    assert theirs > 2.0 * ours
