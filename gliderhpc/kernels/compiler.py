"""A leaner compiler for kernels: most of what numba does for a function is of no use to one that only kernels call.

Numba optimises every function and makes machine code of it, and optimises it again inside each function that calls it.
Here a *part* of kernels ends as LLVM's intermediate code. A *kernel*, which Python calls, is linked with all its parts
and optimised once. Kernels have no closures, generators, array expressions or parallel loops, so the passes for these
are left out. References are not counted: whoever calls a kernel keeps its arrays alive, and a kernel allocates none.
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
"""Whether LLVM's passes can be run by name; an older numba optimises in its own way, which takes longer."""


class PartLibrary(JITCodeLibrary):
    """Intermediate code of a part of kernels, and the libraries that it calls; there is no machine code."""

    inlined = False
    """Whether the code is put in the place of every call."""

    def add_ir_module(self, ir_module):
        """Take over what has been lowered."""
        self._final_module = _parsed(ir_module)

    def finalize(self):
        """Take in what is inlined, and simplify: so a formula is simplified once, however many kernels use it."""
        self._finalized = True
        called = dict.fromkeys(self._linking_libraries)
        inlined = [library for library in called if isinstance(library, PartLibrary) and library.inlined]
        for library in inlined:
            self._final_module.link_in(library._final_module, preserve=True)
            called.update(dict.fromkeys(library._linking_libraries))
        self._linking_libraries = [library for library in called if library not in inlined]
        if inlined and _SEPARATE_PASSES:
            _simplify(self._final_module, self._codegen)
        for function in self._final_module.functions:
            if not function.is_declaration:
                function.linkage = "linkonce_odr"

    def whole(self, seen):
        """Yield the modules of this library and of all that it calls, those in `seen` apart."""
        seen.add(self)
        yield self._final_module
        yield from linked_modules(self._linking_libraries, seen)

    def _get_module_for_linking(self):
        """Return everything in one module, for a function that numba's own compiler compiles."""
        if self._shared_module is None:
            first, *others = self.whole(set())
            self._shared_module = first.clone()
            for module in others:
                self._shared_module.link_in(module, preserve=True)
        return self._shared_module


class KernelLibrary(JITCodeLibrary):
    """Code of a kernel with its parts, optimised once."""

    def add_ir_module(self, ir_module):
        """Take over what has been lowered."""
        # The entry for Python only takes arguments apart: to optimise that would take longer than the kernel itself.
        for function in ir_module.functions:
            if function.blocks and function.name.startswith("_ZN7cpython"):
                function.attributes.add("noinline")
                function.attributes.add("optnone")
        self._final_module.link_in(_parsed(ir_module))

    def finalize(self):
        """Link, optimise, and make machine code."""
        for module in linked_modules(self._linking_libraries, set()):
            self._final_module.link_in(module, preserve=True)
        self._optimize_final_module()
        self._final_module.verify()
        self._finalize_final_module()

    def _optimize_final_module(self):
        if not _SEPARATE_PASSES:
            super()._optimize_final_module()
            return
        passes, builder = self._codegen._module_pass_manager()
        passes.run(self._final_module, builder)


def _simplify(module, codegen):
    passes = llvm.create_new_module_pass_manager()
    passes.add_always_inliner_pass()
    passes.add_sroa_pass()
    passes.add_instruction_combine_pass()
    passes.add_simplify_cfg_pass()
    passes.add_global_dead_code_eliminate_pass()
    passes.run(module, codegen._pass_builder())


def linked_modules(libraries, seen):
    """Yield the modules of some libraries and of all that they call, each once."""
    for library in libraries:
        if library in seen:
            continue
        if isinstance(library, PartLibrary):
            yield from library.whole(seen)
        else:
            seen.add(library)
            yield library._get_module_for_linking()


def _parsed(ir_module):
    module = llvm.parse_assembly(cgutils.normalize_ir_text(str(ir_module)))
    module.name = ir_module.name
    return module


class _Resolved(Context):
    """Numba's typing context, which remembers what each function gives for some types of arguments.

    Numba would try dozens of implementations at every operator, and word an error for each that does not fit.
    """

    _signatures: ClassVar = {}

    def __init__(self, context):
        self.__dict__ = context.__dict__

    def resolve_function_type(self, func, args, kws):
        """Return the signature of a call."""
        key = func, tuple(args)
        if kws or not all(isinstance(kind, types.Type) for kind in args):
            return super().resolve_function_type(func, args, kws)
        if key not in self._signatures:
            self._signatures[key] = super().resolve_function_type(func, args, kws)
        return self._signatures[key]


