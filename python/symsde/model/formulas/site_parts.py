# SPDX-License-Identifier: BSD-3-Clause
"""The quadratic part D of sums over sites, whose exact flow stands between kicks, found or given by hand (split=).

Second derivatives S of D are those of its summands, each at the places of its sites. What H leaves beside D, and every
noise, are functions of q alone, or functions of the actions I_k = (q_k^2 + p_k^2)/2 (actions.py). That is proved of all
summands beside their own quadratic forms, which are added up before they are compared with D.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ...errors import InvalidArgumentError
from ...native.files import optional
from . import in_numpy, quadratic
from .chain import Density
from .named_formulas import quoted

if TYPE_CHECKING:
    from ..split import Split

MOST = 512  #: degrees of freedom, all of which one matrix may couple; its exponential takes the cube of their number

_Place = tuple[int, int]
_Values = list  #: of parameters, of which those with a number for each site are tuples


@dataclass(frozen=True)
class Sites:
    """How the sums count sites."""

    count: int
    size: int  #: coordinates of a site
    arrays: tuple[int, ...]  #: places of the parameters with a number for each site among all parameters

    @property
    def ndof(self) -> int:
        """Number of degrees of freedom."""
        return self.count * self.size

    def of(self, d: Density) -> Iterator[tuple[list[int], list[int]]]:
        """Degrees of freedom of the coordinates of a summand, and sites of its parameters, for each of its terms."""
        whole = range(d.first.of(self.count), d.last.of(self.count) + 1)
        for both in ((i, j) for i in whole for j in (range(i + 1, self.count) if d.is_pair else [i])):
            at = [[(both[row.second] + row.offset) % self.count for row in rows] for rows in (d.rows, d.given)]
            yield [x * self.size + row.component for x, row in zip(at[0], d.rows, strict=True)], at[1]


@dataclass(frozen=True)
class Part:
    """How S follows from values of the parameters."""

    ndof: int
    entries: tuple[tuple[Any, tuple[_Place, ...]], ...]  #: entry of S, an expression, and the places where it stands
    kicks: str  #: what H leaves beside D, and every noise, depend on
    slopes: Callable[[_Values, np.ndarray], np.ndarray] | None = None  #: H_q at p = 0 where S_qq is a choice

    def at(self, values: _Values) -> Split | None:
        """S for these values of the parameters, as rows; None where it is not finite."""
        n = self.ndof
        second = np.zeros((2 * n, 2 * n))
        try:
            for entry, places in self.entries:
                number = complex(entry.xreplace({x: _value(x, values) for x in entry.free_symbols}))
                if number.imag or not math.isfinite(number.real):
                    return None
                for place in places:
                    second[place] += number.real
            if self.slopes is not None:
                places = quadratic.places(n)
                slopes = np.array([self.slopes(values, x) for x in places])
                second[:n, :n] = quadratic.stiffness(second[n:, n:], second[:n, n:], second[:n, :n], slopes)
        except (ArithmeticError, AttributeError, KeyError, RuntimeError, TypeError, ValueError):
            return None
        return tuple(map(tuple, second.tolist())) if np.isfinite(second).all() else None

    def of_complex(self, values: _Values) -> np.ndarray:
        """S for complex values of the parameters; S_qq as their real parts choose it."""
        n = self.ndof
        second = np.zeros((2 * n, 2 * n), complex)
        for entry, places in self.entries:
            number = complex(entry.xreplace({x: _value(x, values) for x in entry.free_symbols}))
            for place in places:
                second[place] += number
        if self.slopes is not None:
            real = [tuple(np.real(x)) if isinstance(x, tuple) else np.real(x) for x in values]
            slopes = np.array([self.slopes(real, x) for x in quadratic.places(n)])
            second[:n, :n] = quadratic.chosen(second[n:, n:], second[:n, n:], second[:n, :n].copy(), slopes)
        return second


def _value(symbol: Any, values: _Values) -> Any:
    """The value of c3, or of c3_7, the number of site 7."""
    sympy = optional("sympy", "sympy")
    number, _, site = symbol.name[1:].partition("_")
    value = complex(values[int(number)][int(site)] if site else values[int(number)])
    return sympy.Float(value.real) + (sympy.I * sympy.Float(value.imag) if value.imag else 0)


class _Summand:
    """A density beside its quadratic form at the origin."""

    def __init__(self, d: Density):
        self.d = d
        self.text = d.derivatives.problem.texts[0]
        self.k = len(d.rows)
        self.names = [*d.derivatives.problem.coordinates("q"), *d.derivatives.problem.coordinates("p")]
        self.symbols = [d.derivatives.symbol[x] for x in self.names]
        self._origin = dict.fromkeys(self.symbols, 0)
        self._second: dict[_Place, Any] = {}

    @property
    def holds_momenta(self) -> bool:
        """Whether any of its Hamiltonians depends on p."""
        made = self.d.derivatives
        return any(e != 0 for x in self.names[self.k :] for e in made.of(x))

    def form(self, rows: Sequence[int]) -> dict[_Place, Any]:
        """Second derivatives at the origin by these coordinates and any other one, those that do not vanish."""
        made, sympy = self.d.derivatives, optional("sympy", "sympy")
        for i, j in itertools.product(rows, range(2 * self.k)):
            if (i, j) not in self._second:
                e = made._engine.sympify(made.of(self.names[i], self.names[j])[0]).subs(self._origin)
                self._second[i, j] = sympy.sympify(e)
        return {(i, j): e for (i, j), e in self._second.items() if i in rows and e != 0}

    def has_form(self, rows: Sequence[int]) -> bool:
        """Whether these second derivatives are finite and do not depend on time."""
        sympy = optional("sympy", "sympy")
        try:
            found = self.form(rows).values()
        except (ArithmeticError, AttributeError, RuntimeError, TypeError, ValueError):
            return False
        strange = (sympy.nan, sympy.zoo, sympy.oo, -sympy.oo)
        return not any(e.has(*strange) or any(x.name == "t" for x in e.free_symbols) for e in found)

    def beside(self, i: int) -> Any:
        """The first derivative by coordinate i, less that of the quadratic form."""
        made = self.d.derivatives
        own = (made._engine.sympify(e) * self.symbols[j] for (_, j), e in self.form([i]).items())
        return made.of(self.names[i])[0] - sum(own, 0 * self.symbols[0])

    def is_form(self, rows: Sequence[int]) -> bool:
        """Whether derivatives by these coordinates are those of a quadratic form."""
        return self.has_form(rows) and all(self.beside(i).expand() == 0 for i in rows)

    def turns(self, *, bare: bool) -> bool:
        """Whether it is a function of the actions, by itself or beside its quadratic form."""
        k, z, made = self.k, self.symbols, self.d.derivatives
        if bare and not self.has_form(range(2 * k)):
            return False
        for i, j in itertools.product(range(k), range(len(made.problem.hamiltonians))):
            hq, hp = (self.beside(x) if bare else made.of(self.names[x])[j] for x in (i, k + i))
            if (z[i] * hp - z[k + i] * hq).expand() != 0:
                return False
        return True

    def is_linear_in_actions(self) -> bool:
        """Whether a function of the actions is linear in them: its second derivative by each q_k is constant."""
        made, state = self.d.derivatives, set(self.symbols)
        curves = (e for x in self.names[: self.k] for e in made.of(x, x))
        return not any(made._engine.sympify(e).expand().free_symbols & state for e in curves)


class _Forms:
    """Entries of a sum of quadratic forms."""

    def __init__(self, sites: Sites):
        self.sites = sites
        self.places: dict[_Place, Any] = {}

    def add(self, part: _Summand, rows: Sequence[int], sign: int = 1) -> None:
        """Add a summand's second derivatives by these of its coordinates, and any other one."""
        sympy = optional("sympy", "sympy")
        d, n = part.d, self.sites.ndof
        first = len(d.derivatives.problem.parameters) - len(d.given)
        local = {f"c{first + k}": self.sites.arrays[row.component] for k, row in enumerate(d.given)}
        here = {at: sign * e for at, e in part.form(rows).items()}
        for dof, given in self.sites.of(d):
            numbers = dict(zip(local, given, strict=True))
            for (i, j), e in here.items():
                own = {
                    x: sympy.Symbol(f"c{local[x.name]}_{numbers[x.name]}") for x in e.free_symbols if x.name in local
                }
                own |= {x: sympy.Symbol(x.name) for x in e.free_symbols if x.name not in local}
                at = tuple(dof[x % part.k] + n * (x >= part.k) for x in (i, j))
                self.places[at] = self.places.get(at, 0) + e.xreplace(own)

    def remainder(self) -> dict[_Place, Any]:
        """The entries that are not proved to vanish."""
        known: dict[Any, bool] = {0: True}
        for e in self.places.values():
            if e not in known:
                known[e] = e.expand() == 0 or bool(e.simplify().is_zero)
        return {at: e for at, e in self.places.items() if not known[e]}

    def entries(self) -> tuple[tuple[Any, tuple[_Place, ...]], ...]:
        """Places by entry."""
        by_entry: dict[Any, list[_Place]] = {}
        for at, e in self.places.items():
            if e != 0:
                by_entry.setdefault(e, []).append(at)
        return tuple((e, tuple(where)) for e, where in by_entry.items())


