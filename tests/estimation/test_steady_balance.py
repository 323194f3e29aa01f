"""Balance of steady flight, straight and turning, compared with the model's own steady glides and turns."""

import math
from dataclasses import replace

import numpy as np
import pytest

from gliderhpc.estimation.steady_balance import (
    LATERAL,
    PITCHING,
    MeasuredAttitude,
    SteadyFlight,
    SteadyMotion,
    _frame_of,
    steady_balances,
)
from gliderhpc.flight.glider import NET_WEIGHT, Glider
from gliderhpc.flight.hull_parameters import with_values
from gliderhpc.flight.steady_glide import steady_glide
from gliderhpc.platform import read_platform, shipped_platforms

pytestmark = pytest.mark.compiled

STEP = 0.1
DEPTH_RATE, PITCH, ROLL, TURN_RATE = range(4)


def motion_of(glide):
    """Measurements of a steady glide."""
    return SteadyMotion(*(np.array([x]) for x in (0.0, glide.pitch, 0.0, glide.depth, glide.depth_rate)))


def steady_balance(glider, bodies, motion):
    """Return the balance of one hull."""
    (balance,) = steady_balances([glider], [bodies], motion)
    return balance


def turning(glider):
    """Measurements of a steady turn, its velocity and its mass properties: a glide with the battery rotated."""
    glide = steady_glide(glider, 0.35, math.radians(-23.0))
    control = glide.control
    control[1] = math.radians(20.0)
    n = 8000
    states = glider.simulate(glide.state, np.tile(control, (n, 1)), np.zeros((n, 6)), STEP)
    (before, at, after), span = states[[-11, -6, -1]], 10 * STEP
    motion = SteadyMotion(
        at[[0]], at[[1]], np.array([after[2] - before[2]]) / span, at[[5]], np.array([after[5] - before[5]]) / span
    )
    return motion, at[6:9], glider.bodies([control])


@pytest.fixture(scope="module")
def petrel():
    """Petrel-L without a depth slope, so that a dive is steady for ever."""
    return Glider(with_values(read_platform("petrel-l"), {"buoyancy.depth_slope": 0.0}))


@pytest.mark.parametrize("name", shipped_platforms())
@pytest.mark.parametrize("net_mass", [0.25, -0.4])
@pytest.mark.parametrize("depth", [0.0, 300.0])
def test_a_steady_glide_balances(name, net_mass, depth):
    glider = Glider(read_platform(name))
    glide = steady_glide(glider, net_mass, math.copysign(math.radians(27.0), -net_mass), depth)
    balance = steady_balance(glider, glider.bodies([glide.control]), motion_of(glide))
    np.testing.assert_allclose(balance.errors, 0.0, atol=1e-9)
    np.testing.assert_allclose(balance.velocity[0], glide.state[6:9], atol=1e-9)


def test_a_steady_turn_balances(petrel):
    motion, velocity, bodies = turning(petrel)
    assert abs(motion.turn_rate[0]) > math.radians(0.1)
    balance = steady_balance(petrel, bodies, motion)
    np.testing.assert_allclose(balance.errors, 0.0, atol=1e-6)
    np.testing.assert_allclose(balance.velocity[0], velocity, atol=1e-5)


def test_several_hulls_are_balanced_as_each_alone(petrel):
    """To the bit, although each needs its own number of iterations, and a stretch without a solution stops no other."""
    motion, _, bodies = turning(petrel)
    three = motion.repeated(3)
    three.depth_rate[1] *= 1.5
    hulls = [petrel, Glider(with_values(petrel.platform, {"viscous.K_D0": 1.4 * petrel.platform.viscous.K_D0}))]
    theirs = [np.repeat(bodies, 3, axis=0), np.repeat(1.02 * bodies, 3, axis=0)]
    for rate in (three.depth_rate[2], np.nan):
        three.depth_rate[2] = rate
        together = list(steady_balances(hulls, theirs, three))
        for hull, own, found in zip(hulls, theirs, together, strict=True):
            alone = steady_balance(hull, own, three)
            np.testing.assert_array_equal(found.errors, alone.errors)
            np.testing.assert_array_equal(found.velocity, alone.velocity)
        np.testing.assert_allclose(together[0].errors[0], 0.0, atol=1e-6)


@pytest.mark.parametrize(("name", "error"), [("pitch", PITCH), ("roll", ROLL), ("turn_rate", TURN_RATE)])
def test_an_angle_measured_too_large_is_predicted_too_small_by_as_much(petrel, name, error):
    motion, _, bodies = turning(petrel)
    off = replace(motion, **{name: getattr(motion, name) + 1e-6})
    changes = steady_balance(petrel, bodies, off).errors - steady_balance(petrel, bodies, motion).errors
    assert changes[0, error] == pytest.approx(-1e-6, rel=1e-4)


def test_roll_and_turn_are_predicted_from_the_controls_not_from_each_other(petrel):
    motion, _, bodies = turning(petrel)
    for name, other in (("roll", TURN_RATE), ("turn_rate", ROLL)):
        off = replace(motion, **{name: getattr(motion, name) + 1e-6})
        changes = steady_balance(petrel, bodies, off).errors - steady_balance(petrel, bodies, motion).errors
        assert abs(changes[0, other]) < 1e-9


