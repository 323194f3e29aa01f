"""Buoyancy in the water that was measured: in-situ density, and what pressure and warmth do to the hull's volume."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gliderhpc.platform import GRAVITY, Platform

REFERENCE_TEMPERATURE = 10.0
"""Temperature at which a hull has the volume that its neutral volume stands for, degC (Merckelbach et al. 2010)."""

DEPTH, DENSITY, TEMPERATURE, PRESSURE = range(4)
"""Columns of the seawater along a record: m, kg/m3 in situ, degC in situ, dbar of sea pressure."""


def excess_weight(platform: Platform, oil_volume: ArrayLike, water: ArrayLike) -> NDArray[np.float64]:
    """Net weight beyond ``m_x g`` that measured water and the hull's own volume leave, less that of the depth slope.

    Parameters
    ----------
    platform : Platform
        The hull; one without a compressibility counts as rigid.
    oil_volume : (n,)
        Oil in the external bladder V, m3.
    water : (n, 4)
        Depth, in-situ density, in-situ temperature and pressure where the glider is, in the order of `DEPTH` ...

    Returns
    -------
    (n,) ndarray
        N, positive heavy, to be added to the weight of eq. 6.

    Notes
    -----
    A hull that is neutral with the oil volume ``V_n`` in water of the density ``rho_w``, at the surface and at
    `REFERENCE_TEMPERATURE`, displaces ``V_h = m / rho_w - V_n`` in addition to the oil. Where the density is ``rho``
    its net weight is (Merckelbach, Smeed & Griffiths 2010, eqs. 4 and 5)

        ``g (m - rho (V_h (1 - kappa p + alpha (T - T_0)) + V))``,

    of which ``m_x g = -g rho_w (V - V_n)`` is counted already. The model goes on to take ``k_z Z`` away; here it is
    given back at the recorded depth, so that the slope acts on the model's departure from the record alone.
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
