"""Compiler of kernels: kernels contain the parts that they call, one version for all integers; kernels call kernels.

These tests are about compilation, so kernels are compiled here even under NUMBA_DISABLE_JIT.
"""

from typing import Any, NamedTuple

import numba
import numpy as np
import pytest
from numba.core.errors import TypingError

from gliderhpc.kernels.array_sizes import declare_sizes
from gliderhpc.kernels.compiler import InnerDispatcher, KernelDispatcher
from gliderhpc.kernels.elementwise import (
    LANES,
    clear,
    copy,
    lane_array,
    load,
    select,
    store,
    with_columns,
    with_sizes,
)
from gliderhpc.kernels.jit import formula, inner_kernel, kernel
from gliderhpc.kernels.parameters import Hull
from gliderhpc.kernels.window import duration, hull_in

OPTIONS = {"nopython": True, "error_model": "numpy", "no_cfunc_wrapper": True, "_nrt": False}


@pytest.fixture(autouse=True)
def _with_the_compiler(monkeypatch):
    monkeypatch.setattr(numba.config, "DISABLE_JIT", 0)


def part(function, *, inlined=False):
    return InnerDispatcher(function, targetoptions={**OPTIONS, "no_cpython_wrapper": True, "forceinline": inlined})


def entry(function):
    return KernelDispatcher(function, targetoptions=OPTIONS)


def code_of(compiled):
    (code,) = compiled.inspect_llvm().values()
    return code


def test_a_formula_is_inside_the_kernels_that_call_it():
    half = part(lambda x: 0.5 * x, inlined=True)
    quarter = part(lambda x: half(half(x)), inlined=True)

    @entry
    def halve_twice(x):
        for i in range(x.shape[0]):
            x[i] = quarter(x[i])

    x = np.arange(5.0)
    halve_twice(x)
    np.testing.assert_array_equal(x, 0.25 * np.arange(5.0))
    assert code_of(halve_twice).count("\ndefine") == 2  # the kernel, and its entry point for Python


def test_the_entry_for_python_is_not_optimised():
    kernel = entry(lambda x, i: x[i])
    assert kernel(np.arange(3.0), 1) == 1.0
    (line,) = (line for line in code_of(kernel).splitlines() if line.startswith("define") and "_ZN7cpython" in line)
    attributes = line[line.rindex("#") :].split()[0]
    (group,) = (line for line in code_of(kernel).splitlines() if line.startswith(f"attributes {attributes} ="))
    assert "optnone" in group


def test_one_version_serves_all_integers():
    """It also serves integers inside a tuple, whose numba types contain their values."""
    one = part(lambda x, i, at: load(x, i) + load(x, at[0]))
    kernel = entry(lambda x: one(x, 0, (1, 2.0)) + one(x, 1, (2, 2.0)) + one(x, 2, (0, 2.0)))
    assert kernel(np.arange(3.0)) == 6.0
    assert len(one.overloads) == 1


def test_a_kernel_that_calls_a_kernel_has_its_part_inside():
    inner = entry(lambda x: x[0] + 1.0)
    outer = entry(lambda x: 2.0 * inner(x))
    assert outer(np.ones(1)) == 4.0
    assert list(inner.part.overloads)
    assert not inner.overloads
    assert inner(np.ones(1)) == 2.0


def test_numba_functions_of_others_may_call_parts():
    inner = part(lambda x: x + 1.0)
    outer = part(lambda x: 2.0 * inner(x), inlined=True)
    assert numba.njit(lambda x: outer(x))(1.0) == 4.0
    assert outer(1.0) == 4.0


def test_operators_are_those_of_numba():
    """The kernel has in-place operators, operators of integers and floats, and powers with a constant exponent."""

    @entry
    def kernel(x, n):
        total = 0.0
        count = 3
        for i in range(n):
            total += x[i] ** 2 + x[i] ** 0.5
            count -= i
            count *= 2
        return total - count // 2 + (n % 4) * (n > 2) + -n

    x = np.arange(5.0)
    assert kernel(x, 5) == pytest.approx(kernel.py_func(x, 5), rel=1e-15)


