# SPDX-License-Identifier: BSD-3-Clause
"""What a study says, in words: for this error use this scheme at this step."""

from __future__ import annotations

import math

import numpy as np

from ... import schemes

DECADES = 3  #: errors that are spoken of
CLOSE = 1.15  #: run times within this factor count as equal


def paragraph(rows: list[dict], orders: dict) -> str:
    """A recommendation for a few errors, what it is worth, and where it does not hold."""
    usable = [row for row in rows if row["status"] == "ok"]
    if not usable:
        text = "No point of this study has an error that can be trusted: use smaller steps or more paths."
        return f"{text} {_failures(rows)}".strip()
    sentences = [recommend(usable, target) for target in targets(usable)]
    sentences += [_losers(usable), _contrast(usable), _order(orders), _failures(rows), _drift(usable)]
    return " ".join(sentence for sentence in sentences if sentence)


def targets(usable: list[dict]) -> list[float]:
    """Round errors that some point reaches, coarse to fine."""
    errors = [row["err_strong_high"] for row in usable]
    low, high = math.ceil(math.log10(min(errors))), math.floor(math.log10(max(errors)))
    decades = list(range(high, low - 1, -1)) or [low]
    step = max(1, math.ceil(len(decades) / DECADES))
    return [10.0**k for k in decades[::step]]


def cheapest(usable: list[dict], target: float) -> list[dict]:
    """For each scheme that reaches the error its fastest point, the fastest first."""
    best: dict[str, dict] = {}
    for row in usable:
        if row["err_strong_high"] <= target:
            known = best.get(row["scheme"])
            if known is None or row["seconds"] < known["seconds"]:
                best[row["scheme"]] = row
    return sorted(best.values(), key=lambda row: row["seconds"])


def recommend(usable: list[dict], target: float) -> str:
    """For this error use this scheme at this step."""
    found = cheapest(usable, target)
    if not found:
        return ""
    best, others = found[0], found[1:]
    text = f"For an error of {target:g} use {best['scheme']} at h = {best['h']:.3g}: "
    text += f"{best['seconds'] * 1e6:.3g} microseconds a path"
    equal = [row["scheme"] for row in others if row["seconds"] <= CLOSE * best["seconds"]]
    if equal:
        return f"{text}; {listed(equal)} {'cost' if equal[1:] else 'costs'} the same within 15 %."
    if others:
        factor = others[0]["seconds"] / best["seconds"]
        return f"{text}, {factor:.1f} times less than {others[0]['scheme']} at h = {others[0]['h']:.3g}."
    return f"{text}; no other scheme reaches it at the steps measured."


def _losers(usable: list[dict]) -> str:
    """The scheme that costs most for the error that most schemes reach."""
    counts = {target: cheapest(usable, target) for target in targets(usable)}
    found = max(counts.values(), key=len)
    if len(found) < 3:
        return ""
    target = next(key for key, value in counts.items() if value is found)
    worst = found[-1]
    factor = worst["seconds"] / found[0]["seconds"]
    if factor < 2:
        return ""
    name = worst["scheme"]
    times = f"it takes {factor:.0f} times as long as the best"
    return f"{name} is the most expensive scheme for an error of {target:g}: {times}."


def _contrast(usable: list[dict]) -> str:
    """Where a scheme that is not symplectic wins."""
    wins, losses = [], []
    for target in targets(usable):
        found = cheapest(usable, target)
        plain = [row for row in found if not symplectic(row["scheme"])]
        structured = [row for row in found if symplectic(row["scheme"])]
        if plain and structured:
            factor = structured[0]["seconds"] / plain[0]["seconds"]
            name = plain[0]["scheme"]
            if factor > CLOSE:
                wins.append(f"{name} is {factor:.1f} times as fast as the best symplectic scheme at {target:g}")
            elif factor < 1 / CLOSE:
                losses.append(f"{1 / factor:.1f} times as long at {target:g}")
    if wins:
        return f"Over this horizon schemes that are not symplectic can be faster: {listed(wins)}."
    if losses:
        return f"The best scheme that is not symplectic takes {listed(losses)}."
    return ""


def _order(orders: dict) -> str:
    shown = [f"{name} {order}" for name, order in orders.items() if order.points > 1]
    return f"The slopes of the error over h, without plateaus, are: {', '.join(shown)}." if shown else ""


def _failures(rows: list[dict]) -> str:
    """Schemes that fail or diverge, with the smallest step at which they do."""
    lost: dict[str, float] = {}
    for row in rows:
        if row["status"] in ("failed", "diverged"):
            lost[row["scheme"]] = min(lost.get(row["scheme"], row["h"]), row["h"])
    if not lost:
        return ""
    return f"Paths fail or diverge with {listed([f'{name} down to h = {h:.3g}' for name, h in lost.items()])}."


def _drift(usable: list[dict]) -> str:
    """Which schemes keep the invariant."""
    kept, worst = drifts(usable)
    if not kept and not worst:
        return ""
    lost = [f"{name} by {value:.0e}" for name, value in worst.items()]
    first = f"The invariant is kept to rounding by {listed(kept)}" if kept else "No scheme keeps the invariant"
    return f"{first}, and at worst changed by {listed(lost)}." if lost else f"{first}."


def drifts(usable: list[dict]) -> tuple[list[str], dict[str, float]]:
    """Schemes that keep the invariant to rounding, and the largest change by each of the others."""
    worst: dict[str, float] = {}
    for row in usable:
        if row.get("drift") is not None:
            worst[row["scheme"]] = float(np.maximum(worst.get(row["scheme"], 0.0), row["drift"]))  # NaN where one is
    lost = {name: value for name, value in worst.items() if not value < 1e-10}
    return [name for name in worst if name not in lost], lost


def symplectic(name: str) -> bool:
    """Whether a scheme of the catalogue is; one of the user's own is taken to be."""
    try:
        return schemes.get(name).info.symplectic
    except ValueError:
        return True


def listed(items: list[str]) -> str:
    """Items in words: a, b and c."""
    if len(items) < 2:
        return "".join(items)
    return f"{', '.join(items[:-1])} and {items[-1]}"
