# SPDX-License-Identifier: BSD-3-Clause
"""Warnings about formulas that are taken: kinks, sites without momenta, and parameters that no formula holds."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ...errors import KinkWarning, StandingSiteWarning, UnusedParameterWarning
from ...native import checks
from .named_formulas import quoted, unused
from .parse import folded


def of_kinks(model: Any) -> None:
    """Say which orders hold where the formulas have kinks."""
    if not model.kinked:
        return
    texts = ", ".join(quoted(model.formula.hamiltonians[k]) for k in model.kinked)
    checks.warn(
        f"{texts} {'has' if len(model.kinked) == 1 else 'have'} a kink or jump: orders of schemes hold on each "
        "side. Steps in which the force jumps have errors of order h, and steps in which its slope jumps of order h^2: "
        "across these no scheme has a higher order, and implicit ones may not solve some. The impulse at a jump of H "
        "itself is not seen at all",
        KinkWarning,
    )


def of_standing_sites(model: Any) -> None:
    """Say which sites of a chain have no momentum in H, since free ends leave their kinetic energy out."""
    if names := model.standing:
        one = len(names) == 1
        checks.warn(
            f"H holds no {' and no '.join(names)}, so that {'this site does' if one else 'these sites do'} not move by "
            "H: free ends leave out all of a summand that reaches beyond an end. Write terms of one site in a sum of "
            'their own, as Sum(p[i]**2/2, i) + Sum((q[i+1] - q[i])**2/2, i), or say ends = "periodic" or "fixed"',
            StandingSiteWarning,
        )


def of_unused(params: Mapping[str, float] | None, formulas: list[Any]) -> None:
    """Warn of parameters that occur in no formula: a misspelt name, or a forgotten noise."""
    if names := unused(params, formulas):
        one = len(names) == 1
        told = (
            f"no formula holds the parameter{'' if one else 's'} {', '.join(names)}: {'its value' if one else 'they'} "
        )
        told += "changes nothing" if one else "change nothing"
        held = sorted(set(map(folded, params)) - set(names))
        told += f"; the formulas hold {', '.join(held)}" if held else ""
        told += "" if len(formulas) > 1 else "; no noise is given: noises stand in a list, as noise=['sigma*q']"
        checks.warn(told, UnusedParameterWarning)
