# SPDX-License-Identifier: BSD-3-Clause
"""Functions with kinks and jumps, written as cases: Piecewise of sympy, whose cases are chosen by comparisons, and
steps, the largest whole number below.

Derivatives are those of each case. At a kink they jump, and at a jump they lack an impulse that no step sees.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable
from typing import Any

from ...errors import InvalidArgumentError
from ...native.files import optional

#: functions that are quotients of others, or others of a reciprocal
REWRITTEN = ("sec", "csc", "cot", "asec", "acsc", "acot", "asech", "acsch", "acoth")
#: functions of one argument that become cases or steps
ONE = ("Abs", "sign", "Heaviside", "floor", "ceiling", "frac")
MANY = ("Min", "Max")  #: functions of two arguments and more
REFUSED = (  #: the error of noises that need a derivative at a kink
    "the noise {} has a kink or jump, and Stratonovich integrals of noises in both q and p need a derivative there: "
    "write it smoothly, as tanh(q/0.01) for sign(q), or let all noises depend on q alone"
)
COMPARISONS = ("StrictLessThan", "LessThan", "StrictGreaterThan", "GreaterThan")


@functools.cache
def step_function() -> Any:
    """floor(u) as a function of sympy whose derivative is zero: sympy leaves the derivative of its own one open."""
    sympy = optional("sympy", "sympy")

    class Step(sympy.Function):
        """The largest whole number that is not above u."""

        nargs = 1
        is_real = True

        @classmethod
        def eval(cls, u: Any) -> Any:
            """A number of a number."""
            return sympy.floor(u) if u.is_number else None

        def fdiff(self, _place: int = 1) -> Any:
            """Zero, beside the jumps."""
            return sympy.Integer(0)

    return Step


def in_cases(e: Any) -> Any:
    """The expression with its kinks written as cases, and without functions that others express."""
    sympy = optional("sympy", "sympy")
    if not e.has(*(getattr(sympy, x) for x in (*REWRITTEN, *ONE, *MANY, "Mod", "Piecewise"))):
        return e

    def cases(*given: tuple[Any, Any]) -> Any:
        return sympy.Piecewise(*given)

    def largest(args: Iterable[Any], sign: int) -> Any:
        left, pairs = list(args), []
        while len(left) > 1:
            x = left.pop(0)
            pairs.append((x, sympy.And(*(sign * x > sign * y for y in left))))
        return cases(*pairs, (left[0], True))

    half, step = sympy.Rational(1, 2), step_function()
    rules = {
        "Abs": lambda u: cases((u, u > 0), (-u, u < 0), (0, True)),
        "sign": lambda u: cases((1, u > 0), (-1, u < 0), (0, True)),
        "Mod": lambda u, v: u - v * step(u / v),
        "floor": step,
        "ceiling": lambda u: -step(-u),
        "frac": lambda u: u - step(u),
        "Heaviside": lambda u, middle=half: cases((1, u > 0), (0, u < 0), (middle, True)),
        "Max": lambda *u: largest(u, 1),
        "Min": lambda *u: largest(u, -1),
        "sec": lambda u: 1 / sympy.cos(u),
        "csc": lambda u: 1 / sympy.sin(u),
        "cot": lambda u: sympy.cos(u) / sympy.sin(u),
        "asec": lambda u: sympy.acos(1 / u),
        "acsc": lambda u: sympy.asin(1 / u),
        "acot": lambda u: sympy.atan(1 / u),
        "asech": lambda u: sympy.acosh(1 / u),
        "acsch": lambda u: sympy.asinh(1 / u),
        "acoth": lambda u: sympy.atanh(1 / u),
    }
    for name, rule in rules.items():
        e = e.replace(getattr(sympy, name), rule)
    return e.replace(sympy.ITE, lambda c, a, b: sympy.Or(sympy.And(c, a), sympy.And(sympy.Not(c), b)))  # as Abs(q) < 1


def require_cases(e: Any, text: str) -> None:
    """Refuse cases that have no last one, or are chosen by other than comparisons."""
    sympy = optional("sympy", "sympy")
    for x in e.atoms(sympy.Piecewise):
        if x.args[-1][1] != True:  # noqa: E712 - sympy's own truth value
            raise InvalidArgumentError(
                f"the formula {text} has cases without a last one for all others: end Piecewise by (.., True)"
            )
        for _, condition in x.args:
            for part in condition.atoms(sympy.core.relational.Relational):
                if type(part).__name__ not in COMPARISONS:
                    raise InvalidArgumentError(
                        f"the formula {text} chooses a case by {part}, which holds nowhere else: compare by < and >"
                    )


def kinds() -> tuple[Any, ...]:
    """The classes of what has kinks, once it is written in cases."""
    return optional("sympy", "sympy").Piecewise, step_function()


def moving(e: Any) -> list[set[str]]:
    """Names of the coordinates and momenta that meet at each kink of the state: those in the cases or the step, and
    those in its factors."""
    sympy = optional("sympy", "sympy")
    found = []
    for x in e.atoms(*kinds()) if hasattr(e, "atoms") else ():
        conditions = [condition for _, condition in x.args] if x.is_Piecewise else [x]
        if any(s.name[0] in "qp" for condition in conditions for s in condition.free_symbols):
            whole = sympy.Dummy(real=True)
            beside = e.xreplace({x: whole}).diff(whole)
            found.append({s.name for s in x.free_symbols | beside.free_symbols if s.name[0] in "qp"})
    return found