class _Lower(Lower):
    """Numba's lowering, where operators are not resolved again."""

    def lower_binop(self, resty, expr, op):
        """Lower an operator."""
        if expr.static_lhs is not ir.UNDEFINED or expr.static_rhs is not ir.UNDEFINED:
            return super().lower_binop(resty, expr, op)
        return self._lower_resolved(resty, op, self.fndesc.calltypes[expr], expr.lhs, expr.rhs)

    def lower_getitem(self, resty, expr, value, index, signature):
        """Lower the access to an element."""
        return self._lower_resolved(resty, operator.getitem, signature, value, index)

    def _lower_resolved(self, resty, function, typed, *operands):
        context = _Resolved(self.context.typing_context)
        kind = context.resolve_value_type(function)
        # An operator in place has been typed as such, and numba lowers it as the one that gives a new value.
        signature = context.resolve_function_type(kind, typed.args, {})
        values = [
            self.context.cast(self.builder, self.loadvar(operand.name), self.typeof(operand.name), wanted)
            for operand, wanted in zip(operands, signature.args, strict=True)
        ]
        result = self.context.get_function(kind, signature)(self.builder, values)
        return self.context.cast(self.builder, result, signature.return_type, resty)


class _PartLower(_Lower):
    def emit_environment_object(self):
        """Emit none: it is for calling Python."""


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

    _library: type
    _lowering: type

    def compile_extra(self, func):
        """Compile a Python function."""
        self.state.typingctx = _Resolved(self.state.typingctx)
        self.state.library = self._library(self.state.targetctx.codegen(), func.__qualname__)
        self.state.library.enable_object_caching()
        self.state.library.inlined = self.state.flags.forceinline
        return super().compile_extra(func)

    def define_pipelines(self):
        """Return the one pipeline."""
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
    """Compiler of a part of kernels."""

    _library, _lowering = PartLibrary, _PartLowering

    def compile_extra(self, func):
        """Compile a Python function without looking for machine code, as numba puts it."""
        self.state.flags.no_compile = True
        return super().compile_extra(func)


class KernelCompiler(_Compiler):
    """Compiler of a kernel."""

    _library, _lowering = KernelLibrary, _KernelLowering

    def compile_extra(self, func):
        """Compile a Python function with the garbage collector off, which would look at all that numba makes of it."""
        enabled = gc.isenabled()
        gc.disable()
        try:
            return super().compile_extra(func)
        finally:
            if enabled:
                gc.enable()


_OF_PARTS = ("nopython", "no_cpython_wrapper", "_nrt")
"""Options that numba's own compiler is not given."""


class InnerDispatcher(CPUDispatcher):
    """Part of kernels, which only kernels call. Where Python does, as a test may, numba's own compiler compiles it."""

    def __init__(self, py_func, _=None, targetoptions=None):
        super().__init__(py_func, {}, targetoptions, PartCompiler)

    def get_call_template(self, args, kws):
        """Return numba's description of a call; integers are typed without their value, so that one version serves."""
        signature, args = self._compiler.fold_argument_types(args, kws)
        plain = tuple(map(_without_value, args))
        self.compile(plain)
        name = self.py_func.__name__
        template = make_concrete_template(name, key=name, signatures=[self.overloads[plain].signature])
        return template, signature, plain, {}

    def add_overload(self, cres):
        """Keep compiled code for kernels; numba's table of entries for Python would hold a null pointer for it."""
        code = cres._replace(entry_point=cres.library)
        self.targetctx.insert_user_function(code.entry_point, code.fndesc, [code.library])
        self.overloads[tuple(code.signature.args)] = code

    def _compile_for_args(self, *args, **kws):
        """Return the function for arguments that are not in numba's table, which is all of them."""
        if not hasattr(self, "_entry"):
            options = {name: value for name, value in self.targetoptions.items() if name not in _OF_PARTS}
            self._entry = njit(**options)(self.py_func)
        return self._entry


def _without_value(kind: types.Type):
    # Numba would make a plain tuple of a named one.
    return kind if isinstance(kind, types.BaseNamedTuple) else types.unliteral(kind)


class KernelDispatcher(CPUDispatcher):
    """Kernel, which Python calls; where another kernel does, its part."""

    def __init__(self, py_func, _=None, targetoptions=None):
        super().__init__(py_func, {}, targetoptions, KernelCompiler)

    @cached_property
    def part(self):
        """The same function as a part of kernels."""
        return InnerDispatcher(self.py_func, targetoptions={**self.targetoptions, "no_cpython_wrapper": True})

    def get_call_template(self, args, kws):
        """Return numba's description of a call from another kernel."""
        return self.part.get_call_template(args, kws)

    def get_overload(self, sig):
        """Return what a call from another kernel is looked up by."""
        return self.part.get_overload(sig)
