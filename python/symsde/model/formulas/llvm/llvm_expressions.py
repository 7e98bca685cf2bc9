# SPDX-License-Identifier: BSD-3-Clause
"""Expressions: words are read, instructions written."""

from __future__ import annotations

from .llvm_instructions import Instructions
from .llvm_types import (
    ASSIGNMENTS,
    DOUBLE,
    FLAG,
    INT,
    INTRINSICS,
    LEVELS,
    LONG,
    NAMES,
    POINTER,
    UNSIGNED,
    VOID,
    Type,
    Value,
)


class Expressions(Instructions):
    """Operations, casts, calls, places."""

    def expressions(self) -> Value:
        """Some with commas between them."""
        value = self.expression()
        while self.unit.takes(","):
            value = self.expression()
        return value

    def expression(self) -> Value:
        """One, an assignment perhaps."""
        left = self.choice()
        operation = self.unit.peek()
        if operation not in ASSIGNMENTS:
            return left
        self.unit.next()
        right = self.expression()
        self.store(left, right if operation == "=" else self.binary(operation[:-1], left, right))
        return left

    def choice(self) -> Value:
        """a ? b : c, of which one is computed."""
        condition = self.level(0)
        if not self.unit.takes("?"):
            return condition
        yes, no, after = self.new_block(), self.new_block(), self.new_block()
        self.branch(self.truth(condition), yes, no)
        self.begin(yes)
        a = self.load(self.expression())
        yes_end = self.block
        self.unit.expect(":")
        self.block = no
        self.blocks.append(no)
        b = self.load(self.choice())
        kind = a.type if a.type == b.type == VOID else self.common(a.type, b.type)
        a, b = self.converted(a, kind, yes_end), self.converted(b, kind)
        yes_end.lines.append(f"br label %{after.label}")
        yes_end.ended = True
        no_end = self.block
        self.begin(after)
        return Value(kind, self.emit(f"phi {kind} [{a.text}, %{yes_end.label}], [{b.text}, %{no_end.label}]"))

    def level(self, k: int) -> Value:
        """Operations that hold so strongly, or more."""
        if k == len(LEVELS):
            return self.unary()
        left = self.level(k + 1)
        while self.unit.peek() in LEVELS[k]:
            operation = self.unit.next()
            left = self.both(operation, left) if k <= 1 else self.binary(operation, left, self.level(k + 1))
        return left

    def both(self, operation: str, left: Value) -> Value:
        """a && b, a || b: b is computed where it counts."""
        more, after = self.new_block(), self.new_block()
        first = self.truth(left)
        begin = self.block
        self.branch(first, *((more, after) if operation == "&&" else (after, more)))
        self.blocks.append(more)
        self.block = more
        second = self.truth(self.level(1 if operation == "||" else 2))
        last = self.block
        self.begin(after)
        known = "false" if operation == "&&" else "true"
        return Value(FLAG, self.emit(f"phi i1 [{known}, %{begin.label}], [{second}, %{last.label}]"))

    def unary(self) -> Value:
        """Signs, stars, casts."""
        unit, word = self.unit, self.unit.peek()
        if word == "(" and unit.is_type(1):
            return self.cast()
        if word not in ("-", "+", "!", "~", "*", "&", "++", "--", "sizeof"):
            return self.postfix(self.primary())
        unit.next()
        if word == "sizeof":
            return self.size()
        x = self.unary()
        if word == "&":
            return Value(Type("pointer", of=x.type), x.text, shared=x.shared)
        if word in ("++", "--"):
            self.store(x, self.binary(word[0], x, Value(INT, "1")))
            return x
        return self.signed(word, self.load(x))

    def signed(self, word: str, x: Value) -> Value:
        """A number behind one of * ! - + ~."""
        if word == "*":
            return Value(x.type.of, x.text, is_place=True, shared=x.shared)
        if word == "!":
            return Value(FLAG, self.emit(f"xor i1 {self.truth(x)}, true"))
        if word == "~":
            return self.binary("^", x, Value(LONG if x.type.bits == LONG.bits else INT, "-1"))
        if word == "-" and x.type == DOUBLE:
            return Value(DOUBLE, self.emit(f"fneg double {x.text}"))
        return self.binary("-", Value(INT, "0"), x) if word == "-" else x

    def cast(self) -> Value:
        """(type) x, or (struct) {..}."""
        self.unit.expect("(")
        base, _ = self.unit.base_type()
        _, kind, _ = self.unit.declarator(base)
        self.unit.expect(")")
        if self.unit.takes("{"):
            place = self.variable("", kind)
            for name, _ in self.unit.structs[kind.name]:
                self.store(self.member(place, name), self.expression())
                self.unit.takes(",")
            self.unit.expect("}")
            return place
        x = self.load(self.unary())
        return Value(VOID, "") if kind == VOID else self.converted(x, kind)

    def size(self) -> Value:
        """Bytes of a variable or a type."""
        unit = self.unit
        if unit.peek() == "(" and unit.is_type(1):
            unit.next()
            base, _ = unit.base_type()
            _, kind, _ = unit.declarator(base)
            unit.expect(")")
        else:
            kind = self.postfix(self.primary()).type
        end = self.emit(f"getelementptr {kind}, ptr null, i64 1")
        return Value(UNSIGNED, self.emit(f"ptrtoint ptr {end} to i64"))

    def primary(self) -> Value:
        """A number, a name, a call, something in parentheses."""
        unit = self.unit
        if unit.takes("("):
            x = self.expressions()
            unit.expect(")")
            return x
        word = unit.next()
        if word[0].isdigit() or word[0] == "." or word in ("UINT64_C", "INT64_MAX"):
            return unit.literal(word)
        if word == "NULL":
            return Value(POINTER, "null")
        if unit.peek() == "(":
            return self.call(word)
        for scope in (*reversed(self.scopes), unit.globals):
            if word in scope:
                return scope[word]
        if word in unit.constants:
            return Value(INT, str(unit.constants[word]))
        unit.at -= 1
        unit.expect("a name that is known")
        raise AssertionError

    def postfix(self, x: Value) -> Value:
        """Indices, members, and ++ behind."""
        unit = self.unit
        while True:
            if unit.takes("["):
                pointer = self.load(x)
                index = self.converted(self.load(self.expression()), LONG)
                unit.expect("]")
                text = self.emit(f"getelementptr {pointer.type.of}, ptr {pointer.text}, i64 {index.text}")
                x = Value(pointer.type.of, text, is_place=True, shared=pointer.shared)
            elif unit.takes("."):
                x = self.member(x, unit.next())
            elif unit.takes("->"):
                pointer = self.load(x)
                x = self.member(Value(pointer.type.of, pointer.text, is_place=True), unit.next())
            elif unit.peek() in ("++", "--"):
                self.store(x, self.binary(unit.next()[0], x, Value(INT, "1")))
            else:
                return x

    def member(self, x: Value, name: str) -> Value:
        """A member of a struct."""
        fields = self.unit.structs[x.type.name]
        [k] = [k for k, (known, _) in enumerate(fields) if known == name]
        text = self.emit(f"getelementptr {x.type}, ptr {x.text}, i32 0, i32 {k}")
        return Value(fields[k][1], text, is_place=True)

    def call(self, name: str) -> Value:
        """A function of the text, or of the C library."""
        unit = self.unit
        unit.expect("(")
        given = []
        while not unit.takes(")"):
            given.append(self.load(self.expression()))
            unit.takes(",")
        result, wanted, called = self.known(name, len(given))
        given = [self.converted(x, kind) for x, kind in zip(given, wanted, strict=True)]
        arguments = [f"{x.type} {x.text}" for x in given] + (["i1 false"] if name in ("memcpy", "memset") else [])
        text = f"call {result} @{called}({', '.join(arguments)})"
        if result == VOID:
            self.block.lines.append(text)
            return Value(VOID, "")
        return Value(result, self.emit(text))

    def known(self, name: str, count: int) -> tuple[Type, list[Type], str]:
        """Result, arguments and name of a function."""
        unit = self.unit
        if name in unit.functions:
            return *unit.functions[name], name
        special = {
            "memcpy": (VOID, [POINTER, POINTER, LONG], "llvm.memcpy.p0.p0.i64"),
            "memset": (VOID, [POINTER, NAMES["char"], LONG], "llvm.memset.p0.i64"),
            "malloc": (POINTER, [LONG], "malloc"),
            "free": (VOID, [POINTER], "free"),
        }
        plain = f"llvm.{INTRINSICS[name]}.f64" if name in INTRINSICS else name
        result, wanted, called = special.get(name, (DOUBLE, [DOUBLE] * count, plain))
        types = [*(str(x) for x in wanted), *(["i1"] if name in ("memcpy", "memset") else [])]
        unit.outside[called] = f"declare {result} @{called}({', '.join(types)})"
        return result, wanted, called
