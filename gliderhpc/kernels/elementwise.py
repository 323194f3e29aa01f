"""Elementwise operations apart from arithmetic, alike for a number and for lanes: selection, root, loads and stores.

An array whose number of axes is that of the index gives numbers; one with an axis more, of `LANES`, gives lanes. So a
kernel is written once and is compiled for either by the arrays it is called with.
"""

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.core.extending import intrinsic, overload

from gliderhpc.kernels.lane_type import LANES, VECTOR, LaneMask, Lanes, as_vector, lanes, vector_intrinsic

_INLINE = {"forceinline": True}


class UncompiledLanes(np.ndarray):
    """Lanes where nothing is compiled: as with numbers, ``+=`` gives a new value and changes no other name's."""

    def __iadd__(self, other):
        return self + other

    def __isub__(self, other):
        return self - other

    def __imul__(self, other):
        return self * other

    def __itruediv__(self, other):
        return self / other


def select(condition, a, b):
    """``a`` where the condition holds, else ``b``; both are computed."""
    return np.where(condition, a, b).view(UncompiledLanes)[()]


def square_root(x):
    """The square root; NaN of a negative number."""
    return np.sqrt(x)


def zero_like(x):
    """Zero, in every lane where ``x`` has lanes."""
    return np.zeros_like(x)[()]


def load(array, index):
    """The number at ``index`` (an integer or a tuple), or the lanes there."""
    return np.array(array[index]).view(UncompiledLanes)[()]


def store(array, index, value):
    """Write a number or lanes to where `load` finds them."""
    array[index] = value


@overload(select, jit_options=_INLINE)
def _select(condition, a, b):
    if isinstance(condition, LaneMask):
        return lambda condition, a, b: _selected(condition, a, b)
    return lambda condition, a, b: a if condition else b


@overload(square_root, jit_options=_INLINE)
def _square_root(x):
    if x == lanes:
        return lambda x: _lane_root(x)
    return lambda x: np.sqrt(x)


@overload(zero_like, jit_options=_INLINE)
def _zero_like(x):
    if x == lanes:
        return lambda x: _spread(0.0)
    return lambda x: 0.0


@overload(load, jit_options=_INLINE)
def _load(array, index):
    return lambda array, index: _loaded(array, index)


@overload(store, jit_options=_INLINE)
def _store(array, index, value):
    return lambda array, index, value: _stored(array, index, value)


def _axes(index):
    return len(index) if isinstance(index, types.BaseTuple) else 1


@intrinsic
def _selected(typingctx, condition, a, b):
    def lower(context, builder, sig, args):
        return builder.select(args[0], *(as_vector(context, builder, args[i], sig.args[i]) for i in (1, 2)))

    return lanes(condition, a, b), lower


@intrinsic
def _lane_root(typingctx, x):
    return lanes(x), lambda context, builder, sig, args: vector_intrinsic(builder, "sqrt", args[0])


@intrinsic
def _spread(typingctx, x):
    return lanes(x), lambda context, builder, sig, args: as_vector(context, builder, args[0], sig.args[0])


@intrinsic
def _loaded(typingctx, array, index):
    kind = array.dtype if array.ndim == _axes(index) else lanes

    def lower(context, builder, sig, args):
        return builder.load(_address(context, builder, sig, args), align=8)

    return kind(array, index), lower


@intrinsic
def _stored(typingctx, array, index, value):
    number = array.ndim == _axes(index)

    def lower(context, builder, sig, args):
        if number:
            written = context.cast(builder, args[2], value, array.dtype)
        else:
            written = as_vector(context, builder, args[2], value)
        builder.store(written, _address(context, builder, sig, args), align=8)
        return context.get_dummy_value()

    return types.void(array, index, value), lower


def _address(context, builder, sig, args):
    """Address at which a number, or its lanes, begin; indices count from the front, and lanes lie side by side."""
    kind, index_kind = sig.args[:2]
    if isinstance(index_kind, types.BaseTuple):
        values, kinds = cgutils.unpack_tuple(builder, args[1]), tuple(index_kind)
    else:
        values, kinds = [args[1]], (index_kind,)
    indices = [context.cast(builder, *pair, types.intp) for pair in zip(values, kinds, strict=True)]
    has_lanes = kind.ndim > len(indices)
    array = context.make_array(kind)(context, builder, args[0])
    shape = cgutils.unpack_tuple(builder, array.shape)
    if has_lanes:
        indices.append(ir.Constant(ir.IntType(64), 0))
        # With the length of the last axis known, the compiler addresses neighbours by constant distances.
        shape[-1] = ir.Constant(ir.IntType(64), LANES)
    pointer = cgutils.get_item_pointer2(
        context, builder, array.data, shape, cgutils.unpack_tuple(builder, array.strides), kind.layout, indices,
        wraparound=False,
    )  # fmt: skip
    return builder.bitcast(pointer, VECTOR.as_pointer()) if has_lanes else pointer


def borrowed(arrays):
    """Give the same tuple of arrays of one kind, not counted as references: taking one in a loop then costs nothing.

    Whoever called the kernel keeps them alive.
    """
    return arrays


@overload(borrowed, jit_options=_INLINE)
def _borrowed(arrays):
    return lambda arrays: _without_owner(arrays)


@intrinsic
def _without_owner(typingctx, arrays):
    def lower(context, builder, sig, args):
        taken = []
        for value, kind in zip(cgutils.unpack_tuple(builder, args[0]), sig.args[0], strict=True):
            array = context.make_array(kind)(context, builder, value)
            array.meminfo = ir.Constant(array.meminfo.type, None)
            array.parent = ir.Constant(array.parent.type, None)
            taken.append(array._getvalue())
        return context.make_tuple(builder, sig.return_type, taken)

    return arrays(arrays), lower


def lane_array(*shape: int):
    """Zeros of a shape with an axis of `LANES` behind it, aligned to a vector register."""
    count = int(np.prod(shape)) * LANES
    memory = np.zeros(count + 8)
    first = -memory.ctypes.data // 8 % 8
    return memory[first : first + count].reshape(*shape, LANES)


__all__ = ["LANES", "Lanes", "borrowed", "lane_array", "load", "select", "square_root", "store", "zero_like"]
