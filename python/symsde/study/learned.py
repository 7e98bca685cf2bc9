# SPDX-License-Identifier: BSD-3-Clause
"""Lessons of several studies together; a lesson is printed only where the numbers show it."""

from __future__ import annotations

import numpy as np

from .. import schemes
from .plan import uses_integrals
from .words import cheapest, listed, symplectic

SAME = 1.15  #: errors within this factor count as the same
EXPLICIT = "stormer_verlet"


def learned(studies: list) -> list[str]:
    """One line for each lesson."""
    lines = [_same_errors(studies), _integrals(studies), *_against(studies), _correction(studies)]
    lines += [_contrast(studies), _invariants(studies), _long_steps(studies)]
    return [line for line in lines if line]


def point(study, scheme: str, status: str = "ok") -> dict | None:
    """The point of smallest step that a scheme has with this status."""
    rows = [row for row in study.rows if row["scheme"] == scheme and row["status"] == status]
    return min(rows, key=lambda row: row["h"]) if rows else None


def _increments_only(study) -> list[dict]:
    """Finest points, at one step, of the symplectic schemes that need dW alone and no correction."""
    found = []
    for name in study.schemes:
        info = schemes.get(name).info
        row = point(study, name)
        plain = info.symplectic and info.correction_coefficient == 0 and not uses_integrals(schemes.get(name))
        if row is not None and plain:
            found.append(row)
    return [row for row in found if row["h"] == min(r["h"] for r in found)]


def _same_errors(studies) -> str:
    same = []
    for study in studies:
        rows = _increments_only(study)
        errors = [row["err_strong"] for row in rows]
        if len(rows) > 1 and max(errors) <= SAME * min(errors):
            seconds = [row["seconds"] for row in rows]
            cheap = min(rows, key=lambda row: row["seconds"])["scheme"]
            same.append(f"{study.name} ({cheap} costs {max(seconds) / min(seconds):.2g} times less than the dearest)")
    if not same:
        return ""
    return (
        "**Stages alone buy no accuracy.** Symplectic schemes that are driven by increments alone end with the same "
        f"error at the finest step, within 15 %, on {listed(same)}: there the cheapest step wins."
    )


def _integrals(studies) -> str:
    parts = []
    for study in studies:
        for name in study.schemes:
            if not uses_integrals(schemes.get(name)) or point(study, name) is None:
                continue
            others = [row for row in study.rows if row["status"] == "ok" and not _beyond(row["scheme"])]
            if not others:
                continue
            least = min(row["err_strong"] for row in others)
            best = min((row for row in others if row["err_strong"] <= SAME * least), key=lambda row: row["seconds"])
            mine = cheapest([r for r in study.rows if r["status"] == "ok" and r["scheme"] == name], best["err_strong"])
            if mine:
                gain = best["seconds"] / mine[0]["seconds"]
                word = f"{gain:.2g} times cheaper than" if gain >= 1 else f"{1 / gain:.2g} times dearer than"
                word = "costs the same as" if 1 / SAME <= gain <= SAME else word
                parts.append(f"{study.name}, {name}: {word} {best['scheme']} at {best['err_strong']:.0e}")
    if not parts:
        return ""
    return (
        "**Integrals beyond increments.** Schemes that also draw dZ or areas, at the smallest error that any scheme "
        f"reaches without them: {'; '.join(parts)}. Below that error their order gains more and "
        "more, far above it what they compute on top is lost."
    )


def _beyond(name: str) -> bool:
    return uses_integrals(schemes.get(name))