def found(densities: Sequence[Density], sites: Sites) -> tuple[Part | None, str]:
    """The quadratic part between kicks by functions of q, or of the actions; without one what is in the way."""
    drift, noises = _sorted(densities)
    if sites.ndof > MOST:
        return None, f"quadratic parts are found for {MOST} degrees of freedom at most, here are {sites.ndof}"
    moving = [x for x in drift if x.holds_momenta]
    if not any(x.d.inner for x in moving) and all(x.is_form(range(x.k, 2 * x.k)) for x in moving):
        if told := next((x.text for x in noises if x.holds_momenta), ""):
            part, why = _of_actions(drift, noises, sites)
            return (
                part,
                why or f"the noise {quoted(told)} holds momenta and does not commute with what H leaves for kicks",
            )
        own = [x for x in drift if not x.d.inner]
        if not all(x.has_form(range(2 * x.k)) for x in own):
            return None, f"{quoted(drift[0].text)} has no finite derivative at q = 0"
        forms = _Forms(sites)
        for x in own:
            forms.add(x, range(2 * x.k))
        return Part(sites.ndof, forms.entries(), "positions", _Slopes(own, sites)), ""
    return _of_actions(drift, noises, sites)


def _of_actions(drift: list[_Summand], noises: list[_Summand], sites: Sites) -> tuple[Part | None, str]:
    """The same between kicks by functions of the actions."""
    if any(x.d.inner for x in (*drift, *noises)) or not all(x.turns(bare=True) for x in drift):
        return None, ""
    for x in noises:
        if not x.turns(bare=False):
            return None, (
                f"{quoted(drift[0].text)} holds beside its quadratic part nothing but functions of the actions "
                f"(q_k^2 + p_k^2)/2, with which the noise {quoted(x.text)} does not commute"
            )
    forms = _Forms(sites)
    for x in drift:
        forms.add(x, range(2 * x.k))
    return Part(sites.ndof, forms.entries(), _kicks_of(noises)), ""


