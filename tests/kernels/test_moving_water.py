"""Effect of moving water on the glider: the kernel compared with independent formulas and with the physics."""

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline
from support.reference import body_to_earth, carried_rhs
from support.sizes import scaled
from support.specimens import body_of

from gliderhpc.flight.glider import Glider
from gliderhpc.flight.steady_glide import steady_glide
from gliderhpc.kernels import current
from gliderhpc.platform import read_platform

STEP = 0.05
NODES = 81
SPACING = 2.0
PATH_SPACING = 0.5
BEARING = 2.3
STILL = np.zeros((2, 2))
STILL_WATER = np.zeros((2, 8))


@pytest.fixture(scope="module")
def platform():
    return read_platform("petrel-l")


@pytest.fixture(scope="module")
def glide(platform):
    return steady_glide(Glider(platform), 0.35, np.radians(-25.0), 50.0)


def field(platform):
    return current.Field(platform.mass.total, SPACING, PATH_SPACING, np.cos(BEARING), np.sin(BEARING))


def random_water(seed):
    """Draw an evolving, sheared current and gusts: nodes with independent slopes."""
    rng = np.random.default_rng(seed)
    water = rng.normal(size=(NODES, 8)) * np.array([0.2, 0.2, 0.02, 0.02, 1e-4, 1e-4, 1e-5, 1e-5])
    return water, rng.normal(size=(400, 2)) * np.array([0.02, 0.02])


def fly(platform, glide, water, gusts, steps, heading=0.7, rotation=0.2, additive=None):
    """Return trajectory, carried path and acting disturbance from a steady glide with the battery rotated."""
    glider = Glider(platform)
    controls = np.tile(glide.control, (steps, 1))
    controls[:, 1] = rotation
    state = glide.state
    state[2] = heading
    b = np.zeros((steps, 6)) if additive is None else additive
    trajectory, carried, acting = np.empty((steps + 1, 12)), np.empty((steps + 1, 3)), np.empty((steps, 6))
    bodies = glider.bodies(controls)
    current.simulate(
        glider.hull, field(platform), bodies, water, gusts, state, np.zeros(3), 0.0, b, STEP,
        trajectory, carried, acting,
    )  # fmt: skip
    return trajectory, carried, acting, controls


def uniform(north, east):
    water = np.zeros((2, 8))
    water[:, 0], water[:, 1] = north, east
    return water


def test_tables_are_cubic_hermite_splines():
    water, gusts = random_water(1)
    depths = np.random.default_rng(2).uniform(0.0, SPACING * (NODES - 1), scaled(200, 20))
    nodes, t = SPACING * np.arange(NODES), 300.0
    for column in range(2):
        spline = CubicHermiteSpline(
            nodes, water[:, column] + t * water[:, 4 + column], water[:, 2 + column] + t * water[:, 6 + column]
        )
        values = np.array([current.current_at(water, SPACING, depth, t) for depth in depths])
        np.testing.assert_allclose(values[:, column], spline(depths), atol=1e-13)
        np.testing.assert_allclose(values[:, 2 + column], spline(depths, 1), atol=1e-13)
    spline = CubicHermiteSpline(PATH_SPACING * np.arange(400), *gusts.T)
    values = np.array([current.gust_at(gusts, PATH_SPACING, s) for s in depths])
    np.testing.assert_allclose(values, np.column_stack([spline(depths), spline(depths, 1)]), atol=1e-13)


def test_beyond_the_tables_the_water_is_constant():
    water, gusts = random_water(1)
    deepest = SPACING * (NODES - 1)
    for depth, node in ((-3.0, 0), (deepest + 3.0, -1), (1e300, -1)):
        assert current.current_at(water, SPACING, depth, 0.0) == (*water[node, :2], 0.0, 0.0)
    assert current.gust_at(gusts, PATH_SPACING, 1e6) == (gusts[-1, 0], 0.0)
    assert current.cell_of(np.nan, SPACING, NODES) == (0, 0.0, 0.0)


def test_kernel_is_the_formula(platform, glide):
    """The kernel equals a Runge-Kutta step with matrices, cross products and the shear at the depth of every stage."""
    steps, h = scaled(600, 30), STEP
    water, gusts = random_water(5)
    additive = np.random.default_rng(6).normal(size=(steps, 6)) * 0.05
    trajectory, carried, acting, controls = fly(platform, glide, water, gusts, steps, additive=additive)
    nodes = SPACING * np.arange(NODES)
    across = np.array([np.cos(BEARING), np.sin(BEARING)])
    gust = CubicHermiteSpline(PATH_SPACING * np.arange(len(gusts)), *gusts.T)

    def flow(t):
        return CubicHermiteSpline(nodes, water[:, :2] + t * water[:, 4:6], water[:, 2:4] + t * water[:, 6:8])

    def rates(x, k, t):
        now = flow(t)
        dy, speed = carried_rhs(
            platform, x[:12], controls[k], additive[k], lambda Z: now(Z, 1), gust(x[14], 1) * across
        )
        return np.concatenate([dy, now(x[5]) + gust(x[14]) * across, [speed]])

    x = np.concatenate([trajectory[0], np.zeros(3)])
    for k in range(steps):
        t = k * h
        k1 = rates(x, k, t)
        k2 = rates(x + 0.5 * h * k1, k, t + 0.5 * h)
        k3 = rates(x + 0.5 * h * k2, k, t + 0.5 * h)
        k4 = rates(x + h * k3, k, t + h)
        x = x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        np.testing.assert_allclose(trajectory[k + 1], x[:12], rtol=1e-9, atol=1e-10)
        np.testing.assert_allclose(carried[k + 1], x[12:], rtol=1e-9, atol=1e-10)
    assert np.abs(acting - additive)[:, 1].max() > 0.1


