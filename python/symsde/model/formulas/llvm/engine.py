# SPDX-License-Identifier: BSD-3-Clause
"""Generated C without a compiler: translated for LLVM (`text.py`), which llvmlite brings, as numba does."""

from __future__ import annotations

import ctypes
import ctypes.util
import functools
import importlib
import platform
import time
from types import ModuleType
from typing import Any

from ..compiler import FLAGS, Compiled
from ..graph import FUNCTIONS
from .llvm_text import translated

_OUTSIDE = (*FUNCTIONS, "pow", "malloc", "free", "memcpy", "memset")  #: what generated code calls of others


def binding() -> ModuleType | None:
    """What llvmlite makes of LLVM; None where it is not installed."""
    try:
        return importlib.import_module("llvmlite.binding")
    except ImportError:
        return None


@functools.lru_cache(maxsize=64)
def library(source: str) -> Library:
    """The compiled functions of a C text; the same for the same text."""
    return Library(source)


class Library:
    """Compiled functions by their names, as of a library that was loaded."""

    def __init__(self, source: str):
        """Translate and compile."""
        machine = this_machine()
        self._engine = binding().create_mcjit_compiler(optimised(source, machine), machine)
        self._engine.finalize_object()

    def __getattr__(self, name: str) -> ctypes.c_void_p:
        """A function."""
        address = self._engine.get_function_address(name) if name.startswith("formula_") else 0
        if not address:
            raise AttributeError(name)
        return ctypes.c_void_p(address)


def optimised(source: str, machine: Any) -> Any:
    """LLVM's module of a C text, with vectors where lanes are."""
    llvm = binding()
    known = {"CONTRACTS": "-DCONTRACTS" in FLAGS, "__FP_FAST_FMA": _multiplies_and_adds()}
    module = llvm.parse_assembly(translated(source, tuple(x for x, is_so in known.items() if is_so)))
    module.verify()
    builder = llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options(speed_level=3))
    builder.getModulePassManager().run(module, builder)
    return module


def build(source: str) -> Compiled:
    """As compiler.build; kept in this process alone."""
    before, start = library.cache_info().misses, time.perf_counter()
    made = library(source)
    seconds = time.perf_counter() - start if library.cache_info().misses > before else 0.0
    return Compiled(made, None, seconds, "LLVM")


def this_machine() -> Any:
    """This machine, for LLVM; functions of the C library are told to it."""
    llvm = binding()
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    _tell_functions()
    features = llvm.get_host_cpu_features().flatten()
    target = llvm.Target.from_default_triple()
    return target.create_target_machine(cpu=llvm.get_host_cpu_name(), features=features, opt=3, jit=True)


@functools.cache
def _tell_functions() -> None:
    llvm = binding()
    libraries = [ctypes.CDLL(None), *(ctypes.CDLL(x) for x in [ctypes.util.find_library("m")] if x)]
    for name in _OUTSIDE:
        there = next(x for x in libraries if hasattr(x, name))
        llvm.add_symbol(name, ctypes.cast(getattr(there, name), ctypes.c_void_p).value)


def _multiplies_and_adds() -> bool:
    """Whether the processor has an operation for a product and a sum, as compilers say by __FP_FAST_FMA."""
    return platform.machine() == "aarch64" or bool(binding().get_host_cpu_features().get("fma"))
