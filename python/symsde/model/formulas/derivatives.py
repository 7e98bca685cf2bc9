# SPDX-License-Identifier: BSD-3-Clause
"""Values, gradients and Hessians of weighted sums S = sum_j w_j H_j as nodes of one graph.

symengine differentiates every H_j (sympy does if symengine is missing, which takes tens of times as long).
S stays a sum of products weight x coefficient x function: if several Hamiltonians share a function of the state, as
in (omega^2 w_0 + sigma w_2) sin q, there is one product with it.
"""

from __future__ import annotations

import functools
import importlib
import itertools
from collections.abc import Container
from dataclasses import replace
from typing import Any

from ...errors import InvalidArgumentError
from ...native.files import optional
from . import kinks
from .graph import BESSEL, Graph, reachable
from .named_formulas import Problem, quoted
from .tails import Tails

MAX_GRADIENT = 3_000  #: most operations of a gradient
MAX_THIRD = 600  #: most nonzero third derivatives, over all degrees of freedom
MAX_SQUARES = 1_000  #: most products in the squares of all noises
#: noises that meet from which their squares are taken together: for fewer little is gained, but in one degree of
#: freedom, where sums come with them
MEETING = 4
BLOCKS = {"hq": "q", "hp": "p", "hqq": "qq", "hqp": "qp", "hpp": "pp"}


def engine(*expressions: Any) -> Any:
    """The module symengine; sympy if it is missing, or for expressions with functions that it does not know."""
    sympy = optional("sympy", "sympy")
    strange = (*(getattr(sympy, x) for x in BESSEL), kinks.step_function())
    if any(hasattr(e, "has") and e.has(*strange) for e in expressions):
        return sympy
    try:
        return importlib.import_module("symengine")
    except ImportError:
        return sympy


