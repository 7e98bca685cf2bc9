# SPDX-License-Identifier: BSD-3-Clause
"""Collective variables: functions of sums over sites, as (Sum(cos(q[i]), i)**2 + Sum(sin(q[i]), i)**2)/(2*N).

A Hamiltonian of a chain is a sum of terms number * Sum(.., i), and a function F(S_0, S_1, ..) of further sums. With
F_a = dF/dS_a and F_ab its second derivatives,

    gradient                    sum_a F_a grad S_a
    Hessian times a vector v    sum_a F_a Hess S_a v + sum_ab F_ab (grad S_b . v) grad S_a

so that the work is a few loops over the sites, whatever the number of coupled pairs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ...native.files import optional
from .derivatives import Derivatives
from .named_formulas import Problem
from .parse import FormulaTextError
from .structure import count_terms

MAX_SUMS = 16  #: most collective variables of a model: the number of their second derivatives is the square
MAX_TERMS = 2_000  #: most terms of a formula that is multiplied out to find out whether a sum is one of its terms


@dataclass(frozen=True)
class Outer:
    """Functions F_j of sums over sites, for the Hamiltonians that contain such a function."""

    numbers: tuple[Any, ...]  #: the Hamiltonians that contain F_j, as `site_reader.Number`
    derivatives: Derivatives  #: derivatives with respect to the sums: coordinate k is sum k

    @property
    def pairs(self) -> list[tuple[int, int]]:
        """Pairs of sums a <= b with a nonzero second derivative."""
        count, of = self.derivatives.problem.ndof, self.derivatives.of
        return [(a, b) for a in range(count) for b in range(a, count) if any(x != 0 for x in of(f"q{a}", f"q{b}"))]

    def used(self, drift: bool) -> set[int]:
        """The sums that occur in H, or in noises."""
        own = [k for k, number in enumerate(self.numbers) if number.is_drift == drift]
        return {a for a in range(self.derivatives.problem.ndof) for k in own if self.derivatives.of(f"q{a}")[k] != 0}

    def is_quadratic(self) -> bool:
        """Whether no second derivative depends on the sums."""
        lanes = self.derivatives.problem.lanes
        entries = [x for a, b in self.pairs for x in self.derivatives.of(f"q{a}", f"q{b}")]
        return not any(lanes[s.name] for x in entries for s in getattr(x, "free_symbols", ()))


def split(total: Any, sums: list[Any]) -> tuple[dict[Any, Any], Any]:
    """Split a formula into a sum of terms factor * Sum and the remaining formula; return the factors and the rest."""
    known, factors = set(sums), {}
    for x in sums:
        slope = total.diff(x)
        if slope.free_symbols & known and count_terms(slope) <= MAX_TERMS:
            slope = slope.expand()
        if not slope.free_symbols & known:
            factors[x] = slope
    return factors, total.xreplace(dict.fromkeys(factors, optional("sympy", "sympy").Integer(0)))


def make_outer(functions: list[tuple[Any, Any, str]], count: int, parameters: dict[str, float]) -> Outer:
    """Make the functions from (number of the Hamiltonian, function of q0, q1, .. for the sums, text) and the number of
    sums."""
    if count > MAX_SUMS:
        raise FormulaTextError(f"the formulas hold {count} different sums in products: allowed are {MAX_SUMS}")
    numbers, expressions, texts = zip(*functions, strict=True)
    return Outer(numbers, Derivatives(Problem(expressions, (), texts, count, parameters)))
