# SPDX-License-Identifier: BSD-3-Clause
"""The page docs/peers.md and its figure, from what was measured."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable
from pathlib import Path

from symsde import look
from symsde.pages import Page, markdown, wrapped

COMMAND = "bench/peers/run.py --page docs/peers.md"
OURS = "symsde"
TITLES = {
    "kubo": "Kubo's oscillator, T = 4",
    "synchrotron": "synchrotron, two noises, T = 4",
    "additive": "oscillator with additive noise, T = 4",
    "henon_heiles": "Henon-Heiles, two noises, T = 8",
    "fpu64": "chain of 64 masses, 64 noises, T = 8",
}
INTRODUCTION = """\
Error against run time of other packages beside symsde, on five problems, by one thread of one machine, in double
precision. Packages that take increments get those of one set of paths, and so does symsde in the rows "given": there
errors are those of the same paths, and no random number is timed. In rows "own" symsde draws what its scheme takes, as
ShARK of diffrax, jitcsde and XMDS2 do in theirs. *Error* is the root mean square distance in (q, p) at the horizon to
symsde's best scheme at many steps; of ShARK and jitcsde, whose paths are their own, to their own finest run. XMDS2
tells means alone: its error is that of the same rule in NumPy on the paths of all. *Run time* is seconds of the
processor for a path, warm; what is compiled first is told below.
"""


def key(row: dict) -> tuple[str, str]:
    """A curve."""
    return row["package"], row["scheme"]


def curves(rows: Iterable[dict], problem: str) -> dict[tuple[str, str], list[tuple[float, float]]]:
    """(error, seconds) of every scheme on a problem, by falling error."""
    found: dict[tuple[str, str], list[tuple[float, float]]] = {}
    for row in rows:
        if row["problem"] == problem and row["error"] is not None and math.isfinite(row["error"]):
            found.setdefault(key(row), []).append((row["error"], row["seconds"]))
    return {name: sorted(points, reverse=True) for name, points in found.items()}


def seconds_to(points: list[tuple[float, float]], error: float) -> float | None:
    """Of the cheapest run with at most this error: between two points on the line through them, never beyond them."""
    best = [s for e, s in points if e <= error]
    for (e0, s0), (e1, s1) in itertools.pairwise(points):
        if e0 > error >= e1:
            share = math.log(e0 / error) / math.log(e0 / e1)
            best.append(s0 ** (1 - share) * s1**share)
    return min(best, default=None)


def compared(rows: list[dict], problem: str) -> dict[tuple[str, str], tuple[float, float, int] | None]:
    """For every scheme of a peer, its seconds over those that symsde takes to the same error: least and most over its
    points, and how many points have an error that symsde did not come to."""
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
    """Who wins on a problem, and by how much."""
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


def write(target: Path, found: dict) -> None:
    """The page and its figure."""
    rows = found["rows"]
    problems = list(dict.fromkeys(row["problem"] for row in rows))
    page = Page(target, COMMAND, "Other packages on the same problems")
    machine = f", {found['machine']}" if "machine" in found else ""
    page.add(INTRODUCTION, f"symsde {found['symsde']}{machine}; " + ", ".join(found["versions"].values()) + ".")
    for name, why in found["skipped"].items():
        page.add(f"{name} was not there ({why}) and is left out.")
    page.figure("peers", {"peers": rows}, save, "error against run time of a path")
    for problem in problems:
        page.add(f"## {TITLES[problem]}", wrapped(sentence(rows, problem)), _table(rows, problem))
    page.add("## What is compiled first", _firsts(rows))
    page.write()


def _table(rows: list[dict], problem: str) -> str:
    lines = []
    for name, points in curves(rows, problem).items():
        cells = [f"{error:.1e} in {1e6 * seconds:.3g} us" for error, seconds in points]
        lines.append([*name, *cells, *[""] * (3 - len(cells))])
    return markdown(["package", "scheme", "error and run time of a path", "", ""], lines)


def _firsts(rows: list[dict]) -> str:
    longest: dict[str, float] = {}
    for row in rows:
        longest[row["package"]] = max(longest.get(row["package"], 0.0), row["first"])
    told = [f"{name} {seconds:.2g} s" for name, seconds in longest.items() if seconds > 0.5]
    return wrapped("Longest first run, with what it compiles: " + (", ".join(told) or "none above half a second") + ".")


def save(path: Path, data: dict) -> None:
    """A panel for each problem."""
    rows = data["peers"]
    problems = list(dict.fromkeys(row["problem"] for row in rows))
    names = sorted({key(row) for row in rows}, key=lambda name: (not name[0].startswith(OURS), name))
    with look.drawing(path, 3.2 * len(problems), 4.2, 110) as page:
        panels = page.subplots(1, len(problems), squeeze=False)[0]
        for axes, problem in zip(panels, problems, strict=True):
            found = curves(rows, problem)
            for i, name in enumerate(names):
                if name in found:
                    style = {
                        "ls": "-" if name[0].startswith(OURS) else "--",
                        "marker": "osD^vPX*<>dph"[i % 13],
                        "ms": 4,
                    }
                    axes.plot([s for _, s in found[name]], [e for e, _ in found[name]], color=f"C{i % 10}",
                              label=" ".join(name), **style)  # fmt: skip
            axes.set(xscale="log", yscale="log", xlabel="run time of a path [s]")
            axes.set_title(TITLES[problem], fontsize=8)
        panels[0].set_ylabel("strong error (rms)")
        handles = {}
        for axes in panels:
            handles |= dict(zip(*reversed(axes.get_legend_handles_labels()), strict=True))
        page.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=6, fontsize=7)
