"""Elementwise operations other than arithmetic, for numbers and lanes alike: selection, root, loads and stores.

An array with as many axes as the index yields numbers; one with a further axis of `LANES` yields lanes. A kernel is
thus written once, and is compiled for either according to the arrays of a call.
"""

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.core.imputils import lower_builtin
from numba.core.typing.templates import AbstractTemplate, infer_global, signature

from gliderhpc.kernels.array_sizes import declared_sizes, with_last_axes
from gliderhpc.kernels.lane_type import LANES, VECTOR, Lanes, as_vector, lane_mask, lanes, vector_intrinsic

_CACHE_LINE = 64
"""Bytes in a line of the processor's caches."""

_READ_INTO_SECOND_CACHE = 0, 2, 1
"""Arguments of LLVM's prefetch: read, locality, data."""


class UncompiledLanes(np.ndarray):
    """Lanes without compilation; as with numbers, ``+=`` creates a new value and changes no other variable's value."""

    def __iadd__(self, other):
        return self + other

    def __isub__(self, other):
        return self - other

    def __imul__(self, other):
        return self * other

    def __itruediv__(self, other):
        return self / other


def select(condition, a, b):
    """Return ``a`` where the condition holds, else ``b``; both are computed."""
    return np.where(condition, a, b).view(UncompiledLanes)[()]


def square_root(x):
    """Return the square root; NaN for a negative number."""
    return np.sqrt(x)


def zero_like(x):
    """Return zero, in every lane if ``x`` has lanes."""
    return np.zeros_like(x)[()]


def load(array, index):
    """Return the number at ``index`` (an integer or a tuple), or the lanes there."""
    return np.array(array[index]).view(UncompiledLanes)[()]


def store(array, index, value):
    """Write a number or lanes to the place from which `load` reads them."""
    array[index] = value


def entry(array, index, lane):
    """Return the number of one lane at ``index``; of an array of numbers, the number there."""
    return array[_with_lane(array, index, lane)]


def set_entry(array, index, lane, value):
    """Write the number of one lane to the place from which `entry` reads it."""
    array[_with_lane(array, index, lane)] = value


def _with_lane(array, index, lane):
    own = index if isinstance(index, tuple) else (index,)
    return own if array.ndim == len(own) else (*own, lane)


def load_along(array, index):
    """Return as lanes the `LANES` numbers of a row from ``index`` (a tuple) on."""
    return np.array(array[_along(index)]).view(UncompiledLanes)


def store_along(array, index, value):
    """Write lanes to the place from which `load_along` reads them."""
    array[_along(index)] = value


def _along(index):
    return (*index[:-1], slice(index[-1], index[-1] + LANES))


def clear(array):
    """Set a contiguous array to zero."""
    array[...] = 0.0


def copy(source, target):
    """Copy a contiguous array into another of the same shape."""
    target[...] = source


def prefetch(array):
    """Ask for a contiguous array before it is read, into the second-level cache; without compilation, do nothing."""


def with_sizes(memory):
    """Return a named tuple of contiguous arrays; without compilation, check its sizes and those of the tuples in it.

    The compiler takes the declared sizes for granted.
    """
    declared = declared_sizes(type(memory))
    for name, part in zip(memory._fields, memory, strict=True):
        if isinstance(part, tuple):
            with_sizes(part)
        elif name in declared and part.shape[part.ndim - len(declared[name]) :] != declared[name]:
            raise ValueError(f"{type(memory).__name__}.{name} has shape {part.shape}, not (..., *{declared[name]})")
    return memory


def with_columns(array, columns):
    """Return a contiguous array whose last axis has ``columns`` elements: a constant of the compiler."""
    if array.shape[-1] != columns:
        raise ValueError(f"an array of shape {array.shape} does not have {columns} columns")
    return array