def test_wrong_types_are_refused():
    kernel = entry(lambda x: x + "deep")
    with pytest.raises(TypingError):
        kernel(1.0)


def test_arrays_are_copied_and_cleared():
    @entry
    def kernel(source, target):
        copy(source[1], target[0])
        clear(target[1])

    source, target = np.arange(12.0).reshape(2, 3, 2), np.ones((2, 3, 2))
    kernel(source, target)
    np.testing.assert_array_equal(target, [source[1], np.zeros((3, 2))])


@pytest.mark.parametrize("pair", [(np.ones((4, 2))[:, 0], np.ones(4)), (np.ones(4), np.ones((2, 2)))])
def test_arrays_with_gaps_or_of_other_axes_are_not_copied(pair):
    with pytest.raises(TypingError):
        entry(lambda source, target: copy(source, target))(*pair)


def test_numbers_of_any_kind_are_loaded_and_stored():
    @entry
    def kernel(flags, bits, x):
        if load(flags, 1):
            store(bits, 0, load(bits, 1))
        store(flags, 0, True)
        return select(load(flags, 2), x, 1)

    flags, bits = np.array([False, True, False]), np.array([1, 5], np.uint8)
    assert kernel(flags, bits, 3.0) == 1.0
    assert flags[0]
    assert bits[0] == 5


def test_a_hull_and_durations_come_as_numbers_or_as_arrays():
    kernel = entry(lambda hull, h, k: hull_in(hull).mass_v + duration(h, k))
    numbers = np.arange(24.0)
    assert kernel(Hull(*numbers.tolist()), 0.5, 1) == 1.5
    assert kernel(numbers, np.array([3.0, 4.0]), 1) == 5.0
    lanes = lane_array(24)
    lanes[1] = np.arange(LANES)
    out = lane_array(1)

    @entry
    def in_lanes(hull, out):
        store(out, 0, hull_in(hull).mass_v)

    in_lanes(lanes, out)
    np.testing.assert_array_equal(out[0], np.arange(LANES))


def test_the_decorators_make_kernels_and_parts():
    assert isinstance(kernel(lambda x: x), KernelDispatcher)
    assert isinstance(formula(lambda x: x), InnerDispatcher)
    assert isinstance(inner_kernel(lambda x: x), InnerDispatcher)


class Memory(NamedTuple):
    """A named tuple of arrays, one of which has declared sizes."""

    matrices: Any
    vector: Any


class Outer(NamedTuple):
    """A named tuple with another in it."""

    memory: Memory
    lanes: Any


declare_sizes(Memory, matrices=(3, 4))
declare_sizes(Outer, lanes=(6, LANES))


def sized_memory():
    """Return memory of the declared sizes, with numbers in order."""
    lanes = np.arange(5.0 * 6 * LANES).reshape(5, 6, LANES)
    return Outer(Memory(np.arange(60.0).reshape(5, 3, 4), np.arange(5.0)), lanes)


def value_in(outer, i):
    return outer.memory.matrices[i, 2, 1] + outer.lanes[i, 0, 1]


def code_of_part(compiled):
    """Return the definition of the only part of a kernel."""
    (code,) = code_of(compiled).split("define internal")[1:]
    return code.split("\n}")[0]


def definition_of_part(compiled):
    """Return the line that defines the only part of a kernel."""
    (line,) = (line for line in code_of(compiled).splitlines() if line.startswith("define internal"))
    return line


