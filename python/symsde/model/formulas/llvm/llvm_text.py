# SPDX-License-Identifier: BSD-3-Clause
"""From generated C to LLVM's language, for machines without a compiler: the same text, and the same bits.

It is not C that is read here but what `emit_c.py` and its like write: int, int64_t, uint64_t, double, pointers, arrays
and structs of these; functions, declarations, if, for, return; operations of numbers. Words are read
once, from left to right, and instructions written as they come; variables are memory, which LLVM makes registers.
"""

from __future__ import annotations

import ast
import struct

from ....errors import InvalidArgumentError
from .llvm_function import Function
from .llvm_types import DOUBLE, IGNORED, INT, LONG, NAMES, UNSIGNED, Type, Value, double_text
from .llvm_words import words_of


def translated(source: str, defined: tuple[str, ...] = ()) -> str:
    """LLVM's text for a generated C text."""
    return Unit(words_of(source, defined)).text()


class Unit:
    """A whole text."""

    def __init__(self, words: list[str]):
        """Nothing is read yet."""
        self.words, self.at = words, 0
        self.types = dict(NAMES)
        self.structs: dict[str, list[tuple[str, Type]]] = {}
        self.constants: dict[str, int] = {}  #: of enum
        self.local: dict[str, int] = {}  #: of enum in the function that is read
        self.globals: dict[str, Value] = {}
        self.functions: dict[str, tuple[Type, list[Type]]] = {}
        self.outside: dict[str, str] = {}  #: declarations of functions of others
        self.parts: list[str] = []
        self.notes: list[str] = []  #: metadata
        self.count = 0

    # ---- words ---------------------------------------------------------------------------------------------

    def peek(self, ahead: int = 0) -> str:
        """A word that comes."""
        return self.words[self.at + ahead] if self.at + ahead < len(self.words) else ""

    def next(self) -> str:
        """The next word."""
        self.at += 1
        return self.words[self.at - 1]

    def takes(self, word: str) -> bool:
        """Whether the next word is this; then it is read."""
        found = self.peek() == word
        self.at += found
        return found

    def expect(self, word: str) -> None:
        """This word, or a sentence."""
        if not self.takes(word):
            near = " ".join(self.words[max(0, self.at - 12) : self.at + 3])
            raise InvalidArgumentError(f"generated code holds {near!r}, which llvm does not read")

    def fresh(self) -> str:
        """A name that nothing else has."""
        self.count += 1
        return f"v{self.count}"

    def note(self, text: str) -> str:
        """A piece of metadata; SELF stands for itself."""
        self.notes.append(f"!{len(self.notes)} = distinct !{{{text.replace('SELF', f'!{len(self.notes)}')}}}")
        return f"!{len(self.notes) - 1}"

    # ---- types and declarations ----------------------------------------------------------------------------

    def is_type(self, ahead: int = 0) -> bool:
        """Whether a type begins here."""
        return self.peek(ahead) in self.types or self.peek(ahead) in ("const", "static", "struct")

    def base_type(self) -> tuple[Type, set[str]]:
        """A type without pointers, and what is said beside it."""
        said, found = set(), None
        while True:
            word = self.peek()
            if word == "__attribute__":
                self.next()
                said |= set(self.skipped("(", ")"))
            elif word in IGNORED:
                said.add(self.next())
            elif found is None and word in self.types:
                found = self.types[self.next()]
            elif found is None:
                self.expect("a type")
            else:
                return found, said

    def skipped(self, opening: str, closing: str) -> list[str]:
        """Words between two that belong together."""
        begin, depth = self.at + 1, 0
        while True:
            word = self.next()
            depth += (word == opening) - (word == closing)
            if depth == 0:
                return self.words[begin : self.at - 1]

    def declarator(self, base: Type, is_argument: bool = False) -> tuple[str, Type, bool]:
        """A name with its stars and brackets, and whether it is restrict."""
        restrict = False
        while self.peek() in ("*", *IGNORED):
            word = self.next()
            base = Type("pointer", of=base) if word == "*" else base
            restrict |= word == "restrict"
        name = self.next() if self.peek().isidentifier() else ""
        sizes = []
        while self.peek() == "[":
            sizes.append(self.number_of(self.skipped("[", "]")))
        for size in reversed(sizes):
            base = Type("array", of=base, count=size)
        if is_argument and base.kind == "array":
            base = Type("pointer", of=base.of)
        return name, base, restrict

    def number_of(self, words: list[str]) -> int:
        """A whole constant from its words: one, or a ? b : c."""
        if "?" in words:
            k, last = words.index("?"), len(words) - 1 - words[::-1].index(":")
            return self.number_of(words[k + 1 : last] if self.number_of(words[:k]) else words[last + 1 :])
        known = {**self.constants, **self.local}
        return _whole(ast.parse(" ".join(str(known.get(x, x)) for x in words), mode="eval").body)

    def text(self) -> str:
        """All of it."""
        while self.at < len(self.words):
            self.top()
        notes = "\n".join(self.notes)
        return "\n".join(
            [
                *(f"%{x} = type {{{', '.join(str(t) for _, t in fields)}}}" for x, fields in self.structs.items()),
                *self.outside.values(),
                *self.parts,
                notes,
                "",
            ]
        )

    def top(self) -> None:
        """A definition outside of functions."""
        if self.takes(";"):
            return
        if self.takes("enum"):
            self.constants |= self.enumeration()
        elif self.takes("typedef"):
            self.structure()
        else:
            base, said = self.base_type()
            name, kind, _ = self.declarator(base)
            if self.peek() == "(":
                Function(self, name, kind, said).define()
            else:
                self.expect("=")
                self.globals[name] = self.constant_of(kind)
                self.expect(";")

    def enumeration(self) -> dict[str, int]:
        """Constants of an enum."""
        self.expect("{")
        last, found = -1, {}
        while not self.takes("}"):
            name, begin = self.next(), self.at
            if self.takes("="):
                while self.peek() not in (",", "}"):
                    self.next()
                last = self.number_of([str(found.get(x, x)) for x in self.words[begin + 1 : self.at]]) - 1
            last += 1
            found[name] = last
            self.takes(",")
        return found

    def structure(self) -> None:
        """A struct that gets a name."""
        self.expect("struct")
        self.expect("{")
        fields = []
        while not self.takes("}"):
            base, _ = self.base_type()
            while not self.takes(";"):
                fields.append(self.declarator(base)[:2])
                self.takes(",")
        name = self.next()
        self.structs[name] = fields
        self.types[name] = Type("struct", name=name)

    def constant_of(self, kind: Type) -> Value:
        """A constant that has a place of its own."""
        name = f"@constant{len(self.parts)}"
        self.parts.append(f"{name} = internal constant {kind} {self.initial(kind)}")
        return Value(kind, name, is_place=True)

    def initial(self, kind: Type) -> str:
        """What a constant begins with."""
        if kind.kind == "array":
            self.expect("{")
            items = []
            while not self.takes("}"):
                items.append(f"{kind.of} {self.initial(kind.of)}")
                self.takes(",")
            items += [f"{kind.of} zeroinitializer"] * (kind.count - len(items))
            return f"[{', '.join(items)}]"
        sign = "-" if self.takes("-") else ""
        value = self.literal(self.next())
        text = value.text.removeprefix("-") if value.type != DOUBLE else value.text
        if kind == DOUBLE:
            number = float(text) if value.type != DOUBLE else struct.unpack(">d", bytes.fromhex(text[2:]))[0]
            return double_text(-number if sign else number)
        return sign + text

    def literal(self, word: str) -> Value:
        """A number as it is written."""
        if word == "UINT64_C":
            self.expect("(")
            value = Value(UNSIGNED, self.literal(self.next()).text)
            self.expect(")")
            return value
        if word == "INT64_MAX":
            return Value(LONG, str(2**63 - 1))
        plain = word.rstrip("uUlL")
        if "." in plain or "p" in plain.lower() or ("e" in plain.lower() and not plain.lower().startswith("0x")):
            return Value(DOUBLE, double_text(float.fromhex(plain) if plain.lower().startswith("0x") else float(plain)))
        number = int(plain, 0)
        kind = (INT if number < 2**31 else LONG) if "u" not in word.lower() else NAMES["unsigned"]
        return Value(kind, str(number))


def _whole(node: ast.AST) -> int:
    """The value of sums and products of whole numbers, or whether one is above another."""
    if isinstance(node, ast.Compare) and isinstance(node.ops[0], ast.Gt):
        return int(_whole(node.left) > _whole(node.comparators[0]))
    if isinstance(node, ast.BinOp):
        a, b = _whole(node.left), _whole(node.right)
        return {ast.Add: a + b, ast.Sub: a - b, ast.Mult: a * b}[type(node.op)]
    return int(ast.literal_eval(node))
