"""Forward run that follows a path, with the disturbance that makes it a single trajectory of the flight model.

Where windows meet, or overlap and are blended, the disturbances of the resulting path reproduce its states only
approximately. A run that is steered towards the path by small forces and moments is an exact trajectory, and these
forces vary on the time scale of the steering.
"""

from gliderhpc.kernels.elementary import wrap
from gliderhpc.kernels.jit import formula, kernel
from gliderhpc.kernels.mass import load_body
from gliderhpc.kernels.rk4 import step
from gliderhpc.kernels.window import load_disturbance, load_state, store_state


@formula
def steering(hull, y, target, rate):
    """Return the forces and moments (six) by which the distance from ``target`` decays at ``rate``, 1/s.

    They are ``M (2 rate dv + rate^2 dx)``: attitude and depth are critically damped, u and v decay at ``2 rate``. Depth
    is steered with the heave force, whose vertical part exceeds that of surge at pitch angles below 45 degrees.
    """
    once, twice = 2.0 * rate, rate * rate
    return (
        hull.mass_u * once * (target[4] - y[4]),
        hull.mass_v * once * (target[5] - y[5]),
        hull.mass_w * (once * (target[6] - y[6]) + twice * (target[3] - y[3])),
        hull.inertia_p * (once * (target[7] - y[7]) + twice * (target[0] - y[0])),
        hull.inertia_q * (once * (target[8] - y[8]) + twice * (target[1] - y[1])),
        hull.inertia_r * (once * (target[9] - y[9]) + twice * wrap(target[2] - y[2])),
    )


@kernel
def follow(hull, bodies, b, h, rate, states):
    """Run forward from the first of ``states (n+1, 10)``, steered towards the others.

    ``states`` and ``b (n, 6)`` are replaced by those of the run; its disturbance includes the steering.
    """
    y = load_state(states, 0)
    for k in range(b.shape[0]):
        push = steering(hull, y, load_state(states, k), rate)
        store_state(states, k, y)
        for i in range(6):
            b[k, i] += push[i]
        y, _, _ = step(hull, load_body(bodies, k), y, load_disturbance(b, k), h)
    store_state(states, b.shape[0], y)
