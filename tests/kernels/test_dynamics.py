"""Right-hand side (eqs. 1-14, 20) and Jacobian, compared with a second implementation, the oracle, and physics."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support import reference
from support.sizes import scaled
from support.specimens import (
    BELOW_A_RIGHT_ANGLE,
    VISCOUS,
    body_of,
    extreme_states,
    lopsided_platform,
    random_controls,
    random_disturbances,
    random_state,
    relative_error,
)

from gliderhpc.errors import InputError
from gliderhpc.flight.glider import SENSED, Glider
from gliderhpc.kernels import dynamics, hydrodynamics
from gliderhpc.kernels import points as point
from gliderhpc.kernels.jacobian import rhs_jacobian
from gliderhpc.platform import read_platform, shipped_platforms, with_overrides

LOPSIDED = Glider(lopsided_platform())
CALM = np.zeros(6)
ANGLES, POSITIONS, VELOCITIES, RATES = slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 12)


def samples(count, seed=0):
    """Draw random states, controls with rudder, and disturbances."""
    rng = np.random.default_rng(seed)
    return [(random_state(rng), random_controls(rng, 1)[0], random_disturbances(rng, 1)[0]) for _ in range(count)]


def sensed_rates(glider, state, control, hull=None, disturbance=CALM):
    """Return `dynamics.rates` of the ten sensed states; the constants may be ones that no platform file can have."""
    body = body_of(glider.bodies(control[None]))
    return np.array(dynamics.rates(hull or glider.hull, body, tuple(state[SENSED]), tuple(disturbance)))


# Mass properties


@pytest.mark.parametrize("control", [sample[1] for sample in samples(5)])
def test_mass_properties_are_sums_over_the_masses(control):
    """S, J_S and m_x g (eqs. 5, 9 and 10) equal sums over the masses with matrices."""
    body = body_of(LOPSIDED.bodies(control[None]))
    inertia = reference.point_inertia(LOPSIDED.platform, control)
    np.testing.assert_allclose(body[:3], reference.first_moment(LOPSIDED.platform, control), rtol=1e-13, atol=1e-15)
    np.testing.assert_allclose(body[3:6], np.diag(inertia), rtol=0.0, atol=1e-14)
    np.testing.assert_allclose(body[6:9], inertia[[0, 0, 1], [1, 2, 2]], rtol=0.0, atol=1e-14)
    assert body.net_weight == pytest.approx((control[2] + control[3]) * reference.GRAVITY, rel=1e-14)
    assert body.rudder == control[4]


def test_battery_turns_about_the_axis():
    """A quarter turn moves the battery's eccentricity from below to starboard (eq. 5)."""
    down, starboard = LOPSIDED.bodies([[0.0, 0.0, 0.0, 0.0], [0.0, math.pi / 2, 0.0, 0.0]])
    lever = LOPSIDED.platform.mass.battery * LOPSIDED.platform.battery_eccentricity
    assert starboard[1] - down[1] == pytest.approx(lever)
    assert down[2] - starboard[2] == pytest.approx(lever)


# Right-hand side


@pytest.mark.parametrize("name", ["lopsided", *shipped_platforms()])
def test_rates_are_those_of_the_equations(name, implementation):
    """The rates equal eqs. 1-14 and 20 with matrices and cross products."""
    glider = LOPSIDED if name == "lopsided" else Glider(read_platform(name))
    for state, control, disturbance in samples(scaled(200, 20), seed=1):
        expected = reference.rhs(glider.platform, state, control, disturbance)
        found = implementation.rhs(np.array(glider.hull), glider.bodies(control[None]), state, disturbance)
        assert relative_error(found, expected) < 1e-13


def test_rates_agree_with_the_oracle(oracle, implementation):
    """State and disturbance are in the order of eqs. 16 and 17, as in the independent automatic differentiation."""
    glider, values = Glider(read_platform(oracle / "platform.yaml")), np.load(oracle / "oracle.npz")
    for state, control, disturbance, expected in zip(
        values["state"], values["control"], values["disturbance"], values["rhs"], strict=True
    ):
        found = implementation.rhs(np.array(glider.hull), glider.bodies(control[None]), state, disturbance)
        assert relative_error(found, expected) < 1e-12


