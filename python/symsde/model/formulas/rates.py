# SPDX-License-Identifier: BSD-3-Clause
"""Rates of damping given as formulas gamma_i(q, t): C, and what they depend on.

There is one formula for all momenta, or one for each, in the coordinates, the time and the parameters of the
Hamiltonians. If no formula holds a coordinate or the time, the rates are numbers that depend on the parameters.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...errors import InvalidArgumentError, WrongShapeError
from ...native import callbacks, checks
from ..rates import Rates
from . import emit_c, in_numpy
from .derivatives import engine, free
from .forces import ForceFormulas
from .graph import Graph
from .named_formulas import Problem, quoted
from .structure import Prover
from .tails import Tails

CALLBACK = """int formula_damping(int nlane, int ndof, int nrate, double t, const double *q, double *rate, void *user);
int formula_damping(int nlane, int ndof, int nrate, double t, const double *q, double *rate, void *user) {
   (void)ndof, (void)nrate;
   of_rate(nlane, t, NULL, q, NULL, PARAMETERS(user), rate);
   return 0;
}
"""


@dataclass(frozen=True)
class Asked:
    """Damping that was given as formulas."""

    formulas: tuple[Any, ...]  #: one formula, or one for each momentum
    allow_gain: bool = False  #: whether rates may be negative


def asked(damping: Any, *, allow_gain: bool = False) -> Any:
    """Damping, as `Asked` if it holds formulas; numbers, functions and None stay as they are."""
    row = damping if isinstance(damping, list | tuple) else (damping,)
    flat = [x for y in row for x in (y if isinstance(y, list | tuple) else (y,))]
    if not any(isinstance(x, str) or hasattr(x, "free_symbols") for x in flat):
        return damping
    if any(isinstance(x, list | tuple) for x in row):
        raise WrongShapeError(
            f"damping = {checks.shown(damping)} has rows with formulas: formulas are rates, one for all momenta or a "
            "list with one for each; a matrix holds numbers"
        )
    return Asked(tuple(row), allow_gain)


class RateFormulas(ForceFormulas):
    """Rates as nodes of one graph."""

    def __init__(self, problem: Problem, rates: list[Any]):
        """Make the graph of these rates, which depend on q and t."""
        self.problem, self._vanishing, self._entries = problem, (), {}
        self.graph, self._engine, self._lanes = Graph(), engine(), problem.lanes
        self.symbol = {name: self._engine.Symbol(name) for name in problem.lanes}
        self._tails = Tails(self._engine, lambda e: any(self._lanes.get(s.name, True) for s in e.free_symbols))
        try:
            rows = [self._engine.sympify(free(e)) for e in rates]
        except (TypeError, ValueError, RuntimeError, NotImplementedError, self._engine.SympifyError):
            raise InvalidArgumentError("damping has no values: write it with functions of formulas") from None
        self.outputs = {"rate": [self._node(e) for e in rows]}


@dataclass(frozen=True)
class Found:
    """The result of deriving rates from formulas."""

    asked: Asked
    texts: tuple[str, ...]
    of: str  #: "q", "t" or "qt"; "" if rates are numbers
    formulas: RateFormulas | None  #: None if rates are numbers
    numbers: Callable[[Mapping[str, float]], list[float]]  #: values of parameters -> rates that are numbers
    rows: tuple[Any, ...] = ()  #: formulas of rates that are numbers, in the symbols of the Hamiltonians

    def at(self, values: Mapping[str, float], compiled: Any) -> Rates | list[float]:
        """The rates for these values of the parameters; compiled: the library with their function, or None."""
        if self.formulas is None:
            return self.numbers(values)
        if compiled is None:
            function: Any = self._in_numpy(values)
        else:
            table = np.array(list(values.values()) or [0.0])
            address = ctypes.cast(compiled.library.formula_damping, ctypes.c_void_p)
            function = callbacks.WithData(address, ctypes.c_void_p(table.ctypes.data), (table, compiled.library))
        return Rates(function, self.of, len(self.texts) > 1, self.asked.allow_gain, self.texts)

    def _in_numpy(self, values: Mapping[str, float]) -> Callable:
        """The rates as a NumPy function, for use without a compiler."""
        graph, roots = self.formulas.graph, self.formulas.outputs["rate"]
        parameters = {f"c{k}": value for k, value in enumerate(values.values())}

        def at(q, t):
            given = {"t": t, **parameters, **{f"q{i}": row for i, row in enumerate(q)}}
            found = in_numpy.values_of(graph, roots, given, q.shape[-1])
            return found if len(roots) > 1 else found[0]

        if self.of == "q":
            return lambda q: at(q, 0.0)
        return at if self.of == "qt" else lambda t: at(np.zeros((0, 1)), t)


def split(problem: Problem, given: Asked) -> tuple[Problem, list[Any]]:
    """A problem without the rates that stand behind its invariants, and the rates."""
    count = len(given.formulas)
    if count not in (1, problem.ndof):
        raise WrongShapeError(
            f"damping has {count} formulas for {problem.ndof} degrees of freedom: give one rate, or one for each"
        )
    bare = replace(problem, invariants=problem.invariants[:-count], texts=problem.texts[:-count])
    return bare, list(problem.invariants[-count:])


def derive(problem: Problem, prover: Prover, given: Asked, rates: list[Any]) -> Found:
    """Find on what the rates depend, and prepare their formulas or numbers."""
    texts = tuple(str(x) for x in given.formulas)
    exact = [prover.sympy.sympify(e).xreplace(prover.special) for e in rates]
    held = set().union(*(e.free_symbols for e in exact))
    for x, text in zip(exact, texts, strict=True):
        if x.free_symbols & set(prover.p):
            raise InvalidArgumentError(
                f"damping = {quoted(text)} holds a momentum: rates depend on q and t alone; give it as a force"
            )
    of = ("q" if held & set(prover.q) else "") + ("t" if prover.t in held else "")
    if not of:
        return Found(given, texts, of, None, _numbers(prover, rates), tuple(rates))
    return Found(given, texts, of, RateFormulas(problem, rates), _numbers(prover, []))


def _numbers(prover: Prover, rates: list[Any]) -> Callable[[Mapping[str, float]], list[float]]:
    """Rates without q and t, as a function of the values of parameters."""

    def at(values: Mapping[str, float]) -> list[float]:
        given = dict(zip(prover._real, values.values(), strict=True))
        return [float(prover.sympy.sympify(e).subs(given)) for e in rates]

    return at


def source(found: Found | None) -> str:
    """The C text of the rates; empty if they are numbers."""
    if found is None or found.formulas is None:
        return ""
    loops = emit_c.Loops(found.formulas.graph, found.formulas.outputs)
    return "\n".join(["", loops.far(("rate",)), loops.function(("rate",)), CALLBACK])
