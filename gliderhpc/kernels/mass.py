"""Mass properties (eqs. 5, 9), which depend on the control alone: computed once per sample, not once per stage."""

from gliderhpc.kernels.elementary import sincos
from gliderhpc.kernels.elementwise import load
from gliderhpc.kernels.jit import formula, kernel
from gliderhpc.kernels.parameters import Body

GRAVITY = 9.81


@formula
def body_of_control(masses, battery_shift, battery_angle, bladder_mass, reservoir_mass, rudder):
    """Return first moment, point-mass inertia and net weight of one control ``[r_px, gamma, m_b, m_m]``."""
    sin_gamma, cos_gamma = sincos(battery_angle)
    mh, mp, mb, mm = masses.hull, masses.battery, bladder_mass, reservoir_mass
    hx, hy, hz = masses.hull_x, masses.hull_y, masses.hull_z
    px = masses.battery_x + battery_shift
    py = masses.battery_eccentricity * sin_gamma
    pz = masses.battery_eccentricity * cos_gamma
    bx, by, bz = masses.bladder_x, masses.bladder_y, masses.bladder_z
    rx, ry, rz = masses.reservoir_x, masses.reservoir_y, masses.reservoir_z
    xx = mh * hx * hx + mp * px * px + mb * bx * bx + mm * rx * rx
    yy = mh * hy * hy + mp * py * py + mb * by * by + mm * ry * ry
    zz = mh * hz * hz + mp * pz * pz + mb * bz * bz + mm * rz * rz
    return Body(
        mh * hx + mp * px + mb * bx + mm * rx,
        mh * hy + mp * py + mb * by + mm * ry,
        mh * hz + mp * pz + mb * bz + mm * rz,
        yy + zz,
        xx + zz,
        xx + yy,
        -(mh * hx * hy + mp * px * py + mb * bx * by + mm * rx * ry),
        -(mh * hx * hz + mp * px * pz + mb * bx * bz + mm * rx * rz),
        -(mh * hy * hz + mp * py * pz + mb * by * bz + mm * ry * rz),
        (mb + mm) * GRAVITY,
        rudder,
    )


@kernel
def bodies_of_controls(masses, controls, bodies):
    """Fill ``bodies (n, 11)`` from the first five columns of ``controls``: [r_px, gamma, m_b, m_m, rudder]."""
    for k in range(controls.shape[0]):
        body = body_of_control(masses, controls[k, 0], controls[k, 1], controls[k, 2], controls[k, 3], controls[k, 4])
        for i in range(11):
            bodies[k, i] = body[i]


@formula
def load_body(bodies, k):
    """Return row ``k`` of an array of mass properties, as a `Body`."""
    return Body(
        load(bodies, (k, 0)), load(bodies, (k, 1)), load(bodies, (k, 2)), load(bodies, (k, 3)), load(bodies, (k, 4)),
        load(bodies, (k, 5)), load(bodies, (k, 6)), load(bodies, (k, 7)), load(bodies, (k, 8)), load(bodies, (k, 9)),
        load(bodies, (k, 10)),
    )  # fmt: skip
