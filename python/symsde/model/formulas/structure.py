# SPDX-License-Identifier: BSD-3-Clause
"""Properties proved from formulas: traits, invariants, commuting flows.

A trait is declared if a derivative vanishes identically. A property that cannot be proved within bounds is not
declared, which may cost time in a run but never correctness. Parameters equal to 0, 1 or -1 are replaced by their
values, since a noise of strength zero is no noise; all others stay symbols.
"""

from __future__ import annotations

import cmath
import itertools
import math
import zlib
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from ...native.files import optional
from ..split import KICKS, Split
from ..traits import FLAGS
from . import actions, kinks, quadratic
from .graph import BESSEL, OF_ORDER, SCALAR
from .named_formulas import Problem

MAX_SIMPLIFY = 400  #: most operations of an expression that is simplified to test whether it vanishes
MAX_ORDER = 10  #: of Bessel functions that are written in those of lower orders, each in two
MAX_TERMS = 2_000  #: most terms of an expression that is multiplied out
_INVERSE = {"sech": "cosh", "csch": "sinh", "coth": "tanh"}
_SMALLEST_BANDED = 8  #: fewest degrees of freedom for which banded matrices pay


@dataclass(frozen=True)
class Structure:
    """Properties derived from formulas."""

    ndof: int  #: degrees of freedom
    separable: bool  #: every H_j = T_j(p) + U_j(q)
    additive: bool  #: every H_k, k >= 1, is linear in (q, p)
    position_noise: bool  #: every H_k, k >= 1, depends on q alone
    quadratic: bool  #: every H_j is a polynomial of degree two at most
    identity_mass: bool  #: H = p.p/2 + U(q)
    constant_mass: bool  #: H = p.M p/2 + U(q) with a matrix M of constants
    diagonal_mass: bool  #: the matrix of constant_mass is diagonal
    time_dependent: bool  #: some H_j depends on t
    bandwidth: int  #: bandwidth of every block of the Hessian: entries (i, j) with |i - j| above it vanish
    nonzero: dict[str, int]  #: number of entries that do not vanish in the blocks qq, qp, pp of the Hessian
    rotation: tuple[float, ...] | None  #: frequencies of the linear part of H around q = 0; None if H has no such part
    split: Split | None  #: second derivatives of a quadratic part of H whose flow is exact; None where none is used
    kicks: str  #: beside a split, what remains of H, and every H_k, depend on: one of KICKS
    unsplit: str  #: what keeps H from being split; empty if nothing does, or nothing could be
    silent: tuple[int, ...]  #: noises k whose H_k does not depend on the state: nothing is drawn for them
    touches: tuple[tuple[int, ...], ...]  #: degrees of freedom i of which q_i or p_i occur in H_k, for each noise k
    noises_commute: bool  #: every {H_k, H_l} is constant
    flows_commute: bool  #: every {H, H_k} is constant, too, and no noise changes in time
    invariants: dict[str, bool] = field(default_factory=dict)  #: candidate I -> whether dI = 0 on every path is proved
    kinked: tuple[int, ...] = ()  #: numbers j of H_j with kinks or jumps in the state

    def traits(self) -> dict[str, Any]:
        """The traits as arguments of `Model`."""
        banded = self.ndof >= _SMALLEST_BANDED and 4 * self.bandwidth <= self.ndof
        told = {key: asdict(self)[key] for key in (*FLAGS, "rotation", "split", "kicks", "silent", "touches")}
        for trait in ("constant_mass", "diagonal_mass"):  # identity_mass implies both
            told[trait] &= not self.identity_mass
        return told | {"bandwidth": self.bandwidth if banded else None}


def _point(symbol: Any, shift: int) -> float:
    """A value of a symbol at which expressions are evaluated, the same in every process. Symbols have values of their
    own: where two coordinates are equal, derivatives of functions of their distance may vanish by accident.
    """
    return 0.45 + 0.9 * zlib.crc32(symbol.name.encode(), shift) / 2**32


