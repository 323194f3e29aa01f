"""Kernel decorators: compiled entry points, and calls from Python of functions without one."""

import pickle

import numpy as np
import pytest
from numba.core.errors import TypingError

from gliderhpc.kernels import elementary, quasi_newton, smoother_covariance
from gliderhpc.kernels.jit import formula, inner_kernel, kernel

pytestmark = pytest.mark.compiled


@formula
def halved(x):
    return 0.5 * x


@inner_kernel
def halve(x, out):
    for i in range(x.size):
        out[i] = halved(x[i])


@kernel
def halve_twice(x, out):
    halve(x, out)
    halve(out, out)


def entries(function):
    """Return the names of the functions in a function's machine code that begin with numba's prefix for Python."""
    (code,) = function.inspect_llvm().values()
    return [line for line in code.splitlines() if line.startswith("define") and "@_ZN7cpython" in line]


def test_only_kernels_have_an_entry_for_python():
    x, out = np.arange(4.0), np.zeros(4)
    halve_twice(x, out)
    np.testing.assert_array_equal(out, 0.25 * x)
    assert len(entries(halve_twice)) == 1
    assert entries(halve) == []
    assert entries(halved) == []


def test_python_may_call_a_formula_before_and_after_a_kernel_did():
    """In numba's own table the formula is a null pointer; a call of it would end the process."""
    assert halved(3.0) == 1.5
    x, out = np.array([4.0, 5.0]), np.zeros(2)
    halve_twice(x, out)
    assert halved(4.0) == 2.0
    assert halved(3) == 1.5
    halve(x, out)
    np.testing.assert_array_equal(out, 0.5 * x)
    np.testing.assert_array_equal(halved(x), 0.5 * x)


def test_wrong_arguments_of_a_formula_are_refused_as_by_any_function():
    with pytest.raises(TypeError, match=r"too many positional arguments|expected 1, got 2"):
        halved(1.0, 2.0)
    with pytest.raises(TypingError, match="unicode_type"):
        halved("deep")


def test_a_formula_survives_the_way_to_another_process():
    assert pickle.loads(pickle.dumps(elementary.sincos))(0.5) == pytest.approx((np.sin(0.5), np.cos(0.5)), abs=1e-15)


@pytest.mark.parametrize("function", [elementary.sincos, smoother_covariance.symmetrise, quasi_newton.give_up_search])
def test_parts_of_kernels_are_compiled_without_it(function):
    assert function.targetoptions["no_cpython_wrapper"]
