# SPDX-License-Identifier: BSD-3-Clause
"""The quadratic part D of H, whose exact flow stands between kicks: H = D(q,p) + V(q), D = z.S z/2 with z = (q, p).

It is looked for where H couples q and p. D holds all of the momenta: H_pp and H_qp are constants and H_p vanishes at
zero. S_qq is a choice, since V takes the rest. Two are compared: the square that the momenta complete, S_qp S_pp^-1
S_pq, as of (p - A).(p - A)/2, and all of the linear motion at q = 0. The second is taken if its V moves less at states
of size one: {D, V} = -(velocity).V_q. The split belongs to the model, not to the state of a path, since paths must not
depend on each other.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ...errors import InvalidArgumentError
from . import actions
from .named_formulas import quoted

if TYPE_CHECKING:
    from ..split import Split
    from .structure import Prover

#: positions of size one at which what is left for kicks is compared
_PLACES = (0.61, -0.83, 1.17, 0.47, -1.31, 0.73, -0.94, 1.09, -0.55)
_COUNT = 3  #: how many of these places
_Number = Callable[[list], complex]


@dataclass(frozen=True)
class Part:
    """How S follows from values of the parameters."""

    momenta: list[list[_Number]]  #: S_pp
    mixed: list[list[_Number]]  #: S_qp, [i][j] by q_i and p_j
    stiffness: list[list[_Number]]  #: S_qq as given, or that of H at q = 0
    slopes: list[list[_Number]]  #: H_q at places, p = 0; empty where S_qq is given
    kicks: str = "positions"  #: what H leaves beside D, and every noise, depend on

    def at(self, values: list) -> Split | None:
        """S for these values of the parameters, as rows; None where it is not finite, or differs by path."""
        try:
            pp, qp, qq = (_numbers(x, values) for x in (self.momenta, self.mixed, self.stiffness))
            if self.slopes:
                qq = stiffness(pp, qp, qq, _numbers(self.slopes, values))
        except (ArithmeticError, AttributeError, KeyError, TypeError, ValueError):
            return None
        second = np.block([[qq, qp], [qp.T, pp]])
        return tuple(map(tuple, second.tolist())) if np.isfinite(second).all() else None

    def of_complex(self, values: list) -> np.ndarray:
        """S for complex values of the parameters; S_qq as their real parts choose it."""
        pp, qp, qq = (np.array([[x(values) for x in row] for row in rows]) for rows in
                      (self.momenta, self.mixed, self.stiffness))  # fmt: skip
        if self.slopes:
            qq = chosen(pp, qp, qq, np.array([[x(values).real for x in row] for row in self.slopes]))
        return np.block([[qq, qp], [qp.T, pp]])


def chosen(pp: np.ndarray, qp: np.ndarray, linear: np.ndarray, slopes: np.ndarray) -> np.ndarray:
    """S_qq of complex numbers as `stiffness` chooses it of their real parts."""
    real = linear.real
    if stiffness(pp.real, qp.real, real, slopes) is real:
        return linear
    square = qp @ np.linalg.solve(pp, qp.T) if np.linalg.matrix_rank(pp.real) == len(pp) else np.zeros_like(pp)
    return (square + square.T) / 2


def stiffness(pp: np.ndarray, qp: np.ndarray, linear: np.ndarray, slopes: np.ndarray) -> np.ndarray:
    """S_qq of the two splits that leaves less for kicks; slopes: H_q at p = 0 and the positions of `places`."""
    square = np.zeros_like(pp)
    if np.linalg.matrix_rank(pp) == len(pp):
        square = qp @ np.linalg.solve(pp, qp.T)
        square = (square + square.T) / 2
    left = [np.abs(slopes - places(len(pp)) @ qq).sum() for qq in (square, linear)]
    return linear if left[1] < left[0] else square


def places(n: int) -> np.ndarray:
    """Positions of size one at which the two are compared, (place, n)."""
    return np.array([_place(n, k) for k in range(_COUNT)])


def _told(prover: Prover, name: str) -> str:
    """The user's name of a coordinate or momentum, or t."""
    n = prover.problem.ndof
    if name == "t":
        return name
    i = int(name[1:]) + n * (name[0] == "p")
    return (prover.problem.columns or [f"{x}_{k + 1}" for x in "qp" for k in range(n)])[i]


