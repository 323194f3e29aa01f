"""Lane type: operators, selections, loads and stores, compared with NumPy's, one lane at a time.

These tests are about compilation for lanes, so formulas are compiled here even under NUMBA_DISABLE_JIT.
"""

import operator

import numba
import numpy as np
import pytest

from gliderhpc.kernels.elementwise import (
    LANES,
    UncompiledLanes,
    lane_array,
    load,
    load_along,
    select,
    square_root,
    store,
    store_along,
    zero_like,
)

SPECIAL = np.array([0.0, -0.0, 1.0, -2.5, np.nan, np.inf, -np.inf, 5e-324, -1e-310, 1e308, 3.0, 1.0 + 2.0**-52])


@pytest.fixture(autouse=True)
def _with_the_compiler(monkeypatch):
    monkeypatch.setattr(numba.config, "DISABLE_JIT", 0)


def rows_of(values):
    """Arrange values as rows of lanes, repeated to fill the last row."""
    rows = lane_array(-(-values.size // LANES))
    rows[...] = np.resize(values, rows.shape)
    return rows


def pairs():
    """Pair every special value with every other, and some ordinary values: two arrays of rows."""
    rng = np.random.default_rng(0)
    a, b = (values.ravel() for values in np.meshgrid(SPECIAL, SPECIAL))
    return rows_of(np.append(a, rng.normal(size=64))), rows_of(np.append(b, rng.normal(size=64) * 1e3))


def in_lanes(formula, *operands):
    """Compile a formula of one or two lanes, and apply it to every row."""
    compiled = numba.njit(error_model="numpy")(formula)

    @numba.njit(error_model="numpy")
    def apply_one(a, out):
        for i in range(a.shape[0]):
            store(out, i, compiled(load(a, i)))

    @numba.njit(error_model="numpy")
    def apply_two(a, b, out):
        for i in range(a.shape[0]):
            store(out, i, compiled(load(a, i), load(b, i)))

    out = np.full_like(operands[0], 7.0)
    (apply_one if len(operands) == 1 else apply_two)(*operands, out)
    return out


def by_numpy(formula, *operands):
    with np.errstate(all="ignore"):
        return np.asarray(formula(*(operand.view(UncompiledLanes) for operand in operands)))


def _accumulated(a, b):
    total = a
    total += b
    total -= 2.0 * a
    total *= b
    total /= a
    return total


ARITHMETIC = {
    "sum": lambda a, b: a + b,
    "difference": lambda a, b: a - b,
    "product": lambda a, b: a * b,
    "quotient": lambda a, b: a / b,
    "in place": _accumulated,
    "with a number before": lambda a, b: 2.5 - a * b,
    "with a number behind": lambda a, b: (a - 2.5) / b,
    "with an integer": lambda a, b: 3 * a + b / 2,
}


@pytest.mark.parametrize("name", ARITHMETIC)
def test_arithmetic_is_numpys(name):
    a, b = pairs()
    np.testing.assert_array_equal(in_lanes(ARITHMETIC[name], a, b), by_numpy(ARITHMETIC[name], a, b))


OF_ONE = {"negative": lambda x: -x, "magnitude": lambda x: abs(x), "root": lambda x: square_root(x)}


@pytest.mark.parametrize("name", OF_ONE)
def test_functions_of_one_value_are_numpys(name):
    a = rows_of(SPECIAL)
    np.testing.assert_array_equal(in_lanes(OF_ONE[name], a), by_numpy(OF_ONE[name], a))


COMPARISONS = {
    "<": lambda a, b: select(a < b, 1.0, 0.0),
    "<=": lambda a, b: select(a <= b, 1.0, 0.0),
    ">": lambda a, b: select(a > b, 1.0, 0.0),
    ">=": lambda a, b: select(a >= b, 1.0, 0.0),
    "==": lambda a, b: select(a == b, 1.0, 0.0),
    "a number before": lambda a, b: select(a > 1.0, a, b),
    "a number behind": lambda a, b: select(a >= 1.0, a, b),
    "or": lambda a, b: select((a < 0.0) | (b < 0.0), a, b),
    "and": lambda a, b: select((a < 0.0) & (b < 0.0), a, b),
    "one side a number": lambda a, b: select(a < b, a, -1.0),
}


@pytest.mark.parametrize("name", COMPARISONS)
def test_selections_are_numpys(name):
    """The values include NaN: every comparison with it is false."""
    a, b = pairs()
    ours = in_lanes(COMPARISONS[name], a, b)
    np.testing.assert_array_equal(ours, by_numpy(COMPARISONS[name], a, b))


@pytest.mark.parametrize("name", ["<", "<=", ">", ">=", "=="])
def test_every_comparison_with_nan_is_false(name):
    a = rows_of(SPECIAL)
    nan = np.full_like(a, np.nan)
    for operands in ((a, nan), (nan, a), (nan, nan)):
        np.testing.assert_array_equal(in_lanes(COMPARISONS[name], *operands), 0.0)


def test_zero_is_zero_whatever_it_is_like():
    np.testing.assert_array_equal(in_lanes(lambda x: zero_like(x), rows_of(SPECIAL)), 0.0)


def test_one_formula_takes_numbers_and_lanes():
    """The same source gives the same bits for arrays of numbers and for arrays with a last axis of lanes."""

    def formula(x, y):
        return select(x > y, square_root(abs(x)), -y) + zero_like(x)

    a, b = pairs()
    compiled = numba.njit(error_model="numpy")(formula)

    @numba.njit(error_model="numpy")
    def apply(a, b, out):
        for i in range(a.shape[0]):
            store(out, i, compiled(load(a, i), load(b, i)))

    lanes, numbers = np.empty_like(a), np.empty(a.size)
    apply(a, b, lanes)
    apply(a.ravel(), b.ravel(), numbers)
    np.testing.assert_array_equal(lanes.ravel(), numbers)
    np.testing.assert_array_equal(numbers, by_numpy(formula, a, b).ravel())


def test_loads_and_stores_touch_their_own_lanes_alone():
    """An index is an integer or a tuple; values are lanes, a number for all lanes, or a number among numbers."""

    @numba.njit
    def move(source, numbers, target, taken):
        store(target, (1, 2), load(source, (0, 1)))
        store(target, (2, 0), 5)
        taken[0] = load(numbers, 2)
        store(numbers, 0, 3)

    source, target = lane_array(2, 3), lane_array(3, 3)
    source[...] = np.arange(source.size).reshape(source.shape)
    target[...] = -1.0
    numbers, taken = np.array([0.5, 1.5, 2.5]), np.zeros(1)
    expected = target.copy()
    expected[1, 2], expected[2, 0] = source[0, 1], 5.0
    move(source, numbers, target, taken)
    np.testing.assert_array_equal(target, expected)
    assert taken[0] == 2.5
    np.testing.assert_array_equal(numbers, [3.0, 1.5, 2.5])


def _shift_along(source, target):
    store_along(target, (0, 3), load_along(source, (1, 2)) + load_along(source, (0, 5)))
    store_along(target, (1, 0), 2.0 * load_along(source, (1, 0)))


@pytest.mark.parametrize("compile_it", [numba.njit, lambda function: function], ids=["compiled", "uncompiled"])
def test_lanes_are_loaded_from_and_stored_to_any_place_in_a_row(compile_it):
    source, target = np.arange(48.0).reshape(2, 24) ** 2, np.full((2, 24), -1.0)
    expected = target.copy()
    expected[0, 3 : 3 + LANES] = source[1, 2 : 2 + LANES] + source[0, 5 : 5 + LANES]
    expected[1, :LANES] = 2.0 * source[1, :LANES]
    compile_it(_shift_along)(source, target)
    np.testing.assert_array_equal(target, expected)


@pytest.mark.parametrize("shape", [(1,), (3, 5), (7, 3, 10)])
def test_lane_arrays_lie_on_register_boundaries(shape):
    for _ in range(20):
        made = lane_array(*shape)
        assert made.shape == (*shape, LANES)
        assert made.ctypes.data % 64 == 0
        assert made.flags.c_contiguous
        assert not made.any()


def test_uncompiled_lanes_are_values():
    """``+=`` creates a new value, as with numbers; other references to the old value are unchanged."""
    array = lane_array(1)
    array[0] = 4.0
    for change in (operator.iadd, operator.isub, operator.imul, operator.itruediv):
        before = load(array, 0)
        changed = change(before, 2.0)
        assert (before == 4.0).all()
        assert (changed != 4.0).all()
    loaded = load(array, 0)
    array[0] = 5.0
    assert (loaded == 4.0).all()
