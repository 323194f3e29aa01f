"""Filter: input, estimate, the vibration set, and initial values."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from support.missions import SETTLING, glide_series, profile_series, replaced

from gliderhpc.errors import ProfileError
from gliderhpc.estimation import filter as filter_module
from gliderhpc.estimation.filter import filter_with_priors, refusal, run_filter, run_filters
from gliderhpc.estimation.preparation import prepare_profile, vibration_set
from gliderhpc.estimation.priors import ROUGH_WATER, candidate_priors, default_prior
from gliderhpc.estimation.profile import estimate_profile
from gliderhpc.estimation.quality import _remarks_on_samples, remarks
from gliderhpc.estimation.resample import resample
from gliderhpc.estimation.self_motion import flight_guesses, smoothed_slope
from gliderhpc.estimation.sensor_noise import measurement_variance
from gliderhpc.estimation.settings import EstimationSettings
from gliderhpc.flight.glider import Glider
from gliderhpc.flight.steady_glide import steady_glide
from gliderhpc.observations.truth import read_profile_truth, truth_path
from gliderhpc.platform import DisturbancePrior, read_platform, shipped_platforms
from gliderhpc.simulator import load_scenario, simulate_profile

pytestmark = pytest.mark.compiled

PETREL = read_platform("petrel-l")
GLIDER = Glider(PETREL)
SETTINGS = EstimationSettings()
STEP = SETTINGS.step


def glide(direction=1.0):
    return steady_glide(GLIDER, direction * 0.4, -direction * np.radians(23.0), 100.0)


def raw_controls(steady, steps):
    buoyancy = PETREL.buoyancy
    volume = buoyancy.neutral_volume_m3 - steady.net_mass / buoyancy.water_density
    return np.tile([steady.battery_position, 0.0, volume, 0.0], (steps, 1))


def glide_record(direction=1.0, steps=3000, **options):
    steady = glide(direction)
    return glide_series(PETREL, steady.state, raw_controls(steady, steps), **options)


def filtered(series, settings=SETTINGS, platform=PETREL):
    return to_the_end([request(series, platform)], settings)[0]


def to_the_end(profiles, settings=SETTINGS):
    """Filter profiles with the priors of their hulls, regardless of the number of rejections."""
    return filter_with_priors(profiles, [default_prior(one.glider.platform) for one in profiles], settings)


# The vibration set


@pytest.mark.parametrize(
    ("column", "rate", "vibrating"),
    [
        (0, 1.1 * PETREL.vibration.battery_position_rate, True),
        (0, 0.9 * PETREL.vibration.battery_position_rate, False),
        (1, 1.1 * PETREL.vibration.battery_rotation_rate_rad, True),
        (1, 0.9 * PETREL.vibration.battery_rotation_rate_rad, False),
        (2, 1.1 * PETREL.vibration.ballast_rate_m3, True),
        (2, 0.9 * PETREL.vibration.ballast_rate_m3, False),
        (3, 10.0, False),
    ],
)
def test_each_actuator_vibrates_the_hull_above_its_own_threshold(column, rate, vibrating):
    series, _ = glide_record(steps=1000)
    controls = series.controls.copy()
    controls[500:510, column] += rate * STEP * np.arange(1, 11)
    controls[510:, column] = controls[509, column]
    assert vibration_set(PETREL, replaced(series, controls=controls)).any() == vibrating


def test_the_vibration_set_is_the_motion_with_a_guard_time_on_either_side():
    series, _ = glide_record(steps=1000)
    controls = series.controls.copy()
    controls[500:, 2] += 100e-6
    vibrating = vibration_set(PETREL, replaced(series, controls=controls))
    reach = round(PETREL.vibration.guard / STEP)
    np.testing.assert_array_equal(np.flatnonzero(vibrating), np.arange(500 - reach, 500 + reach + 1))
    assert vibrating.shape == series.time.shape


# First guesses


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_guesses_of_a_steady_glide_are_that_glide(direction):
    series, states = glide_record(direction)
    guesses = flight_guesses(PETREL, series)
    # A hull that gains buoyancy with depth never flies quite steadily; the guess may be in error by that effect.
    np.testing.assert_allclose(guesses[1000:2000, 6], states[1000:2000, 6], rtol=0.03)
    np.testing.assert_allclose(guesses[1000:2000, 8], states[1000:2000, 8], rtol=0.1)
    assert np.sign(guesses[1500, 8]) == direction
    np.testing.assert_array_equal(guesses[:, [0, 1, 2, 5]], series.measurements)
    assert not guesses[:, [3, 4, 7]].any()


def test_guessed_rates_are_those_of_a_turn():
    series, _ = glide_record(steps=600)
    turning = series.measurements.copy()
    turning[:, 2] = 0.03 * series.time
    turning[:, 0] = 0.2
    guesses = flight_guesses(PETREL, replaced(series, measurements=turning))
    theta = turning[300, 1]
    np.testing.assert_allclose(guesses[300, 9], -0.03 * np.sin(theta), atol=1e-6)
    np.testing.assert_allclose(guesses[300, 10], 0.03 * np.sin(0.2) * np.cos(theta), atol=2e-4)
    np.testing.assert_allclose(guesses[300, 11], 0.03 * np.cos(0.2) * np.cos(theta), atol=2e-4)


def test_slopes_of_straight_lines_are_exact_to_the_ends():
    time = 0.1 * np.arange(400)
    values = np.column_stack([2.0 - 0.3 * time, 0.01 * time])
    for smoothing in (0.1, 10.0, 1e4):
        np.testing.assert_allclose(smoothed_slope(values, 0.1, smoothing), np.tile([-0.3, 0.01], (400, 1)), atol=1e-9)


@pytest.mark.parametrize("seconds", [0.1, 1.0, 3.7, 1e4])
@pytest.mark.parametrize("every", [1, 3, 10, 1000])
def test_slopes_are_those_of_the_straight_lines_fitted(seconds, every):
    """They are least-squares fits about each requested sample; near the ends, over the first or last full length."""
    values = np.random.default_rng(5).normal(size=(211, 2))
    width = min(round(seconds / 0.1), 210) // 2 * 2 + 1
    if width < 3:
        expected = np.gradient(values, 0.1, axis=0)[::every]
    else:
        starts = np.clip(np.arange(0, 211, every) - width // 2, 0, 211 - width)
        expected = [np.polyfit(0.1 * np.arange(width), values[start : start + width], 1)[0] for start in starts]
    np.testing.assert_allclose(smoothed_slope(values, 0.1, seconds, every), expected, atol=1e-9)


def test_sparse_guesses_are_among_the_dense():
    series, _ = glide_record(steps=999)
    np.testing.assert_array_equal(flight_guesses(PETREL, series, 10), flight_guesses(PETREL, series)[::10])


# The filter on records like real ones


def test_the_filter_rejects_hardly_any_sample_of_a_calibrated_hull(twin):
    for number in (1, 2, 3, 4):
        series = profile_series(twin, number, SETTINGS)
        prior = filtered(series)
        assert prior.fed == len(series.sample_index)
        assert prior.reset == 0
        assert prior.rejected_fraction < 0.01
        assert prior.states.shape == (len(series.time), 12)
        assert np.isfinite(prior.states).all()
        assert np.isfinite(prior.disturbances).all()


def test_the_prior_follows_the_slow_disturbances_and_the_motion(twin):
    series = profile_series(twin, 2, SETTINGS)
    truth = read_profile_truth(truth_path(twin), 2)
    prior = filtered(series)
    steady = ~vibration_set(PETREL, series)
    steady[: round(SETTLING / STEP)] = False
    n = truth.sizes["truth_time"]
    for channel, name, most in ((0, "B_cu", 0.08), (4, "B_cq", 0.03)):
        error = (prior.disturbances[:n, channel] - truth[name].values)[steady[:n]]
        assert np.sqrt(np.mean(error**2)) < most
    every = round(1.0 / STEP)
    for column, name in ((6, "u"), (8, "w")):
        error = (prior.states[::every, column] - truth[name].values)[steady[::every]]
        assert np.sqrt(np.mean(error**2)) < 0.02


def test_a_still_record_gives_no_disturbance():
    series, states = glide_record()
    prior = filtered(series)
    assert np.abs(prior.disturbances[1000:, [1, 3, 5]]).max() < 1e-6
    assert np.abs(prior.disturbances[1000:, 0]).max() < 0.1
    np.testing.assert_allclose(prior.states[1000:, 6], states[1000:, 6], atol=0.01)


def test_missing_samples_are_skipped(twin):
    series = profile_series(twin, 1, SETTINGS)
    rows = series.sample_index[::4]
    prior = filtered(replaced(series, sample_index=rows))
    assert prior.fed == len(rows)
    weights = series.weights.copy()
    weights[5000:8001] = 0.0
    gappy = filtered(replaced(series, weights=weights))
    inside = (series.sample_index >= 5000) & (series.sample_index <= 8000)
    assert gappy.fed == len(series.sample_index) - inside.sum()
    assert np.isfinite(gappy.states).all()
    np.testing.assert_array_equal(gappy.states[:5000], filtered(series).states[:5000])


def test_heading_may_turn_through_north():
    """The innovation is wrapped; whole turns in the record change nothing."""
    series, _ = glide_record()
    turned = series.measurements.copy()
    turned[1500:, 2] += 2.0 * np.pi
    prior = filtered(replaced(series, measurements=turned))
    assert prior.gated == prior.reset == 0
    np.testing.assert_allclose(prior.disturbances[:, 5], filtered(series).disturbances[:, 5], atol=1e-9)


def test_an_outlier_is_gated_and_leaves_no_trace():
    series, _ = glide_record()
    corrupted = series.measurements.copy()
    at = 1500
    corrupted[at, 1] += np.radians(20.0)
    prior, clean = filtered(replaced(series, measurements=corrupted)), filtered(series)
    assert (prior.gated, prior.inflated, prior.reset) == (1, 0, 0)
    assert prior.describe().endswith("samples, most of them in pitch")
    assert "most of them" not in clean.describe()
    assert np.abs(prior.states[at:, :3] - clean.states[at:, :3]).max() < 1e-3


@pytest.mark.parametrize(("gated", "reset", "remarked"), [(0, 0, False), (20, 0, False), (21, 0, True), (1, 1, True)])
def test_only_a_share_of_rejected_samples_that_matters_is_remarked(gated, reset, remarked):
    series, _ = glide_record()
    prior = replace(filtered(series), gated=gated, inflated=0, reset=reset, fed=1000)
    estimate = SimpleNamespace(series=series, profile=SimpleNamespace(velocity=None), filtered=prior)
    lines = [line for line in _remarks_on_samples(estimate) if line.startswith("filter")]
    assert bool(lines) is remarked


def test_most_of_no_samples_are_in_no_quantity():
    series, _ = glide_record()
    prior = replace(filtered(series), gated=0, inflated=0, reset=0)
    prior.__dict__["departing"] = "pitch"
    assert prior.describe().endswith(f"0 reset of {prior.fed} samples")


def test_inside_the_vibration_set_the_variance_gives_way_instead():
    series, _ = glide_record()
    controls, corrupted = series.controls.copy(), series.measurements.copy()
    at = 1500
    controls[at - 1 : at + 2, 0] += [1e-4, 2e-4, 1e-4]
    corrupted[at, 1] += np.radians(20.0)
    with_motion = replaced(series, controls=controls, measurements=corrupted)
    assert vibration_set(PETREL, with_motion)[at]
    prior = filtered(with_motion)
    assert (prior.gated, prior.reset) == (0, 0)
    assert prior.inflated >= 1


def test_a_filter_that_lost_the_glider_restarts():
    """The record continues with another dive; after `patience` rejected samples the filter restarts and follows it."""
    series, states = glide_record(steps=3000)
    jumped = series.measurements.copy()
    jumped[1500:, 3] += 60.0
    prior = filtered(replaced(series, measurements=jumped))
    assert prior.reset >= 1
    assert prior.gated >= SETTINGS.filter.patience - 1
    np.testing.assert_allclose(prior.states[-500:, 5], jumped[-500:, 3], atol=0.2)
    np.testing.assert_allclose(prior.states[-1, 6], states[-1, 6], atol=0.05)


# Side by side


def request(series, platform=PETREL):
    return prepare_profile(Glider(platform), series)


def assert_same(estimate, other):
    np.testing.assert_array_equal(estimate.states, other.states)
    np.testing.assert_array_equal(estimate.disturbances, other.disturbances)
    assert estimate.describe() == other.describe()


def cut(series, n):
    """Return the first n steps of a record."""
    return replaced(
        series, time=series.time[: n + 1], measurements=series.measurements[: n + 1], weights=series.weights[: n + 1],
        controls=series.controls[:n], sample_index=series.sample_index[series.sample_index <= n],
    )  # fmt: skip


def test_a_profile_gives_the_same_whatever_is_computed_with_it(twin):
    """Each of more profiles than lanes, of two hulls and many lengths, gives the same as alone, bit for bit."""
    series = [cut(profile_series(twin, number, SETTINGS), 2000 + 117 * number) for number in (1, 2, 3, 4)]
    slow = replaced(series[0], sample_interval=4.0, sample_index=series[0].sample_index[::4])
    seawing = read_platform("seawing")
    requests = [*map(request, series), request(slow), request(series[1], seawing)] * 2
    together = to_the_end(requests)
    for one, estimate in zip(requests, together, strict=True):
        assert_same(estimate, to_the_end([one])[0])


def with_outliers(series, share):
    """Return a record with junk in a fraction of its pitch samples."""
    measurements = series.measurements.copy()
    bad = np.random.default_rng(0).choice(series.sample_index, round(share * len(series.sample_index)), replace=False)
    measurements[bad, 1] += np.radians(30.0)
    return replaced(series, measurements=measurements)


def test_every_profile_gets_the_first_prior_that_can_follow_it(twin, monkeypatch):
    """Calm, gusty, hopeless and empty records are filtered together; each gets its result or the reason for none."""
    searched = []
    monkeypatch.setattr(filter_module, "describe_rest", lambda series: searched.append(series) or "at rest")
    scenario = load_scenario("paper").replaced({"depth": 150.0, "depth_spread": 0.0, "profiles": 1})
    gusty = resample(simulate_profile(PETREL, scenario, 0)[0], SETTINGS.step, SETTINGS.gap_limit(1.0))
    calm = cut(profile_series(twin, 1, SETTINGS), 4000)
    empty = replaced(calm, weights=np.zeros_like(calm.weights))
    requests = [request(series) for series in (calm, gusty, with_outliers(calm, 0.125), empty)]
    first, second = candidate_priors(PETREL).items()
    answers = run_filters(requests, SETTINGS)
    for answer, series, prior in ((answers[0], calm, first), (answers[1], gusty, second)):
        assert (answer.prior_name, answer.prior) == prior
        assert_same(answer, filtered(series, platform=PETREL.model_copy(update={"prior": prior[1]})))
    whole = filtered(with_outliers(calm, 0.125), platform=PETREL.model_copy(update={"prior": second[1]}))
    assert str(answers[2]).startswith(f"{whole.describe()}, more than 5%: the hull's model does not follow")
    assert "; at rest, or raise" in str(answers[2])
    assert searched == [requests[2].series]  # Only a refused record is searched for a rest.
    assert "no sample of roll, pitch, heading and depth together" in str(answers[3])


@pytest.mark.parametrize("hull", shipped_platforms())
def test_every_hull_follows_the_default_scenario(hull):
    """Even hulls with slow sensors do, although yaw impulses are beyond their usual prior."""
    platform, scenario = read_platform(hull), load_scenario("impulses")
    record, _ = simulate_profile(platform, scenario, 1)
    series = resample(record, SETTINGS.step, SETTINGS.gap_limit(platform.sensors.sample_interval))
    (answer,) = run_filters([request(series, platform)], SETTINGS)
    assert answer.rejected_fraction < SETTINGS.filter.max_rejected_fraction


def test_slow_hulls_are_freer_in_yaw_alone():
    usual, rough = candidate_priors(read_platform("slocum")).values()
    assert (usual.deviation[:5], usual.correlation_time) == (rough.deviation[:5], rough.correlation_time)
    assert rough.deviation[5] > usual.deviation[5]


def test_a_prior_of_the_platform_s_own_is_the_only_candidate(twin):
    own = PETREL.model_copy(update={"prior": default_prior(PETREL)})
    series = with_outliers(cut(profile_series(twin, 1, SETTINGS), 4000), 0.125)
    (answer,) = run_filters([request(series, own)], SETTINGS)
    assert isinstance(answer, ProfileError)
    assert filtered(series).describe() in str(answer)


# Slow sensors


def test_a_slow_record_is_fed_interpolated_without_making_up_information():
    fast, _ = glide_record()
    slow = replaced(fast, sample_interval=20.0, sample_index=np.arange(0, 3001, 200))
    once, repeated = (measurement_variance(PETREL, series, SETTINGS) for series in (fast, slow))
    quantum = PETREL.sensors.attitude_resolution_rad**2 / 12.0
    np.testing.assert_allclose(once, [quantum, quantum, quantum, PETREL.sensors.depth_noise**2])
    prior = filtered(slow)
    assert prior.fed == 301
    # Information per second, fed samples over their variance, equals that of the true samples.
    np.testing.assert_allclose(1.0 / repeated / SETTINGS.filter.feed_interval, 1.0 / once / 20.0)


def test_a_record_of_two_seconds_is_fed_as_it_is():
    series, _ = glide_record(sample_interval=2.0)
    prior = filtered(series)
    assert prior.fed == 151
    quantum = PETREL.sensors.attitude_resolution_rad**2 / 12.0
    assert measurement_variance(PETREL, series, SETTINGS)[0] == pytest.approx(quantum)


def test_slow_hulls_have_a_prior_of_their_own():
    fast, slow = default_prior(PETREL), default_prior(read_platform("seaexplorer"))
    assert slow.deviation[5] < fast.deviation[5]
    assert slow.deviation[4] > fast.deviation[4]


# Failure


def test_a_record_that_the_hull_does_not_follow_fails_with_the_counts(twin):
    """An eighth of the pitch record is junk; the filter rejects it, and the profile fails instead of being guessed."""
    series = profile_series(twin, 1, SETTINGS)
    rng = np.random.default_rng(0)
    corrupted = series.measurements.copy()
    bad = rng.choice(series.sample_index, len(series.sample_index) // 8, replace=False)
    corrupted[bad, 1] += np.radians(30.0)
    with pytest.raises(
        ProfileError,
        match=r"filter: \d+ gated, \d+ inflated, \d+ reset of \d+ samples, most of them in \w+, more than 5%",
    ):
        estimate_profile(request(replaced(series, measurements=corrupted)), SETTINGS)
    lenient = EstimationSettings.model_validate({"filter": {"max_rejected_fraction": 0.5}})
    assert estimate_profile(request(replaced(series, measurements=corrupted)), lenient).filtered.gated >= len(bad) // 2


def test_a_profile_with_nothing_to_feed_fails():
    series, _ = glide_record()
    with pytest.raises(ProfileError, match="no sample of roll, pitch, heading and depth together"):
        filtered(replaced(series, weights=np.zeros_like(series.weights)))


def twin_series(name, seed=0, depth=150.0):
    scenario = load_scenario(name).replaced({"depth": depth, "depth_spread": 0.0, "profiles": 1})
    record, _ = simulate_profile(PETREL, scenario, seed)
    return resample(record, SETTINGS.step, SETTINGS.gap_limit(1.0))


def test_gusts_that_the_calm_prior_cannot_follow_are_followed_by_the_second():
    """In lateral gusts and sheared water, the calm prior rejects far over 5 %, and that for rough water hardly any."""
    series = twin_series("paper")
    (calm,) = filter_with_priors([request(series)], [default_prior(PETREL)], SETTINGS)
    assert calm.rejected_fraction > 0.05
    estimate = estimate_profile(request(series), SETTINGS)
    assert estimate.filtered.prior_name == "rough_water"
    assert estimate.filtered.rejected_fraction <= 0.05
    assert any("gust prior" in line for line in remarks(PETREL, estimate))
    with pytest.raises(ProfileError, match="more than 5%"):
        estimate_profile(request(series, PETREL.model_copy(update={"prior": default_prior(PETREL)})), SETTINGS)


@pytest.mark.parametrize(
    ("name", "prior"), [("demo", "rough_water"), ("calm", "usual"), ("impulses", "usual"), ("stratified", "usual")]
)
def test_weak_gusts_that_contradict_the_calm_prior_are_followed_by_the_second(name, prior):
    """The calm prior rejects few samples of weak gusts; its innovations are far larger than it expects."""
    estimate = run_filter(request(twin_series(name, 1, 80.0)), SETTINGS)
    assert estimate.prior_name == prior


@pytest.mark.parametrize(
    ("name", "sway", "yaw", "chosen"),
    [("demo", 1.0, 1.0, "second"), ("impulses", 30.0, 1.0, "usual"), ("impulses", 1.0, 1e-3, "usual")],
    ids=["likelier", "too wide", "refused"],
)
def test_the_more_likely_of_two_priors_is_used(name, sway, yaw, chosen, monkeypatch):
    """A second prior that rejects more than the allowed share of the samples is not used, however likely."""
    deviation = (0.4, sway, 0.4, 0.3, 0.15, yaw)
    second = DisturbancePrior(deviation=deviation, correlation_time=ROUGH_WATER.correlation_time)
    priors = {"usual": default_prior(PETREL), "second": second}
    monkeypatch.setattr(filter_module, "candidate_priors", lambda *_: priors)
    monkeypatch.setattr(filter_module, "contradict_prior", lambda *_: True)
    assert run_filter(request(twin_series(name, 1, 60.0)), SETTINGS).prior_name == chosen


@pytest.mark.parametrize(
    ("departing", "remedy"), [("heading", "`gliderhpc tune`"), ("pitch", "neutral volume"), ("", "neutral volume")]
)
def test_the_remedy_for_a_refused_profile_depends_on_what_departs(departing, remedy):
    """A hull out of trim shows in pitch and depth; water that turns the glider, in roll and heading."""
    estimate = SimpleNamespace(departing=departing, describe=lambda: "filter: 9 gated")
    assert remedy in str(refusal(estimate, SETTINGS))