@pytest.mark.parametrize("option", ["K_L0", "K_delta", "rate_damping_floor"])
def test_optional_terms_enter_where_they_should(option):
    """Test the optional terms one at a time: lift at zero angle of attack, rudder, damping near rest."""
    without = Glider(lopsided_platform(K_L0=0.0, K_delta=0.0, rate_damping_floor=0.0))
    glider = Glider(with_overrides(without.platform, {f"viscous.{option}": "0.3"}))
    for state, control, _ in samples(20, seed=2):
        change = glider.rhs(state, control, CALM) - without.rhs(state, control, CALM)
        forces, moments = (change * np.append(np.ones(6), reference.inertia(glider.platform)))[6:].reshape(2, 3)
        speed2 = state[VELOCITIES] @ state[VELOCITIES]
        alpha = math.atan2(state[8], state[6])
        expected_force, expected_moment = np.zeros(3), np.zeros(3)
        R = reference.flow_to_body(alpha, math.asin(state[7] / math.sqrt(speed2)))
        K = glider.platform.viscous
        if option == "K_L0":
            expected_force = R @ [0.0, 0.0, -0.3 * speed2]
        elif option == "K_delta":
            expected_moment = R @ [0.0, 0.0, 0.3 * speed2 * control[4]]
        else:
            expected_moment = R @ (0.3**2 * np.array([K.K_p, K.K_q, K.K_r]) * state[RATES])
        np.testing.assert_allclose(forces, expected_force, atol=1e-12)
        np.testing.assert_allclose(moments, expected_moment, atol=1e-12)


def test_a_missing_rudder_is_amidships():
    state, control, disturbance = samples(1, seed=3)[0]
    control[4] = 0.0
    np.testing.assert_array_equal(
        LOPSIDED.rhs(state, control[:4], disturbance), LOPSIDED.rhs(state, control, disturbance)
    )


# Jacobian


@pytest.mark.parametrize("name", ["lopsided", *shipped_platforms()])
def test_jacobian_is_the_derivative_of_the_equations(name, implementation):
    """The hand-written df/dy equals the complex step of the equations with matrices."""
    glider = LOPSIDED if name == "lopsided" else Glider(read_platform(name))
    for state, control, disturbance in samples(scaled(40, 10), seed=4):
        expected = reference.jacobian(
            lambda y, c=control, b=disturbance: reference.rhs(glider.platform, y, c, b), state
        )
        found = implementation.jacobian(np.array(glider.hull), glider.bodies(control[None]), state)
        assert relative_error(found, expected) < 1e-12


def test_jacobian_agrees_with_the_oracle(oracle, implementation):
    glider, values = Glider(read_platform(oracle / "platform.yaml")), np.load(oracle / "oracle.npz")
    for state, control, expected in zip(values["state"], values["control"], values["jacobian"], strict=True):
        found = implementation.jacobian(np.array(glider.hull), glider.bodies(control[None]), state)
        assert relative_error(found, expected) < 1e-12


def test_jacobian_has_seventy_nine_entries():
    """Of 144 entries, 79 are non-zero on a hull without a vanishing term, and nothing depends on X or Y."""
    met = np.zeros((12, 12), dtype=bool)
    expected = np.zeros((12, 12), dtype=bool)
    for state, control, disturbance in samples(10, seed=5):
        met |= LOPSIDED.jacobian(state, control) != 0.0
        derivative = reference.jacobian(
            lambda y, c=control, b=disturbance: reference.rhs(LOPSIDED.platform, y, c, b), state
        )
        # The products of eq. 3 cancel in the row of the depth; the remainder is rounding, not structure.
        expected |= np.abs(derivative) > 1e-13 * np.abs(derivative).max()
    assert met.sum() == 79
    np.testing.assert_array_equal(met, expected)
    assert not met[:, 3:5].any()


def test_disturbances_enter_by_a_constant_diagonal():
    """In eq. 20, df/db contains the reciprocal effective masses and inertias in every state."""
    np.testing.assert_array_equal(LOPSIDED.input_diagonal(), 1.0 / reference.inertia(LOPSIDED.platform))
    expected = np.zeros((12, 6))
    expected[6:] = np.diag(LOPSIDED.input_diagonal())
    for state, control, disturbance in samples(10, seed=6):
        base = LOPSIDED.rhs(state, control, CALM)
        change = LOPSIDED.rhs(state, control, disturbance) - base
        np.testing.assert_allclose(change, expected @ disturbance, atol=1e-14 * np.abs(base).max())


