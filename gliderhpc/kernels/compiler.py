"""Compiler of kernels: numba's typing and lowering, with one optimisation for each kernel that Python calls.

Numba optimises every function, generates its machine code, and optimises it again inside each function that calls it.
Most functions here are called only by kernels. Such a *part* is compiled only to LLVM's intermediate code. A *kernel*,
which Python calls, is linked with all its parts, optimised once and compiled to machine code.

Kernels have no closures, generators, array expressions or parallel loops, so numba's passes for these are left out.
References are not counted: the caller of a kernel keeps its arrays alive, and a kernel allocates none.
"""

import gc
import operator
from functools import cached_property
from typing import ClassVar

import llvmlite.binding as llvm
from numba import njit
from numba.core import cgutils, ir, typed_passes, types, untyped_passes
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase
from numba.core.compiler_machinery import PassManager, register_pass
from numba.core.lowering import Lower
from numba.core.registry import CPUDispatcher
from numba.core.typing import Context
from numba.core.typing.templates import make_concrete_template

_SEPARATE_PASSES = hasattr(llvm.newpassmanagers.ModulePassManager, "add_always_inliner_pass")
"""Whether LLVM's passes can be chosen one by one; with an older llvmlite, numba's own, slower optimisation is used."""


class PartLibrary(JITCodeLibrary):
    """Intermediate code of a part, without machine code.

    The parts that it calls are linked only in the library of a kernel, where machine code is generated.

    Parameters
    ----------
    codegen, name
        Arguments of numba's libraries.
    inlined : bool
        Whether the part is inlined at every call.
    """

    def __init__(self, codegen, name, inlined):
        super().__init__(codegen, name)
        self.inlined = inlined

    def add_ir_module(self, ir_module):
        """Use the lowered code as the library's module."""
        self._final_module = _parsed(ir_module)

    def finalize(self):
        """Inline the parts marked for it, and simplify; this is done once for a part, however many kernels use it."""
        called = dict.fromkeys(self._linking_libraries)
        inlined = [library for library in called if isinstance(library, PartLibrary) and library.inlined]
        for library in inlined:
            self._final_module.link_in(library._final_module, preserve=True)
            called.update(dict.fromkeys(library._linking_libraries))
        self._linking_libraries = [library for library in called if library not in inlined]
        if inlined and _SEPARATE_PASSES:
            _simplify(self._final_module, self._codegen)
        # Only after simplifying, which drops functions of this linkage that nothing in the module calls.
        for function in self._final_module.functions:
            if not function.is_declaration:
                function.linkage = "linkonce_odr"
                if not self.inlined and not any(b"alwaysinline" in group for group in function.attributes):
                    # Merged into one function, a kernel would need more registers than there are.
                    function.add_function_attribute("noinline")
        self._finalized = True

    def modules(self, seen):
        """Yield the modules of this library and of all libraries that it calls, except those in `seen`."""
        seen.add(self)
        yield self._final_module
        yield from linked_modules(self._linking_libraries, seen)

    def _get_module_for_linking(self):
        """Return all modules linked into one, for a function that numba's own compiler compiles."""
        if self._shared_module is None:
            own, *others = self.modules(set())
            self._shared_module = own.clone()
            for module in others:
                self._shared_module.link_in(module, preserve=True)
        return self._shared_module


class KernelLibrary(JITCodeLibrary):
    """Machine code of a kernel with all its parts, optimised once."""

    def add_ir_module(self, ir_module):
        """Add lowered code, without numba's separate optimisation of each function."""
        # The entry point for Python only unpacks arguments; optimising it would take longer than the kernel itself.
        for function in ir_module.functions:
            if function.blocks and function.name.startswith("_ZN7cpython"):
                function.attributes.add("noinline")
                function.attributes.add("optnone")
        self._final_module.link_in(_parsed(ir_module))

    def finalize(self):
        """Link the parts, optimise, and generate machine code."""
        for module in linked_modules(self._linking_libraries, set()):
            self._final_module.link_in(module, preserve=True)
        for function in self._final_module.functions:
            if not function.is_declaration and function.linkage == llvm.Linkage.linkonce_odr:
                # LLVM then drops unused arguments: most of the fields of arrays.
                function.linkage = "internal"
        self._optimize_final_module()
        self._final_module.verify()
        self._finalize_final_module()

    def _optimize_final_module(self):
        if not _SEPARATE_PASSES:
            super()._optimize_final_module()
            return
        _propagate_constants(self._final_module, self._codegen)
        # Only numba's full optimisation: the cheap one before it serves reference counting.
        passes, builder = self._codegen._module_pass_manager()
        passes.run(self._final_module, builder)