def _place(n: int, k: int) -> list[float]:
    """The k-th position of size one."""
    return [_PLACES[(3 * k + i) % len(_PLACES)] * (-1) ** (k * i) for i in range(n)]


def _numbers(rows: list[list[_Number]], values: list) -> np.ndarray:
    """Numbers of a matrix; an error where one is not real."""
    found = [[x(values) for x in row] for row in rows]
    if any(x.imag or not math.isfinite(x.real) for row in found for x in row):
        raise ValueError
    return np.array([[x.real for x in row] for row in found])


def found(prover: Prover, function: Callable) -> tuple[Part | None, str]:
    """The quadratic part of H where H couples q and p; without one the terms that are in its way."""
    q, p, count = prover.q, prover.p, len(prover.hams)
    if all(prover.diff(0, x, y) == 0 for x in q for y in p):
        return None, ""
    moving = {*q, *p, prover.t}
    texts = prover.problem.texts
    for x, y in itertools.product((*q, *p), p):
        if held := prover.diff(0, x, y).free_symbols & moving:
            names = ", ".join(_told(prover, s.name) for s in sorted(held, key=str))
            return (
                None,
                f"{quoted(texts[0])} is not quadratic in what holds momenta: a second derivative by p has {names}",
            )
    rest = dict.fromkeys((*q, *p), 0)
    if any(prover.diff(0, x).subs(rest) != 0 for x in p):
        return None, f"{quoted(texts[0])} has a term that is linear in p alone"
    for k in range(1, count):
        if any(prover.diff(k, x) != 0 for x in p):
            return None, f"the noise {quoted(texts[k])} holds momenta and does not commute with what H leaves for kicks"
    real, zero = prover._real, dict.fromkeys((*q, *p, prover.t), 0.0)

    def matrix(one: list, other: list) -> list[list[_Number]]:
        return [[function(prover.diff(0, x, y), zero, real) for y in other] for x in one]

    try:
        slopes = [
            [function(prover.diff(0, x), {**zero, **dict(zip(q, _place(len(q), k), strict=True))}, real) for x in q]
            for k in range(_COUNT)
        ]
        return Part(matrix(p, p), matrix(q, p), matrix(q, q), slopes), ""
    except (ArithmeticError, AttributeError, KeyError, TypeError, ValueError):
        return None, f"{quoted(texts[0])} has no finite derivative at q = 0"


def given(prover: Prover, part: Any, text: str, function: Callable) -> Part:
    """The quadratic part that a user gives as a formula D; H - D must be a function of q alone, or of the actions."""
    part = prover.sympy.sympify(part).xreplace(prover.special)
    q, p, real = prover.q, prover.p, prover._real
    zero = dict.fromkeys((*q, *p, prover.t), 0.0)
    entries = {(x, y): part.diff(x).diff(y) for x, y in itertools.product((*q, *p), repeat=2)}
    moved = any(e.free_symbols & set(zero) and not prover.vanishes(e.diff(z)) for e in entries.values() for z in zero)
    if moved or prover.t in part.free_symbols or any(part.diff(x).subs(dict.fromkeys(zero, 0)) != 0 for x in (*q, *p)):
        raise InvalidArgumentError(
            f"split = {quoted(text)} is no quadratic form with constant coefficients: give the terms of H of degree "
            "two in q and p whose flow shall be exact"
        )
    moving = next((x for x in p if not prover.vanishes(prover.diff(0, x) - part.diff(x))), None)
    noisy = any(prover.diff(k, x) != 0 for k in range(1, len(prover.hams)) for x in p)
    both = (*q, *p)
    second = [[entries[x, y].subs(dict.fromkeys(zero, 0)) for y in both] for x in both]
    turned = (moving is not None or noisy) and actions.beside(prover, second)
    kicks = actions.kicks_of(prover) if turned else "positions"
    if kicks == "positions" and moving is not None:
        raise InvalidArgumentError(
            f"H = {quoted(prover.problem.texts[0])} without split = {quoted(text)} depends on a momentum: kicks do "
            "not commute with it, so give all terms that hold momenta"
        )

    def matrix(one: list, other: list) -> list[list[_Number]]:
        return [[function(second[both.index(x)][both.index(y)], zero, real) for y in other] for x in one]

    return Part(matrix(p, p), matrix(q, p), matrix(q, q), [], kicks)
