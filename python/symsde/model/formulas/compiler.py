# SPDX-License-Identifier: BSD-3-Clause
"""Compile generated C with the system's compiler, and keep it on disk for all processes that need the same code.

A file is identified by a hash of its text (which contains the formulas and all generated code, but no values of
parameters), the compiler with its version, the flags, and the features of the processor. Any number of processes may
need the file at once.
"""

from __future__ import annotations

import functools
import hashlib
import importlib.util
import os
import platform
import shlex
import shutil
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...errors import InvalidArgumentError, NotWrittenError
from ...native import parts as _parts
from ...native.build import build_info
from . import cache

# Compilers contract nothing by themselves, so an output has the same bits in every function. With CONTRACTS the macro
# FMA of lane_functions.h is one operation; it is set if the library contracts, too. Without it bits do not depend on
# the processor.
FLAGS = ("-std=c11", "-O3", "-march=native", "-fPIC", "-shared", "-fno-math-errno", "-fno-trapping-math")
FLAGS += ("-ffp-contract=off", "-fno-semantic-interposition", "-w")
if platform.machine() in ("x86_64", "AMD64"):
    FLAGS += ("-mprefer-vector-width=512",)  # for processors that have them: 1.0 instead of 1.12 of the built-in's time
if build_info().get("arithmetic") == "fused":
    FLAGS += ("-DCONTRACTS",)
LONG = 300_000  #: characters above which there is less optimisation (functions alone have 60000); bits are the same
#: most seconds of processor time of one compilation; processor time, since a busy machine is no reason to refuse
TIME_LIMIT = 120.0
PATIENCE = 3600.0  #: most seconds of one compilation by the clock


@dataclass(frozen=True)
class Compiled:
    """A compiled file."""

    library: Any  #: the loaded library, whose attributes are functions
    path: Path
    seconds: float  #: seconds of processor time of the compiler; 0 = the library was in the cache


def command() -> list[str] | None:
    """The compiler: SYMSDE_CC, CC, the system's cc, gcc or clang, or ziglang's; None if there is none."""
    for given in (os.environ.get("SYMSDE_CC"), os.environ.get("CC"), "cc", "gcc", "clang"):
        words = shlex.split(given) if given else []
        if words and shutil.which(words[0]):
            return words
    return [sys.executable, "-m", "ziglang", "cc"] if importlib.util.find_spec("ziglang") else None


def flags(source: str) -> tuple[str, ...]:
    """Flags of the compiler for a text: long texts are compiled at a lower level, since the highest level would take
    several times as long.
    """
    return tuple("-O1" if flag == "-O3" and len(source) > LONG else flag for flag in FLAGS)


def build(source: str) -> Compiled | None:
    """The library of a C text, compiled unless it is in the cache; None without a compiler."""
    compiler = command()
    if compiler is None:
        return None
    target = cache.folder() / f"{_key(source, tuple(compiler))}.so"
    library, seconds = cache.load(target), 0.0
    if library is None:
        start, before = time.perf_counter(), _spent()
        _compile(compiler, source, target)
        seconds = min(_spent() - before, time.perf_counter() - start)  # other threads may have had children, too
        library = cache.load(target)
    if library is None:
        raise InvalidArgumentError(f"what {shlex.join(compiler)} makes of the formula cannot be loaded: set SYMSDE_CC")
    return Compiled(library, target, seconds)


def _spent() -> float:
    """Seconds of processor time of all child processes that have ended."""
    times = os.times()
    return times.children_user + times.children_system


def _compile(compiler: list[str], source: str, target: Path) -> None:
    """Compile to a temporary file, then rename it to the target."""
    try:
        _parts.sweep(target.parent)
        with _parts.beside(target) as made:
            text = made.with_suffix(".c")
            text.write_text(source, encoding="utf-8")
            words = [*compiler, *flags(source), "-o", str(made), str(text), "-lm"]
            done = _bounded(words)
            if done is None or "CPU time limit" in done.stderr:
                raise InvalidArgumentError(
                    f"compiling the formula took more than {TIME_LIMIT:g} s: write sums over sites as Sum(..., i), "
                    "or take fewer degrees of freedom"
                )
            if done.returncode != 0:
                raise InvalidArgumentError(f"{shlex.join(compiler)} does not compile the formula: {done.stderr[:500]}")
            cache.keep(target, made.read_bytes(), source)
    except OSError as error:
        raise NotWrittenError(
            f"compiled formulas cannot be kept in {target.parent}: {error.strerror}: set SYMSDE_CACHE to a folder"
        ) from error


def _bounded(words: list[str]) -> subprocess.CompletedProcess[str] | None:
    """Run a compiler with a limit on its processor time; None if it exceeds the limit."""
    if os.name == "posix":
        words = ["/bin/sh", "-c", f'ulimit -t {TIME_LIMIT:.0f} && exec "$0" "$@"', *words]
    told = {**os.environ, "LC_ALL": "C"}
    try:
        return subprocess.run(words, capture_output=True, text=True, timeout=PATIENCE, check=False, env=told)
    except subprocess.TimeoutExpired:
        return None


def _key(source: str, compiler: tuple[str, ...]) -> str:
    parts = (source, *compiler, _version(compiler), *flags(source), _processor())
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:32]


@functools.cache
def _version(compiler: tuple[str, ...]) -> str:
    """The compiler's version text."""
    done = subprocess.run([*compiler, "--version"], capture_output=True, text=True, timeout=30, check=False)
    return done.stdout


@functools.cache
def _processor() -> str:
    """The features of the processor, since several machines may share a cache folder."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    flags = next((line for line in lines if line.startswith(("flags", "Features"))), "")
    return f"{platform.machine()} {flags}"
