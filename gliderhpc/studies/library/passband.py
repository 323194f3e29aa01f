"""Vertical scales that the depth-resolved current can resolve, from the settings and the flight of the hull.

Three filters lie between the current across the hull and the solution of eq. 41. First, the hull follows the water in
sideslip: to first order the relative velocity obeys ``(m + M_f2) dv/dt = -m dU/dt - |K_beta| V v``. The response to a
current of period P is therefore ``m / (m + M_f2)`` times a high-pass of time constant
``tau = (m + M_f2) / (|K_beta| V)``. Second, subtracting the moving average has the response ``1 - sin(x) / x``,
``x = pi baseline / P``. Third, the response of Savitzky and Golay's filter is the Fourier transform of its weights. A
glider that sinks or rises at W crosses a vertical scale in the period scale / W.
"""

import textwrap
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from gliderhpc.platform import Platform
from gliderhpc.studies.library.retrieval import DepthResolvedSettings, smoothing_samples

Array = NDArray[np.float64]

HALF = 0.5
"""Share of the amplitude below which a scale is regarded as unresolved."""

_HALF_SINC = 0.603355
"""Root of ``sin(pi x) / (pi x) = 1/2``."""

_WIDTH = 150
"""Characters per line below a figure."""

PERIODS = np.geomspace(1.0, 1000.0, 4001)
"""Periods among which the ends of the band are searched, s."""


@dataclass(frozen=True)
class Passband:
    """Transfer of vertical scales to the retrieved current.

    Attributes
    ----------
    vertical_speed : float
        Magnitude of the vertical speed, m/s.
    following : float
        Time constant with which the hull follows the water, s.
    share : float
        Response to currents that change much faster than that: ``m / (m + M_f2)``.
    step : float
        Time between the samples that are smoothed, s.
    settings : DepthResolvedSettings
        Baseline and smoothing.
    """

    vertical_speed: float
    following: float
    share: float
    step: float
    settings: DepthResolvedSettings

    @property
    def baseline_limit(self) -> float:
        """Vertical scale above which subtracting the moving average leaves less than half, m."""
        return self._scale(PERIODS[self.baseline_response(PERIODS) >= HALF].max())

    @property
    def smoothing_limit(self) -> float:
        """Vertical scale below which the smoothing leaves less than half, m."""
        below = np.flatnonzero(self.smoothing_response(PERIODS) < HALF)
        return self._scale(PERIODS[below.max() + 1] if below.size else PERIODS[0])

    @property
    def following_limit(self) -> float:
        """Vertical scale above which the hull follows the water more than it slips, m: ``2 pi tau W``."""
        return self._scale(2.0 * np.pi * self.following)

    @property
    def bin_limit(self) -> float:
        """Vertical scale below which means over depth bins leave less than half, m."""
        return float(self.settings.bin / _HALF_SINC)

    @property
    def band(self) -> tuple[float, float]:
        """Vertical scales between which the response is at least half of its maximum, m."""
        response = self.response(PERIODS)
        seen = PERIODS[response >= HALF * response.max()]
        return self._scale(seen.min()), self._scale(seen.max())

    def baseline_response(self, periods: Array) -> Array:
        """Amplitude left after subtraction of the moving average, at periods (s)."""
        return np.asarray(np.abs(1.0 - np.sinc(self.settings.baseline / periods)))

    def smoothing_response(self, periods: Array) -> Array:
        """Amplitude left by Savitzky and Golay's filter, at periods (s)."""
        window = smoothing_samples(round(self.settings.smoothing / self.step), self.settings.order)
        _, response = scipy.signal.freqz(
            scipy.signal.savgol_coeffs(window, self.settings.order), worN=2.0 * np.pi * self.step / periods
        )
        return np.asarray(np.abs(response))

    def slip_response(self, periods: Array) -> Array:
        """Relative velocity over the current across the hull, at periods (s)."""
        x = 2.0 * np.pi * self.following / periods
        return np.asarray(self.share * x / np.hypot(1.0, x))

    def response(self, periods: Array) -> Array:
        """Ratio of the retrieved lateral current to the true one for a perfect estimate, at periods (s)."""
        return self.slip_response(periods) * self.baseline_response(periods) * self.smoothing_response(periods)

    def _scale(self, period: float) -> float:
        return float(self.vertical_speed * period)


def passband(
    platform: Platform, *, speed: float, vertical_speed: float, step: float, settings: DepthResolvedSettings
) -> Passband:
    """Return the passband of a hull at given total and vertical speeds (m/s), for samples that lie `step` s apart."""
    mass = platform.mass.total
    effective = mass + platform.added_mass[1]
    return Passband(
        vertical_speed=vertical_speed,
        following=effective / (abs(platform.viscous.K_beta) * speed),
        share=mass / effective,
        step=step,
        settings=settings,
    )


def describe_bin_averaging(band: Passband) -> str:
    """Describe the attenuation by means over depth bins, in lines of text for a figure."""
    return textwrap.fill(
        f"Bins of {band.settings.bin:g} m retain less than half of scales shorter than {band.bin_limit:.2g} m: what "
        f"the records show is averaged {'away' if band.bin_limit > band.baseline_limit else 'down'} in them.",
        _WIDTH,
    )


def describe_unresolved(band: Passband) -> str:
    """Describe the unresolved vertical scales, in lines of text for a figure."""
    settings = band.settings
    text = (
        f"Vertical scales that are not resolved, at {band.vertical_speed:.2g} m/s up or down: longer than "
        f"{band.baseline_limit:.2g} m (less than half passes the moving average of {settings.baseline:g} s) and "
        f"shorter than {band.smoothing_limit:.2g} m (less than half passes the smoothing over {settings.smoothing:g} "
        f"s, order {settings.order}). From {band.following_limit:.2g} m on the hull follows the water more than it "
        f"slips ({band.following:.2g} s): a steady current leaves no trace, because the yaw moment responds to "
        "changes of the current across the hull. Amplitudes are a lower bound."
    )
    return textwrap.fill(text, _WIDTH)
