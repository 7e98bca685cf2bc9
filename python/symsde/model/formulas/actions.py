# SPDX-License-Identifier: BSD-3-Clause
"""Formulas whose kicks turn every plane (q_k, p_k): functions of the actions beside a quadratic coupling.

With I_k = (q_k^2 + p_k^2)/2 a Hamiltonian K is a function of the actions alone where {I_k, K} = q_k K_p_k - p_k K_q_k
vanishes for all k. Two such functions commute, whatever they are. H is split into its quadratic part D = z.S z/2, with
the second derivatives S at z = 0, and K_0 = H - D.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from .named_formulas import quoted

if TYPE_CHECKING:
    from ..split import Split
    from .structure import Prover


@dataclass(frozen=True)
class Part:
    """How S follows from values of the parameters."""

    size: int  #: rows of S
    #: entry of S, and the places (i, j) to which it is added
    entries: tuple[tuple[Callable[[list], complex], tuple[tuple[int, int], ...]], ...]
    kicks: str  #: what H leaves beside D, and every noise, depend on: actions, or phases

    def at(self, values: list) -> Split | None:
        """S for these values of the parameters, as rows; None where it is not finite, or differs by path."""
        second = [[0.0] * self.size for _ in range(self.size)]
        try:
            for entry, places in self.entries:
                number = entry(values)
                if number.imag or not math.isfinite(number.real):
                    return None
                for i, j in places:
                    second[i][j] += number.real
        except (ArithmeticError, AttributeError, KeyError, RuntimeError, TypeError, ValueError):
            return None
        return tuple(map(tuple, second))


def found(prover: Prover, function: Callable) -> tuple[Part | None, str]:
    """The quadratic part beside functions of the actions; without one the noise that is none, where H has one.

    function: (expression, values of variables, parameters) -> its value as a function of the values of parameters.
    """
    second = second_derivatives(prover)
    if second is None:
        return None, ""
    texts, planes = prover.problem.texts, range(len(prover.q))
    for j in range(1, len(prover.hams)):
        if not all(prover.vanishes(_turns(prover, k, j)) for k in planes):
            return None, (
                f"{quoted(texts[0])} holds beside its quadratic part nothing but functions of the actions "
                f"(q_k^2 + p_k^2)/2, with which the noise {quoted(texts[j])} does not commute"
            )
    entries = [
        (function(e, {}, prover._real), ((i, j),)) for i, row in enumerate(second) for j, e in enumerate(row) if e != 0
    ]
    return Part(len(second), tuple(entries), kicks_of(prover)), ""


def kicks_of(prover: Prover) -> str:
    """What kicks depend on where H - D and every noise are functions of the actions: "phases" where noises are proved
    to be linear in these, as a constant second derivative by each q_k says.
    """
    state = {*prover.q, *prover.p}
    curved = (prover.diff(j, x, x).free_symbols & state for j in range(1, len(prover.hams)) for x in prover.q)
    return "actions" if any(prover.kinked[1:]) or any(curved) else "phases"


def beside(prover: Prover, second: list[list[Any]]) -> bool:
    """Whether H - z.S z/2 and every noise are proved to be functions of the actions."""
    planes, noises = range(len(prover.q)), range(1, len(prover.hams))
    return all(prover.vanishes(_turns(prover, k, 0, second)) for k in planes) and all(
        prover.vanishes(_turns(prover, k, j)) for j in noises for k in planes
    )


def second_derivatives(prover: Prover) -> list[list[Any]] | None:
    """S of the quadratic part D of H by q and then by p, expressions of the parameters, where H - D is proved to be a
    function of the actions; None where that is not proved.
    """
    try:
        second = _at_rest(prover)
    except (ArithmeticError, AttributeError, TypeError, ValueError):
        return None
    if second is None:
        return None
    return second if all(prover.vanishes(_turns(prover, k, 0, second)) for k in range(len(prover.q))) else None


def _turns(prover: Prover, k: int, j: int, second: list[list[Any]] | None = None) -> Any:
    """{I_k, H_j}, or {I_k, H_j - z.S z/2}, which vanish where each depends on q_k and p_k by I_k alone."""
    n, both = len(prover.q), [*prover.q, *prover.p]
    slope = [prover.diff(j, both[i]) for i in (k, n + k)]
    for place, i in enumerate((k, n + k)) if second else ():
        slope[place] -= prover.sympy.Add(*(s * x for s, x in zip(second[i], both, strict=True) if s != 0))
    return prover.q[k] * slope[1] - prover.p[k] * slope[0]


def _at_rest(prover: Prover) -> list[list[Any]] | None:
    """Second derivatives of H at the origin; None where some are not finite, or depend on time."""
    both = [*prover.q, *prover.p]
    origin = dict.fromkeys(both, 0)
    rows = [[prover.sympy.Integer(0)] * len(both) for _ in both]
    for (i, x), (j, y) in itertools.combinations_with_replacement(enumerate(both), 2):
        found = prover.diff(0, x, y)
        if found == 0:
            continue
        found = found.subs(origin)
        if found.is_finite is False or found.has(prover.sympy.nan) or prover.t in found.free_symbols:
            return None
        rows[i][j] = rows[j][i] = found
    return rows
