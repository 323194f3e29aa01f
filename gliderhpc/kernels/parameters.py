"""Parameters of a hull, and its mass properties (one set for each sample), in the form that kernels use."""

from typing import NamedTuple


class Hull(NamedTuple):
    """Constants of a hull: effective masses and inertias (diagonal of eqs. 7-8), viscous coefficients (eqs. 11-12).

    Masses in kg, inertias in kg m2; force coefficients in kg/m (per rad where they multiply an angle), moment
    coefficients in kg, rate coefficients in kg s; ``depth_slope`` in N/m; ``rate_floor2`` is V_0 squared in m2/s2.
    """

    mass_u: float
    mass_v: float
    mass_w: float
    inertia_p: float
    inertia_q: float
    inertia_r: float
    added_p: float
    added_q: float
    added_r: float
    depth_slope: float
    K_D0: float
    K_D: float
    K_beta: float
    K_L0: float
    K_L: float
    K_MR: float
    K_p: float
    K_M0: float
    K_M: float
    K_q: float
    K_MY: float
    K_r: float
    K_delta: float
    rate_floor2: float


class Body(NamedTuple):
    """Mass properties of a control sample: first moment S (kg m), point-mass inertia J_S (kg m2), net weight m_x g (N).

    ``rudder`` is the rudder's angle in rad.
    """

    Sx: float
    Sy: float
    Sz: float
    Jxx: float
    Jyy: float
    Jzz: float
    Jxy: float
    Jxz: float
    Jyz: float
    net_weight: float
    rudder: float


class Masses(NamedTuple):
    """Internal masses and their positions: kg and m from the centre of buoyancy (eqs. 5, 9)."""

    hull: float
    hull_x: float
    hull_y: float
    hull_z: float
    battery: float
    battery_x: float
    battery_eccentricity: float
    bladder_x: float
    bladder_y: float
    bladder_z: float
    reservoir_x: float
    reservoir_y: float
    reservoir_z: float
