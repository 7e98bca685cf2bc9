# SPDX-License-Identifier: BSD-3-Clause
"""Nodes of a graph as expressions of Fortran that can be read: a node that is used once is inlined.

Operations keep the order that the graph gives them, by parentheses, so that numbers agree with those of the compiled
formulas up to the rounding of sine and similar functions.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable

from ..model.formulas.emit_c import reachable
from ..model.formulas.graph import Graph
from .given import Given

SUM, PRODUCT, ATOM = 1, 2, 9  #: precedence of the last operation of an expression
#: functions that Fortran has under another name
NAMES = {"fabs": "abs", "besselj": "bessel_jn", "bessely": "bessel_yn"}
MAX_CHARACTERS = 90  #: most characters of one expression; parts of longer expressions get a name


class Expressions:
    """Some outputs as statements: `parts` are the named intermediate results, `results` the outputs."""

    def __init__(self, graph: Graph, roots: Iterable[int], leaf: Callable[[str], str], number: Callable[[str], str]):
        """Write the outputs. `leaf` writes an input, `number` a number."""
        self.graph, self.leaf, self.number = graph, leaf, number
        roots = list(roots)
        uses = Counter(a for x in reachable(graph, roots) for a in graph.nodes[x].arguments)
        uses.update(roots)
        self.parts: list[tuple[str, str]] = []
        self._text: dict[int, tuple[str, int]] = {}
        for x in reachable(graph, roots):
            text, strength = self._written(x)
            simple = graph.nodes[x].kind in ("leaf", "number", "negative")
            if not simple and (uses[x] > 1 or len(text) > MAX_CHARACTERS) and x not in roots:
                name = f"x{len(self.parts) + 1}"
                self.parts.append((name, text))
                text, strength = name, ATOM
            self._text[x] = text, strength
        self.results = [self._text[x][0] for x in roots]

    def _written(self, x: int) -> tuple[str, int]:
        node = self.graph.nodes[x]
        if node.kind == "number":
            text = self.number(node.value)
            return text, SUM if text.startswith("-") else ATOM
        if node.kind == "leaf":
            return self.leaf(node.value), ATOM
        if node.kind == "negative":
            return f"-{self.held(node.arguments[0], PRODUCT)}", SUM
        if node.kind in ("+", "-"):
            a, b = node.arguments
            return f"{self.held(a, SUM)} {node.kind} {self.held(b, PRODUCT)}", SUM
        if node.kind in ("*", "/"):
            a, b = node.arguments
            return f"{self.held(a, PRODUCT)}{node.kind}{self.held(b, ATOM)}", PRODUCT
        order = [] if node.value is None else [str(node.value)]  # of Bessel functions and polygamma
        arguments = [*order, *(self._text[a][0] for a in node.arguments)]
        return self.called(node.kind, arguments), ATOM

    def called(self, function: str, arguments: list[str]) -> str:
        """Write a function of its arguments; a power is an operator, and a comparison is 1 or 0."""
        if function in ("less", "upto"):
            compared = f"{arguments[0]} {'<' if function == 'less' else '<='} {arguments[1]}"
            return f"merge({self.number('1.0')}, {self.number('0.0')}, {compared})"
        if function == "select":
            return f"merge({arguments[1]}, {arguments[2]}, {arguments[0]} > {self.number('0.5')})"
        if function == "floor":
            [whole] = [f"aint({x})" for x in arguments]
            return f"({whole} - merge({self.number('1.0')}, {self.number('0.0')}, {arguments[0]} < {whole}))"
        if function == "pow":
            return f"(({arguments[0]})**({arguments[1]}))"
        return f"{NAMES.get(function, function)}({', '.join(arguments)})"

    def held(self, x: int, strength: int) -> str:
        """Write a node as an operand, with parentheses if its operation has lower precedence."""
        text, own = self._text[x]
        return text if own >= strength else f"({text})"


def called(given: Given, functions: Iterable[str]) -> list[str]:
    """The functions among these that the formulas of a model call."""
    made = [d.derivatives for d in given.model._chain.densities] if given.is_chain else [given.model._derivatives]
    found = {node.kind for derivatives in made for node in derivatives.graph.nodes}
    return [name for name in functions if name in found]


def wrapped(text: str, width: int, indent: str, mark: str = "") -> list[str]:
    """Break a statement into lines at blanks, after commas if possible."""
    lines, rest = [], text
    while len(rest) > width:
        last = width - len(mark)
        cut = rest.rfind(", ", width // 2, last) + 1 or rest.rfind(" ", 0, last)
        if cut <= len(indent):
            break
        lines.append(rest[:cut] + mark)
        rest = indent + rest[cut + 1 :]
    return [*lines, rest]
