# SPDX-License-Identifier: BSD-3-Clause
"""Models, schemes and certificates in notebooks: HTML without scripts."""

from __future__ import annotations

import html
import math
from collections.abc import Sequence
from fractions import Fraction
from typing import Any

import numpy as np

from ..native.checks import counted
from .tables import notebook as table

_ROOTS = (2, 3, 5, 6, 15, 30)
_WHOLES = sorted({Fraction(k, n) for n in (4, 9, 36) for k in range(-n, n + 1)}, key=lambda x: (x.denominator, abs(x)))
_ROUNDING = 4e-15
_MOST_STAGES = 6  #: most stages of a tableau that is shown with all coefficients


def number(x: float) -> str:
    """A coefficient as a person would write it, if it is exact to rounding: 1/2, -1/6, 5/36 + √15/24."""
    exact = _fraction(x, 360)
    if exact is not None:
        return str(exact)
    for root in _ROOTS:
        for whole in _WHOLES:
            part = _fraction((x - float(whole)) / math.sqrt(root), 60)
            if part is not None:
                return _sum(whole, part, root)
    return f"{x:.6g}"


def _fraction(x: float, largest: int) -> Fraction | None:
    """The fraction with a small denominator that equals a number to rounding; None if there is none."""
    found = Fraction(float(x)).limit_denominator(largest)
    return found if abs(float(found) - x) < _ROUNDING else None


def _sum(whole: Fraction, part: Fraction, root: int) -> str:
    over = f"/{part.denominator}" if part.denominator != 1 else ""
    times = "" if abs(part.numerator) == 1 else f"{abs(part.numerator)} "
    radical = f"{times}√{root}{over}"
    if whole == 0:
        return radical if part > 0 else f"-{radical}"
    return f"{whole} {'+' if part > 0 else '-'} {radical}"


def text(shown: str) -> str:
    """A text with its lines and spaces preserved."""
    return f"<pre>{html.escape(shown)}</pre>"


def told(value: Any) -> str:
    """The value of a parameter, shortened."""
    if np.ndim(value) == 0:
        return f"{value:g}"
    what = "sites" if isinstance(value, tuple) else "paths"
    return f"[{value[0]:g}]" if len(value) == 1 else f"[{value[0]:g}, .. {value[-1]:g}; {len(value)} {what}]"


def model(shown: Any, hamiltonians: Sequence[str], traits: Sequence[str]) -> str:
    """A model: its name, its Hamiltonians as texts, parameters with their values, names of its traits."""
    loss = " - Γ M⁻¹ p dt" if shown.has_friction else " - γ p dt" if shown.damping else ""
    lines = [f"<b>{html.escape(shown.name)}</b>: dp = -H_q dt{loss} - Σ H_k,q ∘ dW_k, dq = H_p dt + Σ H_k,p ∘ dW_k"]
    lines += [f"<code>{html.escape(line)}</code>" for line in hamiltonians]
    page = "<br>".join(lines)
    if shown.parameters:
        page += table(list(shown.parameters), [[told(value) for value in shown.parameters.values()]])
    if shown.has_friction:
        page += table(["friction Γ", *[""] * (shown.ndof - 1)], [[f"{x:g}" for x in row] for row in shown.damping])
    elif shown._varying:
        page += f"<br>damping γ = {html.escape(', '.join(shown._varying.told()))}"
    elif shown.damping:
        page += f"<br>damping γ = {', '.join(f'{rate:g}' for rate in dict.fromkeys(shown.damping))}"
    sizes = f"{counted(shown.ndof, 'degree of freedom')}, {counted(shown.nnoise, 'noise')}"
    return f"<div>{page}<br>{sizes}; {', '.join(traits).replace('_', ' ') or 'no traits'}</div>"


def scheme(shown: Any) -> str:
    """A scheme: its name, structure, tableau if it has one, orders."""
    info = shown.info
    kinds = [name for name in ("symplectic", "symmetric") if getattr(info, name)] or ["not symplectic"]
    head = f"<b>{html.escape(info.name)}</b>: {info.form}, {counted(info.nstage, 'stage')}, {', '.join(kinds)}"
    values = [f"{order.value:g}" if order.value else "-" for order in info.orders.values()]
    orders = table(["order, noise", *info.orders], [["", *values]])
    source = f"<br>{html.escape(info.reference)}" if info.reference else ""
    return f"<div>{head}{source}{_tableaux(shown)}{orders}</div>"


def _tableaux(shown: Any) -> str:
    """The coefficients of q and p side by side; also those of the noise if they differ."""
    found = shown.tableau()
    if found is None or shown.info.nstage > _MOST_STAGES:
        return ""
    parts = [("Q", found.a, found.alpha), ("P", found.abar, found.alpha)]
    if not (np.array_equal(found.a, found.b) and np.array_equal(found.abar, found.bbar)):
        parts += [("Q, noise", found.b, found.beta), ("P, noise", found.bbar, found.beta)]
    tables = "".join(_tableau(name, found.c, matrix, weights) for name, matrix, weights in parts)
    return tables + (f"not in the tableau: {html.escape(found.beside)}" if found.beside else "")


def _tableau(name: str, c: np.ndarray, matrix: np.ndarray, weights: np.ndarray) -> str:
    rows = [[number(node), *map(number, row)] for node, row in zip(c, matrix, strict=True)]
    return table([name, *[""] * len(weights)], [*rows, ["", *map(number, weights)]])
