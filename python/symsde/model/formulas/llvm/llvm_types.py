# SPDX-License-Identifier: BSD-3-Clause
"""Types, values and operations of the C that is read, and what LLVM calls them."""

from __future__ import annotations

import struct
from dataclasses import dataclass


@dataclass(frozen=True)
class Type:
    """A type of C."""

    kind: str  #: int, double, void, pointer, array, struct
    bits: int = 0  #: of int; 1 = of a comparison
    signed: bool = True
    of: Type | None = None  #: what a pointer or array holds
    count: int = 0  #: of an array
    name: str = ""  #: of a struct

    def __str__(self) -> str:
        """In LLVM's language."""
        words = {"int": f"i{self.bits}", "pointer": "ptr", "struct": f"%{self.name}", "array": ""}
        return f"[{self.count} x {self.of}]" if self.kind == "array" else words.get(self.kind, self.kind)


INT, DOUBLE, VOID, FLAG = Type("int", 32), Type("double"), Type("void"), Type("int", 1, signed=False)
LONG, UNSIGNED = Type("int", 64), Type("int", 64, signed=False)
NAMES = {"int": INT, "unsigned": Type("int", 32, signed=False), "double": DOUBLE, "void": VOID, "char": Type("int", 8)}
NAMES |= {"int64_t": LONG, "ptrdiff_t": LONG, "uint64_t": UNSIGNED, "size_t": UNSIGNED}
IGNORED = ("static", "inline", "const", "restrict", "extern")
INTRINSICS = {"fabs": "fabs", "sqrt": "sqrt", "copysign": "copysign", "__builtin_fma": "fma"}
#: how strongly operations hold, the weakest first
LEVELS = (("||",), ("&&",), ("|",), ("^",), ("&",), ("==", "!="), ("<", "<=", ">", ">="), ("<<", ">>"))
LEVELS += (("+", "-"), ("*", "/", "%"))
ASSIGNMENTS = ("=", "+=", "-=", "*=", "/=", "|=", "&=", "^=")
COMPARISONS = {"==": "eq", "!=": "ne", "<": "lt", "<=": "le", ">": "gt", ">=": "ge"}
POINTER = Type("pointer", of=VOID)


@dataclass
class Value:
    """A number, or the place of one."""

    type: Type
    text: str  #: an operand; of a place the pointer to it
    is_place: bool = False
    shared: bool = False  #: a place in an array that others see, as lanes of a loop


def double_text(value: float) -> str:
    """A number in LLVM's language, to the bit."""
    return "0x" + struct.pack(">d", value).hex().upper()
