"""Vertical scales that the depth-resolved current can show, from the settings and the flight of the hull.

Three filters separate the current across the hull from the solution of eq. 41. The hull follows the water in sideslip:
to first order the relative velocity obeys ``(m + M_f2) dv/dt = -m dU/dt - |K_beta| V v``, so of a current of period P
there remains ``m / (m + M_f2)`` times a high-pass of time constant ``tau = (m + M_f2) / (|K_beta| V)``. The moving
average that is taken out leaves ``1 - sin(x) / x``, ``x = pi baseline / P``. Savitzky-Golay leaves the transform of its
weights. A glider that sinks or rises at W meets a vertical scale in the period scale / W.
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
"""Share of the amplitude below which a scale counts as not seen."""

_HALF_SINC = 0.603355
"""Root of ``sin(pi x) / (pi x) = 1/2``."""

_WIDTH = 150
"""Letters of a line below a figure."""

PERIODS = np.geomspace(1.0, 1000.0, 4001)
"""Among which the ends of the band are sought, s."""


@dataclass(frozen=True)
class Passband:
    """Transfer of vertical scales to the retrieved current.

    Attributes
    ----------
    vertical_speed : float
        Magnitude, m/s.
    following : float
        Time constant in which the hull follows the water, s.
    share : float
        Share that is left of currents that change much faster than that: ``m / (m + M_f2)``.
    step : float
        Between the samples that are smoothed, s.
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
        """Vertical scale from which on the moving average leaves less than half, m."""
        return self._scale(PERIODS[self.baseline_response(PERIODS) >= HALF].max())

    @property
    def smoothing_limit(self) -> float:
        """Vertical scale below which the smoothing leaves less than half, m."""
        below = np.flatnonzero(self.smoothing_response(PERIODS) < HALF)
        return self._scale(PERIODS[below.max() + 1] if below.size else PERIODS[0])

    @property
    def following_limit(self) -> float:
        """Vertical scale beyond which the hull follows the water more than it slips, m: ``2 pi tau W``."""
        return self._scale(2.0 * np.pi * self.following)

    @property
    def bin_limit(self) -> float:
        """Vertical scale below which means over bins of depth leave less than half, m."""
        return float(self.settings.bin / _HALF_SINC)

    @property
    def band(self) -> tuple[float, float]:
        """Vertical scales between which at least half of the largest response is left, m."""
        response = self.response(PERIODS)
        seen = PERIODS[response >= HALF * response.max()]
        return self._scale(seen.min()), self._scale(seen.max())

    def baseline_response(self, periods: Array) -> Array:
        """Amplitude that taking the moving average out leaves, at periods (s)."""
        return np.asarray(np.abs(1.0 - np.sinc(self.settings.baseline / periods)))

    def smoothing_response(self, periods: Array) -> Array:
        """Amplitude that Savitzky-Golay leaves, at periods (s)."""
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
        """Lateral current as it is retrieved over the true one, at periods (s), were the estimate perfect."""
        return self.slip_response(periods) * self.baseline_response(periods) * self.smoothing_response(periods)

    def _scale(self, period: float) -> float:
        return float(self.vertical_speed * period)


def passband(
    platform: Platform, *, speed: float, vertical_speed: float, step: float, settings: DepthResolvedSettings
) -> Passband:
    """Return the passband of a hull (m/s through the water and vertically) whose samples lie `step` s apart."""
    mass = platform.mass.total
    effective = mass + platform.added_mass[1]
    return Passband(
        vertical_speed=vertical_speed,
        following=effective / (abs(platform.viscous.K_beta) * speed),
        share=mass / effective,
        step=step,
        settings=settings,
    )


def unseen_in_bins(band: Passband) -> str:
    """Describe the attenuation by means over bins of depth, in lines for a figure."""
    return textwrap.fill(
        f"Bins of {band.settings.bin:g} m leave less than half of scales shorter than {band.bin_limit:.2g} m: what the "
        f"records show is averaged {'away' if band.bin_limit > band.baseline_limit else 'down'} in them.",
        _WIDTH,
    )


def unseen(band: Passband) -> str:
    """Describe the vertical scales that are not seen, in lines for a figure."""
    settings = band.settings
    text = (
        f"Vertical scales that do not show, at {band.vertical_speed:.2g} m/s up or down: longer than "
        f"{band.baseline_limit:.2g} m (less than half passes the moving average of {settings.baseline:g} s) and "
        f"shorter than {band.smoothing_limit:.2g} m (less than half passes the smoothing over "
        f"{settings.smoothing:g} s, order {settings.order}). From {band.following_limit:.2g} m on the hull follows "
        f"the water more than it slips ({band.following:.2g} s): a steady current leaves no trace, the yaw moment "
        "feels how fast the current across the hull changes. Amplitudes are a lower bound."
    )
    return textwrap.fill(text, _WIDTH)