def _kicks_of(noises: list[_Summand]) -> str:
    """What kicks depend on where all are functions of the actions."""
    return "phases" if all(x.is_linear_in_actions() for x in noises) else "actions"


def given(split: Sequence[Density], densities: Sequence[Density], sites: Sites) -> Part:
    """The quadratic part that a user gives as sums over sites; H - D must be a function of q, or of the actions."""
    parts = [_Summand(d) for d in split]
    drift, noises = _sorted(densities)
    told, hamiltonian = f"split = {quoted(parts[0].text)}", f"H = {quoted(drift[0].text)}"
    if sites.ndof > MOST:
        raise InvalidArgumentError(
            f"{told} for {sites.ndof} degrees of freedom: {MOST} are the most that one matrix may couple; leave it out"
        )
    if not all(x.is_form(range(2 * x.k)) for x in parts):
        raise InvalidArgumentError(
            f"{told} is no quadratic form with constant coefficients: give the terms of H of degree two in q and p "
            "whose flow shall be exact"
        )
    forms = _Forms(sites)
    for x in parts:
        forms.add(x, range(2 * x.k))
    kicks = "positions"
    if not _leaves_positions(parts, drift, noises, sites):
        kicks = _kicks_of(noises)
        if any(x.d.inner for x in (*drift, *noises)) or not _leaves_actions(parts, drift, sites):
            raise InvalidArgumentError(
                f"{hamiltonian} without {told} is no function of q alone, and none of the actions (q_k^2 + p_k^2)/2, "
                "so that kicks by it are not known: give all terms that hold momenta"
            )
        for x in noises:
            if not x.turns(bare=False):
                raise InvalidArgumentError(
                    f"{hamiltonian} without {told} leaves functions of the actions (q_k^2 + p_k^2)/2, with which the "
                    f"noise {quoted(x.text)} does not commute: give all terms of H that hold momenta"
                )
    return Part(sites.ndof, forms.entries(), kicks)


