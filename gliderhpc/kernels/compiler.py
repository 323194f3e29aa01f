"""Compiler of kernels: numba's typing and lowering, with one optimisation for each kernel that Python calls.

Numba optimises every function, generates its machine code, and optimises it again inside each function that calls it.
Most functions here are called only by kernels. Such a *part* is compiled only to LLVM's intermediate code. A *kernel*,
which Python calls, is linked with all its parts, optimised once and compiled to machine code.

Kernels have no closures, generators, array expressions or parallel loops, so numba's passes for these are left out.
References are not counted: the caller of a kernel keeps its arrays alive, and a kernel allocates none. Neither are
variables deleted after their last use.
"""

import gc
from functools import cached_property

from numba import njit
from numba.core import typed_passes, types, untyped_passes
from numba.core.compiler import CompilerBase
from numba.core.compiler_machinery import PassManager, register_pass
from numba.core.ir_utils import build_definitions
from numba.core.registry import CPUDispatcher
from numba.core.ssa import reconstruct_ssa
from numba.core.typing.templates import make_concrete_template

from gliderhpc.kernels.calling import part_call
from gliderhpc.kernels.linking import KernelLibrary, PartLibrary
from gliderhpc.kernels.lowering import CachingContext, KernelLower, PartLower


@register_pass(mutates_CFG=True, analysis_only=False)
class _SingleAssignment(untyped_passes.ReconstructSSA):
    """Numba's pass, without the lifetimes of variables, which only generators and counted references need."""

    _name = "gliderhpc_reconstruct_ssa"

    def run_pass(self, state):
        state.func_ir = reconstruct_ssa(state.func_ir)
        state.func_ir._definitions = build_definitions(state.func_ir.blocks)
        return True


@register_pass(mutates_CFG=False, analysis_only=False)
class _StripPhis(typed_passes.PreLowerStripPhis):
    """Numba's pass, without the lifetimes of variables."""

    _name = "gliderhpc_strip_phis"

    def run_pass(self, state):
        state.func_ir = self._strip_phi_nodes(state.func_ir)
        state.func_ir._definitions = build_definitions(state.func_ir.blocks)
        return True


@register_pass(mutates_CFG=True, analysis_only=False)
class _KernelLowering(typed_passes.NativeLowering):
    _name = "gliderhpc_kernel_lowering"
    lowering_class = KernelLower


@register_pass(mutates_CFG=True, analysis_only=False)
class _PartLowering(typed_passes.NativeLowering):
    _name = "gliderhpc_part_lowering"
    lowering_class = PartLower


class _Compiler(CompilerBase):
    """Numba's passes that kernels need."""

    _lowering: type

    def _new_library(self, codegen, name):
        """Create the library for the compiled code."""
        raise NotImplementedError

    def compile_extra(self, func):
        """Compile a Python function."""
        self.state.typingctx = CachingContext(self.state.typingctx)
        self.state.library = self._new_library(self.state.targetctx.codegen(), func.__qualname__)
        return super().compile_extra(func)

    def define_pipelines(self):
        """Return the only pipeline."""
        manager = PassManager("kernel")
        for one in (
            untyped_passes.TranslateByteCode,
            untyped_passes.FixupArgs,
            untyped_passes.GenericRewrites,
            _SingleAssignment,
            typed_passes.NopythonTypeInference,
            _StripPhis,
            self._lowering,
            typed_passes.NoPythonBackend,
        ):
            manager.add_pass(one, one.__name__)
        manager.finalize()
        return [manager]


class PartCompiler(_Compiler):
    """Compiler of a part."""

    _lowering = _PartLowering

    def _new_library(self, codegen, name):
        return PartLibrary(codegen, name, inlined=self.state.flags.forceinline)

    def compile_extra(self, func):
        """Compile a Python function; with this flag, numba does not request the address of its machine code."""
        self.state.flags.no_compile = True
        return super().compile_extra(func)


class KernelCompiler(_Compiler):
    """Compiler of a kernel."""

    _lowering = _KernelLowering

    def _new_library(self, codegen, name):
        library = KernelLibrary(codegen, name)
        library.enable_object_caching()
        return library

    def compile_extra(self, func):
        """Compile a Python function without the garbage collector, which would search numba's many objects in vain."""
        enabled = gc.isenabled()
        gc.disable()
        try:
            return super().compile_extra(func)
        finally:
            if enabled:
                gc.enable()


_PART_OPTIONS = ("nopython", "no_cpython_wrapper", "_nrt")
"""Options of a part that do not apply when numba's own compiler compiles it for Python."""


class InnerDispatcher(CPUDispatcher):
    """Part of kernels, called only by kernels; if Python calls it, as in a test, numba's own compiler compiles it.

    The parameters are those with which numba rebuilds a pickled dispatcher; the second, types of local variables, is
    not used.
    """

    def __init__(self, py_func, _locals=None, targetoptions=None):
        super().__init__(py_func, {}, targetoptions, PartCompiler)

    def get_call_template(self, args, kws):
        """Return numba's description of a call; integers are typed without their values, and share one version."""
        pysig, args = self._compiler.fold_argument_types(args, kws)
        plain = tuple(map(_without_value, args))
        self.compile(plain)
        name = self.py_func.__name__
        template = make_concrete_template(name, key=name, signatures=[self.overloads[plain].signature])
        return template, pysig, plain, {}

    def add_overload(self, cres):
        """Store compiled code for kernels, except in numba's table for calls from Python, for which it has no entry."""
        # Numba identifies a function by its entry point; the library is used in its place.
        result = cres._replace(entry_point=cres.library)
        call = part_call(result.fndesc, result.library)
        self.targetctx.insert_func_defn([(call, result.entry_point, call.signature)])
        self.overloads[tuple(result.signature.args)] = result

    def _compile_for_args(self, *args, **kws):
        """Return the function for calls from Python; numba always calls this method, since its table is empty."""
        return self._for_python

    @cached_property
    def _for_python(self):
        options = {name: value for name, value in self.targetoptions.items() if name not in _PART_OPTIONS}
        return njit(**options)(self.py_func)


def _without_value(kind: types.Type):
    # Numba's `unliteral` makes a plain tuple of a named one.
    return kind if isinstance(kind, types.BaseNamedTuple) else types.unliteral(kind)


class KernelDispatcher(CPUDispatcher):
    """Kernel, called by Python, or by another kernel as a part; its parameters are those of `InnerDispatcher`."""

    def __init__(self, py_func, _locals=None, targetoptions=None):
        super().__init__(py_func, {}, targetoptions, KernelCompiler)

    @cached_property
    def part(self):
        """The same function as a part."""
        return InnerDispatcher(self.py_func, targetoptions={**self.targetoptions, "no_cpython_wrapper": True})

    def get_call_template(self, args, kws):
        """Return numba's description of a call from another kernel."""
        return self.part.get_call_template(args, kws)

    def get_overload(self, sig):
        """Return the identifier of the compiled code for a call from another kernel."""
        return self.part.get_overload(sig)
