"""Glider in moving water: effects of a sheared current and of a frozen gust field, and forward runs.

The state's velocity is relative to the water. As the water's velocity changes along the path, the force
``-m R_eb^T dU/dt`` and the moment ``-S x (R_eb^T dU/dt)`` act on the hull, which the water carries along. They are
added to the disturbance at every Runge-Kutta stage. A current that varies only in time carries a neutrally buoyant body
with it and is not part of ``dU/dt``.

``water (n, 8)`` contains, on a depth grid, the current at the start (north, east), its derivatives with respect to
depth, and the rates of change in time of these four. ``gusts (n, 2)`` contains, on a grid of path length, the gust and
its slope. Both are interpolated by cubic Hermite polynomials, whose slope is consistent with their value, and are
constant outside their grids.
"""

from typing import NamedTuple

from gliderhpc.kernels.dynamics import rates
from gliderhpc.kernels.elementary import sincos
from gliderhpc.kernels.jit import formula, kernel
from gliderhpc.kernels.mass import load_body
from gliderhpc.kernels.rk4 import advanced, displacement, shifted
from gliderhpc.kernels.window import load_disturbance, sensed_of, store_row


class Field(NamedTuple):
    """Constants that belong to the tables: the glider's mass (kg), the grids' spacings (m), the gust's direction."""

    mass: float
    depth_spacing: float
    path_spacing: float
    gust_north: float
    gust_east: float


@formula
def cubic(f, width, a, da, b, db):
    """Return value and slope of the cubic Hermite polynomial at the fraction ``f`` of the way between two nodes."""
    g = 1.0 - f
    value = g * g * ((1.0 + 2.0 * f) * a + f * width * da) + f * f * ((1.0 + 2.0 * g) * b - g * width * db)
    slope = 6.0 * f * g * (b - a) / width + g * (1.0 - 3.0 * f) * da + f * (3.0 * f - 2.0) * db
    return value, slope


@formula
def cell_of(x, spacing, nodes):
    """Return the cell of a uniform grid that contains ``x``, the fraction of that cell, and 1 inside or 0 outside."""
    scaled = x / spacing
    last = nodes - 1.0
    inside = 0.0 <= scaled <= last
    # Written to give an existing cell even for NaN.
    bounded = scaled if inside else (last if scaled > last else 0.0)
    cell = min(int(bounded), nodes - 2)
    return cell, bounded - cell, 1.0 if inside else 0.0


@formula
def current_at(water, spacing, Z, t):
    """Return the current at a depth and a time, north and east (m/s), and its derivatives in depth (1/s)."""
    i, f, inside = cell_of(Z, spacing, water.shape[0])
    north, d_north = cubic(
        f, spacing, water[i, 0] + t * water[i, 4], water[i, 2] + t * water[i, 6],
        water[i + 1, 0] + t * water[i + 1, 4], water[i + 1, 2] + t * water[i + 1, 6],
    )  # fmt: skip
    east, d_east = cubic(
        f, spacing, water[i, 1] + t * water[i, 5], water[i, 3] + t * water[i, 7],
        water[i + 1, 1] + t * water[i + 1, 5], water[i + 1, 3] + t * water[i + 1, 7],
    )  # fmt: skip
    return north, east, inside * d_north, inside * d_east


@formula
def gust_at(gusts, spacing, s):
    """Return the gust (m/s) at a path length ``s`` (m), and its slope along the path (1/s)."""
    i, f, inside = cell_of(s, spacing, gusts.shape[0])
    value, slope = cubic(f, spacing, gusts[i, 0], gusts[i, 1], gusts[i + 1, 0], gusts[i + 1, 1])
    return value, inside * slope


@formula
def body_axes(y, north, east):
    """Rotate a horizontal vector into the body frame: R_eb^T of eq. 3."""
    sp, cp = sincos(y[0])
    st, ct = sincos(y[1])
    ss, cs = sincos(y[2])
    ahead = cs * north + ss * east
    across = cs * east - ss * north
    return ct * ahead, sp * st * ahead + cp * across, cp * st * ahead - sp * across


