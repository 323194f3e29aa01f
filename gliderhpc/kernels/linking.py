"""Libraries of compiled code: intermediate code of parts, and machine code of kernels, linked with their parts."""

import llvmlite.binding as llvm
from numba.core import cgutils
from numba.core.codegen import JITCodeLibrary

_SEPARATE_PASSES = hasattr(llvm.newpassmanagers.ModulePassManager, "add_always_inliner_pass")
"""True if LLVM's passes can be chosen one by one; with an older llvmlite, numba's own, slower optimisation is used."""


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
        if not self.inlined:
            # Merged into one function, a kernel would need more registers than there are.
            for function in ir_module.functions:
                if function.blocks and "alwaysinline" not in function.attributes:
                    function.attributes.add("noinline")
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
                # LLVM then drops what no part of the kernel uses.
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
