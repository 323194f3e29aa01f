"""Forward run that follows a path, with the disturbance that makes it a single trajectory of the flight model.

If windows are joined, or blended where they overlap, the disturbances of the resulting path reproduce its states only
approximately. A run that is steered towards the path by small forces and moments is an exact trajectory, and these
forces vary on the time scale of the steering.
"""

from gliderhpc.kernels.elementary import wrap
from gliderhpc.kernels.jit import formula, kernel
from gliderhpc.kernels.mass import load_body
from gliderhpc.kernels.rk4 import step
from gliderhpc.kernels.window import load_disturbance, load_state, store_state


@formula
def steering(hull, y, target, lateral, longitudinal):
    """Return the forces and moments (six) by which the distance from ``target`` decays at two rates, 1/s.

    They are ``M (2 rate dv + rate^2 dx)``: attitude and depth are critically damped, u and v decay at ``2 rate``. Depth
    is steered with the heave force, whose vertical part exceeds that of surge at pitch angles below 45 degrees. Sway,
    roll and yaw have the rate ``lateral``; surge, heave and pitch have the rate ``longitudinal``.
    """
    side, side2 = 2.0 * lateral, lateral * lateral
    along, along2 = 2.0 * longitudinal, longitudinal * longitudinal
    return (
        hull.mass_u * along * (target[4] - y[4]),
        hull.mass_v * side * (target[5] - y[5]),
        hull.mass_w * (along * (target[6] - y[6]) + along2 * (target[3] - y[3])),
        hull.inertia_p * (side * (target[7] - y[7]) + side2 * (target[0] - y[0])),
        hull.inertia_q * (along * (target[8] - y[8]) + along2 * (target[1] - y[1])),
        hull.inertia_r * (side * (target[9] - y[9]) + side2 * wrap(target[2] - y[2])),
    )


@kernel
def follow(hull, bodies, b, h, lateral, longitudinal, states):
    """Run forward from the first of ``states (n+1, 10)``, steered towards the others at two rates (`steering`).

    ``states`` and ``b (n, 6)`` are replaced by those of the run; its disturbance includes the steering.
    """
    y = load_state(states, 0)
    for k in range(b.shape[0]):
        push = steering(hull, y, load_state(states, k), lateral, longitudinal)
        store_state(states, k, y)
        for i in range(6):
            b[k, i] += push[i]
        y, _, _ = step(hull, load_body(bodies, k), y, load_disturbance(b, k), h)
    store_state(states, b.shape[0], y)
