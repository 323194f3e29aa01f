"""Constants of a platform, packed for the kernels, and the mass properties that result from its controls."""

import numpy as np
from numpy.typing import NDArray

from gliderhpc.kernels.mass import bodies_of_controls
from gliderhpc.kernels.parameters import Body, Hull, Masses
from gliderhpc.platform import Platform


def hull_of(platform: Platform) -> Hull:
    """Pack the constants of eqs. 7, 8, 11 and 12 (kg, kg m2, SI coefficients)."""
    total = platform.mass.total
    added, added_inertia = platform.added_mass, platform.added_inertia
    inertia, viscous = platform.inertia, platform.viscous
    return Hull(
        mass_u=total + added[0],
        mass_v=total + added[1],
        mass_w=total + added[2],
        inertia_p=inertia[0] + added_inertia[0],
        inertia_q=inertia[1] + added_inertia[1],
        inertia_r=inertia[2] + added_inertia[2],
        added_p=added_inertia[0],
        added_q=added_inertia[1],
        added_r=added_inertia[2],
        depth_slope=platform.buoyancy.depth_slope,
        K_D0=viscous.K_D0,
        K_D=viscous.K_D,
        K_beta=viscous.K_beta,
        K_L0=viscous.K_L0,
        K_L=viscous.K_L,
        K_MR=viscous.K_MR,
        K_p=viscous.K_p,
        K_M0=viscous.K_M0,
        K_M=viscous.K_M,
        K_q=viscous.K_q,
        K_MY=viscous.K_MY,
        K_r=viscous.K_r,
        K_delta=viscous.K_delta,
        rate_floor2=viscous.rate_damping_floor**2,
    )


def masses_of(platform: Platform) -> Masses:
    """Pack the internal masses and their positions (kg, m)."""
    position = platform.position
    return Masses(
        platform.mass.hull,
        *position.hull,
        platform.mass.battery,
        position.battery,
        platform.battery_eccentricity,
        *position.bladder,
        *position.reservoir,
    )


def mass_properties(masses: Masses, controls: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the mass properties ``(n, 11)``, one `Body` in each row, of contiguous controls ``(n, 6)`` (eqs. 5, 9)."""
    bodies = np.empty((len(controls), len(Body._fields)))
    bodies_of_controls(masses, controls, bodies)
    return bodies
