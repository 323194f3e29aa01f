"""Filter of the nowcast, compared with dense least squares, and its ellipses on synthetic series."""

import numpy as np
import pytest

from gliderhpc.surfacing.nowcast import CurrentObservation, CurrentProcess, CurrentState, filtered_states, nowcasts

HOUR = 3600.0


def filter_currents(observations, process):
    """Return the state after all observations."""
    *_, last = filtered_states(observations, process)
    return last


def nowcast(observations, *tides):
    """Return the nowcast after all observations."""
    *_, last = nowcasts(observations, *tides)
    return last


def _dense_covariance(spans, process, nodes=80):
    """Return the covariance of one component's averages over spans, by Gauss-Legendre quadrature on both axes.

    It is independent of the filter: there is no state and no transition.
    """
    points, weights = np.polynomial.legendre.leggauss(nodes)
    times = np.array([0.5 * (a + b) + 0.5 * (b - a) * points for a, b in spans])
    lags = np.abs(times[:, :, None, None] - times[None, None])
    kernel = process.mean_deviation**2 + process.deviation**2 * np.exp(-lags / process.correlation_time)
    for period in process.periods:
        kernel += process.tidal_deviation**2 * np.cos(2.0 * np.pi * lags / period)
    return 0.25 * np.einsum("m,n,imjn->ij", weights, weights, kernel)


@pytest.mark.parametrize("tide", [{}, {"tidal_deviation": 0.07, "periods": (12.42 * HOUR, 23.93 * HOUR)}])
def test_the_filter_is_dense_least_squares_on_averages_and_points(tide):
    """Averages and instantaneous values of `u = m + g + sum c_k` are observed; the next average is predicted."""
    rng = np.random.default_rng(3)
    process = CurrentProcess(0.12, 9.0 * HOUR, 0.4, **tide)
    spans = [(0.0, 4.0), (4.2, 4.2), (4.5, 8.0), (8.3, 8.3), (20.0, 24.0)]
    spans = [(HOUR * a, HOUR * b) for a, b in spans]
    ahead = (25.0 * HOUR, 29.0 * HOUR)
    noise = rng.uniform(0.01, 0.05, len(spans)) ** 2
    velocities = rng.normal(0.0, 0.2, (len(spans), 2))
    observations = [CurrentObservation(*s, v, n) for s, v, n in zip(spans, velocities, noise, strict=True)]
    state = filter_currents(observations, process)

    both = np.kron(_dense_covariance([*spans, ahead], process), np.eye(2))
    seen = 2 * len(spans)
    data = both[:seen, :seen] + np.diag(np.repeat(noise, 2))
    gain = np.linalg.solve(data, both[:seen, seen:]).T
    mean, covariance = gain @ velocities.ravel(), both[seen:, seen:] - gain @ both[:seen, seen:]

    drift, variance = state.drift(*ahead)
    length = ahead[1] - ahead[0]
    # At the kernel's kink on the diagonal the quadrature is accurate to a few 1e-5 of its value.
    np.testing.assert_allclose(drift / length, mean, atol=2e-5)
    np.testing.assert_allclose(variance / length**2 * np.eye(2), covariance, atol=2e-6)
    likelihood = -0.5 * (
        velocities.ravel() @ np.linalg.solve(data, velocities.ravel()) + np.linalg.slogdet(2.0 * np.pi * data)[1]
    )
    assert state.log_likelihood == pytest.approx(likelihood, abs=0.02)


def test_a_transition_is_two_of_half_the_time():
    process = CurrentProcess(0.1, 7.0 * HOUR)
    whole, noise = process.transition(2.0 * HOUR)
    half, half_noise = process.transition(HOUR)
    np.testing.assert_allclose(half @ half, whole, rtol=1e-12)
    np.testing.assert_allclose(half @ half_noise @ half.T + half_noise, noise, rtol=1e-9, atol=1e-12)


def test_a_line_is_its_cosine_and_its_integral_the_quadrature():
    """`dc/dt = -w s`, `ds/dt = w c` give `c(t) = A cos(w t + phase)`; the third state is the integral of `u`."""
    period, amplitude, phase, elapsed = 12.42 * HOUR, 0.11, 0.7, 5.3 * HOUR
    process = CurrentProcess(0.1, 7.0 * HOUR, tidal_deviation=0.1, periods=(period,))
    mean = np.zeros((5, 2))
    mean[3], mean[4] = amplitude * np.cos(phase), amplitude * np.sin(phase)
    ahead = CurrentState(process, 0.0, mean, np.zeros((5, 5))).at(elapsed)
    points, weights = np.polynomial.legendre.leggauss(30)
    times = 0.5 * elapsed * (1.0 + points)
    integral = 0.5 * elapsed * weights @ (amplitude * np.cos(2.0 * np.pi * times / period + phase))
    assert ahead.mean[3] == pytest.approx(amplitude * np.cos(2.0 * np.pi * elapsed / period + phase), rel=1e-12)
    assert ahead.mean[2] == pytest.approx(integral, rel=1e-12)


