"""Declared sizes of the arrays in named tuples: constants of the compiler.

With constant sizes, elements of an array are at constant distances. The sizes are those with which the arrays are
allocated.
"""

from numba.core import types

_SIZES: dict[type, dict[str, tuple[int, ...]]] = {}


def declare_sizes(memory, **sizes):
    """Declare the sizes of the last axes of a named tuple's arrays, which must be contiguous."""
    _SIZES[memory] = sizes


def declared_sizes(memory):
    """Return the declared sizes of a named tuple's arrays, by the name of the field."""
    return _SIZES.get(memory, {})


def with_last_axes(context, builder, kind, array, sizes):
    """Return an array with constants for the sizes of its last axes, and for the strides that follow from them."""
    if kind.layout != "C":
        return array
    model = context.data_model_manager[kind]
    shape, strides = (model.get_field_position(name) for name in ("shape", "strides"))
    stride = context.get_abi_sizeof(context.get_data_type(kind.dtype))
    for axis in range(kind.ndim - 1, -1, -1):
        array = builder.insert_value(array, context.get_constant(types.intp, stride), (strides, axis))
        position = axis - kind.ndim + len(sizes)
        if position < 0:
            break
        array = builder.insert_value(array, context.get_constant(types.intp, sizes[position]), (shape, axis))
        stride *= sizes[position]
    return array