def test_input_jacobian_is_the_oracle_s(oracle):
    glider, values = Glider(read_platform(oracle / "platform.yaml")), np.load(oracle / "oracle.npz")
    expected = np.zeros((12, 6))
    expected[6:] = np.diag(glider.input_diagonal())
    for sample in values["input_jacobian"]:
        np.testing.assert_array_equal(sample, expected)


# At rest and at the edges


def at_rest(rates=(0.1, -0.2, 0.15)):
    state = random_state(np.random.default_rng(7))
    state[VELOCITIES] = 0.0
    state[RATES] = rates
    return state


@pytest.mark.parametrize("rates", [(0.0, 0.0, 0.0), (0.1, -0.2, 0.15)], ids=["still", "turning"])
@pytest.mark.parametrize("speed", [0.0, 1e-120], ids=["at rest", "squares underflow"])
def test_at_rest_the_water_exerts_nothing(rates, speed):
    """Viscous forces, moments and their derivatives are zero at V_b = 0 (docs/theory/model.md)."""
    glider = Glider(lopsided_platform(rate_damping_floor=0.0))
    state, control = at_rest(rates), np.array([0.02, 0.5, 0.1, 0.2, 0.1])
    state[VELOCITIES] = speed
    bodies = glider.bodies(control[None])
    inviscid = glider.hull._replace(**dict.fromkeys(VISCOUS, 0.0))
    expected, expected_jacobian = np.empty(12), np.empty((12, 12))
    point.rhs(inviscid, bodies, state, CALM, expected)
    rhs_jacobian(inviscid, bodies, state, expected_jacobian)
    y, a = tuple(state[SENSED]), tuple(np.random.default_rng(8).normal(size=10))
    by_state, _ = dynamics.rates_vjp(glider.hull, body_of(bodies), y, dynamics.geometry_of(y), a)
    expected_by_state, _ = dynamics.rates_vjp(inviscid, body_of(bodies), y, dynamics.geometry_of(y), a)
    allowance = {"rtol": 0.0, "atol": 1e3 * speed}
    np.testing.assert_allclose(glider.rhs(state, control, CALM), expected, **allowance)
    np.testing.assert_allclose(glider.jacobian(state, control), expected_jacobian, **allowance)
    np.testing.assert_allclose(by_state, expected_by_state, **allowance)


def test_the_damping_floor_damps_at_rest():
    state, control = at_rest(), np.array([0.02, 0.5, 0.1, 0.2, 0.1])
    expected = reference.rhs(LOPSIDED.platform, state, control, CALM)
    assert relative_error(LOPSIDED.rhs(state, control, CALM), expected) < 1e-13
    derivative = reference.jacobian(lambda y: reference.rhs(LOPSIDED.platform, y, control, CALM), state)
    assert relative_error(LOPSIDED.jacobian(state, control), derivative) < 1e-12


def test_viscous_derivatives_fade_towards_rest():
    """They are of the order of V_b; there is no jump where the hull comes to rest."""
    glider = Glider(lopsided_platform(rate_damping_floor=0.0))
    state, control = at_rest(), np.array([0.02, 0.5, 0.1, 0.2, 0.1])
    still = glider.jacobian(state, control)
    gaps = []
    for speed in (1e-3, 1e-6, 1e-9):
        state[VELOCITIES] = speed * np.array([0.8, 0.5, -0.3])
        gaps.append(np.abs(glider.jacobian(state, control) - still).max())
    assert gaps[1] / gaps[0] == pytest.approx(1e-3, rel=1e-2)
    assert gaps[2] / gaps[1] == pytest.approx(1e-3, rel=1e-2)


@pytest.mark.parametrize("v", [0.3, -0.3])
def test_flow_from_abeam(v):
    """In a flow from abeam, where eqs. 13 and 14 leave alpha undefined, the sideslip is 90 degrees and alpha is 0."""
    flow = hydrodynamics.flow_of(0.0, v, 0.0)
    assert flow.alpha == 0.0
    assert flow.beta == math.copysign(math.pi / 2, v)
    axes = np.array([hydrodynamics.to_body(flow, *axis) for axis in np.eye(3)]).T
    np.testing.assert_allclose(axes, reference.flow_to_body(0.0, flow.beta), atol=1e-16)