@formula
def push(body, mass, ax, ay, az):
    """Return force and moment on a hull in water with the acceleration ``a`` (body frame): ``-m a`` and ``-S x a``."""
    return (
        -mass * ax,
        -mass * ay,
        -mass * az,
        body.Sz * ay - body.Sy * az,
        body.Sx * az - body.Sz * ax,
        body.Sy * ax - body.Sx * ay,
    )


@formula
def stage(hull, body, field, water, gusts, y, s, t, b):
    """Compute a Runge-Kutta stage: rates of the sensed states; total disturbance; velocity of the water and speed."""
    _, theta, _, Z, u, v, w, _, _, _ = y
    sp, cp = sincos(y[0])
    st, ct = sincos(theta)
    speed = (u * u + v * v + w * w) ** 0.5
    sinking = sp * ct * v + cp * ct * w - st * u
    north, east, shear_north, shear_east = current_at(water, field.depth_spacing, Z, t)
    gust, gust_slope = gust_at(gusts, field.path_spacing, s)
    growth = speed * gust_slope
    ax, ay, az = body_axes(
        y, sinking * shear_north + growth * field.gust_north, sinking * shear_east + growth * field.gust_east
    )
    p = push(body, field.mass, ax, ay, az)
    total = (b[0] + p[0], b[1] + p[1], b[2] + p[2], b[3] + p[3], b[4] + p[4], b[5] + p[5])
    flow = (north + gust * field.gust_north, east + gust * field.gust_east, speed)
    return rates(hull, body, y, total), total, flow


@formula
def weighted(k1, k2, k3, k4, i):
    """Return the Runge-Kutta mean of the ``i``-th entry of four stages."""
    return (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]) / 6.0


@kernel
def simulate(hull, field, bodies, water, gusts, state0, carried0, t0, b, h, trajectory, carried, acting):
    """Run forward in moving water.

    ``trajectory (n+1, 12)`` starts from ``state0 (12)``, with X and Y relative to the water. ``carried (n+1, 3)`` is
    the displacement of the glider by the water, north and east, and the path length flown. ``acting (n, 6)`` is the
    total disturbance, ``b`` plus that of the water, averaged over each step.
    """
    y = sensed_of(state0)
    X, Y = state0[3], state0[4]
    north, east, s = carried0[0], carried0[1], carried0[2]
    store_row(trajectory, 0, y, X, Y)
    carried[0, 0], carried[0, 1], carried[0, 2] = north, east, s
    for k in range(b.shape[0]):
        body = load_body(bodies, k)
        bk = load_disturbance(b, k)
        t = t0 + k * h
        k1, b1, f1 = stage(hull, body, field, water, gusts, y, s, t, bk)
        y2 = shifted(y, 0.5 * h, k1)
        k2, b2, f2 = stage(hull, body, field, water, gusts, y2, s + 0.5 * h * f1[2], t + 0.5 * h, bk)
        y3 = shifted(y, 0.5 * h, k2)
        k3, b3, f3 = stage(hull, body, field, water, gusts, y3, s + 0.5 * h * f2[2], t + 0.5 * h, bk)
        y4 = shifted(y, h, k3)
        k4, b4, f4 = stage(hull, body, field, water, gusts, y4, s + h * f3[2], t + h, bk)
        dX, dY = displacement((y, y2, y3, y4), h)
        X += dX
        Y += dY
        north += h * weighted(f1, f2, f3, f4, 0)
        east += h * weighted(f1, f2, f3, f4, 1)
        s += h * weighted(f1, f2, f3, f4, 2)
        y = advanced(y, h / 6.0, k1, k2, k3, k4)
        store_row(trajectory, k + 1, y, X, Y)
        carried[k + 1, 0], carried[k + 1, 1], carried[k + 1, 2] = north, east, s
        for i in range(6):
            acting[k, i] = weighted(b1, b2, b3, b4, i)


@kernel
def water_along(field, water, gusts, depth, path, time, out):
    """Fill ``out (n, 3)``: current north and east without the gust, and the gust, along the glider's path (m/s)."""
    for k in range(depth.shape[0]):
        north, east, _, _ = current_at(water, field.depth_spacing, depth[k], time[k])
        gust, _ = gust_at(gusts, field.path_spacing, path[k])
        out[k, 0], out[k, 1], out[k, 2] = north, east, gust
