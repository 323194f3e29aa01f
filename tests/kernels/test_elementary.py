"""Sine, cosine, arctangent and wrapping, compared with extended precision over the ranges that occur in a mission."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit
from support.implementations import implementation_named
from support.sizes import COMPILED, scaled

from gliderhpc.kernels.elementary import arctan2, round_to_integer, sincos, wrap
from gliderhpc.kernels.elementwise import LANES

EXTENDED = np.finfo(np.longdouble).nmant > np.finfo(np.float64).nmant
POINTS = scaled(400_000, 4_000)

extended_precision = pytest.mark.skipif(not EXTENDED, reason="this machine's long double is no longer than its double")


def one_by_one(x):
    """Arrange arguments as numbers."""
    return x


def in_lanes(x):
    """Arrange arguments as rows of lanes, with the last row filled up."""
    rows = -(-x.size // LANES)
    return np.resize(x, (rows, LANES))


WAYS = {"numbers": ("numba", one_by_one), "lanes": ("numba", in_lanes), "fortran": ("fortran", one_by_one)}


class Way:
    """Implementation, with the form of its arguments."""

    def __init__(self, name):
        which, self._arranged = WAYS[name]
        self._kernels = implementation_named(which)

    def sine_and_cosine(self, x):
        sine, cosine = self._kernels.sincos(self._arranged(x))
        return sine.ravel()[: x.size], cosine.ravel()[: x.size]

    def angle_of(self, y, x):
        return self._kernels.arctan2(self._arranged(y), self._arranged(x)).ravel()[: x.size]

    def wrapped(self, x):
        return self._kernels.wrap(self._arranged(x)).ravel()[: x.size]


@pytest.fixture(scope="module", params=list(WAYS))
def way(request):
    return Way(request.param)


def ulps(actual, exact):
    """Return the largest error in units of the last place of the exact value."""
    return np.max(np.abs(actual - exact) / np.spacing(np.abs(exact.astype(np.float64))))


@extended_precision
@pytest.mark.parametrize(
    ("reach", "bound"),
    [
        pytest.param(0.1, 1.0, id="roll"),
        pytest.param(math.pi / 2, 2.0, id="pitch"),
        pytest.param(math.pi, 2.0, id="a turn"),
        pytest.param(20.0, 2.0, id="a profile's heading"),
        pytest.param(1e3, 2.0, id="a spiral of a day"),
        pytest.param(1e6, 3.0, id="the domain"),
    ],
)
def test_sine_and_cosine_are_right_to_their_last_places(reach, bound, way):
    x = np.random.default_rng(0).uniform(-reach, reach, POINTS)
    sine, cosine = way.sine_and_cosine(x)
    assert ulps(sine, np.sin(x.astype(np.longdouble))) <= bound
    assert ulps(cosine, np.cos(x.astype(np.longdouble))) <= bound


@extended_precision
def test_sine_and_cosine_where_they_vanish(way):
    """Near multiples of pi/2, the reduction of the argument cancels almost all digits."""
    multiples = np.arange(1, 637) * (math.pi / 2)
    close = [multiples, np.nextafter(multiples, 0.0), np.nextafter(multiples, np.inf)]
    x = np.concatenate(close + [multiples + 10.0**-digits for digits in range(1, 15)])
    sine, cosine = way.sine_and_cosine(x)
    assert ulps(sine, np.sin(x.astype(np.longdouble))) <= 2.0
    assert ulps(cosine, np.cos(x.astype(np.longdouble))) <= 2.0


@given(st.floats(-1e6, 1e6))
@settings(deadline=None, max_examples=scaled(500, 100))
def test_sine_is_odd_and_cosine_even(x):
    sine, cosine = sincos(x)
    assert sincos(-x) == (-sine, cosine)
    assert sine**2 + cosine**2 == pytest.approx(1.0, abs=1e-15)


def test_sine_and_cosine_at_the_quarters(way):
    sine, cosine = way.sine_and_cosine(np.arange(-8, 8) * (math.pi / 2))
    np.testing.assert_allclose(sine, np.tile([0.0, 1.0, 0.0, -1.0], 4), atol=2e-15)
    np.testing.assert_allclose(cosine, np.tile([1.0, 0.0, -1.0, 0.0], 4), atol=2e-15)


@pytest.mark.parametrize("x", [math.nan, math.inf, -math.inf])
def test_nan_and_infinite_angles_give_nan(x, way):
    with np.errstate(invalid="ignore", over="ignore"):
        assert np.isnan(way.sine_and_cosine(np.array([x]))).all()
        assert np.isnan(way.angle_of(np.array([math.nan]), np.ones(1))).all()
        assert np.isnan(way.wrapped(np.array([x]))).all()


@extended_precision
@pytest.mark.parametrize("spread", [0.0, 3.0, 12.0], ids=["round", "elongated", "needle"])
def test_arctangent_is_right_to_its_last_places(spread, way):
    rng = np.random.default_rng(1)
    y = rng.normal(size=POINTS)
    x = rng.normal(size=POINTS) * 10.0 ** rng.uniform(-spread, spread, POINTS)
    assert ulps(way.angle_of(y, x), np.arctan2(y.astype(np.longdouble), x.astype(np.longdouble))) <= 2.0


@extended_precision
def test_arctangent_where_its_polynomial_changes(way):
    """The reduction of the argument changes at 0.66 and at tan(3 pi/8)."""
    limits = np.array([0.66, 2.414213562373095])
    slopes = np.concatenate([limits * (1.0 + k * 2.0**-52) for k in range(-20, 21)])
    for sign_y in (1.0, -1.0):
        for sign_x in (1.0, -1.0):
            y, x = sign_y * slopes, np.full_like(slopes, sign_x)
            assert ulps(way.angle_of(y, x), np.arctan2(y.astype(np.longdouble), x.astype(np.longdouble))) <= 2.0


@pytest.mark.parametrize("x", [-3.0, -1.0, -0.2, 0.2, 1.0, 3.0])
@pytest.mark.parametrize("y", [-3.0, -1.0, -0.2, 0.2, 1.0, 3.0])
def test_arctangent_knows_its_quadrants(y, x):
    assert arctan2(y, x) == pytest.approx(math.atan2(y, x), rel=4e-16)


def test_arctangent_on_the_axes(way):
    y, x = np.array([[0.0, 2.0], [2.0, 0.0], [-2.0, 0.0], [0.0, -2.0]]).T.copy()
    np.testing.assert_array_equal(way.angle_of(y, x), [0.0, math.pi / 2, -math.pi / 2, math.pi])


def test_a_signed_zero_is_a_zero(way):
    """The range is (-pi, pi]: dead astern is +pi for either sign of zero, and the origin has the angle 0."""
    y, x = np.array(
        [[-0.0, -2.0], [-0.0, 2.0], [2.0, -0.0], [0.0, 0.0], [0.0, -0.0], [-0.0, 0.0], [-0.0, -0.0]]
    ).T.copy()
    np.testing.assert_array_equal(way.angle_of(y, x), [math.pi, 0.0, math.pi / 2, 0.0, 0.0, 0.0, 0.0])


@given(st.floats(-1e6, 1e6))
@settings(deadline=None, max_examples=scaled(500, 100))
def test_rounding_is_to_the_nearest_and_ties_to_even(x):
    assert round_to_integer(x) == np.rint(x)
    assert round_to_integer(math.floor(x) + 0.5) == np.rint(math.floor(x) + 0.5)


@given(st.floats(-1e4, 1e4))
@settings(deadline=None, max_examples=scaled(500, 100))
def test_wrapped_angle_is_the_same_direction_within_half_a_turn(angle):
    wrapped = wrap(angle)
    assert abs(wrapped) <= math.pi * (1.0 + 1e-12)
    turns = (angle - wrapped) / (2.0 * math.pi)
    assert turns == pytest.approx(round(turns), abs=1e-11)


@given(st.floats(-3.1, 3.1), st.integers(-50, 50))
@settings(deadline=None, max_examples=scaled(500, 100))
def test_wrapping_removes_full_turns(angle, turns):
    assert wrap(angle) == angle
    assert wrap(angle + 2.0 * math.pi * turns) == pytest.approx(angle, abs=1e-13)


# In lanes


def test_lanes_give_the_bits_of_numbers():
    """The arguments are headings and rolls of a mission, steep and shallow flows, and NaN and infinities."""
    rng = np.random.default_rng(2)
    x = np.concatenate([rng.uniform(-100.0, 100.0, POINTS // 2), [0.0, math.nan, math.inf, -math.inf, 1e6]])
    y = rng.normal(size=x.size)
    lanes, numbers = Way("lanes"), Way("numbers")
    with np.errstate(invalid="ignore", over="ignore"):
        for ours, theirs in zip(lanes.sine_and_cosine(x), numbers.sine_and_cosine(x), strict=True):
            np.testing.assert_array_equal(ours, theirs)
        np.testing.assert_array_equal(lanes.angle_of(y, x), numbers.angle_of(y, x))
        np.testing.assert_array_equal(lanes.wrapped(x), numbers.wrapped(x))


@pytest.mark.skipif(not COMPILED, reason="nothing is compiled")
def test_rounding_does_not_depend_on_the_first_caller():
    """A formula keeps its own flags, independent of those of the kernel for which it is compiled."""
    x = np.random.default_rng(3).uniform(-100.0, 100.0, POINTS)
    results = []
    for fastmath in (False, {"contract", "nsz", "arcp"}):
        options = {name: value for name, value in sincos.targetoptions.items() if name != "nopython"}
        fresh = njit(**options)(sincos.py_func)

        @njit(fastmath=fastmath)
        def first_caller(x, sine, fresh=fresh):
            for i in range(x.size):
                sine[i] = fresh(x[i])[0]

        results.append(np.empty_like(x))
        first_caller(x, results[-1])
    np.testing.assert_array_equal(*results)
