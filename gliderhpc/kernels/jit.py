"""Decorators that compile kernels: for formulas that are inlined into their callers, and for loops."""

import logging
from collections.abc import Callable
from functools import cached_property, partial
from multiprocessing import parent_process
from pathlib import Path
from typing import Any

from numba.core import config
from numba.core.caching import CompileResultCacheImpl, FunctionCache, _Cache, _CacheLocator
from numba.core.registry import CPUDispatcher

from gliderhpc.kernels.cache import SOURCES, compiled_cache
from gliderhpc.kernels.compiler import InnerDispatcher, KernelDispatcher
from gliderhpc.kernels.precompiled import precompiled_kernels

log = logging.getLogger(__name__)

UNCOMPILED = "NUMBA_DISABLE_JIT is set, so the kernels run as plain Python, about a thousand times slower"
"""Consequence of numba's setting for debugging, which a user may have forgotten in the environment."""


def is_uncompiled() -> bool:
    """Return whether numba is set to compile nothing, by ``NUMBA_DISABLE_JIT`` or its configuration file."""
    return bool(vars(config)["DISABLE_JIT"])


if is_uncompiled() and parent_process() is None:
    # Worker processes do not repeat this.
    log.warning("%s; unset it unless you are debugging", UNCOMPILED)


class _Locator(_CacheLocator):
    """Location of a kernel's compiled code: a folder named after the digest of all sources, or after a level."""

    def __init__(self, function: Any, folder: Path) -> None:
        self._py_file, self._lineno = function.__code__.co_filename, function.__code__.co_firstlineno
        self._folder = folder

    def get_cache_path(self) -> str:
        return str(self._folder)

    def get_source_stamp(self) -> str:
        return self._folder.name

    def get_disambiguator(self) -> str:
        return str(self._lineno)


class _Files(CompileResultCacheImpl):
    """Files of one kernel.

    The base class's constructor is not called, since it tries numba's locators and those that a user has set.
    """

    def __init__(self, function: Any, folder: Path) -> None:
        self._lineno, self._locator = function.__code__.co_firstlineno, _Locator(function, folder)
        name = f"{Path(function.__code__.co_filename).stem}.{function.__qualname__}"
        self._filename_base = self.get_filename_base(name, "")


class _FolderCache(FunctionCache):
    """Numba's cache of one function in a folder; damaged code is compiled again."""

    def __init__(self, function: Any, folder: Path) -> None:
        self._impl_class: Any = partial(_Files, folder=folder)
        super().__init__(function)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        try:
            return super().load_overload(sig, target_context)
        except Exception as error:  # noqa: BLE001 - reading a damaged pickle raises whatever its bytes mean
            log.warning("compiled kernels in %s are damaged (%s): compiling them again", self.cache_path, error)
            self.discard()
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        try:
            super().save_overload(sig, data)
        except OSError as error:
            log.warning(
                "compiled kernels cannot be stored in %s (%s): the next run compiles again", self.cache_path, error
            )
            self.disable()

    def discard(self) -> None:
        """Discard the damaged code."""
        self.flush()


class LevelCache(_FolderCache):
    """Code of one function for a level of processors; all of them find it, and none changes it."""

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        """Return the key without the processor's name and features, which the folder's level replaces."""
        sig, _, code = super()._index_key(sig, codegen)
        return sig, code

    def discard(self) -> None:
        """Stop loading from the folder."""
        self.disable()


class _KernelCache(_Cache):
    """Compiled code of one kernel: precompiled for this level of processors, else compiled here and stored.

    The folder in which it is stored is created when it is needed.
    """

    def __init__(self, function: Any) -> None:
        self._function = function

    @cached_property
    def _level(self) -> LevelCache | None:
        folder, _ = precompiled_kernels()
        return None if folder is None else LevelCache(self._function, folder)

    @cached_property
    def _own(self) -> _FolderCache:
        return _FolderCache(self._function, compiled_cache())

    @property
    def cache_path(self) -> str:
        return str(self._own.cache_path)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        found = None if self._level is None else self._level.load_overload(sig, target_context)
        return self._own.load_overload(sig, target_context) if found is None else found

    def save_overload(self, sig: Any, data: Any) -> None:
        self._own.save_overload(sig, data)

    def enable(self) -> None:
        self._own.enable()

    def disable(self) -> None:
        self._own.disable()

    def flush(self) -> None:
        self._own.flush()


# Kernels are not used as C callbacks; the wrapper for that would take a seventh of the compile time.
_COMMON: dict[str, Any] = {"nopython": True, "error_model": "numpy", "no_cfunc_wrapper": True, "_nrt": False}


def _decorator(dispatcher: type[CPUDispatcher], **options: Any) -> Callable[[Any], Any]:
    """Return a decorator that compiles functions, and that caches in our folder the kernels of this package."""

    def decorate(function: Any) -> Any:
        if is_uncompiled():
            return function
        compiled: Any = dispatcher(function, targetoptions={**_COMMON, **options})
        if dispatcher is KernelDispatcher and Path(function.__code__.co_filename).resolve().parent == SOURCES:
            compiled._cache = _KernelCache(function)
        return compiled

    return decorate


# No reassociation, no finite-maths assumption: NaN must be detected, and results must not depend on the vector width.
_FASTMATH = {"contract", "nsz", "arcp"}

formula = _decorator(InnerDispatcher, fastmath=_FASTMATH, forceinline=True, no_cpython_wrapper=True)
"""Straight-line formula on scalars and tuples; it is always inlined, which lets a loop around it vectorise."""

kernel = _decorator(KernelDispatcher, fastmath=_FASTMATH, nogil=True)
"""Loop over samples on preallocated arrays."""

inner_kernel = _decorator(InnerDispatcher, fastmath=_FASTMATH, nogil=True, no_cpython_wrapper=True)
"""Part of a kernel that only kernels call."""

exact_formula = _decorator(InnerDispatcher, fastmath={"contract"}, forceinline=True, no_cpython_wrapper=True)
"""Formula that relies on its rounding (argument reduction, polynomials): only sums of products may be fused.

The flags are given explicitly: otherwise numba inherits those of the first caller, and the cache stores that code.
"""