def _simplify(module, codegen):
    """Inline the functions marked for it and reduce the result; kernels then link less code."""
    passes = llvm.create_new_module_pass_manager()
    passes.add_always_inliner_pass()
    passes.add_sroa_pass()
    passes.add_instruction_combine_pass()
    passes.add_simplify_cfg_pass()
    passes.add_global_dead_code_eliminate_pass()
    passes.run(module, codegen._pass_builder())


def _propagate_constants(module, codegen):
    """Replace arguments that are the same constant in all calls of an internal function."""
    passes = llvm.create_new_module_pass_manager()
    passes.add_sroa_pass()
    passes.add_instruction_combine_pass()
    passes.add_ipsccp_pass()
    passes.run(module, codegen._pass_builder())


def linked_modules(libraries, seen):
    """Yield the modules of some libraries and of all libraries that they call, each once."""
    for library in libraries:
        if library in seen:
            continue
        if isinstance(library, PartLibrary):
            yield from library.modules(seen)
        else:
            seen.add(library)
            yield library._get_module_for_linking()


def _parsed(ir_module):
    module = llvm.parse_assembly(cgutils.normalize_ir_text(str(ir_module)))
    module.name = ir_module.name
    return module


class _CachingContext(Context):
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
    """Numba's lowering, with the signatures of operators from the cache of `_CachingContext`."""

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
        context = _CachingContext(self.context.typing_context)
        kind = context.resolve_value_type(function)
        # Resolved again, since `typed` may be that of an in-place operator, which is lowered as the plain one.
        signature = context.resolve_function_type(kind, typed.args, {})
        values = [
            self.context.cast(self.builder, self.loadvar(operand.name), self.typeof(operand.name), wanted)
            for operand, wanted in zip(operands, signature.args, strict=True)
        ]
        result = self.context.get_function(kind, signature)(self.builder, values)
        return self.context.cast(self.builder, result, signature.return_type, resty)


class _PartLower(_Lower):
    def emit_environment_object(self):
        """Emit nothing: numba's environment is for calls of Python, and a part contains none."""


@register_pass(mutates_CFG=True, analysis_only=False)
class _KernelLowering(typed_passes.NativeLowering):
    _name = "gliderhpc_kernel_lowering"
    lowering_class = _Lower


@register_pass(mutates_CFG=True, analysis_only=False)
class _PartLowering(typed_passes.NativeLowering):
    _name = "gliderhpc_part_lowering"
    lowering_class = _PartLower


class _Compiler(CompilerBase):
    """Numba's passes that kernels need."""

    _lowering: type

    def _new_library(self, codegen, name):
        """Create the library for the compiled code."""
        raise NotImplementedError

    def compile_extra(self, func):
        """Compile a Python function."""
        self.state.typingctx = _CachingContext(self.state.typingctx)
        self.state.library = self._new_library(self.state.targetctx.codegen(), func.__qualname__)
        return super().compile_extra(func)

    def define_pipelines(self):
        """Return the only pipeline."""
        manager = PassManager("kernel")
        for one in (
            untyped_passes.TranslateByteCode,
            untyped_passes.FixupArgs,
            untyped_passes.IRProcessing,
            untyped_passes.GenericRewrites,
            untyped_passes.ReconstructSSA,
            typed_passes.NopythonTypeInference,
            typed_passes.PreLowerStripPhis,
            typed_passes.IRLegalization,
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
        self.targetctx.insert_user_function(result.entry_point, result.fndesc, [result.library])
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
