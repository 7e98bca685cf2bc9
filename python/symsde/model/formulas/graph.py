# SPDX-License-Identifier: BSD-3-Clause
"""Expressions as one graph in which equal parts are one node, so that parts shared by outputs are computed once.

A node is a number in a list. Every node but a leaf is exactly one floating-point operation, so that the order of
operations, and with it every bit of a result, is fixed here, whatever else is computed.
"""

from __future__ import annotations

import math
from collections.abc import Container, Iterable
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

from ...errors import InvalidArgumentError
from . import kinks
from .scaled import Scaled

#: names of functions of one argument, as formulas call them
FUNCTIONS = (
    *("sin", "cos", "tan", "exp", "log", "sqrt", "sinh", "cosh", "tanh"),
    *("asin", "acos", "atan", "asinh", "acosh", "atanh", "sech", "csch", "coth", "erf", "erfc"),
)
#: functions that the C library computes lane by lane; Bessel functions and polygamma of a whole order come first
SCALAR = ("gamma", "loggamma")
BESSEL = ("besselj", "bessely", "besseli", "besselk")
OF_ORDER = (*BESSEL, "polygamma")
MAX_ORDER = 40  #: of Bessel functions, whose derivatives are of orders nearby
INNER = ("log1p", "gauss", "logcosh")  #: functions that formulas are rewritten in: log(1 + x), exp(-x^2), log(cosh(x))
MAX_OPERATIONS = 12_000


@dataclass(frozen=True)
class Node:
    """One operation and its arguments, which are nodes."""

    kind: str  #: "number", "leaf", or the name of an operation
    arguments: tuple[int, ...] = ()
    value: Any = None  #: value of a number; name of a leaf
    lane: bool = False  #: whether the node differs from lane to lane and is computed in the loop


