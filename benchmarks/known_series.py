"""Series with known statistics, on which the statistics of this package are tested.

The intermittent series and its Gaussian twin are the simulator's own gust fields; the others are the ways in which a
series that is no turbulence may look like it.
"""

import math

import numpy as np
import scipy
from numpy.typing import NDArray

from gliderhpc.simulator.sections import Gusts
from gliderhpc.simulator.water import gust_field, node_spacing

Array = NDArray[np.float64]

CASCADE = Gusts(kind="cascade", rms=1.0, outer=256.0, inner=0.25)
"""A cascade over ten octaves; its unit of length stands for a second."""


def cascade(count: int, rng: np.random.Generator, settings: Gusts = CASCADE) -> Array:
    """She and Leveque's log-Poisson cascade ``(count,)`` at unit distances."""
    every = round(1.0 / node_spacing(settings))
    return gust_field(settings, float(count), rng)[::every][:count]


def gaussian_twin(count: int, rng: np.random.Generator, settings: Gusts = CASCADE) -> Array:
    """Gaussian series ``(count,)`` of a cascade's expected spectrum."""
    return cascade(count, rng, settings.model_copy(update={"kind": "gaussian"}))


def fractional_brownian_motion(count: int, hurst: float, rng: np.random.Generator) -> Array:
    """Fractional Brownian motion ``(count,)``: increments of variance ``lag^(2 H)``, exactly (Davies & Harte 1987)."""
    k = np.arange(count + 1.0)
    covariance = 0.5 * (np.abs(k + 1) ** (2 * hurst) - 2 * k ** (2 * hurst) + np.abs(k - 1) ** (2 * hurst))
    power = np.maximum(scipy.fft.rfft(np.concatenate([covariance[:-1], covariance[:0:-1]])).real, 0.0)
    size = 2 * count
    noise = rng.standard_normal(len(power)) + 1j * rng.standard_normal(len(power))
    noise[[0, -1]] = math.sqrt(2.0) * noise[[0, -1]].real
    return np.cumsum(scipy.fft.irfft(np.sqrt(0.5 * power * size) * noise, size)[:count])


def autoregressive(count: int, coefficients: tuple[float, ...], rng: np.random.Generator) -> Array:
    """Gaussian autoregressive process ``(count,)``, its start-up transient dropped."""
    transient = 1000
    driven = scipy.signal.lfilter([1.0], [1.0, *(-c for c in coefficients)], rng.standard_normal(count + transient))
    return np.asarray(driven)[transient:]


def shot_train(count: int, interval: float, width: float, rng: np.random.Generator) -> Array:
    """Poisson train ``(count,)`` of Gaussian pulses of normal amplitude, `interval` apart on average."""
    amplitudes = rng.standard_normal(count) * rng.poisson(1.0 / interval, count)
    reach = math.ceil(6.0 * width)
    pulse = np.exp(-0.5 * (np.arange(-reach, reach + 1) / width) ** 2)
    return np.asarray(scipy.signal.fftconvolve(amplitudes, pulse, mode="same"))


def shot_flatness(interval: float, width: float, lag: float) -> float:
    """Flatness of the increments of `shot_train` over a lag, by Campbell's theorem.

    Notes
    -----
    A Poisson train of rate ``1 / T``, pulses ``a h(t)``: cumulants ``k_n = <a^n> int h^n dt / T``, here of the pulse's
    own increment, and ``F = 3 + k_4 / k_2^2``, with ``<a^4> = 3 <a^2>^2`` for normal amplitudes.
    """
    t = np.linspace(-12.0 * width - lag, 12.0 * width + lag, 20001)
    difference = np.exp(-0.5 * ((t + lag) / width) ** 2) - np.exp(-0.5 * (t / width) ** 2)
    second, fourth = (np.trapezoid(difference**n, t) for n in (2, 4))
    return float(3.0 + 3.0 * interval * fourth / second**2)
