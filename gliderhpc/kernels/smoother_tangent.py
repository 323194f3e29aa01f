"""Transpose of the step including X and Y, whose unit costates give the transition matrix in lanes."""

from gliderhpc.kernels.dynamics import horizontal_velocity_vjp, rates_vjp
from gliderhpc.kernels.jit import formula, inner_kernel
from gliderhpc.kernels.rk4 import scaled, shifted


@formula
def _stage_vjp(hull, body, y, geometry, a, north, east):
    """Apply the transposed derivative of one stage's rates, including those of X and Y."""
    e, g = rates_vjp(hull, body, y, geometry, a)
    return shifted(e, 1.0, horizontal_velocity_vjp(y, north, east)), g


@formula
def step_vjp_with_track(hull, body, stages, geometry, a, north, east, h):
    """Return `gliderhpc.kernels.rk4.step_vjp` for the costates of X and Y in addition to the ten of ``a``.

    Those two do not change over the step; their contribution to the others is the transpose of the displacement. The
    third result contains the costates of the four stages' rates.
    """
    outer, inner = h / 6.0, h / 3.0
    y, y2, y3, y4 = stages
    a4 = scaled(outer, a)
    e4, g4 = _stage_vjp(hull, body, y4, geometry[3], a4, outer * north, outer * east)
    a3 = shifted(scaled(inner, a), h, e4)
    e3, g3 = _stage_vjp(hull, body, y3, geometry[2], a3, inner * north, inner * east)
    a2 = shifted(scaled(inner, a), 0.5 * h, e3)
    e2, g2 = _stage_vjp(hull, body, y2, geometry[1], a2, inner * north, inner * east)
    a1 = shifted(scaled(outer, a), 0.5 * h, e2)
    e1, g1 = _stage_vjp(hull, body, y, geometry[0], a1, outer * north, outer * east)
    e = shifted(shifted(shifted(shifted(a, 1.0, e1), 1.0, e2), 1.0, e3), 1.0, e4)
    g = (
        g1[0] + g2[0] + g3[0] + g4[0], g1[1] + g2[1] + g3[1] + g4[1], g1[2] + g2[2] + g3[2] + g4[2],
        g1[3] + g2[3] + g3[3] + g4[3], g1[4] + g2[4] + g3[4] + g4[4], g1[5] + g2[5] + g3[5] + g4[5],
    )  # fmt: skip
    return e, g, (a1, a2, a3, a4)


@inner_kernel
def separate_track(decay, tangent, track_tangent):
    """Move the columns of X and Y out of the transposed transition, and fill in those of the disturbances."""
    for j in range(16):
        track_tangent[0, j] = tangent[j, 10]
        track_tangent[1, j] = tangent[j, 11]
        for i in range(6):
            tangent[j, 10 + i] = decay[i] if j == 10 + i else 0.0