def count_terms(e: Any) -> float:
    """An upper bound of the number of terms of an expression when it is multiplied out."""
    if e.is_Add:
        return sum(count_terms(x) for x in e.args)
    if e.is_Mul:
        return math.prod(count_terms(x) for x in e.args)
    if e.is_Pow and e.exp.is_Integer:
        return min(count_terms(e.base), 1e6) ** min(abs(int(e.exp)), 40)
    return 1.0


def _value(e: Any, at: Mapping[Any, float]) -> complex:
    """The value of an expression of sympy in floating point; an error on overflow."""
    if e.is_Symbol:
        return complex(at[e])
    if e.is_Piecewise:
        numbers = {x: float(v) for x, v in at.items()}
        return next(_value(x, at) for x, condition in e.args if condition.subs(numbers) == True)  # noqa: E712
    return _applied(e, [_value(x, at) for x in e.args]) if e.args else complex(e)


def _applied(e: Any, parts: list[complex]) -> complex:
    """The operation of an expression on its arguments."""
    if e.is_Add or e.is_Mul:
        return sum(parts) if e.is_Add else math.prod(parts)
    return parts[0] ** parts[1] if e.is_Pow else _called(e, type(e).__name__, parts)


def _called(e: Any, name: str, parts: list[complex]) -> complex:
    """A function of its arguments."""
    if name == "atan2":
        return cmath.phase(complex(parts[1].real, parts[0].real))
    if name in _INVERSE:
        return 1 / getattr(cmath, _INVERSE[name])(*parts)
    if name == "Step":
        return complex(math.floor(parts[0].real))
    if name in (*SCALAR, *OF_ORDER):
        return complex(e.func(*(x if x.is_Integer else y.real for x, y in zip(e.args, parts, strict=True))).evalf())
    return getattr(cmath, name)(*parts)


def _function(e: Any, at: Mapping[Any, float], parameters: list) -> Callable[[list], complex]:
    """The value of an expression as a function of parameters; parts that do not depend on parameters are computed
    once.
    """
    if e in parameters:
        place = parameters.index(e)
        return lambda values: complex(values[place])
    if not e.free_symbols.intersection(parameters):
        value = _value(e, at)
        return lambda _: value
    parts = [_function(x, at, parameters) for x in e.args]
    return lambda values: _applied(e, [f(values) for f in parts])


