# SPDX-License-Identifier: BSD-3-Clause
"""Lessons of several studies together; a lesson is printed only where the numbers show it."""

from __future__ import annotations

from collections.abc import Iterator

from ... import schemes
from ...answers.error_plan import uses_integrals
from .study_words import cheapest, drifts, listed, symplectic

SAME = 1.15  #: errors within this factor count as the same
EXPLICIT = "stormer_verlet"


def learned(studies: list) -> list[str]:
    """One line for each lesson: what each study has to say, in a sentence."""
    lines = []
    for find, join, sentence in LESSONS:
        parts = [part for study in studies for part in find(study)]
        if parts:
            lines.append(sentence.format(join(parts)))
        elif find is _contrast:
            lines.append("**Not being symplectic never pays** at any error of these studies.")
    return lines


def _usable(study, scheme: str | None = None) -> list[dict]:
    """Points whose errors can be trusted, of one scheme or of all."""
    return [row for row in study.rows if row["status"] == "ok" and scheme in (None, row["scheme"])]


def point(study, scheme: str) -> dict | None:
    """The usable point of smallest step of a scheme."""
    return min(_usable(study, scheme), key=lambda row: row["h"], default=None)


def _beyond(name: str) -> bool:
    return uses_integrals(schemes.get(name))


def _increments_only(study) -> list[dict]:
    """Finest points, at one step, of the symplectic schemes that need dW alone and no correction."""
    found = []
    for name in study.schemes:
        info = schemes.get(name).info
        row = point(study, name)
        plain = info.symplectic and info.correction_coefficient == 0 and not _beyond(name)
        if row is not None and plain:
            found.append(row)
    return [row for row in found if row["h"] == min(r["h"] for r in found)]


def _same_errors(study) -> Iterator[str]:
    rows = _increments_only(study)
    errors = [row["err_strong"] for row in rows]
    if len(rows) > 1 and max(errors) <= SAME * min(errors):
        seconds = [row["seconds"] for row in rows]
        cheap = min(rows, key=lambda row: row["seconds"])["scheme"]
        times = max(seconds) / min(seconds)
        how = f"{cheap} is cheapest, by up to {times:.2g} times" if times >= 1.05 else "all take the same time"
        yield f"{study.name} ({how})"


def _integrals(study) -> Iterator[str]:
    others = [row for row in _usable(study) if not _beyond(row["scheme"])]
    if not others:
        return
    least = min(row["err_strong"] for row in others)
    best = min((row for row in others if row["err_strong"] <= SAME * least), key=lambda row: row["seconds"])
    found = []
    for name in filter(_beyond, study.schemes):
        if mine := cheapest(_usable(study, name), best["err_strong"]):
            gain = best["seconds"] / mine[0]["seconds"]
            word = f"{gain:.2g} times cheaper" if gain >= 1 else f"{1 / gain:.2g} times dearer"
            found.append(f"{name} is {'as cheap' if 1 / SAME <= gain <= SAME else word}")
    if found:
        yield f"{study.name} to {best['err_strong']:.0e}, beside {best['scheme']}: {', '.join(found)}"


def _losses(study) -> Iterator[str]:
    """Where the library's first scheme, midpoint, loses."""
    yield from _against(study, "midpoint", EXPLICIT)


def _wins(study) -> Iterator[str]:
    yield from _against(study, EXPLICIT, "midpoint")


def _against(study, dear: str, cheap: str) -> Iterator[str]:
    """Where one of two schemes costs more than the other, at an error that both reach."""
    mine, rest = _usable(study, dear), _usable(study, cheap)
    if mine and rest:
        target = 1.02 * max(min(row["err_strong_high"] for row in rows) for rows in (mine, rest))
        factor = cheapest(mine, target)[0]["seconds"] / cheapest(rest, target)[0]["seconds"]
        if factor > SAME:
            yield f"{study.name} ({factor:.1f} times, error {target:.0e})"


def _correction(study) -> Iterator[str]:
    mine, rest = point(study, "symplectic_euler"), point(study, EXPLICIT)
    if mine is None or rest is None or mine["iterations"] == 0:
        return
    if mine["seconds"] >= rest["seconds"] and mine["err_strong"] >= rest["err_strong"]:
        yield (
            f"{study.name} ({mine['gradients']:.0f} gradients and {mine['iterations']:.1f} iterations a step, "
            f"{mine['seconds'] / rest['seconds']:.0f} times the cost of stormer_verlet for "
            f"{mine['err_strong'] / rest['err_strong']:.1f} times its error)"
        )


def _contrast(study) -> Iterator[str]:
    front = [row for row in _usable(study) if row["pareto"] and not symplectic(row["scheme"])]
    if front:
        errors = [row["err_strong"] for row in front]
        names = listed(list(dict.fromkeys(row["scheme"] for row in front)))
        yield f"{study.name} ({names}, errors {min(errors):.0e} to {max(errors):.0e})"


def _invariants(study) -> Iterator[str]:
    _, lost = drifts(_usable(study))
    if lost:
        yield f"{study.name}: {', '.join(f'{name} {value:.0e}' for name, value in lost.items())}"


def _long_steps(study) -> Iterator[str]:
    lost = {row["scheme"] for row in study.rows if row["status"] in ("failed", "diverged")}
    if lost and "midpoint" in study.schemes and "midpoint" not in lost:
        coarse = max(row["h"] for row in study.rows)
        row = next(r for r in study.rows if r["scheme"] == "midpoint" and r["h"] == coarse)
        quality = f"with an error of {row['err_strong']:.0e}" + (
            "" if row["status"] == "ok" else ", as large as the motion itself"
        )
        yield f"{study.name} (h = {coarse:g}, midpoint stable {quality})"


#: What is looked for in each study, how the findings are joined, and the sentence that they go into.
LESSONS = (
    (
        _same_errors,
        listed,
        "**More stages alone give no accuracy.** At the finest step, symplectic schemes that are driven by increments "
        "alone have the same error, within 15 %, on {}. There the scheme with the cheapest step wins.",
    ),
    (
        _integrals,
        "; ".join,
        "**Integrals beyond increments.** Some schemes also draw dZ or areas. The list compares their cost with that "
        "of the best other scheme, at the smallest error that the other schemes reach: {}. For smaller errors their "
        "higher order gains more and more; for much larger errors the extra work does not pay.",
    ),
    (
        _losses,
        listed,
        "**Where midpoint loses.** On separable Hamiltonians the explicit stormer_verlet reaches the same error in "
        "less time on {}, because midpoint needs Newton iterations.",
    ),
    (_wins, listed, "**Where midpoint wins** against stormer_verlet: {}."),
    (
        _correction,
        listed,
        "**Corrected one-sided schemes lose.** If symplectic_euler needs its Stratonovich correction, it is not "
        "explicit: {}.",
    ),
    (
        _contrast,
        listed,
        "**Where symplectic schemes lose to others.** Over these short horizons, schemes that are not symplectic are "
        "among the best on {}. The strength of symplectic schemes is long times: see the drift of invariants, and "
        "[Stiff and extreme cases](stability.md).",
    ),
    (_invariants, "; ".join, "**Invariants that are lost**, with the largest rms change at a measured step: {}."),
    (_long_steps, listed, "**Stable is not accurate.** At the longest steps explicit schemes fail or diverge on {}."),
)