def test_arrays_and_their_tuples_are_passed_by_reference():
    inner = part(
        lambda outer, x, i: outer.memory.matrices[i][2, 1] + outer.memory.vector[i] + outer.lanes[i, 0, 1] + x[i]
    )
    kernel = entry(lambda outer, x, i: inner(outer, x, i) + inner(outer, x[1:], 0))
    outer, x = sized_memory(), np.arange(5.0)
    expected = value_in(outer, 4) + outer.memory.vector[4] + x[4] + value_in(outer, 0) + outer.memory.vector[0] + x[1]
    assert kernel(outer, x, 4) == pytest.approx(expected)
    arguments = definition_of_part(kernel)
    assert "noinline" in code_of(kernel)
    assert arguments.count("%arg.outer") == 1
    assert "insertvalue" not in code_of_part(kernel)


def test_declared_sizes_are_constants_in_the_parts_of_a_kernel():
    """A part loads only the length of the first axis, which is not declared and counts for a negative index."""
    inner = part(lambda outer, i: outer.memory.matrices[i][2, 1] + outer.lanes[i, 0, 1])
    kernel = entry(lambda outer, i: inner(with_sizes(outer), i) + inner(outer, 0))
    outer = sized_memory()
    assert kernel(outer, 4) == pytest.approx(value_in(outer, 4) + value_in(outer, 0))
    assert code_of_part(kernel).count("load i64") == 2


def test_a_tuple_passed_on_or_taken_apart_is_not_copied():
    last = part(lambda memory, i: memory.matrices[i, 2, 1] + memory.vector[i])
    first = part(lambda outer, i: last(outer[0], i) + last(outer.memory, 0) + outer[-1][i, 0, 1])
    kernel = entry(lambda outer, i: first(outer, i) + first(outer, 0))
    outer, vector = sized_memory(), np.arange(5.0)
    expected = sum(value_in(outer, i) + vector[i] + outer.memory.matrices[0, 2, 1] for i in (4, 0))
    assert kernel(outer, 4) == pytest.approx(expected)
    # The kernel puts its own arguments on the stack, once; the parts put nothing there.
    assert all("alloca {" not in one for one in code_of(kernel).split("define internal")[1:])


def test_a_variable_assigned_once_has_a_value_after_branches_and_loops():
    """Variables that a loop or a branch may leave unassigned, or assigns for its next round, need memory."""

    @part
    def walk(x, n):
        total, before = 0.0, -1.0
        for i in range(n):
            here = x[i]
            if here > 2.0:
                large = here
                total += large
            if i > 0:
                total += 100.0 * (here - before)
            before = here
        return total + here + large

    kernel = entry(lambda x, n: walk(x, n) + walk(x, 5))
    x = np.array([3.0, 1.0, 4.0, 1.0, 5.0])
    # 3 + 4 + 5, 100 (x_n - x_1), and the last values
    assert kernel(x, 3) == pytest.approx((7.0 + 100.0 + 4.0 + 4.0) + (12.0 + 200.0 + 5.0 + 5.0))


def test_the_number_of_columns_is_a_constant_in_the_parts_of_a_kernel():
    inner = part(lambda x, i: x[i, 2])
    kernel = entry(lambda x, i: inner(with_columns(x, 4), i) + inner(with_columns(x, 4), 0))
    assert kernel(np.arange(12.0).reshape(3, 4), 1) == 8.0
    assert "%arg.x.5.1" not in definition_of_part(kernel)


def test_sizes_of_an_array_that_is_not_contiguous_are_left_to_it():
    kernel = entry(lambda x, i: with_columns(x, 4)[i, 2])
    assert kernel(np.arange(24.0).reshape(3, 8)[:, ::2], 1) == 12.0


def test_other_sizes_than_the_declared_ones_are_refused_without_the_compiler():
    right = Outer(Memory(np.zeros((2, 3, 4)), np.zeros(3)), np.zeros((6, LANES)))
    assert with_sizes(right) is right
    with pytest.raises(ValueError, match=r"Memory.matrices has shape \(2, 4, 3\)"):
        with_sizes(right._replace(memory=Memory(np.zeros((2, 4, 3)), np.zeros(3))))
    with pytest.raises(ValueError, match="4 columns"):
        with_columns(np.zeros((2, 3)), 4)