@dataclass
class Graph:
    """A list of nodes, each after its arguments."""

    nodes: list[Node] = field(default_factory=list)
    _known: dict[tuple, int] = field(default_factory=dict)
    _made: dict[Any, int] = field(default_factory=dict)  #: whole expressions -> their nodes
    #: stand-in symbol of a node -> the expression that it replaces
    stand_ins: dict[Any, Any] = field(default_factory=dict)

    def node(self, kind: str, *arguments: int, value: Any = None, lane: bool = False) -> int:
        """Make a node, or return an equal one that exists."""
        key = (kind, arguments, value)
        if key not in self._known:
            if len(self.nodes) >= MAX_OPERATIONS:
                raise InvalidArgumentError(
                    f"the derivatives take more than {MAX_OPERATIONS} operations: write sums over sites as "
                    "Sum(..., i), which stay loops, or take fewer degrees of freedom"
                )
            lane = lane or any(self.nodes[x].lane for x in arguments)
            self._known[key] = len(self.nodes)
            self.nodes.append(Node(kind, arguments, value, lane))
        return self._known[key]

    def number(self, value: float) -> int:
        """The node of a number."""
        return self.node("number", value=repr(float(value)))

    def leaf(self, name: str, lane: bool) -> int:
        """The node of an input: a coordinate, a weight, a parameter, the time."""
        return self.node("leaf", value=name, lane=lane)

    def is_number(self, x: int, value: float) -> bool:
        """Whether a node is this number."""
        node = self.nodes[x]
        return node.kind == "number" and float(node.value) == value

    def multiply(self, a: int, b: int) -> int:
        """A product of two nodes. A factor of one is dropped, and signs, which do not affect rounding, are moved to
        the front.
        """
        minus = (self._sign(a) < 0) != (self._sign(b) < 0)
        a, b = sorted((self._size(a), self._size(b)))
        result = self.node("*", a, b) if self._trivial(a, b) is None else self._trivial(a, b)
        return self.negative(result) if minus else result

    def _trivial(self, a: int, b: int) -> int | None:
        """The value of a product with one or zero; else None."""
        for x, y in ((a, b), (b, a)):
            if self.is_number(x, 1.0):
                return y
            if self.is_number(x, 0.0):
                return x
        return None

    def negative(self, x: int) -> int:
        """Change of sign."""
        node = self.nodes[x]
        if node.kind == "number":
            return self.number(-float(node.value))
        return node.arguments[0] if node.kind == "negative" else self.node("negative", x)

    def product(self, factors: Iterable[int]) -> int:
        """A product from left to right; factors that are equal for all lanes come first, so that their product
        leaves the loop.
        """
        ordered = sorted(factors, key=lambda x: (self.nodes[x].lane, x))
        result = self.number(1.0)
        for x in ordered:
            result = self.multiply(result, x)
        return result

    def dot(self, pairs: Iterable[tuple[int, int]]) -> int:
        """The sum of products of pairs of nodes."""
        return self.sum(self.multiply(a, b) for a, b in pairs)

    def sum(self, terms: Iterable[int]) -> int:
        """A sum from left to right; negative terms are subtracted, and if all are negative the sum gets the sign."""
        ordered = [x for x in terms if not self.is_number(x, 0.0)]
        if not ordered:
            return self.number(0.0)
        if all(self._sign(x) < 0 for x in ordered):
            return self.negative(self.sum(self._size(x) for x in ordered))
        ordered.sort(key=lambda x: (self.nodes[x].lane, self._sign(x) < 0, self._size(x)))
        result = ordered[0]
        for x in ordered[1:]:
            if self._sign(x) < 0:
                result = self.node("-", result, self._size(x))
            else:
                result = self.node("+", *sorted((result, x)))
        return result

    def _sign(self, x: int) -> int:
        node = self.nodes[x]
        return -1 if node.kind == "negative" or (node.kind == "number" and float(node.value) < 0) else 1

    def _size(self, x: int) -> int:
        """A node without its sign."""
        return self.negative(x) if self._sign(x) < 0 else x

    def power(self, x: int, exponent: int) -> int:
        """An integer power by multiplication."""
        if exponent < 0:
            return self.node("/", self.number(1.0), self.power(x, -exponent))
        if exponent == 0:
            return self.number(1.0)
        if exponent == 1:
            return x
        half = self.power(x, exponent // 2)
        square = self.multiply(half, half)
        return self.multiply(square, x) if exponent % 2 else square

    def quotient(self, above: int, below: int) -> int:
        """A quotient."""
        return above if self.is_number(below, 1.0) else self.node("/", above, below)

    # ---- from expressions of sympy or symengine ------------------------------------------------------------

    def stand_in(self, symbol: Any, node: int, plain: Any) -> None:
        """Let a symbol in expressions stand for a node, whose expression is `plain`."""
        self._made[symbol], self.stand_ins[symbol] = node, plain

    def add(self, expression: Any, leaves: dict[str, bool]) -> int:
        """The node of an expression; `leaves`: name -> whether it differs from lane to lane."""
        if expression in self._made:
            return self._made[expression]
        made = Scaled(self, leaves).node(expression)
        made = self._make(expression, leaves) if made is None else made
        self._made[expression] = made
        return made

    def _make(self, e: Any, leaves: dict[str, bool]) -> int:
        kind = type(e).__name__
        if kind in ("Symbol", "Dummy"):
            return self.leaf(e.name, leaves[e.name])
        if not e.args or getattr(e, "is_Number", False):
            return self.number(constant(e))
        if kind == "Add":
            return self.sum(self.add(x, leaves) for x in e.args)
        if kind == "Mul":
            return self._product_of(e.args, leaves)
        if kind == "Pow":
            return self._power_of(*e.args, leaves)
        return self._cases(e, leaves) if kind == "Piecewise" else self._called(e, kind, leaves)

    def _called(self, e: Any, kind: str, leaves: dict[str, bool]) -> int:
        """A function."""
        if kind in FUNCTIONS or kind in SCALAR or kind == "atan2":
            return self.node(kind, *(self.add(x, leaves) for x in e.args))
        if kind == "Step":
            return self.node("floor", self.add(e.args[0], leaves))
        if kind in OF_ORDER:
            return self.node(kind, self.add(e.args[1], leaves), value=_order(kind, e.args[0]))
        name = str(e).partition("(")[0] if kind == "PyFunction" else kind  # a sympy function unknown to symengine
        raise InvalidArgumentError(
            f"{name} in a formula has no derivative everywhere, or no code here: use + - * / ** and "
            + ", ".join((*FUNCTIONS, "atan2", *SCALAR, *BESSEL))
            + ", "
            + ", ".join((*kinks.REWRITTEN, *kinks.ONE, *kinks.MANY, "Mod", "Piecewise"))
        )

    def _cases(self, e: Any, leaves: dict[str, bool]) -> int:
        """The first case whose condition holds. sympy has pairs, symengine a list in which they alternate."""
        flat = [x for pair in e.args for x in pair.args] if type(e.args[0]).__name__ == "ExprCondPair" else list(e.args)
        *pairs, last = zip(flat[::2], flat[1::2], strict=True)
        result = self.add(last[0], leaves)
        for value, condition in reversed(pairs):
            chosen, here = self._condition(condition, leaves), self.add(value, leaves)
            result = here if here == result else self.node("select", chosen, here, result)
        return result

    def _condition(self, e: Any, leaves: dict[str, bool]) -> int:
        """1 where a condition holds, else 0."""
        kind = type(e).__name__
        if kind in kinks.COMPARISONS:
            a, b = (self.add(x, leaves) for x in e.args)
            return self.node("less" if "Strict" in kind else "upto", *((b, a) if "Greater" in kind else (a, b)))
        if kind in ("And", "Or", "Not"):
            parts = [self._condition(x, leaves) for x in e.args]
            one = self.number(1.0)
            if kind == "And":
                return self.product(parts)
            none = self.product(self.node("-", one, x) for x in parts)
            return self.node("-", one, none) if kind == "Or" else none
        return self.number(1.0 if kind == "BooleanTrue" else 0.0)

    def _product_of(self, factors, leaves) -> int:
        """Numerators over denominators, with one division for each kind of factor in the denominator."""
        above, below = [], []
        for factor in factors:
            base, exponent = factor.args if type(factor).__name__ == "Pow" else (factor, None)
            if exponent is not None and _negative(exponent) and type(base).__name__ != "Exp1":
                below.append(self.add(1 / factor, leaves))
            else:
                above.append(self.add(factor, leaves))
        return self.quotient(self.product(above), self.product(below))

    def _power_of(self, base, exponent, leaves) -> int:
        if type(base).__name__ == "Exp1":
            return self.node("exp", self.add(exponent, leaves))
        x = self.add(base, leaves)
        if getattr(exponent, "is_Number", False):
            return self.raised(x, float(exponent))
        return self.node("pow", x, self.add(exponent, leaves))

    def raised(self, x: int, exponent: float) -> int:
        """A power with a constant exponent: by multiplication and a root if possible."""
        twice = 2 * exponent
        if not twice.is_integer() or abs(twice) > 128:
            return self.node("pow", x, self.number(exponent))
        whole, half = divmod(abs(int(twice)), 2)
        result = self.power(x, whole)
        if half:
            result = self.multiply(result, self.node("sqrt", x))
        return result if twice >= 0 else self.node("/", self.number(1.0), result)


def reachable(graph: Graph, roots: Iterable[int], given: Container[int] = ()) -> list[int]:
    """The nodes that these need, in order; empty for given nodes."""
    found, waiting = set(), list(roots)
    while waiting:
        x = waiting.pop()
        if x not in found:
            found.add(x)
            waiting.extend(graph.nodes[x].arguments if x not in given else ())
    return sorted(found)


def constant(e: Any) -> float:
    """A constant as a floating-point number; a constant that is not real and finite is refused."""
    try:  # integers of any length exactly: symengine's own conversion loses digits
        value = float(Fraction(str(e))) if getattr(e, "is_Rational", False) else float(e)
    except (TypeError, ValueError, RuntimeError, OverflowError, ZeroDivisionError):
        value = float("nan")
    if not math.isfinite(value):
        raise InvalidArgumentError(
            f"the constant {e!s:.40} in a formula is not a finite real number: formulas are real"
        )
    return value


def _order(kind: str, given: Any) -> int:
    """The order of a function, a small whole number."""
    most = 3 if kind == "polygamma" else MAX_ORDER
    if not getattr(given, "is_Integer", False) or not 0 <= int(given) <= most:
        name = "derivatives of gamma" if kind == "polygamma" else kind
        raise InvalidArgumentError(
            f"{name} of order {given!s:.40} in a formula has no code here: orders are whole numbers from 0 to {most}"
        )
    return int(given)


def _negative(exponent) -> bool:
    return bool(getattr(exponent, "is_Number", False)) and float(exponent) < 0
