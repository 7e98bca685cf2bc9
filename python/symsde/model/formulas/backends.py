# SPDX-License-Identifier: BSD-3-Clause
"""How generated code is compiled: by the C compiler, where there is none by LLVM, where that is missing, too, not."""

from __future__ import annotations

from . import compiler
from .llvm import engine


def is_there() -> bool:
    """Whether anything compiles."""
    return compiler.command() is not None or engine.binding() is not None


def build(source: str) -> compiler.Compiled | None:
    """The functions of a C text; None where nothing compiles."""
    if compiler.command() is not None:
        return compiler.build(source)
    return engine.build(source) if engine.binding() is not None else None