def operation(function, kind_of, lower, *, literal=False):
    """Make a function callable from compiled formulas: type it with ``kind_of(*kinds)`` and lower it at each call.

    As an overload it would be a separate function, compiled for every combination of types. Constant arguments are
    typed with their values if they are to be ``literal``.
    """

    class Template(AbstractTemplate):  # type: ignore[misc]
        key = function
        prefer_literal = literal

        def generic(self, args, kws):
            kind = kind_of(*args)
            return None if kind is None else signature(kind, *args)

    infer_global(function)(Template)
    lower_builtin(function, types.VarArg(types.Any))(lower)


def _widest(*kinds):
    return lanes if lanes in kinds else types.float64


def _as_kind(context, builder, value, kind, wanted):
    """Return an operand as a number or as lanes."""
    return as_vector(context, builder, value, kind) if wanted == lanes else context.cast(builder, value, kind, wanted)


def _lower_select(context, builder, sig, args):
    values = (_as_kind(context, builder, args[i], sig.args[i], sig.return_type) for i in (1, 2))
    return builder.select(args[0], *values)


def _lower_root(context, builder, sig, args):
    value = _as_kind(context, builder, args[0], sig.args[0], sig.return_type)
    if sig.return_type == lanes:
        return vector_intrinsic(builder, "sqrt", value)
    return builder.call(builder.module.declare_intrinsic("llvm.sqrt", [value.type]), [value])


def _lower_zero(context, builder, sig, args):
    return ir.Constant(context.get_value_type(sig.return_type), None)


def kind_loaded(array, index):
    """Return the numba type of `load` for an array and an index: a number, or lanes if an axis is left over."""
    return array.dtype if array.ndim == _axes(index) else lanes


def lower_load(context, builder, sig, args):
    """Emit the code that reads a number or lanes."""
    value = builder.load(_address(context, builder, sig, args), align=_alignment(sig.return_type))
    return context.data_model_manager[sig.return_type].from_data(builder, value)


def _lower_store(context, builder, sig, args):
    kind = kind_loaded(*sig.args[:2])
    value = _as_kind(context, builder, args[2], sig.args[2], kind)
    written = context.data_model_manager[kind].as_data(builder, value)
    builder.store(written, _address(context, builder, sig, args), align=_alignment(kind))
    return context.get_dummy_value()


def _lower_entry(context, builder, sig, args):
    return builder.load(_address(context, builder, sig, args, args[2]), align=_alignment(sig.return_type))


def _lower_set_entry(context, builder, sig, args):
    value = context.cast(builder, args[3], sig.args[3], types.float64)
    builder.store(value, _address(context, builder, sig, args, args[2]), align=_alignment(types.float64))
    return context.get_dummy_value()


def _lower_load_along(context, builder, sig, args):
    pointer = builder.bitcast(_address(context, builder, sig, args), VECTOR.as_pointer())
    return builder.load(pointer, align=_alignment(lanes))


def _lower_store_along(context, builder, sig, args):
    value = as_vector(context, builder, args[2], sig.args[2])
    pointer = builder.bitcast(_address(context, builder, sig, args), VECTOR.as_pointer())
    builder.store(value, pointer, align=_alignment(lanes))
    return context.get_dummy_value()


def _lower_clear(context, builder, sig, args):
    data, size = _bytes(context, builder, sig.args[0], args[0])
    cgutils.memset(builder, data, size, 0)
    return context.get_dummy_value()


def _lower_copy(context, builder, sig, args):
    source, _ = _bytes(context, builder, sig.args[0], args[0])
    target, size = _bytes(context, builder, sig.args[1], args[1])
    cgutils.raw_memcpy(builder, target, source, size, 1)
    return context.get_dummy_value()


def _lower_prefetch(context, builder, sig, args):
    data, size = _bytes(context, builder, sig.args[0], args[0])
    number, byte = ir.IntType(32), ir.IntType(8).as_pointer()
    kind = ir.FunctionType(ir.VoidType(), [byte, number, number, number])
    intrinsic = builder.module.declare_intrinsic("llvm.prefetch", [byte], kind)
    first, options = builder.bitcast(data, byte), [ir.Constant(number, value) for value in _READ_INTO_SECOND_CACHE]
    with cgutils.for_range_slice(builder, size.type(0), size, size.type(_CACHE_LINE)) as (offset, _):
        builder.call(intrinsic, [builder.gep(first, [offset]), *options])
    return context.get_dummy_value()