def _sorted(densities: Sequence[Density]) -> tuple[list[_Summand], list[_Summand]]:
    """Summands of H, and of noises; a sum inside of a function counts as both."""
    every = [_Summand(d) for d in densities]
    return [x for x in every if x.d.weight.is_drift], [x for x in every if x.d.inner or not x.d.weight.is_drift]


def _leaves_positions(parts: list[_Summand], drift: list[_Summand], noises: list[_Summand], sites: Sites) -> bool:
    """Whether H - D and all noises are proved to be functions of q."""
    moving = [x for x in drift if x.holds_momenta]
    if any(x.holds_momenta for x in noises) or not all(x.is_form(range(x.k, 2 * x.k)) for x in moving):
        return False
    left = _Forms(sites)
    for x, sign in (*((x, 1) for x in moving), *((x, -1) for x in parts)):
        left.add(x, range(x.k, 2 * x.k), sign)
    return not left.remainder()


def _leaves_actions(parts: list[_Summand], drift: list[_Summand], sites: Sites) -> bool:
    """Whether H - D is proved to be a function of the actions."""
    if not all(x.turns(bare=True) for x in drift):
        return False
    left, n = _Forms(sites), sites.ndof
    for x, sign in (*((x, 1) for x in drift), *((x, -1) for x in parts)):
        left.add(x, range(2 * x.k), sign)
    for k in range(n):  # what turns a plane is no coupling
        left.places[n + k, n + k] = left.places.get((n + k, n + k), 0) - left.places.pop((k, k), 0)
    return not left.remainder()


class _Slopes:
    """H_q of all sites at p = 0, of the sums that stand in no function."""

    def __init__(self, parts: list[_Summand], sites: Sites):
        self.parts, self.sites = parts, sites

    def __call__(self, values: _Values, q: np.ndarray) -> np.ndarray:
        """(ndof,) at the positions q (ndof,), at the time 0."""
        total = np.zeros(self.sites.ndof)
        for x in self.parts:
            terms = list(self.sites.of(x.d))
            if not terms:
                continue
            dof, where = (np.array(rows, dtype=int).reshape(len(terms), -1).T for rows in zip(*terms, strict=True))
            made, count = x.d.derivatives, len(values)
            held = {"t": 0.0, "w0": 1.0} | {f"p{i}": np.zeros(len(terms)) for i in range(x.k)}
            held |= {f"q{i}": q[rows] for i, rows in enumerate(dof)}
            held |= {f"c{i}": value for i, value in enumerate(values) if not isinstance(value, tuple)}
            for i, (row, rows) in enumerate(zip(x.d.given, where, strict=True)):
                held[f"c{count + i}"] = np.array(values[self.sites.arrays[row.component]])[rows]
            found = in_numpy.values_of(made.graph, made.outputs["hq"], held, len(terms))
            np.add.at(total, dof, found)
        return total
