# SPDX-License-Identifier: BSD-3-Clause
"""A function: its arguments, and its statements."""

from __future__ import annotations

from .llvm_expressions import Expressions
from .llvm_instructions import Loop
from .llvm_types import INT, VOID, Value
from .llvm_words import IVDEP, UNROLL


class Function(Expressions):
    """One function: its words are read, its instructions written."""

    def define(self) -> None:
        """From its arguments to its end; a declaration alone is none."""
        unit = self.unit
        unit.expect("(")
        unit.local, arguments = {}, []
        while not unit.takes(")"):
            base, _ = unit.base_type()
            name, kind, restrict = unit.declarator(base, is_argument=True)
            arguments.append((name, kind, restrict))
            unit.takes(",")
        unit.functions[self.name] = (self.result, [kind for _, kind, _ in arguments])
        if unit.takes(";"):
            return
        given = []
        for k, (name, kind, restrict) in enumerate(arguments):
            given.append(f"{kind}{' noalias' if restrict else ''} %a{k}")
            place = self.variable(name, kind)
            self.entry.lines.append(f"store {kind} %a{k}, ptr {place.text}")
        unit.expect("{")
        self.body()
        if not self.block.ended:
            self.end("ret void" if self.result == VOID else "unreachable")
        self.entry.lines.append("br label %begin")
        linkage = "internal " if "static" in self.said else ""
        words = [x for x, y in (("alwaysinline", "always_inline"), ("noinline cold", "noinline")) if y in self.said]
        text = "".join(f"{b.label}:\n" + "".join(f"  {x}\n" for x in b.lines) for b in self.blocks)
        head = f"define {linkage}{self.result} @{self.name}({', '.join(given)}) nounwind {' '.join(words)}"
        unit.parts.append(f'{head} "prefer-vector-width"="512" {{\n{text}}}')

    def body(self) -> None:
        """Statements up to the brace that ends them, with names of their own."""
        self.scopes.append({})
        while not self.unit.takes("}"):
            self.statement()
        self.scopes.pop()

    def statement(self) -> None:
        """One statement."""
        unit = self.unit
        marks = set()
        while unit.peek() in (IVDEP, UNROLL):
            marks.add(unit.next())
        if self.block.ended:  # what follows a return is never run
            self.block = self.new_block()
            self.blocks.append(self.block)
        word = unit.peek()
        if unit.takes("{"):
            self.body()
        elif unit.takes("if"):
            self.condition()
        elif unit.takes("for"):
            self.loop(marks)
        elif unit.takes("return"):
            self.leave()
        elif word in ("break", "continue"):
            unit.next()
            self.end(f"br label %{(self.loops[-1].end if word == 'break' else self.loops[-1].step).label}")
            unit.expect(";")
        elif unit.takes("enum"):
            unit.local |= unit.enumeration()
            self.scopes[-1] |= {x: Value(INT, str(value)) for x, value in unit.local.items()}
        elif unit.is_type():
            self.declaration()
        elif not unit.takes(";"):
            self.expressions()
            unit.expect(";")

    def leave(self) -> None:
        """What follows return."""
        if self.unit.takes(";"):
            self.end("ret void")
            return
        x = self.converted(self.load(self.expression()), self.result)
        self.unit.expect(";")
        self.end(f"ret {self.result} {x.text}")

    def declaration(self) -> None:
        """Variables of a type, with what they begin with."""
        base, _ = self.unit.base_type()
        while True:
            name, kind, _ = self.unit.declarator(base)
            if self.unit.takes("="):
                if self.unit.peek() == "{":
                    self.scopes[-1][name] = self.unit.constant_of(kind)
                else:
                    value = self.load(self.expression())
                    self.store(self.variable(name, kind), value)
            else:
                self.variable(name, kind)
            if not self.unit.takes(","):
                break
        self.unit.expect(";")

    def condition(self) -> None:
        """If, and else."""
        yes, no, after = self.new_block(), self.new_block(), self.new_block()
        self.unit.expect("(")
        self.branch(self.truth(self.expression()), yes, no)
        self.unit.expect(")")
        self.blocks.append(yes)
        self.block = yes
        self.statement()
        self.end(f"br label %{after.label}")
        self.blocks.append(no)
        self.block = no
        if self.unit.takes("else"):
            self.statement()
        self.begin(after)

    def loop(self, marks: set[str]) -> None:
        """For; of lanes that are marked so, accesses do not hang on each other."""
        unit, around = self.unit, self.group
        body, step, test, end = (self.new_block() for _ in range(4))
        self.scopes.append({})
        unit.expect("(")
        if unit.is_type():
            self.declaration()
        else:
            if unit.peek() != ";":
                self.expressions()
            unit.expect(";")
        self.begin(test)
        self.branch(self.truth(self.expression()) if unit.peek() != ";" else "true", body, end)
        unit.expect(";")
        self.blocks.append(step)
        self.block = step
        if unit.peek() != ")":
            self.expressions()
        self.end(f"br label %{test.label}{self.about_loop(marks)}")
        unit.expect(")")
        self.blocks.append(body)
        self.block = body
        self.loops.append(Loop(step, end))
        self.statement()
        self.loops.pop()
        self.end(f"br label %{step.label}")
        self.blocks.append(end)
        self.block = end
        self.group = around
        self.scopes.pop()

    def about_loop(self, marks: set[str]) -> str:
        """Metadata of a loop."""
        unit = self.unit
        if not marks:
            return ""
        about = []
        if IVDEP in marks:
            self.group = unit.note("")
            about.append(unit.note(f'!"llvm.loop.parallel_accesses", {self.group}'))
        if UNROLL in marks:
            about.append(unit.note('!"llvm.loop.unroll.full"'))
        return f", !llvm.loop {unit.note(', '.join(['SELF', *about]))}"
