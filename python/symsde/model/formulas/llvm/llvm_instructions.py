# SPDX-License-Identifier: BSD-3-Clause
"""Instructions of one function: numbers, memory, conversions, blocks."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from ....errors import InvalidArgumentError
from .llvm_types import COMPARISONS, DOUBLE, FLAG, INT, LONG, VOID, Type, Value


@dataclass
class Block:
    """Instructions in their order, with one at the end that goes elsewhere."""

    label: str
    lines: list[str] = field(default_factory=list)
    ended: bool = False


@dataclass
class Loop:
    """Where continue and break go."""

    step: Block
    end: Block


class Instructions:
    """What is written of a function so far."""

    def __init__(self, unit: Any, name: str, result: Type, said: set[str]):
        """Nothing but an entry."""
        self.unit, self.name, self.result, self.said = unit, name, result, said
        self.scopes: list[dict[str, Value]] = [{}]
        self.entry = Block("entry")
        self.block = Block("begin")
        self.blocks = [self.entry, self.block]
        self.loops: list[Loop] = []
        self.group = ""  #: of accesses that do not hang on each other, in a loop over lanes

    def variable(self, name: str, kind: Type) -> Value:
        """Memory of a name."""
        place = Value(kind, f"%{self.unit.fresh()}", is_place=True)
        self.entry.lines.insert(0, f"{place.text} = alloca {kind}")
        self.scopes[-1][name] = place
        return place

    def emit(self, text: str, block: Block | None = None) -> str:
        """An instruction that gives a number: its name."""
        name = f"%{self.unit.fresh()}"
        (block or self.block).lines.append(f"{name} = {text}")
        return name

    def end(self, text: str) -> None:
        """The last instruction of a block, if it has none."""
        if not self.block.ended:
            self.block.lines.append(text)
        self.block.ended = True

    def new_block(self) -> Block:
        """One that is to be written."""
        return Block(self.unit.fresh())

    def begin(self, block: Block) -> None:
        """Go on in a block, which follows where the last one has not ended."""
        self.end(f"br label %{block.label}")
        self.blocks.append(block)
        self.block = block

    def branch(self, condition: str, yes: Block, no: Block) -> None:
        """Go on in one of two blocks."""
        self.end(f"br i1 {condition}, label %{yes.label}, label %{no.label}")

    def access(self, place: Value) -> str:
        """What is said of accesses that do not hang on each other."""
        return f", !llvm.access.group {self.group}" if place.shared and self.group else ""

    def load(self, x: Value) -> Value:
        """The number at a place."""
        if not x.is_place:
            return x
        if x.type.kind == "array":
            return Value(Type("pointer", of=x.type.of), x.text, shared=x.shared)
        text = self.emit(f"load {x.type}, ptr {x.text}{self.access(x)}")
        return Value(x.type, text, shared=x.type.kind == "pointer")

    def store(self, place: Value, x: Value) -> None:
        """A number at a place."""
        x = self.converted(self.load(x), place.type)
        self.block.lines.append(f"store {place.type} {x.text}, ptr {place.text}{self.access(place)}")

    def converted(self, x: Value, kind: Type, block: Block | None = None) -> Value:
        """A number as one of another type."""
        if str(x.type) == str(kind):
            return Value(kind, x.text, shared=x.shared)
        if kind.kind == "pointer" and x.text in ("0", "null"):
            return Value(kind, "null")
        if x.type.kind == kind.kind == "int":
            how = "trunc" if kind.bits < x.type.bits else "sext" if x.type.signed else "zext"
        elif x.type.kind == "int" and kind == DOUBLE:
            how = "sitofp" if x.type.signed else "uitofp"
        elif x.type == DOUBLE and kind.kind == "int":
            how = "fptosi" if kind.signed else "fptoui"
        else:
            raise InvalidArgumentError(f"generated code turns {x.type} into {kind}, which llvm does not do")
        return Value(kind, self.emit(f"{how} {x.type} {x.text} to {kind}", block))

    def truth(self, x: Value) -> str:
        """Whether a number is not zero."""
        x = self.load(x)
        if x.type == FLAG:
            return x.text
        zero = {"double": "0.0", "pointer": "null"}.get(x.type.kind, "0")
        return self.emit(f"{'fcmp une' if x.type == DOUBLE else 'icmp ne'} {x.type} {x.text}, {zero}")

    @staticmethod
    def common(a: Type, b: Type) -> Type:
        """What C makes of two numbers."""
        if DOUBLE in (a, b):
            return DOUBLE
        if a.kind == "pointer" or b.kind == "pointer" or a.kind == "struct":
            return a if a.kind != "int" and a.of != VOID else b
        wide = max(a.bits, b.bits, 32)
        return Type("int", wide, signed=all(x.signed or x.bits < wide for x in (a, b)))

    def binary(self, operation: str, a: Value, b: Value) -> Value:
        """Two numbers, or a pointer and a number."""
        a, b = self.load(a), self.load(b)
        if a.type.kind == "pointer" and operation in ("+", "-") and b.type.kind == "int":
            b = self.converted(b, LONG)
            b = self.binary("-", Value(LONG, "0"), b) if operation == "-" else b
            text = self.emit(f"getelementptr {a.type.of}, ptr {a.text}, i64 {b.text}")
            return Value(a.type, text, shared=a.shared)
        kind = self.common(a.type, b.type) if operation not in ("<<", ">>") else self.common(a.type, INT)
        a, b = self.converted(a, kind), self.converted(b, kind)
        if operation in COMPARISONS:
            return Value(FLAG, self.emit(f"{self.comparison(operation, kind)} {kind} {a.text}, {b.text}"))
        if kind == DOUBLE:
            names = {"+": "fadd", "-": "fsub", "*": "fmul", "/": "fdiv"}
        else:
            sign = "s" if kind.signed else "u"
            names = {"+": "add", "-": "sub", "*": "mul", "/": f"{sign}div", "%": f"{sign}rem", "&": "and", "|": "or"}
            names |= {"^": "xor", "<<": "shl", ">>": "ashr" if kind.signed else "lshr"}
        return Value(kind, self.emit(f"{names[operation]} {kind} {a.text}, {b.text}"))

    @staticmethod
    def comparison(operation: str, kind: Type) -> str:
        """The name of a comparison."""
        name = COMPARISONS[operation]
        if kind == DOUBLE:
            return f"fcmp {'une' if name == 'ne' else 'o' + name}"
        sign = "" if name in ("eq", "ne") else "s" if kind.signed and kind.kind == "int" else "u"
        return f"icmp {sign}{name}"