def _bytes(context, builder, kind, array):
    """Return the address of a contiguous array's bytes, and their number."""
    data, items, size = _members(context, builder, kind, array, "data", "nitems", "itemsize")
    return data, builder.mul(items, size)


def _members(context, builder, kind, array, *names):
    model = context.data_model_manager[kind]
    return (builder.extract_value(array, model.get_field_position(name)) for name in names)


def _nothing_of_contiguous(*kinds):
    """Return the type of no result for contiguous arrays of one type and number of axes, else None."""
    same = len({(kind.dtype, kind.ndim) for kind in kinds}) == 1
    return types.void if same and all(kind.layout == "C" for kind in kinds) else None


def _alignment(kind):
    return 8 if kind in (lanes, types.float64) else None


def _axes(index):
    return len(index) if isinstance(index, types.BaseTuple) else 1


def _address(context, builder, sig, args, lane=None):
    """Return the address of a number, of all lanes, or of one; indices are not negative, and lanes are contiguous."""
    kind, index_kind = sig.args[:2]
    if isinstance(index_kind, types.BaseTuple):
        values, kinds = cgutils.unpack_tuple(builder, args[1]), tuple(index_kind)
    else:
        values, kinds = [args[1]], (index_kind,)
    indices = [context.cast(builder, *pair, types.intp) for pair in zip(values, kinds, strict=True)]
    has_lanes = kind.ndim > len(indices)
    data, shape, strides = _members(context, builder, kind, args[0], "data", "shape", "strides")
    shape, strides = cgutils.unpack_tuple(builder, shape), cgutils.unpack_tuple(builder, strides)
    if has_lanes:
        whole = lane is None
        indices.append(
            ir.Constant(ir.IntType(64), 0) if whole else context.cast(builder, lane, sig.args[2], types.intp)
        )
        # With a constant length of the last axis, the compiler addresses neighbours at constant distances.
        shape[-1] = ir.Constant(ir.IntType(64), LANES)
    pointer = cgutils.get_item_pointer2(context, builder, data, shape, strides, kind.layout, indices, wraparound=False)
    return builder.bitcast(pointer, VECTOR.as_pointer()) if has_lanes and lane is None else pointer


def _lower_with_columns(context, builder, sig, args):
    return with_last_axes(context, builder, sig.args[0], args[0], (sig.args[1].literal_value,))


def _lower_with_sizes(context, builder, sig, args):
    return args[0]


def lane_array(*shape: int):
    """Return zeros of a shape with a further last axis of `LANES`, aligned to a vector register."""
    count = int(np.prod(shape)) * LANES
    memory = np.zeros(count + 8)
    first = -memory.ctypes.data // 8 % 8
    return memory[first : first + count].reshape(*shape, LANES)


operation(select, lambda condition, a, b: lanes if condition == lane_mask else types.float64, _lower_select)
operation(square_root, _widest, _lower_root)
operation(zero_like, _widest, _lower_zero)
operation(load, kind_loaded, lower_load)
operation(store, lambda array, index, value: types.void, _lower_store)
operation(entry, lambda array, index, lane: types.float64, _lower_entry)
operation(set_entry, lambda array, index, lane, value: types.void, _lower_set_entry)
operation(load_along, lambda array, index: lanes, _lower_load_along)
operation(store_along, lambda array, index, value: types.void, _lower_store_along)
operation(clear, _nothing_of_contiguous, _lower_clear)
operation(with_columns, lambda array, columns: array, _lower_with_columns, literal=True)
operation(with_sizes, lambda memory: memory, _lower_with_sizes)
operation(copy, _nothing_of_contiguous, _lower_copy)
operation(prefetch, _nothing_of_contiguous, _lower_prefetch)

__all__ = [
    "LANES", "Lanes", "entry", "lane_array", "load", "load_along", "select", "set_entry", "square_root", "store",
    "store_along", "zero_like",
]  # fmt: skip
