"""Buoyancy in measured water: in-situ density, and the effects of pressure and temperature on the hull's volume."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gliderhpc.platform import GRAVITY, Platform

REFERENCE_TEMPERATURE = 10.0
"""Temperature at which the neutral volume of a hull is defined, degC (Merckelbach et al. 2010)."""

DEPTH, DENSITY, TEMPERATURE, PRESSURE = range(4)
"""Columns of the seawater along a record: depth (m), in-situ density (kg/m3) and temperature (degC), sea pressure
(dbar)."""


def excess_weight(platform: Platform, oil_volume: ArrayLike, water: ArrayLike) -> NDArray[np.float64]:
    """Return the net weight in measured water minus that of the model, ``m_x g`` less the depth-slope term.

    Parameters
    ----------
    platform : Platform
        The hull; one without a compressibility is treated as incompressible.
    oil_volume : (n,)
        Oil in the external bladder V, m3.
    water : (n, 4)
        Depth, in-situ density, in-situ temperature and pressure at the glider, in the order of `DEPTH` ...

    Returns
    -------
    (n,) ndarray
        N, positive heavy, to be added to the weight of eq. 6.

    Notes
    -----
    A hull that is neutral with the oil volume ``V_n`` in water of the density ``rho_w``, at the surface and at
    `REFERENCE_TEMPERATURE`, displaces ``V_h = m / rho_w - V_n`` in addition to the oil. In water of the density
    ``rho`` its net weight is (Merckelbach, Smeed & Griffiths 2010, eqs. 4 and 5)

        ``g (m - rho (V_h (1 - kappa p + alpha (T - T_0)) + V))``.

    The model already contains ``m_x g = -g rho_w (V - V_n)``, and it subtracts ``k_z Z``. That term is added back here
    at the recorded depth; the slope then acts only on the difference between the model's depth and the recorded one.
    """
    buoyancy = platform.buoyancy
    volume = np.asarray(oil_volume, dtype=np.float64)
    depth, density, temperature, pressure = np.moveaxis(np.asarray(water, dtype=np.float64), -1, 0)
    hull = platform.mass.total / buoyancy.water_density - buoyancy.neutral_volume_m3
    strain = buoyancy.thermal_expansion * (temperature - REFERENCE_TEMPERATURE)
    strain -= (buoyancy.compressibility or 0.0) * pressure
    displaced = density * (hull * (1.0 + strain) + volume)
    reference = buoyancy.water_density * (hull + volume)
    return np.asarray(GRAVITY * (reference - displaced) + buoyancy.depth_slope * depth)