def test_acting_disturbance_drives_the_plain_model_to_the_same_states(platform, glide):
    """The stored truth is the disturbance that the estimator's model, which has no current, would need."""
    steps = scaled(1200, 20)
    trajectory, _, acting, controls = fly(platform, glide, *random_water(7), steps)
    states = Glider(platform).simulate(trajectory[0], controls, acting, STEP)
    difference = np.abs(states - trajectory)
    assert np.degrees(difference[:, :3]).max() < 0.01
    assert difference[:, 3:6].max() < 2e-3


def test_uniform_steady_current_only_displaces(platform, glide):
    steps = scaled(2400, 20)
    still = fly(platform, glide, STILL_WATER, STILL, steps)
    moved = fly(platform, glide, uniform(0.35, -0.2), STILL, steps)
    np.testing.assert_array_equal(still[0], moved[0])
    time = STEP * np.arange(steps + 1)
    np.testing.assert_allclose(moved[1][:, :2], np.outer(time, [0.35, -0.2]), atol=1e-10)
    assert not still[1][:, :2].any()


def test_current_varying_in_time_alone_is_left_out(platform, glide):
    """It carries a neutrally buoyant body with it (Froude-Krylov); attitude and depth are not affected."""
    steps = scaled(2400, 20)
    water = uniform(0.1, 0.1)
    water[:, 4], water[:, 5] = 1e-3, -2e-3
    still, moved = (fly(platform, glide, w, STILL, steps) for w in (STILL_WATER, water))
    np.testing.assert_array_equal(still[0], moved[0])
    t = STEP * steps
    expected = [0.1 * t + 0.5e-3 * t**2, 0.1 * t - 1e-3 * t**2]
    np.testing.assert_allclose(moved[1][-1, :2], expected, rtol=1e-10)


def test_plain_run_is_that_in_still_water(platform, glide):
    steps = scaled(600, 20)
    trajectory, _, acting, controls = fly(platform, glide, STILL_WATER, STILL, steps)
    plain = Glider(platform).simulate(trajectory[0], controls, np.zeros((steps, 6)), STEP)
    np.testing.assert_allclose(trajectory, plain, atol=1e-12)
    assert not acting.any()


@pytest.mark.compiled
def test_hull_follows_a_gust_in_sideslip(platform, glide):
    """A step of the current across the course causes sideslip at first, which vanishes after some seconds."""
    gusts = np.zeros((4000, 2))
    ramp = np.arange(20.0, 1999.75, PATH_SPACING)
    gusts[: len(ramp), 0] = 0.05 * np.clip((ramp - 30.0) / 0.5, 0.0, 1.0)
    gusts[len(ramp) :, 0] = 0.05
    gusts[:, 1] = np.gradient(gusts[:, 0], PATH_SPACING)
    trajectory, carried, _, _ = fly(
        platform, glide, STILL_WATER, gusts, 3000, heading=BEARING - np.pi / 2, rotation=0.0
    )
    across = np.array([np.cos(BEARING), np.sin(BEARING)])
    sideslip = trajectory[:, 7]
    hit = int(np.argmax(carried[:, :2] @ across > 1e-3))
    # At first the hull keeps its velocity over the ground, except for its added mass's part: m / (m + M_f2) = 0.54.
    assert -0.027 < sideslip.min() < -0.02
    assert np.abs(sideslip[hit + 600 :]).max() < 0.005


def test_push_is_that_of_the_formula(platform, glide):
    glider = Glider(platform)
    body = glider.bodies([[0.01, 0.4, *glide.ballast]])[0]
    a = np.array([0.1, -0.2, 0.3])
    p = current.push(body_of(body[None]), 88.0, *a)
    np.testing.assert_allclose(p[:3], -88.0 * a)
    np.testing.assert_allclose(p[3:], -np.cross(body[:3], a))
    y = (0.3, -0.4, 2.1, 10.0, 0.3, 0.0, 0.0, 0.0, 0.0, 0.0)
    np.testing.assert_allclose(current.body_axes(y, 0.5, -0.7), body_to_earth(0.3, -0.4, 2.1).T @ [0.5, -0.7, 0.0])


def test_water_along_is_what_was_met():
    platform = read_platform("petrel-l")
    water, gusts = random_water(9)
    depth, path, time = np.array([3.0, 50.0]), np.array([7.0, 1.0]), np.array([0.0, 100.0])
    out = np.empty((2, 3))
    current.water_along(field(platform), water, gusts, depth, path, time, out)
    for k in range(2):
        assert tuple(out[k, :2]) == current.current_at(water, SPACING, depth[k], time[k])[:2]
        assert out[k, 2] == current.gust_at(gusts, PATH_SPACING, path[k])[0]
