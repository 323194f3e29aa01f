"""Water along one profile: its current, and its gusts as a random velocity field along a line.

The field has a prescribed spectrum and is intermittent or Gaussian. It is a sum of wavelets on a dyadic tree (Benzi et
al. 1993). At level j, cells have the length ``outer / 2^j``. The coefficient of a cell is a Gaussian number times the
product of the multipliers W along its branch of the tree. She and Leveque's log-Poisson multipliers
``W = 2^(-1/9) (2/3)^(N/3)``, with N of mean ``2 ln 2``, give ``E[W^p] = 2^(-zeta_p)`` with

    ``zeta_p = p/9 + 2 (1 - (2/3)^(p/3))``,

and increments scale accordingly. With the constant ``W = 2^(-zeta_2 / 2)`` the field is Gaussian and has the same
expected spectrum, of slope ``1 + zeta_2``. For a given slope, every W is multiplied by the same power of two.
"""

import math
from dataclasses import dataclass

import numpy as np
import scipy

from gliderhpc.kernels.current import Field, water_along
from gliderhpc.observations.records import FloatArray
from gliderhpc.seeds import Stream, generator
from gliderhpc.simulator.ocean import CurrentProfile, VerticalMotion, current_profile, draw_vertical_motion
from gliderhpc.simulator.plan import FlightPlan
from gliderhpc.simulator.scenario import Scenario
from gliderhpc.simulator.sections import Gusts
from gliderhpc.vocabulary import she_leveque

NODES_PER_CELL = 4
"""Number of grid nodes in a cell of the smallest scale."""

_WIDTH = 0.35
"""Width of the wavelet (standard deviation of a Mexican hat) in cells, which gives an even variance within a cell."""

_SUPPORT = 5.0
"""Half the wavelet's support, in widths."""

_MARGIN = 3
"""Number of cells of the largest scale on either side of the line, which prevent end effects."""


def spectral_slope(settings: Gusts) -> float:
    """Slope of the spectrum between the largest and the smallest scale; positive for a falling spectrum."""
    return 1.0 + she_leveque(2.0) if settings.slope is None else settings.slope


def levels(settings: Gusts) -> int:
    """Number of levels of the tree below the first."""
    return max(1, round(math.log2(settings.outer / settings.inner)))


def node_spacing(settings: Gusts) -> float:
    """Spacing of the field's nodes, m."""
    return float(settings.outer / (2 ** levels(settings) * NODES_PER_CELL))


def gust_field(settings: Gusts, length: float, rng: np.random.Generator) -> FloatArray:
    """Draw a field with a length of at least `length`.

    Parameters
    ----------
    settings : Gusts
        Kind, strength, scales and slope.
    length : float
        Length of the line, m.
    rng : numpy.random.Generator
        Random generator of the multipliers and the coefficients.

    Returns
    -------
    (n,) array
        Velocity at nodes `node_spacing` apart, m/s; its expected mean square is the square of `Gusts.rms`.
    """
    deepest = levels(settings)
    finest = 2**deepest * NODES_PER_CELL
    roots = math.ceil(length / settings.outer) + 1 + 2 * _MARGIN
    field = np.zeros(roots * finest)
    strength = np.ones(roots)
    for level in range(deepest + 1):
        if level:
            strength = _descended(settings, strength, rng)
        coefficients = strength * rng.standard_normal(len(strength))
        _add_wavelets(field, coefficients, finest >> level)
    inner = field[_MARGIN * finest : len(field) - _MARGIN * finest]
    scaled: FloatArray = settings.rms / _expected_rms(settings) * inner
    return scaled


def with_slopes(values: FloatArray, spacing: float) -> FloatArray:
    """Values and slopes ``(n, 2)`` at uniform nodes; slopes are central differences (a Catmull-Rom spline)."""
    return np.column_stack([values, np.gradient(values, spacing)])


