"""Translation of typed functions into LLVM's intermediate code, with fewer instructions than numba's own.

A variable that is assigned once, before all of its uses, is a value and needs no memory. A field of a tuple that was
passed by reference is loaded alone.
"""

import operator
from collections import defaultdict
from typing import ClassVar

from numba.core import ir, types
from numba.core.analysis import compute_cfg_from_blocks, compute_use_defs
from numba.core.lowering import Lower
from numba.core.typing import Context

from gliderhpc.kernels.calling import WithReferences, address_of, by_reference, load_field, load_unchanging, stored


class CachingContext(Context):
    """Numba's typing context, with a cache of the signature of every call by the types of its arguments.

    Without it, numba tries dozens of implementations at every operator, and composes an error message for each that
    does not fit.
    """

    _signatures: ClassVar = {}

    def __init__(self, context):
        # The two contexts share their state: an implementation registered in one is available in the other.
        self.__dict__ = context.__dict__

    def resolve_function_type(self, func, args, kws):
        """Return the signature of a call, None if no implementation fits."""
        if kws or not all(isinstance(kind, types.Type) for kind in args):
            return super().resolve_function_type(func, args, kws)
        key = func, tuple(args)
        signature = self._signatures.get(key)
        if signature is None:
            signature = super().resolve_function_type(func, args, kws)
            # A failure is not stored: an implementation may be registered later.
            if signature is not None:
                self._signatures[key] = signature
        return signature


class _Lower(Lower):
    """Numba's lowering, with the signatures of operators from the cache of `CachingContext`."""

    def lower_binop(self, resty, expr, op):
        """Lower an operator; numba lowers one with a constant operand, which may have a special implementation."""
        if expr.static_lhs is not ir.UNDEFINED or expr.static_rhs is not ir.UNDEFINED:
            return super().lower_binop(resty, expr, op)
        return self._lower_call(resty, op, self.fndesc.calltypes[expr], expr.lhs, expr.rhs)

    def lower_getitem(self, resty, expr, value, index, signature):
        """Lower the access to an element."""
        return self._lower_call(resty, operator.getitem, signature, value, index)

    def _lower_call(self, resty, function, typed, *operands):
        """Lower a call of `function` that was typed as `typed`, with a result of type `resty`."""
        context = CachingContext(self.context.typing_context)
        kind = context.resolve_value_type(function)
        # Resolved again, since `typed` may be that of an in-place operator, which is lowered as the plain one.
        signature = context.resolve_function_type(kind, typed.args, {})
        values = [
            self.context.cast(self.builder, self.loadvar(operand.name), self.typeof(operand.name), wanted)
            for operand, wanted in zip(operands, signature.args, strict=True)
        ]
        result = self.context.get_function(kind, signature)(self.builder, values)
        return self.context.cast(self.builder, result, signature.return_type, resty)

    def lower_expr(self, resty, expr):
        """Lower an expression; a field of a tuple that is in memory is loaded alone."""
        if expr.op in ("getattr", "static_getitem"):
            kind = self.typeof(expr.value.name)
            if isinstance(kind, types.BaseTuple):
                address = address_of(self.loadvar(expr.value.name))
                index = kind.fields.index(expr.attr) if expr.op == "getattr" else expr.index
                if address is not None and isinstance(index, int):
                    index %= len(kind)
                    value = load_field(self.context, self.builder, address, kind, index)
                    return self.context.cast(self.builder, value, kind[index], resty)
        return super().lower_expr(resty, expr)

    def _find_singly_assigned_variable(self):
        """Find the variables that need no memory; numba's own are those used only in the block that assigns them."""
        blocks = self.func_ir.blocks
        assigned, used = defaultdict(list), defaultdict(set)
        for place, block in blocks.items():
            for one in block.find_insts(ir.Assign):
                assigned[one.target.name].append(place)
        # A use before the assignment in the same block, of the value from a loop's last round, is among these.
        for place, names in compute_use_defs(blocks).usemap.items():
            for name in names:
                used[name].add(place)
        dominators = compute_cfg_from_blocks(blocks).dominators()
        self._singly_assigned_vars = {
            name
            for name, places in assigned.items()
            if len(places) == 1 and all(places[0] < use and places[0] in dominators[use] for use in used[name])
        }
        self._blk_local_varmap = {}


class KernelLower(_Lower):
    """Lowering of a kernel, which has numba's calling convention, so that Python can call it."""

    def extract_function_arguments(self):
        """Return the arguments, with those in memory that the parts take by reference."""
        values = super().extract_function_arguments()
        self.fnargs = [
            load_unchanging(self.builder, stored(self.builder, value), value.type) if by_reference(kind) else value
            for kind, value in zip(self.fndesc.argtypes, values, strict=True)
        ]
        return self.fnargs


class PartLower(_Lower):
    """Lowering of a part."""

    @property
    def call_conv(self):
        """The calling convention of parts."""
        return WithReferences(self.context).call_conv

    def setup_function(self, fndesc):
        """Declare the function with the calling convention of parts."""
        context, self.context = self.context, WithReferences(self.context)
        try:
            super().setup_function(fndesc)
        finally:
            self.context = context

    def emit_environment_object(self):
        """Emit nothing: numba's environment is for calls of Python, and a part contains none."""
