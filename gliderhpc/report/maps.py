"""Elements of maps: positions of the dives, frame, arrows of currents with a scale, and error ellipses."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gliderhpc.findings.drawing import FILTER, SMALL
from gliderhpc.observations.fixes import midpoint
from gliderhpc.studies.library.scores import covariance_matrix

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.quiver import Quiver

Array = NDArray[np.float64]
Pair = tuple[Array, Array] | tuple[float, float]

CIRCLE = np.stack([np.cos(np.linspace(0.0, 2.0 * np.pi, 61)), np.sin(np.linspace(0.0, 2.0 * np.pi, 61))])
"""Unit circle, (2, 61)."""

_DEGREE = 111_195.0
"""Length of a degree of latitude, m."""

_MIN_EXTENT = 2000.0
"""Minimum extent of a map, m."""

_ASPECT_RATIO, _MARGIN_FACTOR = 1.3, 1.12
"""Width over height of the map, and size of the map relative to its content."""


def dive_midpoints(table: xr.Dataset) -> Array:
    """Return latitude and longitude ``(n, 2)`` midway between the fixes of each dive on the WGS84 ellipsoid, degrees.

    Parameters
    ----------
    table : xarray.Dataset
        Rows of an archive's table.
    """
    names = ("entry_latitude", "entry_longitude", "exit_latitude", "exit_longitude")
    ends = zip(*(table[name].values.tolist() for name in names), strict=True)
    return np.array([midpoint((a, b), (c, d)) for a, b, c, d in ends])


def map_extent(points: Array, shrink: float) -> float:
    """Return the diagonal of the region with some points, in degrees of latitude, or that of the smallest map.

    Parameters
    ----------
    points : (n, 2) array
        Longitudes and latitudes, degrees.
    shrink : float
        Length of a degree of longitude over that of a degree of latitude.
    """
    return max(float(np.hypot(*(np.ptp(points, axis=0) * [shrink, 1.0]))), _MIN_EXTENT / _DEGREE)


def frame_map(axes: Axes, points: Array, shrink: float) -> None:
    """Set limits around the points, with a margin and a fixed aspect ratio."""
    low, high = points.min(axis=0), points.max(axis=0)
    middle, (width, height) = 0.5 * (low + high), (high - low) * [shrink, 1.0]
    height = _MARGIN_FACTOR * max(height, width / _ASPECT_RATIO, _MIN_EXTENT / _DEGREE)
    axes.set_xlim(middle[0] - 0.5 * _ASPECT_RATIO * height / shrink, middle[0] + 0.5 * _ASPECT_RATIO * height / shrink)
    axes.set_ylim(middle[1] - 0.5 * height, middle[1] + 0.5 * height)


def draw_arrows(axes: Axes, tails: Pair, lengths: Pair, *, width: float, name: str) -> Quiver:
    """Draw depth-averaged currents as arrows in their true direction.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        Panel.
    tails, lengths : pair of (k,) arrays or floats
        Positions and components along x and y, in units of the axes.
    width : float
        Width of a shaft relative to the panel's.
    name : str
        Estimate of the current, for the legend.
    """
    arrows = axes.quiver(
        *tails, *lengths, color=FILTER, angles="xy", scale_units="xy", scale=1.0, width=width, zorder=4.0
    )
    arrows.set_label(f"depth-averaged current, {name}")
    return arrows


def scale_arrow(axes: Axes, arrows: Quiver, length: float, text: str) -> None:
    """Draw a labelled scale arrow at the lower right; its length is in units of the x axis."""
    axes.quiverkey(arrows, 0.86, 0.04, length, text, labelpos="N", fontproperties={"size": SMALL + 1})


def round_speed(speed: float) -> float:
    """Round a speed (m/s) to 1, 2 or 5 times a power of ten, for a scale arrow."""
    if speed <= 0.0:
        return 0.1
    power = 10.0 ** math.floor(math.log10(speed))
    return float(min((1.0, 2.0, 5.0, 10.0), key=lambda digit: abs(digit * power - speed)) * power)


def covariance_factors(north_std: Array, east_std: Array, covariance: Array) -> NDArray[np.float64]:
    """Return factors ``(n, 2, 2)`` of the covariances of (east, north); they map the unit circle to the ellipse."""
    matrices = covariance_matrix(east_std, north_std, covariance)
    values, vectors = np.linalg.eigh(np.nan_to_num(matrices))
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :])