def _descended(settings: Gusts, strength: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Strengths of the next level: those of each cell's two children, multiplied by their W."""
    children = np.repeat(strength, 2)
    steepened = math.pow(2.0, -0.5 * (spectral_slope(settings) - 1.0))
    if settings.kind == "gaussian":
        return children * steepened
    counts = rng.poisson(2.0 * math.log(2.0), len(children))
    multipliers: FloatArray = 2.0 ** (-1.0 / 9.0) * (2.0 / 3.0) ** (counts / 3.0)
    # The multipliers themselves already have an rms of 2^(-zeta_2 / 2) per level.
    multipliers *= steepened * math.pow(2.0, 0.5 * she_leveque(2.0))
    return children * multipliers


def _add_wavelets(field: FloatArray, coefficients: FloatArray, stride: int) -> None:
    """Add one wavelet at the middle of each cell of `stride` nodes."""
    width = _WIDTH * stride
    reach = math.ceil(_SUPPORT * width)
    x = np.arange(-reach, reach + 1) / width
    comb = np.zeros(len(field))
    comb[stride // 2 :: stride] = coefficients
    field += scipy.signal.oaconvolve(comb, (1.0 - x**2) * np.exp(-0.5 * x**2), mode="same")


def _expected_rms(settings: Gusts) -> float:
    """Root mean square of the field before scaling, from the wavelet's energy and the levels' expected squares."""
    energy = _WIDTH * 0.75 * math.sqrt(math.pi)
    ratio = 2.0 ** (1.0 - spectral_slope(settings))
    return math.sqrt(energy * sum(ratio**level for level in range(levels(settings) + 1)))


OVERSHOOT = 50.0
"""Depth below a dive's turning point to which its current is computed (m)."""

_STILL = np.zeros((2, 2))


@dataclass(frozen=True, eq=False)
class WaterMotion:
    """Motion of the water along one profile.

    Attributes
    ----------
    current : CurrentProfile
        Current as a function of depth and time.
    gusts : (n, 2) array
        Gust (m/s) and its slope (1/s) at nodes of path length.
    gust_spacing : float
        Spacing of these nodes, m.
    bearing : float
        Direction of a positive gust: to starboard of the course, rad clockwise from north.
    vertical : VerticalMotion
        Vertical motion of the water.
    """

    current: CurrentProfile
    gusts: FloatArray
    gust_spacing: float
    bearing: float
    vertical: VerticalMotion

    def field(self, mass: float) -> Field:
        """Pack the parameters for the kernel, with the mass (kg) of the hull carried by the water."""
        return Field(mass, self.current.spacing, self.gust_spacing, math.cos(self.bearing), math.sin(self.bearing))

    def along(self, depth: FloatArray, path: FloatArray, time: FloatArray) -> FloatArray:
        """Current north and east without the gust, and the gust, ``(n, 3)``, m/s, at depths, path lengths and times."""
        out = np.empty((len(depth), 3))
        water_along(self.field(0.0), self.current.table, self.gusts, depth, path, time, out)
        return out


def still_water() -> WaterMotion:
    """Water at rest."""
    return WaterMotion(
        CurrentProfile(1.0, np.zeros((2, 8))), _STILL, 1.0, 0.0, VerticalMotion(np.zeros(1), np.ones(1), np.zeros(1))
    )


def draw_water(
    scenario: Scenario, plan: FlightPlan, seed: int, number: int, course: float, *, down_to: float = 0.0
) -> WaterMotion:
    """Draw the water of the profile `number`, flown on a `course` (rad), at least to the depth `down_to` (m)."""
    depth = max(scenario.depth + OVERSHOOT, down_to)
    current = current_profile(scenario.current, seed, number, depth=depth, duration=plan.nominal_duration)
    bearing = course + 0.5 * math.pi
    vertical = draw_vertical_motion(scenario.vertical, generator(seed, number, Stream.VERTICAL))
    settings = scenario.gusts
    if settings.kind == "none" or settings.rms == 0.0:
        return WaterMotion(current, _STILL, 1.0, bearing, vertical)
    values = gust_field(settings, plan.longest_path, generator(seed, number, Stream.GUSTS))
    spacing = node_spacing(settings)
    return WaterMotion(current, with_slopes(values, spacing), spacing, bearing, vertical)