@given(state=extreme_states(), costate=st.tuples(*[st.floats(-10.0, 10.0)] * 10))
@settings(deadline=None, max_examples=scaled(1000, 300))
def test_everything_is_finite_below_ninety_degrees(state, costate):
    """Rates, Jacobian and transpose are finite for every state with |theta| < 90 degrees."""
    control = np.array([0.02, 0.5, 0.1, 0.2, 0.1])
    assert np.isfinite(LOPSIDED.rhs(state, control, CALM)).all()
    assert np.isfinite(LOPSIDED.jacobian(state, control)).all()
    y = tuple(state[SENSED])
    by_state, by_disturbance = dynamics.rates_vjp(
        LOPSIDED.hull, body_of(LOPSIDED.bodies(control[None])), y, dynamics.geometry_of(y), costate
    )
    assert np.isfinite(by_state).all()
    assert np.isfinite(by_disturbance).all()


@pytest.mark.parametrize("pitch", [BELOW_A_RIGHT_ANGLE, -BELOW_A_RIGHT_ANGLE])
def test_the_last_pitch_below_ninety_degrees(pitch):
    state = random_state(np.random.default_rng(9))
    state[1] = pitch
    assert np.isfinite(LOPSIDED.rhs(state, np.zeros(5), CALM)).all()
    assert np.isfinite(LOPSIDED.jacobian(state, np.zeros(5))).all()


# Physics


def test_momentum_terms_do_no_work():
    """Without viscous forces the power is only that of buoyancy, weight and disturbance (eqs. 6 and 9)."""
    inviscid = LOPSIDED.hull._replace(**dict.fromkeys(VISCOUS, 0.0))
    for state, control, disturbance in samples(20, seed=10):
        rates = sensed_rates(LOPSIDED, state, control, inviscid, disturbance)
        motion = state[6:]
        k = reference.body_to_earth(*state[ANGLES])[2]
        buoyancy = (control[2] + control[3]) * reference.GRAVITY - LOPSIDED.platform.buoyancy.depth_slope * state[5]
        weight = np.cross(reference.first_moment(LOPSIDED.platform, control), reference.GRAVITY * k)
        forcing = np.concatenate([buoyancy * k, weight]) + disturbance
        power = motion * reference.inertia(LOPSIDED.platform) * rates[4:]
        assert abs(power.sum() - motion @ forcing) < 1e-13 * np.abs(power).max()


def test_only_drag_does_work():
    """Lift and side force are normal to the velocity; drag has the power ``V^3 (K_D0 + K_D alpha^2)`` (eqs. 11, 14)."""
    hull = LOPSIDED.hull
    for state, *_ in samples(20, seed=11):
        V = state[VELOCITIES]
        flow = hydrodynamics.flow_of(*V)
        load = hydrodynamics.load_of(hull, 0.0, flow, *state[RATES])
        force = np.array(hydrodynamics.to_body(flow, load.f1, load.f2, load.f3))
        drag = np.linalg.norm(V) ** 3 * (hull.K_D0 + hull.K_D * math.atan2(V[2], V[0]) ** 2)
        assert force @ V == pytest.approx(-drag, rel=1e-12)


def test_flow_frame_is_orthonormal():
    """`to_flow` is the inverse of `to_body`, and the first axis of the flow is the velocity (eq. 14)."""
    for state, *_ in samples(20, seed=12):
        V, a = state[VELOCITIES], state[RATES]
        flow = hydrodynamics.flow_of(*V)
        there_and_back = hydrodynamics.to_flow(flow, *hydrodynamics.to_body(flow, *a))
        np.testing.assert_allclose(there_and_back, a, rtol=0, atol=1e-15)
        np.testing.assert_allclose(hydrodynamics.to_flow(flow, *V), [np.linalg.norm(V), 0.0, 0.0], atol=1e-15)


