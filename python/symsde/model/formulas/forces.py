# SPDX-License-Identifier: BSD-3-Clause
"""Forces given as formulas: derivatives, C, and what is proved of them.

F and every f_k are lists of expressions, one for each degree of freedom, in the symbols of the Hamiltonians. What the
library asks for are weighted sums, w_0 F and sum_k w_k f_k, with their derivatives by q and p: outputs f, fq, fp and g,
gq, gp of one graph.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ...errors import InvalidArgumentError, WrongShapeError
from ...native import checks
from ...native.files import optional
from . import emit_c, in_numpy
from .derivatives import Derivatives, engine, free
from .graph import Graph
from .named_formulas import MAX_DOF, MAX_NOISES, Problem, quoted, several
from .structure import Prover
from .tails import Tails

#: function of symsde.h -> its outputs
FUNCTIONS = {
    "force": ("f",),
    "force_derivative": ("fq", "fp"),
    "noise_force": ("g",),
    "noise_force_derivative": ("gq", "gp"),
}


def rows_of(force: Any, noise_force: Any, most: int = MAX_DOF) -> list[list[Any]]:
    """F, f_1 .. f_m as lists of formulas; a single formula is that of one degree of freedom."""
    noises = [_row("noise_force", x, most) for x in _row("noise_force", noise_force, MAX_NOISES)]
    return [_row("force", force, most), *noises]


def _row(name: str, given: Any, most: int) -> list[Any]:
    """A list of formulas; refuses a long one before it is gone through."""
    count = 1 if isinstance(given, str) else getattr(given, "shape", None) or (len(given) if _is_list(given) else 1)
    count = count[0] if isinstance(count, tuple) else count
    if count > most:
        raise WrongShapeError(f"{name} holds {count} entries in a row: allowed are {most}")
    return several(name, given)


def _is_list(given: Any) -> bool:
    return isinstance(given, list | tuple | range)


def split(problem: Problem, rows: list[list[Any]]) -> tuple[Problem, list[list[Any]]]:
    """A problem without the forces that stand behind its invariants, and the forces: F, f_1 .. f_m."""
    count = sum(map(len, rows))
    if not count:
        return problem, []
    expressions = iter(problem.invariants[len(problem.invariants) - count :])
    found = [[next(expressions) for _ in row] for row in rows]
    _check(problem, rows)
    bare = replace(
        problem,
        invariants=problem.invariants[: len(problem.invariants) - count],
        texts=problem.texts[: len(problem.texts) - count],
    )
    zero = [0] * problem.ndof
    return bare, [row or zero for row in (*found, *([] for _ in range(problem.nnoise + 1 - len(found))))]


def _check(problem: Problem, rows: list[list[Any]]) -> None:
    """Refuse forces of the wrong shape."""
    n, m = problem.ndof, problem.nnoise
    if len(rows[0]) not in (0, n):
        raise WrongShapeError(f"force has {len(rows[0])} formulas: give one for each of the {n} degrees of freedom")
    if len(rows) - 1 not in (0, m):
        raise WrongShapeError(
            f"noise_force has {len(rows) - 1} rows for {m} noises: give one list for each noise, with the formula '0' "
            "where no force goes with it; noises that are forces alone have H_k = 0"
        )
    for k, row in enumerate(rows[1:], 1):
        if len(row) != n:
            raise WrongShapeError(
                f"row {k} of noise_force has {len(row)} formulas: give one for each of the {n} degrees of freedom"
            )


def friction_of_noises(problem: Problem, beta: float) -> list[list[Any]]:
    """F = -beta/2 sum_k H_k,q (H_k,q . H_p), the friction that belongs to noises in position at 1/beta, and no f_k."""
    h, *noises = problem.hamiltonians
    sympy = optional("sympy", "sympy")
    q, p = ([sympy.Symbol(x, real=True) for x in problem.coordinates(letter)] for letter in "qp")
    gradients = [[sympy.diff(noise, x) for x in q] for noise in noises]
    works = [sum(g * sympy.diff(h, y) for g, y in zip(row, p, strict=True)) for row in gradients]
    half = sympy.Integer(int(beta / 2)) if beta == 2 * int(beta / 2) else sympy.Float(beta / 2)
    force = [-half * sum(row[i] * work for row, work in zip(gradients, works, strict=True)) for i in range(len(q))]
    return [force, *([0] * len(q) for _ in noises)]


class ForceFormulas(Derivatives):
    """Weighted sums of forces and their derivatives, as nodes of one graph."""

    def __init__(self, problem: Problem, forces: list[list[Any]]):
        """Differentiate F, f_1 .. f_m."""
        self.problem, self._vanishing, self._entries = problem, (), {}
        self.graph, self._engine, self._lanes = Graph(), engine(), problem.lanes
        self.symbol = {name: self._engine.Symbol(name) for name in problem.lanes}
        self._tails = Tails(self._engine, lambda e: any(self._lanes.get(s.name, True) for s in e.free_symbols))
        zeros = [self._engine.Integer(0)] * problem.ndof
        try:
            rows = [[self._engine.sympify(free(e) if e != 0 else 0) for e in row] for row in forces]
        except (TypeError, ValueError, RuntimeError, NotImplementedError, self._engine.SympifyError):
            raise InvalidArgumentError(
                "a force cannot be differentiated: write it with functions of formulas"
            ) from None
        self.outputs = self._part("f", rows[:1]) | self._part("g", [zeros, *rows[1:]])
        self.has = {"f": any(e != 0 for e in rows[0]), "g": any(e != 0 for row in rows[1:] for e in row)}

    def _part(self, name: str, rows: list[list[Any]]) -> dict[str, list[int]]:
        """A sum and its derivatives, [j][i] of component i by variable j."""
        n = self.problem.ndof
        found = {name: [self._weighted([row[i] for row in rows], "") for i in range(n)]}
        formed = [[self._tails.formed(e) for e in row] for row in rows]
        for letter in "qp":
            symbols = [self.symbol[x] for x in self.problem.coordinates(letter)]
            found[name + letter] = [
                self._weighted([self._by(row[i], x) for row in formed], str(x)) for x in symbols for i in range(n)
            ]
        return found

    def _by(self, e: Any, x: Any) -> Any:
        """A derivative."""
        return self._tails.diff(e, x) if x in self._tails.plain(e).free_symbols else 0 * x

    def kinds(self) -> dict[str, tuple[str, ...]]:
        """The functions that are wanted, and their outputs."""
        return {kind: outputs for kind, outputs in FUNCTIONS.items() if self.has[outputs[0][0]]}


class _Code(emit_c.Loops):
    """Functions of C behind those of the Hamiltonians in one file."""

    def __init__(self, forces: ForceFormulas):
        super().__init__(forces.graph, forces.outputs)
        self.kinds = forces.kinds()

    def text(self) -> str:
        """All of them."""
        parts = []
        for kind, outputs in self.kinds.items():
            parts += [self.far(outputs), self.function(outputs), emit_c.callback(kind, outputs)]
        return "\n".join(parts)


def source(found: Found) -> str:
    """The C text."""
    return "" if found.formulas is None else _Code(found.formulas).text()


def proofs(prover: Prover, forces: list[list[Any]]) -> dict[str, Any]:
    """Which forces depend on q and t alone, and how far they reach."""
    special = [[prover.sympy.sympify(e).xreplace(prover.special) for e in row] for row in forces]
    parts = {"position_force": special[:1], "position_noise_force": special[1:]}
    found: dict[str, Any] = {
        name: all(prover.vanishes(e.diff(x)) for row in rows for e in row for x in prover.p if x in e.free_symbols)
        for name, rows in parts.items()
    }
    places = {x: i for names in (prover.q, prover.p) for i, x in enumerate(names)}
    reaches = [abs(i - places[x]) for row in special for i, e in enumerate(row) for x in e.free_symbols if x in places]
    return {**found, "force_bandwidth": max(reaches, default=0)}


def friction(prover: Prover, force: list[Any]) -> tuple[Any, ...]:
    """Formulas of the rates gamma_i, if F is proved to be -gamma_i p_i with constants; empty otherwise."""
    formulas, at = [], dict.fromkeys((*prover.q, *prover.p, prover.t), 0)
    for p, given in zip(prover.p, force, strict=True):
        component = prover.sympy.sympify(given)
        rate = -component.diff(p).subs(at)
        if not rate.is_finite or not prover.vanishes(component + rate * p):
            return ()
        formulas.append(rate)
    return tuple(formulas)


def _rates_at(formulas: tuple[Any, ...], values: Mapping[str, float]) -> tuple[float, ...] | None:
    """The rates of friction for these values of the parameters; None if there are none, or all vanish."""
    named = {f"c{k}": value for k, value in enumerate(values.values())}
    found = tuple(float(e.subs({x: named[x.name] for x in e.free_symbols})) for e in formulas)
    return found if any(found) and np.isfinite(found).all() else None


@dataclass(frozen=True)
class Found:
    """What formulas of forces are."""

    formulas: ForceFormulas | None = None  #: with their derivatives; None: none acts
    proved: dict[str, Any] = field(default_factory=dict)  #: arguments of `Model.forced`
    friction: tuple[float, ...] | None = None  #: rates of F = -gamma_i p_i, which is left out of the formulas
    rates: tuple[Any, ...] = ()  #: formulas of these rates, also where they vanish and are left in the formulas
    rows: list[list[Any]] = field(default_factory=list)  #: F, f_1 .. f_m without this friction

    @property
    def acts(self) -> bool:
        """Whether there are forces, or were."""
        return self.formulas is not None or bool(self.friction)

    def at(self, values: Mapping[str, float]) -> Found | None:
        """The same for other values of the parameters, of the same kind; None if it has to be derived again, as a force
        becomes friction, or friction becomes none.
        """
        friction = _rates_at(self.rates, values)
        return replace(self, friction=friction) if (friction is None) == (self.friction is None) else None


def derive(problem: Problem, prover: Prover, forces: list[list[Any]], *, rates: bool) -> Found:
    """Derive and prove what there is of F, f_1 .. f_m; rates: whether linear friction may become rates of damping."""
    formulas = friction(prover, forces[0]) if rates else ()
    found = _rates_at(formulas, problem.parameters)
    acting = [[0] * problem.ndof, *forces[1:]] if found else forces
    return Found(ForceFormulas(problem, acting), proofs(prover, acting), found, formulas, acting)


def in_python(found: Found, parameters: Mapping[str, float]) -> dict[str, Any]:
    """The functions without a compiler."""
    return {} if found.formulas is None else _InNumpy(found.formulas, parameters).functions()


class _InNumpy:
    """Functions of (q, p, t)."""

    def __init__(self, forces: ForceFormulas, parameters: Mapping[str, float]):
        """Formulas with values of their parameters."""
        self.forces = forces
        self.parameters = {f"c{k}": value for k, value in enumerate(parameters.values())}

    def functions(self) -> dict[str, Any]:
        """By the names of the arguments of `Model.forced`."""
        return {kind: getattr(self, kind) for kind in self.forces.kinds()}

    def force(self, q, p, t):
        """F."""
        return self._of("f", (0,), q, p, t)[0]

    def force_derivative(self, q, p, t):
        """F_q and F_p."""
        return tuple(self._of(x, (0,), q, p, t)[0].reshape(len(q), *q.shape) for x in ("fq", "fp"))

    def noise_force(self, q, p, t):
        """f_1 .. f_m."""
        return np.array(self._of("g", self._noises, q, p, t))

    def noise_force_derivative(self, q, p, t):
        """Derivatives of all f_k by q and p."""
        shape = (self.forces.problem.nnoise, len(q), *q.shape)
        return tuple(np.array(self._of(x, self._noises, q, p, t)).reshape(shape) for x in ("gq", "gp"))

    @property
    def _noises(self) -> range:
        return range(1, self.forces.problem.nnoise + 1)

    def _of(self, name: str, which, q, p, t) -> list[np.ndarray]:
        """An output for each Hamiltonian alone."""
        given = {"t": t, **self.parameters}
        given |= {f"{x}{i}": row for x, rows in (("q", q), ("p", p)) for i, row in enumerate(rows)}
        weights = dict.fromkeys((f"w{j}" for j in range(self.forces.problem.nnoise + 1)), 0.0)
        graph, roots = self.forces.graph, self.forces.outputs[name]
        return [in_numpy.values_of(graph, roots, given | weights | {f"w{j}": 1.0}, q.shape[-1]) for j in which]


def refuse_sites(force: Any, noise_force: Any) -> None:
    """Sums over sites know no forces."""
    if force is not None or noise_force is not None:
        told = checks.shown(force if force is not None else noise_force)
        raise InvalidArgumentError(
            f"force = {told}: models of n sites take no forces as formulas; leave out n and write the coordinates q1, "
            f"q2, .., or give functions to `model.forced` ({quoted('-gamma*p[i]')} is damping=gamma)"
        )
