# SPDX-License-Identifier: BSD-3-Clause
"""Which variants of the library the processor can run: the levels of x86-64."""

from __future__ import annotations

import os
import platform
from pathlib import Path

from ..errors import InvalidArgumentError, LibraryNotFoundError

BASELINE = "baseline"  #: level of the package's own library; wheels have v2, which NumPy's wheels need too
_V2 = {"cx16", "lahf_lm", "popcnt", "sse4_1", "sse4_2", "ssse3"}
#: flags of /proc/cpuinfo that each level needs beyond the level before (x86-64 psABI, table 3.1)
LEVELS = {
    "v3": {"abm", "avx", "avx2", "bmi1", "bmi2", "f16c", "fma", "movbe", "xsave", *_V2},
    "v4": {"avx512bw", "avx512cd", "avx512dq", "avx512f", "avx512vl"},
}


def flags(text: str) -> set[str]:
    """The flags of the first processor in a text like /proc/cpuinfo; empty if the text has none."""
    for line in text.splitlines():
        key, _, value = line.partition(":")
        if key.strip() == "flags":
            return set(value.split())
    return set()


def supported(have: set[str]) -> list[str]:
    """The levels that a processor with these flags can run, the highest first, the baseline last."""
    found = [BASELINE]
    for level, needed in LEVELS.items():
        if not needed <= have:
            break
        found.insert(0, level)
    return found


def wanted(choice: str | None, have: set[str]) -> list[str]:
    """The levels to look for, in order: all that the processor supports, or the choice (SYMSDE_CPU) alone."""
    possible = supported(have)
    if not choice:
        return possible
    if choice not in (BASELINE, *LEVELS):
        raise InvalidArgumentError(
            f"SYMSDE_CPU = {choice!r}: give one of {', '.join((BASELINE, *LEVELS))}, or unset it"
        )
    if choice not in possible:
        missing = ", ".join(sorted(set().union(*LEVELS.values()) - have))
        raise InvalidArgumentError(
            f"SYMSDE_CPU = {choice!r}, but this processor lacks {missing}: give {' or '.join(possible)}, or unset it"
        )
    return [choice]


def levels() -> list[str]:
    """The levels of this machine, the highest first; empty if it is not x86-64."""
    if platform.machine().lower() not in ("x86_64", "amd64"):
        return []
    return supported(_flags_here())


def flags_are_known() -> bool:
    """Whether this machine reports the features of its processor."""
    return bool(_flags_here())


def folders(package: Path) -> list[Path]:
    """Folders with variants for this machine, in the package's folder and below, in the order of search."""
    if not levels():
        return [package]
    have = _flags_here()
    chosen = wanted(os.environ.get("SYMSDE_CPU"), have)
    if have and not have >= _V2 and (package / "glibc-hwcaps").is_dir():  # every variant of a wheel needs these
        raise LibraryNotFoundError(
            f"this processor lacks {', '.join(sorted(_V2 - have))}, which this package's library needs (x86-64-v2): "
            "build one for it from the sources with ./bootstrap build, and set SYMSDE_LIBRARY to its libsymsde.so"
        )
    return [package if level == BASELINE else package / "glibc-hwcaps" / f"x86-64-{level}" for level in chosen]


def alone(package: Path) -> list[str]:
    """The levels that a package was compiled for; empty if for all. By default pip compiles for one processor."""
    return [] if not levels() else sorted(folder.name for folder in (package / "glibc-hwcaps").glob("x86-64-v*"))


def _flags_here() -> set[str]:
    described = Path("/proc/cpuinfo")
    return flags(described.read_text(encoding="utf-8", errors="replace")) if described.exists() else set()