def test_speed_is_the_same_in_either_frame():
    """R_eb is a rotation (eqs. 1 and 3)."""
    for state, control, _ in samples(20, seed=13):
        drift = LOPSIDED.rhs(state, control, CALM)[POSITIONS]
        assert np.linalg.norm(drift) == pytest.approx(np.linalg.norm(state[VELOCITIES]), rel=1e-14)


def test_only_the_track_knows_north():
    """A rotated start only rotates the horizontal velocity; a start at another place changes nothing else either."""
    for state, control, disturbance in samples(20, seed=14):
        turned = state.copy()
        turned[2] += math.pi / 2
        turned[3:5] += 1000.0
        rates = LOPSIDED.rhs(state, control, disturbance)
        expected = rates.copy()
        expected[3], expected[4] = -rates[4], rates[3]
        np.testing.assert_allclose(LOPSIDED.rhs(turned, control, disturbance), expected, rtol=1e-13, atol=1e-14)


def test_port_and_starboard_are_alike():
    """A symmetric hull flies the mirrored path, bit for bit, if its start and forcing are mirrored."""
    glider = Glider(read_platform("seawing"))
    mirror = np.array([-1.0, 1.0, -1.0, 1.0, -1.0, 1.0, 1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
    mirror_control = np.array([1.0, -1.0, 1.0, 1.0, -1.0])
    for state, control, disturbance in samples(20, seed=15):
        expected = mirror * glider.rhs(state, control, disturbance)
        mirrored = glider.rhs(mirror * state, mirror_control * control, mirror[6:] * disturbance)
        np.testing.assert_array_equal(mirrored, expected)


@pytest.mark.parametrize("side", [1.0, -1.0], ids=["as published", "mirrored"])
def test_seawing_settles_in_its_published_spiral(side):
    """Compare with Zhang et al. 2013: Seawing with the battery rotated 45 degrees and 2 cm forward, 0.3 kg heavy.

    Speed 0.490 m/s, pitch -35.6, roll -13.7, angle of attack 1.27, sideslip -1.28 deg, turn rate 0.0039 rad/s, radius
    about 100 m. (Their gamma has the opposite sign.)
    """
    glider, step = Glider(read_platform("seawing")), 0.2
    n = scaled(10_000, 5_000)
    start = np.zeros(12)
    start[1], start[6] = math.radians(-35.0), 0.45
    controls = np.tile([0.02, side * math.radians(-45.0), 0.0, 0.3], (n, 1))
    state = glider.simulate(start, controls, np.zeros((n, 6)), step)[-1]
    rates = glider.rhs(state, controls[-1], CALM)
    np.testing.assert_allclose(rates[6:], 0.0, atol=1e-6)
    speed = np.linalg.norm(state[VELOCITIES])
    assert speed == pytest.approx(0.490, abs=0.005)
    angles = [state[1], side * state[0], math.atan2(state[8], state[6]), side * math.asin(state[7] / speed)]
    np.testing.assert_allclose(np.degrees(angles), [-35.6, -13.7, 1.27, -1.28], atol=0.3)
    assert side * rates[2] == pytest.approx(0.0039, abs=0.0001)
    assert math.hypot(rates[3], rates[4]) / abs(rates[2]) == pytest.approx(100.0, abs=3.0)


# The border


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((np.zeros(11), np.zeros(4), CALM), r"state has shape \(11,\); it must be \(12\)"),
        ((np.zeros(12), np.zeros(3), CALM), r"control has shape \(3,\); it must be \(4,\), \(5,\) or \(6,\)"),
        ((np.zeros(12), np.zeros(4), np.zeros(5)), r"disturbance has shape \(5,\)"),
        ((np.full(12, np.nan), np.zeros(4), CALM), r"state\[0\] is nan; every value must be finite"),
        ((np.zeros(12), np.full(4, np.inf), CALM), r"controls\[0, 0\] is inf"),
    ],
)
def test_bad_values_are_named(arguments, message):
    with pytest.raises(InputError, match=message):
        LOPSIDED.rhs(*arguments)


@pytest.mark.parametrize("step", [0.0, -0.1, math.nan])
def test_a_step_must_lead_forward(step):
    with pytest.raises(InputError, match=r"step is .*; it must be above zero"):
        LOPSIDED.simulate(np.zeros(12), np.zeros((2, 4)), np.zeros((2, 6)), step)