def test_a_batch_of_processes_is_each_alone():
    rng = np.random.default_rng(5)
    observations = [
        CurrentObservation(HOUR * k, HOUR * (k + 0.8), rng.normal(0.0, 0.1, 2), 1e-4) for k in range(0, 30, 2)
    ]
    deviations, hours, tidal = np.array([0.04, 0.2]), np.array([5.0, 40.0]), np.array([0.0, 0.1])
    periods = (12.42 * HOUR,)
    batch = filter_currents(observations, CurrentProcess(deviations, HOUR * hours, 0.5, tidal, periods))
    drifts, variances = batch.drift(31.0 * HOUR, 34.0 * HOUR)
    for k in range(2):
        alone = filter_currents(observations, CurrentProcess(deviations[k], HOUR * hours[k], 0.5, tidal[k], periods))
        drift, variance = alone.drift(31.0 * HOUR, 34.0 * HOUR)
        np.testing.assert_allclose(drifts[k], drift, rtol=1e-9)
        np.testing.assert_allclose(variances[k], variance, rtol=1e-9, atol=1e-6)
        assert batch.log_likelihood[k] == pytest.approx(float(alone.log_likelihood))


def _tidal_misses(amplitude):
    """Return the errors of the next average (m/s) with and without tidal lines after 40 dives, over 20 series."""
    rng, misses = np.random.default_rng(11), []
    for _ in range(20):
        averages, measured = _series(rng, 40, CurrentProcess(0.03, 20.0 * HOUR))
        times = 4.0 * HOUR * (np.arange(41) + 0.5)
        tide = amplitude * np.cos(2.0 * np.pi * times / (12.4206012 * HOUR) + rng.uniform(0.0, 2.0 * np.pi))[:, None]
        observations = [
            CurrentObservation(time - 2.0 * HOUR, time + 2.0 * HOUR, velocity, 1e-4)
            for time, velocity in zip(times[:-1], measured + tide[:-1], strict=True)
        ]
        wanted = averages[-1] + tide[-1]
        found = [nowcast(observations, *lines).drift(160.0 * HOUR, 164.0 * HOUR)[0] for lines in ((), ((),))]
        misses.append([np.linalg.norm(drift / (4.0 * HOUR) - wanted) for drift in found])
    return np.median(misses, axis=0)


@pytest.mark.long
def test_tidal_lines_halve_the_error_with_a_tide_and_do_no_harm_without():
    with_lines, without = _tidal_misses(0.1)
    assert with_lines < 0.5 * without
    with_lines, without = _tidal_misses(0.0)
    assert with_lines < 1.1 * without


def _series(rng, dives, process, step=300.0):
    """Draw the current of a series of four-hour dives, by Euler steps of the process, and its averages with noise."""
    count = round((dives + 1) * 4.0 * HOUR / step)
    mean = rng.normal(0.0, 0.15, 2)
    kick = process.deviation * np.sqrt(2.0 * step / process.correlation_time)
    g = np.empty((count, 2))
    g[0] = rng.normal(0.0, process.deviation, 2)
    for k in range(1, count):
        g[k] = g[k - 1] * (1.0 - step / process.correlation_time) + rng.normal(0.0, kick, 2)
    averages = (mean + g).reshape(dives + 1, -1, 2).mean(axis=1)
    return averages, averages[:-1] + rng.normal(0.0, 0.01, (dives, 2))


@pytest.mark.long
def test_the_ellipse_of_the_next_average_holds_its_part():
    """The process is chosen by likelihood; the fraction is within three standard deviations of a binomial."""
    rng, inside, runs = np.random.default_rng(7), 0, 120
    for _ in range(runs):
        process = CurrentProcess(rng.choice([0.05, 0.1]), rng.choice([10.0, 30.0]) * HOUR)
        averages, measured = _series(rng, 12, process)
        begins = 4.0 * HOUR * np.arange(12)
        observations = [
            CurrentObservation(begin, begin + 4.0 * HOUR, velocity, 1e-4)
            for begin, velocity in zip(begins, measured, strict=True)
        ]
        state = nowcast(observations)
        drift, covariance = state.drift(48.0 * HOUR, 52.0 * HOUR)
        miss = averages[-1] * 4.0 * HOUR - drift
        inside += float(miss @ np.linalg.solve(covariance, miss)) <= -2.0 * np.log(1.0 - 0.68)
    assert abs(inside / runs - 0.68) < 3.0 * np.sqrt(0.68 * 0.32 / runs)


def test_observations_out_of_order_are_refused():
    process, still = CurrentProcess(0.1, HOUR), np.zeros(2)
    observations = [CurrentObservation(10.0, 20.0, still, 1.0), CurrentObservation(15.0, 30.0, still, 1.0)]
    with pytest.raises(ValueError, match=r"from 15\.0 s"):
        filter_currents(observations, process)
