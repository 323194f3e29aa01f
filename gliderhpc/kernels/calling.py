"""Calls between the parts of a kernel: arrays, and tuples of them, are passed by reference.

Numba takes a tuple of arrays apart at every call, into ten numbers and pointers for each array, and puts it together
again in the called function. This would be half of the code of the parts, which have many such arguments. Here, a call
passes the address of the tuple, or of one of its fields, and only what is used is loaded.
"""

from llvmlite import ir
from numba.core import types
from numba.core.callconv import CPUCallConv
from numba.core.cpu import CPUContext
from numba.core.datamodel import ArgPacker
from numba.core.imputils import user_function

from gliderhpc.kernels.array_sizes import declared_sizes, with_last_axes

_ADDRESS = ir.IntType(8).as_pointer()


def by_reference(kind: types.Type) -> bool:
    """Return whether arguments of a type are passed by reference: arrays, and tuples that contain any."""
    if isinstance(kind, types.BaseTuple):
        return any(map(by_reference, kind.types))
    return isinstance(kind, types.Array)


def address_of(value):
    """Return the address from which a value was loaded, None unless the value there is constant."""
    return getattr(value, "unchanging_address", None)


def load_unchanging(builder, address, kind):
    """Load a value of an LLVM type from an address whose content never changes."""
    value = builder.load(builder.bitcast(address, kind.as_pointer()))
    value.unchanging_address = address
    return value


def stored(builder, value):
    """Store a value on the stack, and return its address."""
    with builder.goto_entry_block():
        slot = builder.alloca(value.type)
    builder.store(value, slot)
    return builder.bitcast(slot, _ADDRESS)


def load_field(context, builder, address, kind, index):
    """Load a field of the tuple at an address, with its declared sizes if it is an array."""
    offset = _offsets(context, context.get_value_type(kind))[index]
    place = builder.gep(address, [ir.IntType(64)(offset)])
    value = load_unchanging(builder, place, context.get_value_type(kind[index]))
    if not isinstance(kind, types.BaseNamedTuple):
        return value
    sizes = declared_sizes(kind.instance_class).get(kind.fields[index])
    if sizes is None:
        return value
    sized = with_last_axes(context, builder, kind[index], value, sizes)
    sized.unchanging_address = place
    return sized


_OFFSETS: dict[str, list[int]] = {}


def _offsets(context, kind):
    """Return the offsets of the fields of a tuple's LLVM type, byte."""
    key = str(kind)
    found = _OFFSETS.get(key)
    if found is None:
        data = context.target_data
        if isinstance(kind, ir.ArrayType):
            found = [index * kind.element.get_abi_size(data) for index in range(kind.count)]
        else:
            found = [kind.get_element_offset(data, index) for index in range(len(kind.elements))]
        _OFFSETS[key] = found
    return found


class _PartArguments(ArgPacker):
    """Numba's order of arguments, with an address for each that is passed by reference."""

    def __init__(self, models, kinds):
        self._referenced = [models.lookup(kind).get_value_type() if by_reference(kind) else None for kind in kinds]
        super().__init__(models, [types.voidptr if by_reference(kind) else kind for kind in kinds])

    def as_arguments(self, builder, values):
        """Return the arguments of a call."""
        return super().as_arguments(
            builder,
            [
                value if kind is None else address_of(value) or stored(builder, value)
                for kind, value in zip(self._referenced, values, strict=True)
            ],
        )

    def from_arguments(self, builder, args):
        """Return the values of a function's arguments."""
        return [
            value if kind is None else load_unchanging(builder, value, kind)
            for kind, value in zip(self._referenced, super().from_arguments(builder, args), strict=True)
        ]


class _PartConvention(CPUCallConv):
    """Numba's calling convention, with references."""

    def _get_arg_packer(self, argtypes):
        return _PartArguments(self.context.data_model_manager, argtypes)

    def decorate_function(self, fn, args, fe_argtypes, noalias=False):
        """Set the names and attributes of a function's arguments."""
        super().decorate_function(fn, args, fe_argtypes, noalias)
        for argument in self.get_arguments(fn):
            if argument.type == _ADDRESS:
                # As those of the place for the result: nothing else leads there, and the address is not kept.
                for attribute in fn.args[0].attributes:
                    argument.add_attribute(attribute)


class WithReferences(CPUContext):
    """Numba's target, in which functions are declared and called with references.

    Parameters
    ----------
    context : CPUContext
        Target whose state is shared.
    """

    def __init__(self, context):
        self.__dict__ = context.__dict__

    @property
    def call_conv(self):
        """The calling convention."""
        return _PartConvention(self)


def part_call(described, library):
    """Return the implementation of a call of a compiled part, in numba's form."""
    plain = user_function(described, [library])

    def call(context, builder, signature, arguments):
        return plain(WithReferences(context), builder, signature, arguments)

    call.signature, call.libs = plain.signature, plain.libs
    return call
