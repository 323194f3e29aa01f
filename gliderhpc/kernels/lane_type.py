"""Lanes: a vector of doubles, one for each profile, as a type that compiled formulas accept in place of a number.

A formula written for scalars works on lanes unchanged. The operators below are lowered to LLVM's vector instructions,
which use the machine's full width without a loop that the compiler must vectorise, and never mix lanes. Arrays contain
lanes along their last axis (`gliderhpc.kernels.elementwise.load`).
"""

import operator

import llvmlite.binding
from llvmlite import ir
from numba.core import cgutils, config, types
from numba.core.extending import models, register_model
from numba.core.imputils import lower_builtin
from numba.core.typing.templates import AbstractTemplate, infer_global, signature


def _vector_doubles() -> int:
    """Return the doubles in a vector register of this machine, or of the one that NUMBA_CPU_FEATURES describes."""
    if config.CPU_FEATURES is not None:
        wide = "+avx512f" in config.CPU_FEATURES
    else:
        wide = config.CPU_NAME is None and llvmlite.binding.get_host_cpu_features().get("avx512f", False)
    return lanes_with(wide=wide)


def lanes_with(*, wide: bool) -> int:
    """Return the number of lanes on processors with AVX-512 (`wide`) or without."""
    return 8 if wide else 4


LANES = _vector_doubles()
"""Number of profiles computed together, those of one full vector register (8 with AVX-512, 4 otherwise). Two registers
per value were slower in measurements: the right-hand side needs more values at once than there are registers."""


class Lanes(types.Type):  # type: ignore[misc]
    """Numba type of `LANES` doubles."""

    def __init__(self) -> None:
        super().__init__(name=f"lanes{LANES}")


class LaneMask(types.Type):  # type: ignore[misc]
    """Numba type of `LANES` truth values."""

    def __init__(self) -> None:
        super().__init__(name=f"lanes{LANES}_mask")


lanes, lane_mask = Lanes(), LaneMask()
VECTOR = ir.VectorType(ir.DoubleType(), LANES)
_MASK = ir.VectorType(ir.IntType(1), LANES)


@register_model(Lanes)
class _LanesModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, dmm, fe_type):
        super().__init__(dmm, fe_type, VECTOR)


@register_model(LaneMask)
class _MaskModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, dmm, fe_type):
        super().__init__(dmm, fe_type, _MASK)


def as_vector(context, builder, value, kind):
    """Return an operand as a vector, with a number repeated in every lane."""
    if kind == lanes:
        return value
    number = context.cast(builder, value, kind, types.float64)
    nothing = ir.Constant(VECTOR, ir.Undefined)
    first = builder.insert_element(nothing, number, ir.Constant(ir.IntType(32), 0))
    everywhere = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
    return builder.shuffle_vector(first, nothing, everywhere)


def vector_intrinsic(builder, name, value):
    """Call one of LLVM's elementwise functions, such as ``sqrt``."""
    function = cgutils.get_or_insert_function(
        builder.module, ir.FunctionType(VECTOR, [VECTOR]), f"llvm.{name}.v{LANES}f64"
    )
    return builder.call(function, [value])


def _mixes(a, b):
    return lanes in (a, b) and all(kind == lanes or isinstance(kind, types.Number) for kind in (a, b))


def _register_binary(function, result, emit):
    """Type and lower an operator of two lanes, or of lanes and a number."""

    class Template(AbstractTemplate):  # type: ignore[misc]
        key = function

        def generic(self, args, kws):
            return signature(result, *args) if len(args) == 2 and _mixes(*args) else None

    infer_global(function)(Template)

    def lower(context, builder, sig, args):
        return emit(builder, *(as_vector(context, builder, *pair) for pair in zip(args, sig.args, strict=True)))

    for kinds in ((Lanes, Lanes), (Lanes, types.Number), (types.Number, Lanes)):
        lower_builtin(function, *kinds)(lower)


def _register_unary(function, emit):
    class Template(AbstractTemplate):  # type: ignore[misc]
        key = function

        def generic(self, args, kws):
            return signature(lanes, lanes) if tuple(args) == (lanes,) else None

    infer_global(function)(Template)
    lower_builtin(function, Lanes)(lambda context, builder, sig, args: emit(builder, args[0]))


def _register_logic(function, name):
    class Template(AbstractTemplate):  # type: ignore[misc]
        key = function

        def generic(self, args, kws):
            return signature(lane_mask, *args) if tuple(args) == (lane_mask, lane_mask) else None

    infer_global(function)(Template)
    lower_builtin(function, LaneMask, LaneMask)(lambda context, builder, sig, args: getattr(builder, name)(*args))


for _operators, _name in (
    ((operator.add, operator.iadd), "fadd"),
    ((operator.sub, operator.isub), "fsub"),
    ((operator.mul, operator.imul), "fmul"),
    ((operator.truediv, operator.itruediv), "fdiv"),
):
    for _operator in _operators:
        _register_binary(_operator, lanes, lambda builder, a, b, name=_name: getattr(builder, name)(a, b))
for _operator, _symbol in (
    (operator.lt, "<"), (operator.le, "<="), (operator.gt, ">"), (operator.ge, ">="), (operator.eq, "=="),
):  # fmt: skip
    # Ordered: a comparison with NaN is false, as for numbers.
    _register_binary(_operator, lane_mask, lambda builder, a, b, symbol=_symbol: builder.fcmp_ordered(symbol, a, b))
_register_unary(operator.neg, lambda builder, value: builder.fneg(value))
_register_unary(abs, lambda builder, value: vector_intrinsic(builder, "fabs", value))
_register_logic(operator.or_, "or_")
_register_logic(operator.and_, "and_")
