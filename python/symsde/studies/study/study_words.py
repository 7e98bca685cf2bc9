# SPDX-License-Identifier: BSD-3-Clause
"""The result of a study in words: a recommended scheme and step for each error."""

from __future__ import annotations

import math

import numpy as np

DECADES = 3  #: most decades of errors in the text
CLOSE = 1.15  #: run times within this factor count as equal


def paragraph(rows: list[dict]) -> str:
    """A recommendation for a few errors, schemes that fail, and schemes that keep the invariant."""
    usable = [row for row in rows if row["status"] == "ok"]
    if usable:
        sentences = [recommend(usable, target) for target in targets(usable)]
    else:
        sentences = ["No point of this study has an error that can be trusted: use smaller steps or more paths."]
    return " ".join(sentence for sentence in [*sentences, _failures(rows), _drift(usable)] if sentence)


def targets(usable: list[dict]) -> list[float]:
    """Round errors that some point reaches, coarse to fine."""
    errors = [row["err_strong_high"] for row in usable]
    low, high = math.ceil(math.log10(min(errors))), math.floor(math.log10(max(errors)))
    decades = list(range(high, low - 1, -1)) or [low]
    step = max(1, math.ceil(len(decades) / DECADES))
    return [10.0**k for k in decades[::step]]


def cheapest(usable: list[dict], target: float) -> list[dict]:
    """For each scheme that reaches the error, its fastest point; the fastest scheme first."""
    best: dict[str, dict] = {}
    for row in usable:
        if row["err_strong_high"] <= target:
            known = best.get(row["scheme"])
            if known is None or row["seconds"] < known["seconds"]:
                best[row["scheme"]] = row
    return sorted(best.values(), key=lambda row: row["seconds"])


def recommend(usable: list[dict], target: float) -> str:
    """The sentence that recommends scheme and step for an error."""
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
    """Which schemes keep the invariant to rounding, and the largest change by each other scheme."""
    worst: dict[str, float] = {}
    for row in usable:
        if row.get("drift") is not None:
            worst[row["scheme"]] = float(np.maximum(worst.get(row["scheme"], 0.0), row["drift"]))  # NaN where one is
    if not worst:
        return ""
    lost = [f"{name} by {value:.0e}" for name, value in worst.items() if not value < 1e-10]
    kept = [name for name, value in worst.items() if value < 1e-10]
    first = f"The invariant is kept to rounding by {listed(kept)}" if kept else "No scheme keeps the invariant"
    return f"{first}, and at worst changed by {listed(lost)}." if lost else f"{first}."


def listed(items: list[str]) -> str:
    """Items in words: a, b and c."""
    if len(items) < 2:
        return "".join(items)
    return f"{', '.join(items[:-1])} and {items[-1]}"