def test_the_depth_rate_is_that_of_the_net_weight(petrel):
    """With four times the weight a glider at the same attitude sinks twice as fast, as the balance predicts."""
    slow, fast = (steady_glide(petrel, mass, math.radians(-25.0)) for mass in (0.1, 0.4))
    balance = steady_balance(petrel, petrel.bodies([fast.control]), motion_of(slow))
    assert balance.errors[0, DEPTH_RATE] == pytest.approx(fast.depth_rate - slow.depth_rate, rel=1e-9)
    assert fast.depth_rate == pytest.approx(2.0 * slow.depth_rate)


@pytest.mark.parametrize("kind", ["straight", "turning"])
def test_the_pitch_error_is_newtons_step_where_the_weight_is_wrong_too(petrel, kind):
    """The rate of nodding over its slope by pitch, the velocity solved for again at each pitch (central difference)."""
    motion, _, bodies = turning(petrel)
    if kind == "straight":
        glide = steady_glide(petrel, 0.35, math.radians(-23.0))
        motion, bodies = motion_of(glide), petrel.bodies([glide.control])
    heavier = bodies.copy()
    heavier[:, NET_WEIGHT] += 1.0

    def nodding(pitch):
        flight = SteadyFlight([petrel], [heavier], replace(motion, pitch=motion.pitch + 0.02 + pitch), None)
        flight.solve_velocity()
        return flight._values[0, PITCHING], flight

    (after, _), (before, _), (now, flight) = nodding(1e-5), nodding(-1e-5), nodding(0.0)
    assert abs(now) > 1e-6
    assert flight.pitch_error()[0] == pytest.approx(-now / ((after - before) / 2e-5), rel=1e-5)


def test_the_lateral_errors_are_newtons_step_where_the_weight_is_wrong_too(petrel):
    """Roll and yaw accelerations over their slopes by roll and rate of turn (central differences)."""
    motion, _, bodies = turning(petrel)
    heavier = bodies.copy()
    heavier[:, NET_WEIGHT] += 1.0

    def accelerations(roll, turn_rate):
        off = replace(motion, roll=motion.roll + 0.1 + roll, turn_rate=motion.turn_rate + turn_rate)
        flight = SteadyFlight([petrel], [heavier], off, None)
        flight.solve_velocity()
        return flight._values[0, LATERAL], flight

    step = 1e-5
    slopes = np.column_stack(
        [(accelerations(*more)[0] - accelerations(*less)[0]) / (2.0 * step)
         for more, less in (((step, 0.0), (-step, 0.0)), ((0.0, step), (0.0, -step)))]
    )  # fmt: skip
    now, flight = accelerations(0.0, 0.0)
    np.testing.assert_allclose(flight.lateral_errors()[0], np.linalg.solve(slopes, -now), rtol=1e-4)


def test_a_hull_that_would_float_gives_a_finite_error_of_the_right_sign(petrel):
    """A neutral volume so wrong that the dive's weight points up."""
    dive, climb = (steady_glide(petrel, mass, math.radians(pitch)) for mass, pitch in ((0.3, -25.0), (-0.3, 25.0)))
    balance = steady_balance(petrel, petrel.bodies([climb.control]), motion_of(dive))
    assert -math.inf < balance.errors[0, DEPTH_RATE] < -dive.depth_rate


def test_a_path_flatter_than_the_hull_glides_gives_finite_errors(petrel):
    flat = SteadyMotion(*(np.array([x, x]) for x in (0.0, math.radians(-6.0), 0.0, 50.0, 0.1)))
    flat.pitch[1] *= -1.0
    glide = steady_glide(petrel, 0.3, math.radians(-25.0))
    balance = steady_balance(petrel, petrel.bodies([glide.control] * 2), flat)
    assert np.isfinite(balance.errors).all()


def test_chosen_samples_keep_their_quantities():
    attitude = MeasuredAttitude(*(np.arange(3.0) + 10.0 * place for place in range(4)))
    chosen = attitude.select(np.array([True, False, True]))
    assert [list(getattr(chosen, name)) for name in ("roll", "pitch", "turn_rate", "depth")] == [
        [0.0, 2.0], [10.0, 12.0], [20.0, 22.0], [30.0, 32.0],
    ]  # fmt: skip


def test_the_frames_derivatives_are_those_of_its_directions():
    rng = np.random.default_rng(4)
    motion = SteadyMotion(*rng.uniform(-1.0, 1.0, (5, 8)))
    frame, step = _frame_of(motion), 1e-6
    np.testing.assert_allclose(np.cross(frame.across, frame.down), frame.ahead, atol=1e-12)
    for name, partials in (("roll", frame.by_roll), ("pitch", frame.by_pitch)):
        after, before = (_frame_of(replace(motion, **{name: getattr(motion, name) + d})) for d in (step, -step))
        for direction, partial in zip(("down", "ahead", "across"), partials, strict=True):
            change = (getattr(after, direction) - getattr(before, direction)) / (2.0 * step)
            np.testing.assert_allclose(partial, change, atol=1e-9, err_msg=f"{direction} by {name}")
