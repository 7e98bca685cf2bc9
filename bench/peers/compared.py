# SPDX-License-Identifier: BSD-3-Clause
"""Other packages beside symsde: their errors and run times, and who is faster by how much."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable

from symsde.show import look

OURS = "symsde"
TITLES = {
    "kubo": "Kubo's oscillator, T = 4",
    "synchrotron": "synchrotron, two noises, T = 4",
    "additive": "oscillator with additive noise, T = 4",
    "henon_heiles": "Henon-Heiles, two noises, T = 8",
    "fpu64": "chain of 64 masses, 64 noises, T = 8",
}


def key(row: dict) -> tuple[str, str]:
    """Package and scheme of a row, which identify a curve."""
    return row["package"], row["scheme"]


def curves(rows: Iterable[dict], problem: str) -> dict[tuple[str, str], list[tuple[float, float]]]:
    """(error, seconds) of every scheme on a problem, in order of falling error."""
    found: dict[tuple[str, str], list[tuple[float, float]]] = {}
    for row in rows:
        if row["problem"] == problem and row["error"] is not None and math.isfinite(row["error"]):
            found.setdefault(key(row), []).append((row["error"], row["seconds"]))
    return {name: sorted(points, reverse=True) for name, points in found.items()}


def seconds_to(points: list[tuple[float, float]], error: float) -> float | None:
    """Seconds of the cheapest run with at most this error: interpolated between two points, never extrapolated."""
    best = [s for e, s in points if e <= error]
    for (e0, s0), (e1, s1) in itertools.pairwise(points):
        if e0 > error >= e1:
            share = math.log(e0 / error) / math.log(e0 / e1)
            best.append(s0 ** (1 - share) * s1**share)
    return min(best, default=None)


def compared(rows: list[dict], problem: str) -> dict[tuple[str, str], tuple[float, float, int] | None]:
    """For every scheme of a peer, its seconds over symsde's for the same error: least and most over its points, and
    the number of points with an error that symsde did not reach.
    """
    every = curves(rows, problem)
    ours = {name: points for name, points in every.items() if name[0].startswith(OURS)}
    found = {}
    for name, points in every.items():
        if name in ours:
            continue
        times, beyond = [], 0
        for error, seconds in points:
            best = [s for s in (seconds_to(x, error) for x in ours.values()) if s is not None]
            if best:
                times.append(seconds / min(best))
            else:
                beyond += 1
        found[name] = (min(times), max(times), beyond) if times else None
    return found


def sentence(rows: list[dict], problem: str) -> str:
    """A sentence on who is faster on a problem, and by how much."""
    wins, losses = [], []
    for name, found in compared(rows, problem).items():
        if found is None:
            losses.append(f"{' '.join(name)} came to no error that symsde came to")
            continue
        low, high, beyond = found
        more = f" ({beyond} of its errors symsde did not come to)" if beyond else ""
        if low < 1:
            where = (
                "at every error" if high < 1 else f"at some errors, and takes up to {high:.2g} times as long at others"
            )
            wins.append(f"{' '.join(name)} is up to {1 / low:.2g} times faster than symsde {where}{more}")
        else:
            span = f"{low:.2g}" if f"{low:.2g}" == f"{high:.2g}" else f"{low:.2g} to {high:.2g}"
            losses.append(f"{' '.join(name)} takes {span} times as long{more}")
    won = f"**A peer wins:** {'; '.join(wins)}. " if wins else "symsde is the fastest at every error here. "
    return won + (f"To the same error, {'; '.join(losses)}." if losses else "")


def draw(axes, rows: list[dict]) -> None:
    """Error over run time of every scheme of one problem: full lines for symsde, broken lines for other packages.

    A colour is a scheme, the same in every figure; markers and dashes distinguish packages.
    """
    for name, points in sorted(curves(rows, rows[0]["problem"]).items(), key=lambda found: _rank(found[0])):
        errors, seconds = zip(*points, strict=True)
        axes.plot(seconds, errors, label=" ".join(name), ms=5, **_style(name))
    axes.set(xscale="log", yscale="log", xlabel="run time of a path [s]")


_ORDER = (
    ("symsde, given", "heun"), ("symsde, given", "midpoint"), ("symsde, given", "stormer_verlet"),
    ("symsde, own", "chin4a"), ("symsde, own", "gauss3"), ("numba_loop", "Heun"), ("numpy_steps", "Heun"),
    ("diffrax", "Heun"), ("diffrax", "ShARK"), ("torchsde", "heun"), ("sdeint", "stratHeun"), ("jitcsde", "adaptive"),
    ("xmds2", "RK4"),
)  # fmt: skip


_LINES = {
    "numba_loop": ("P", "--"), "numpy_steps": ("X", ":"), "diffrax": ("*", "-."), "torchsde": (">", (0, (6, 2))),
    "sdeint": ("d", "--"), "jitcsde": ("p", "--"), "xmds2": ("H", "--"),
}  # fmt: skip
_COLOURS = dict.fromkeys(("Heun", "heun", "stratHeun"), look.colour("heun")) | {
    "ShARK": look.TEAL,
    "adaptive": look.GREY,
}


def _rank(name: tuple[str, str]) -> int:
    return _ORDER.index(name) if name in _ORDER else len(_ORDER)


def _style(name: tuple[str, str]) -> dict[str, str]:
    if name[0].startswith(OURS):
        return {"ls": "-", **look.of_scheme(name[1])}
    marker, line = _LINES.get(name[0], (".", "--"))
    return {"ls": line, "marker": marker, "color": _COLOURS.get(name[1], look.BLACK)}
