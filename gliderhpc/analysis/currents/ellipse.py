"""The depth-averaged current's uncertainty, term by term, and its ellipse (section 5.5)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gliderhpc.analysis.current_difference import sigma_distance
from gliderhpc.estimation.currents import CurrentSettings, current_covariance
from gliderhpc.estimation.self_motion import SelfMotion

Array = NDArray[np.float64]

COVERAGE = {1: 0.393, 2: 0.865}
"""Probability inside the ellipse of so many sigma, in two dimensions."""


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Terms of the current's uncertainty, m/s, and their sum.

    Attributes
    ----------
    axial, cross_track, magnitude, heading, fixes, actuation : float
        Standard deviations: along and across the track, along and across the current, and (either way) by the fixes and
        by the displacement bridged while the actuators moved.
    covariance : (2, 2)
        Of north and east, m2/s2.
    """

    axial: float
    cross_track: float
    magnitude: float
    heading: float
    fixes: float
    actuation: float
    covariance: Array

    @property
    def axes(self) -> tuple[float, float]:
        """Semi-axes of the 1-sigma ellipse, m/s, the longer first."""
        smaller, larger = np.sqrt(np.maximum(np.linalg.eigvalsh(self.covariance), 0.0))
        return float(larger), float(smaller)

    @property
    def orientation(self) -> float:
        """Direction of the longer axis, degrees clockwise from north, in [0, 180)."""
        north, east = np.linalg.eigh(self.covariance)[1][:, 1]
        return float(np.degrees(np.arctan2(east, north)) % 180.0)

    @property
    def area(self) -> float:
        """Of the 1-sigma ellipse, m2/s2."""
        return float(np.pi * np.sqrt(max(np.linalg.det(self.covariance), 0.0)))

    def sigmas(self, difference: Array) -> float:
        """Distance of a difference ``(2,)`` (m/s, north and east) in sigma (Mahalanobis)."""
        return sigma_distance(difference, self.covariance)


def uncertainty(
    velocity: Array, track: Array, duration: float, bridged: float, actuation_error: float, settings: CurrentSettings
) -> Uncertainty:
    """Combine the terms.

    Parameters
    ----------
    velocity : (2,)
        The current, north and east, m/s.
    track : (2,)
        Displacement through the water, north and east, m.
    duration : float
        From fix to fix, s.
    bridged : float
        Length of the displacement that was put into the actuation intervals, m.
    actuation_error : float
        Relative error of that.
    settings : CurrentSettings
        Axial, cross-track, relative and heading error, and that of a fix.
    """
    speed = float(np.linalg.norm(velocity))
    fixes = float(np.sqrt(2.0) * settings.fix_error / duration)
    actuation = actuation_error * bridged / duration
    motion = SelfMotion(np.asarray(track)[None, :], bridged)
    covariance = current_covariance(velocity, motion, settings) + (fixes**2 + actuation**2) * np.eye(2)
    return Uncertainty(
        axial=settings.axial_error,
        cross_track=settings.cross_track_error,
        magnitude=settings.relative_error * speed,
        heading=float(np.radians(settings.heading_error)) * speed,
        fixes=fixes,
        actuation=actuation,
        covariance=covariance,
    )