class Prover:
    """Hamiltonians with their derivatives, in sympy."""

    def __init__(self, problem: Problem):
        """Start without derivatives."""
        self.sympy = optional("sympy", "sympy")
        self.problem = problem
        real = [self.sympy.Symbol(f"c{k}", real=True) for k in range(len(problem.parameters))]
        self._real = real
        self._squares: list[Callable[[list], complex]] | None = None
        self.values = dict(zip(real, problem.parameters.values(), strict=True))
        numbers = {x: v for x, v in self.values.items() if np.ndim(v) == 0}
        self.special = {x: self.sympy.Integer(int(v)) for x, v in numbers.items() if v in (0.0, 1.0, -1.0)}
        self.hams = [h.xreplace(self.special) for h in problem.hamiltonians]
        self.q, self.p = ([self.sympy.Symbol(x, real=True) for x in problem.coordinates(letter)] for letter in "qp")
        self.t = self.sympy.Symbol("t", real=True)
        self.symbols = [h.free_symbols for h in self.hams]
        self._derived: dict[tuple, Any] = {}
        self.part: actions.Part | None = None  #: the quadratic part of H between kicks, once the structure is known
        #: for each H_j names of the coordinates and momenta of each of its cases, which are never said to be apart
        self.kinked = [kinks.moving(h) for h in self.hams]

    def vanishes(self, e: Any) -> bool:
        """Whether an expression is shown to be zero."""
        if e == 0:
            return True
        if not e.free_symbols or e.count_ops() > MAX_SIMPLIFY or self._refuted(e):
            return False
        if count_terms(e) > MAX_TERMS:
            return False
        bessel = e.atoms(*(getattr(self.sympy, x) for x in BESSEL))
        high = [x for x in bessel if x.args[0].is_number and abs(x.args[0]) > MAX_ORDER]
        e = e.xreplace({x: self.sympy.Dummy(real=True) for x in high})
        return self.sympy.expand(e) == 0 or bool(self.sympy.simplify(e).is_zero)

    def _refuted(self, e: Any) -> bool:
        """Whether some point shows that an expression is not zero, which is much faster than simplifying. True also if
        the expression overflows there, as exp(exp(exp(exp(2)))), because it could not be shown to vanish."""
        overflows = False
        for shift in (0, 1):
            try:
                if abs(_value(e, {x: _point(x, shift) for x in e.free_symbols})) > 1e-6:
                    return True  # well above rounding errors of numbers near one
            except OverflowError:
                overflows = True
            except (AttributeError, KeyError, TypeError, ValueError, ZeroDivisionError, RecursionError):
                continue  # no floating-point value, or a variable bound inside: this point shows nothing
        return overflows

    def diff(self, j: int, *variables: Any) -> Any:
        """A derivative of H_j; zero where it is shown to vanish."""
        if not variables:
            return self.hams[j]
        if not self.symbols[j].issuperset(variables):  # true for most noises: usually one per degree of freedom
            return self.sympy.Integer(0)
        *others, last = sorted(variables, key=str)
        key = (j, *others, last)
        if key not in self._derived:
            before = self.diff(j, *others)
            result = before.diff(last) if last in before.free_symbols else self.sympy.Integer(0)
            self._derived[key] = self.sympy.Integer(0) if self.vanishes(result) else result
        return self._derived[key]

    def vanishing(self) -> set[tuple]:
        """(j, variables) of first and second derivatives that are known to vanish."""
        return {(j, *sorted(x.name for x in variables)) for (j, *variables), e in self._derived.items() if e == 0}

    def bracket(self, f: Any, g: Any) -> Any:
        """{F,G} = F_q.G_p - F_p.G_q."""
        return self._half_bracket(f, g) - self._half_bracket(g, f)

    def _half_bracket(self, f: Any, g: Any) -> Any:
        """F_q.G_p."""
        left, right = f.free_symbols, g.free_symbols
        pairs = ((q, p) for q, p in zip(self.q, self.p, strict=True) if q in left and p in right)
        return sum((f.diff(q) * g.diff(p) for q, p in pairs), self.sympy.Integer(0))

    def structure(self, given: tuple[Any, str] | None = None) -> Structure:
        """All properties of the formulas; given: a quadratic part of H by hand, and its text."""
        count, n = len(self.hams), self.problem.ndof
        every, noises = range(count), range(1, count)
        blocks = {"qq": (self.q, self.q), "qp": (self.q, self.p), "pp": (self.p, self.p)}
        entries = {
            block: [
                (i, j)
                for (i, x), (j, y) in itertools.product(enumerate(rows), enumerate(columns))
                if any(self._meet(k, x, y) for k in every)
            ]
            for block, (rows, columns) in blocks.items()
        }
        state = {*self.q, *self.p}
        both = [*self.q, *self.p]
        second = {k: [self.diff(k, x, y) for x, y in itertools.combinations_with_replacement(both, 2)] for k in every}
        mass = [self.diff(0, x, y) for x, y in itertools.product(self.p, self.p)]
        kinked = any(self.kinked)
        kinked_mass = any(x.name in names for names in self.kinked[0] for x in self.p)
        identity = [int(i == j) for i, j in itertools.product(range(n), range(n))]
        linear = all(self.diff(0, x).subs(dict.fromkeys(self.p, 0)) == 0 for x in self.p)
        separable = not entries["qp"]
        drift_separable = not any(self._meet(0, x, y) for x in self.q for y in self.p)
        constant_mass = (
            drift_separable and not kinked_mass and linear and all(not m.free_symbols & {*state, self.t} for m in mass)
        )
        unit = constant_mass and mass == identity
        position_noise = all(self.diff(k, x) == 0 for k in noises for x in self.p)
        values, unsplit = list(self.problem.parameters.values()), ""
        if given is not None:
            self.part = quadratic.given(self, *given, _function)
        elif not (constant_mass and position_noise) and not kinked:
            self.part, unsplit = quadratic.found(self, _function)
            if self.part is None:
                self.part, other = actions.found(self, _function)
                unsplit = "" if self.part else other or unsplit
        split = self.split(values)
        if self.part and split is None:
            unsplit = "parameters that differ by path, or are not finite, enter the quadratic part or decide on it"
        return Structure(
            ndof=n,
            separable=separable,
            additive=not any(self.kinked[1:]) and all(x == 0 for k in noises for x in second[k]),
            position_noise=position_noise,
            quadratic=not kinked and all(not x.free_symbols & state for k in every for x in second[k]),
            identity_mass=unit,
            constant_mass=constant_mass,
            diagonal_mass=constant_mass and all(m == 0 for m, one in zip(mass, identity, strict=True) if not one),
            time_dependent=any(self.t in h.free_symbols for h in self.hams),
            bandwidth=max((abs(i - j) for pairs in entries.values() for i, j in pairs), default=0),
            nonzero={block: len(pairs) for block, pairs in entries.items()},
            rotation=self.rotation(values) if unit else None,
            split=split,
            kicks=self.part.kicks if split else KICKS[0],
            unsplit=unsplit,
            silent=tuple(k for k in noises if all(self.diff(k, x) == 0 for x in both)),
            touches=tuple(
                tuple(
                    i + 1
                    for i, pair in enumerate(zip(self.q, self.p, strict=True))
                    if any(self.diff(k, x) != 0 for x in pair)
                )
                for k in noises
            ),
            noises_commute=not any(self.kinked[1:]) and self._constant(itertools.combinations(noises, 2)),
            flows_commute=not kinked
            and not any(self.t in self.diff(k, x).free_symbols for k in noises for x in both)
            and self._constant(itertools.combinations(every, 2)),
            invariants=self._invariants(),
            kinked=tuple(k for k in every if self.kinked[k]),
        )

    def _meet(self, k: int, x: Any, y: Any) -> bool:
        """Whether a second derivative of H_k does not vanish, or has an impulse where cases meet."""
        return self.diff(k, x, y) != 0 or any({x.name, y.name} <= names for names in self.kinked[k])

    def rotation(self, values: list) -> tuple[float, ...] | None:
        """Roots of the diagonal of the Hessian at q = 0, for these values of the parameters; None if these differ by
        path."""
        squares = []
        try:
            found = self.squares(values)
        except (ArithmeticError, AttributeError, KeyError, TypeError, ValueError):
            return None
        for square in found:
            if square.imag or not 0 <= square.real < math.inf:
                return None
            squares.append(math.sqrt(square.real))
        return tuple(squares) if any(squares) else None

    def squares(self, values: list) -> list[complex]:
        """The diagonal of the Hessian at q = 0 for values of the parameters, which may be complex."""
        if self._squares is None:
            rest = dict.fromkeys((*self.q, *self.p, self.t), 0.0)
            self._squares = [_function(self.diff(0, x, x), rest, self._real) for x in self.q]
        return [square(values) for square in self._squares]

    def split(self, values: list) -> Split | None:
        """Second derivatives of the quadratic part for these values of the parameters; None without one."""
        return self.part and self.part.at(values)

    def _constant(self, pairs) -> bool:
        """Whether the brackets of these pairs of Hamiltonians are proved not to depend on the state."""
        return all(
            self.vanishes(bracket.diff(x))
            for i, j in pairs
            if (bracket := self.bracket(self.hams[i], self.hams[j])) != 0
            for x in (*self.q, *self.p)
        )

    def _invariants(self) -> dict[str, bool]:
        """Which candidates are proved to be invariants: I_t + {I, H} = 0 and {I, H_k} = 0."""
        texts = self.problem.texts[len(self.hams) :]
        proved = {}
        for text, given in zip(texts, self.problem.invariants, strict=True):
            candidate = given.xreplace(self.special)
            drift = candidate.diff(self.t) + self.bracket(candidate, self.hams[0])
            noises = (self.bracket(candidate, h) for h in self.hams[1:])
            proved[text] = all(self.vanishes(x) for x in (drift, *noises))
        return proved