class Derivatives:
    """All derivatives of a problem; zero where a derivative vanishes."""

    def __init__(
        self,
        problem: Problem,
        vanishing: Container[tuple] = (),
        *,
        kicks: str | None = None,
        thirds: bool = False,
        folds: bool = False,
    ):
        """Store the problem. vanishing: (j, variables) of derivatives that are zero, in whatever form they are
        written; thirds: whether third derivatives are wanted where no bracket needs them, too; folds: whether cases
        that are all equal become one, by sympy, which takes longer.
        """
        self.problem = problem
        self.kicks = kicks  #: what kicks between flows of a quadratic part of H depend on; None without such a part
        self._vanishing = vanishing
        self.graph = Graph()
        self._engine = optional("sympy", "sympy") if folds else engine(*problem.hamiltonians)
        self.symbol = {name: self._engine.Symbol(name) for name in problem.lanes}
        self._third: dict[str, list[int]] | None = None
        self._thirds = thirds
        self._constants: list[int] | None = None
        self._squares: dict[str, list[int]] | None = None
        try:
            self.hamiltonians = [self._engine.sympify(free(h)) for h in problem.hamiltonians]
        except (TypeError, ValueError, RuntimeError, NotImplementedError, self._engine.SympifyError):
            raise InvalidArgumentError(f"the formula {quoted(problem.texts[0])} cannot be differentiated") from None
        self._lanes = problem.lanes
        self._tails = Tails(self._engine, lambda e: any(s.name not in self._fixed for s in e.free_symbols))
        self._formed = [self._tails.formed(h) for h in self.hamiltonians]
        self._entries: dict[tuple, list[Any]] = {}
        self.outputs = {"value": [self._weighted(self.hamiltonians, "")]}
        for block, variables in BLOCKS.items():  # gradients first, to find large formulas before Hessians
            self.outputs[block] = self._block(variables)
            if len(variables) == 1 and len(self.graph.nodes) > MAX_GRADIENT:
                raise InvalidArgumentError(
                    f"the gradient of {quoted(problem.texts[0])} and its noises takes {len(self.graph.nodes)} "
                    f"operations, allowed are {MAX_GRADIENT}: shorten products, or take fewer degrees of freedom"
                )

    def at_rest(self) -> Derivatives:
        """The derivatives of H and its noises at p = 0."""
        still = dict.fromkeys(self.problem.coordinates("p"), 0)
        rest = {x: still[x.name] for h in self.problem.hamiltonians for x in h.free_symbols if x.name in still}
        return Derivatives(replace(self.problem, hamiltonians=tuple(h.subs(rest) for h in self.problem.hamiltonians)))

    @functools.cached_property
    def _fixed(self) -> set[str]:
        """Names that do not belong to the state, though their values may differ from lane to lane."""
        return {name for name in self.problem.lanes if name[0] in "ct"}

    def of(self, *variables: str) -> list[Any]:
        """Derivatives of every H_j by these variables."""
        return [self._tails.plain(e) for e in self._of(*variables)] if variables else self.hamiltonians

    def node(self, j: int, *variables: str) -> int:
        """The node of a derivative of H_j."""
        return self._node(self._of(*variables)[j] if variables else self.hamiltonians[j])

    def _of(self, *variables: str) -> list[Any]:
        """Derivatives of every H_j in stand-in symbols for functions that have limits (tails.py)."""
        if not variables:
            return self._formed
        key = tuple(sorted(variables))
        if key not in self._entries:
            self._entries[key] = [self._derivative(j, h, key) for j, h in enumerate(self._of(*key[:-1]))]
        return self._entries[key]

    def _node(self, e: Any) -> int:
        written = self._tails.written(self._engine.sympify(e), self.graph, self._lanes)
        return self.graph.add(written, self._lanes)

    def _derivative(self, j: int, before: Any, key: tuple[str, ...]) -> Any:
        """The last derivative of several. An expression that contains a variable but does not depend on it, as p + q -
        p, is written without the variable: rounding would depend on it, which steps of separable Hamiltonians must
        not."""
        last = self.symbol[key[-1]]
        result = self._tails.diff(before, last) if last in self._tails.plain(before).free_symbols else 0 * last
        if (j, *key) in self._vanishing and result.expand() == 0:
            return 0 * last
        for x in sorted(x.name for x in result.free_symbols) if len(key) == 1 else ():
            if (j, *sorted((x, *key))) in self._vanishing:
                result = self._without(result, self.symbol[x])
        return result

    def _without(self, e: Any, x: Any) -> Any:
        """The function written without a variable that it does not depend on; unchanged if that is not certain."""
        if self._tails.plain(e) != e or e.diff(x).expand() != 0:
            return e
        others = sorted((s for s in e.free_symbols if s != x), key=str)
        for value in (0, 1):
            found = e.subs({x: value})
            try:
                self.graph.add(found, self.problem.lanes)  # raises an error if the expression is singular there
                places = [dict(zip(others, itertools.cycle(p), strict=False)) for p in ((0.83, 1.17), (-0.61, 0.47))]
                same = (
                    abs(complex(e.subs({**at, x: y})) - complex(found.subs(at))) < 1e-9  # no branch, as in atan(1/p)
                    for at in places
                    for y in (0.73, -1.31)
                )
                if all(same):
                    return found
            except (InvalidArgumentError, TypeError, ValueError, RuntimeError):
                continue
        return e

    def third(self) -> dict[str, list[int]] | None:
        """Nodes of the gradient of a^T S'' b, outputs tq and tp, in leaves aq0 .., ap0 .., bq0 .., bp0 ..

        None if the gradient vanishes or has too many terms.
        """
        names = [*self.problem.coordinates("q"), *self.problem.coordinates("p")]
        terms: dict[str, list[int]] = {x: [] for x in names}
        count = 0
        for j, k in itertools.combinations_with_replacement(range(len(names)), 2):
            x, y = names[j], names[k]
            present = {s.name for e in self.of(x, y) for s in e.free_symbols}
            for z in names:
                if z not in present or all(e == 0 for e in self.of(x, y, z)):
                    continue
                count += 1
                if count > MAX_THIRD:
                    return None
                a, b = ([self.graph.leaf(f"{letter}{v}", True) for v in (x, y)] for letter in "ab")
                along = self.graph.multiply(a[0], b[1])
                if j != k:
                    along = self.graph.sum((along, self.graph.multiply(a[1], b[0])))
                try:
                    terms[z].append(self.graph.multiply(self._weighted(self._of(x, y, z), x + y + z), along))
                except InvalidArgumentError:  # a graph cannot hold this many operations
                    return None
        n = self.problem.ndof
        nodes = [self.graph.sum(terms[x]) for x in names]
        return {"tq": nodes[:n], "tp": nodes[n:]} if count else None

    def wanted_third(self) -> dict[str, list[int]]:
        """The nodes of `third`, computed once; empty if no scheme needs third derivatives and nobody wants them."""
        if self._third is None:
            self._third = ((self._thirds or self.has_brackets()) and self.third()) or {}
        return self._third

    def constants(self) -> list[int]:
        """Nodes that depend on parameters alone, and that other nodes use: computed once for each path. Empty if all
        paths have the same parameters: expressions that are equal for all lanes are computed before loops.
        """
        if self._constants is None:
            self._constants = self._found_constants() if self.problem.by_path else []
        return self._constants

    def _found_constants(self) -> list[int]:
        noise = [x for variables in BLOCKS.values() for x in self.noise_block(variables)]
        nodes, more = self.graph.nodes, (*self.wanted_third().values(), *self.squares().values())
        roots = [*itertools.chain(*self.outputs.values(), *more), *noise]
        needed = reachable(self.graph, roots)
        fixed: set[int] = set()
        for x in needed:
            is_leaf = nodes[x].kind == "leaf"
            if nodes[x].value[0] == "c" if is_leaf else fixed.issuperset(nodes[x].arguments):
                fixed.add(x)
        taken = {a for x in needed if x not in fixed for a in nodes[x].arguments} | set(roots)
        return [x for x in needed if x in fixed & taken and nodes[x].lane]

    def has_brackets(self) -> bool:
        """Whether nested brackets need third derivatives; for H = p.p/2 + U(q) with noise in position they are
        squares.
        """
        return len(self.hamiltonians) > 1 and not self._is_simple()

    def _is_simple(self) -> bool:
        """Whether H = p.p/2 + U(q) with noise in position."""
        slopes = {x: self.of(x) for x in self.problem.coordinates("p")}
        return all(e[0] == self.symbol[x] and all(h == 0 for h in e[1:]) for x, e in slopes.items())

    def squares(self) -> dict[str, list[int]]:
        """Nodes of b = sum_k (Hess H_k) H_k,q and, of one degree of freedom, of the derivatives of sums s
        (symsde_squares in symsde.h), where the weights c_k are leaves z0 .., computed once; empty unless several
        nonlinear noises meet or one acts on one degree of freedom, and for too many products.
        """
        if self._squares is None:
            self._squares = self._found_squares() if self._is_simple() else {}
        return self._squares

    def bend(self) -> list[int]:
        """Nodes of the gradient of half of sum_k H_k,q.M^-1 H_k,q over the noises."""
        graph, q, p = self.graph, self.problem.coordinates("q"), self.problem.coordinates("p")
        found: list[list[int]] = [[] for _ in q]
        for k in range(1, self.problem.nnoise + 1):
            slope = [self.node(k, x) for x in q]
            moved = [graph.dot((self.node(0, y, z), s) for z, s in zip(p, slope, strict=True)) for y in p]
            for i, x in enumerate(q):
                found[i].append(graph.dot((self.node(k, x, y), v) for y, v in zip(q, moved, strict=True)))
        return [graph.sum(x) for x in found]

    def _found_squares(self) -> dict[str, list[int]]:
        names, noises, graph = self.problem.coordinates("q"), range(1, len(self.hamiltonians)), self.graph
        touched = {x: {k for k in noises if self.of(x)[k] != 0} for x in names}
        if max(map(len, touched.values())) < (MEETING if len(names) > 1 else 1):
            return {}
        pairs = [(x, y, k) for x in names for y in names for k in touched[x] & touched[y] if self.of(x, y)[k] != 0]
        if not 0 < len(pairs) <= MAX_SQUARES:
            return {}
        try:
            squares = {"b": self.bend()}
            if len(names) == 1:
                squares["s"] = [*self.outputs["hq"], *self.outputs["hqq"]]
                zero = self._engine.Integer(0)
                squares["s"] += [self._weighted([zero, *self._of(*names * i)[1:]], "", "z") for i in (1, 2, 3)]
                slopes, curves, bends = ([self.node(k, *names * i) for _x, _y, k in pairs] for i in (1, 2, 3))
                parts = [graph.multiply(x, x) for x in curves] + [*map(graph.multiply, slopes, bends)]
                squares["s"].append(graph.sum(parts))
        except InvalidArgumentError:  # a graph cannot hold this many operations
            return {}
        # Momenta may be written that no noise depends on; they are not given.
        leaves = (graph.nodes[x] for x in reachable(graph, itertools.chain(*squares.values())))
        return {} if any(x.kind == "leaf" and x.value[0] == "p" for x in leaves) else squares

    def noise_block(self, variables: str) -> list[int]:
        """A block of derivatives of sum_k w_k H_k, the noises alone."""
        return self._block(variables, first=1)

    def _block(self, variables: str, first: int = 0) -> list[int]:
        """Nodes of a block of derivatives: [i], or by rows [j][i] with i for the first letter and j for the second.
        Hamiltonians with a number below `first` are left out."""
        names = [self.problem.coordinates(letter) for letter in variables]
        keys = [(x,) for x in names[0]] if len(names) == 1 else [(x, y) for y in names[1] for x in names[0]]
        zeros = [self._engine.Integer(0)] * first
        return [self._weighted([*zeros, *self._of(*key)[first:]], "".join(key)) for key in keys]

    def _weighted(self, expressions: list[Any], what: str, letter: str = "w") -> int:
        """The node of sum_j w_j e_j, with weights in leaves of this letter."""
        graph = self.graph
        table: dict[Any, dict[int, Any]] = {}
        try:
            for j, e in enumerate(self._tails.written(e, graph, self._lanes) for e in expressions):
                for factor, function in self._terms(e):
                    row = table.setdefault(function, {})
                    row[j] = row.get(j, 0) + factor
            weights = [graph.leaf(f"{letter}{j}", True) for j in range(len(expressions))]
            terms, alone = [], {}
            for function, row in table.items():
                parts = {j: self._node(factor) for j, factor in row.items()}
                if len(parts) == 1:
                    [(j, factor)] = parts.items()
                    alone.setdefault(j, []).append((factor, self._node(function)))
                else:
                    coefficient = graph.dot((factor, weights[j]) for j, factor in parts.items())
                    terms.append(graph.multiply(coefficient, self._node(function)))
            for j, group in alone.items():
                if len(group) == 1:
                    [(factor, function)] = group
                    terms.append(graph.multiply(graph.multiply(factor, weights[j]), function))
                else:
                    inner = graph.dot(group)
                    terms.append(graph.multiply(weights[j], inner))
        except InvalidArgumentError as error:
            where = f"the derivative by {what} of " if what else ""
            raise InvalidArgumentError(f"{where}{quoted(self.problem.texts[0])} or its noises: {error}") from error
        return graph.sum(terms)

    def _terms(self, e: Any) -> list[tuple[Any, Any]]:
        """Split an expression into terms (factor that is the same for all lanes) x (function of the state)."""
        one = self._engine.Integer(1)
        result = []
        for term in e.args if type(e).__name__ == "Add" else (e,):
            factor, function = one, one
            for x in term.args if type(term).__name__ == "Mul" else (term,):
                if any(s.name not in self._fixed for s in x.free_symbols):
                    function = function * x
                else:
                    factor = factor * x
            if factor != 0:
                result.append((factor, function))
        return result


def free(expression: Any) -> Any:
    """The expression with symbols without assumptions, as in symengine."""
    sympy = optional("sympy", "sympy")
    return expression.xreplace({x: sympy.Symbol(x.name) for x in expression.free_symbols})