def _against(studies) -> list[str]:
    """Where the library's first scheme, midpoint, loses and where it wins."""
    wins, losses = [], []
    for study in studies:
        mine = [row for row in study.rows if row["status"] == "ok" and row["scheme"] == "midpoint"]
        rest = [row for row in study.rows if row["status"] == "ok" and row["scheme"] == EXPLICIT]
        if not mine or not rest:
            continue
        target = 1.02 * max(min(r["err_strong_high"] for r in mine), min(r["err_strong_high"] for r in rest))
        here, there = cheapest(mine, target), cheapest(rest, target)
        factor = here[0]["seconds"] / there[0]["seconds"]
        text = f"{study.name} ({max(factor, 1 / factor):.1f} times, error {target:.0e})"
        if max(factor, 1 / factor) > SAME:
            (losses if factor > 1 else wins).append(text)
    lines = []
    if losses:
        lines.append(
            "**Where midpoint loses.** On separable Hamiltonians the explicit stormer_verlet reaches the same error in "
            f"less time on {listed(losses)}: midpoint pays for its Newton iterations."
        )
    if wins:
        lines.append(f"**Where midpoint wins** against stormer_verlet: {listed(wins)}.")
    return lines


def _correction(studies) -> str:
    parts = []
    for study in studies:
        mine, rest = point(study, "symplectic_euler"), point(study, EXPLICIT)
        if mine is None or rest is None or mine["iterations"] == 0:
            continue
        if mine["seconds"] < rest["seconds"] or mine["err_strong"] < rest["err_strong"]:
            continue
        parts.append(
            f"{study.name} ({mine['gradients']:.0f} gradients and {mine['iterations']:.1f} iterations a step, "
            f"{mine['seconds'] / rest['seconds']:.0f} times the cost of stormer_verlet for "
            f"{mine['err_strong'] / rest['err_strong']:.1f} times its error)"
        )
    if not parts:
        return ""
    return (
        "**Corrected one-sided schemes lose.** Where symplectic_euler needs its Stratonovich correction it is no "
        f"longer explicit: {listed(parts)}."
    )


def _contrast(studies) -> str:
    parts = []
    for study in studies:
        usable = [row for row in study.rows if row["status"] == "ok"]
        front = [row for row in usable if row["pareto"] and not symplectic(row["scheme"])]
        if front:
            errors = [row["err_strong"] for row in front]
            names = listed(list(dict.fromkeys(row["scheme"] for row in front)))
            parts.append(f"{study.name} ({names}, errors {min(errors):.0e} to {max(errors):.0e})")
    if not parts:
        return "**Not being symplectic never pays** at any error of these studies."
    return (
        "**Where symsde's symplectic schemes lose to plain ones.** Over horizons as short as these, schemes that are "
        f"not symplectic hold a part of the front on {listed(parts)}. Errors over a short horizon are not what "
        "symplectic schemes are for: see the drift of invariants, and docs/stability.md for long times."
    )


def _invariants(studies) -> str:
    parts = []
    for study in studies:
        known = [row for row in study.rows if row.get("drift") is not None and row["status"] == "ok"]
        lost: dict[str, float] = {}
        for row in known:
            if not row["drift"] < 1e-10:
                lost[row["scheme"]] = float(np.maximum(lost.get(row["scheme"], 0.0), row["drift"]))
        if lost:
            parts.append(f"{study.name}: {', '.join(f'{name} {value:.0e}' for name, value in lost.items())}")
    if not parts:
        return ""
    return f"**Invariants that are lost**, largest rms change over the steps measured: {'; '.join(parts)}."


def _long_steps(studies) -> str:
    parts = []
    for study in studies:
        lost = {row["scheme"] for row in study.rows if row["status"] in ("failed", "diverged")}
        if lost and "midpoint" in study.schemes and "midpoint" not in lost:
            coarse = max(row["h"] for row in study.rows)
            row = next(r for r in study.rows if r["scheme"] == "midpoint" and r["h"] == coarse)
            quality = f"with an error of {row['err_strong']:.0e}" + ("" if row["status"] == "ok" else ", all of it")
            parts.append(f"{study.name} (h = {coarse:g}, midpoint stable {quality})")
    if not parts:
        return ""
    return f"**Stable is not accurate.** At the longest steps explicit schemes fail or diverge on {listed(parts)}."
