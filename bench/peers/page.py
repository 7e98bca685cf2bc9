# SPDX-License-Identifier: BSD-3-Clause
"""The page docs/peers.md and its figure, from what was measured."""

from __future__ import annotations

from pathlib import Path

from symsde.reports.pages import Page, markdown, wrapped
from symsde.reports.study.peers import TITLES, curves, draw, sentence
from symsde.show import look

COMMAND = "bench/peers/run.py --page docs/peers.md"
INTRODUCTION = """\
This page compares error and run time of symsde and of other packages on five problems. All runs are in double
precision, on one thread of one machine. Packages that take increments get those of one set of paths, and so does symsde
in the rows "given". The errors of these rows are for the same paths, and the generation of random numbers is not timed.
In the rows "own" symsde draws its random numbers itself, as ShARK of diffrax, jitcsde and XMDS2 do in their rows.
*Error* is the root mean square distance in (q, p) at the horizon from a reference: symsde's best scheme with many
steps. ShARK and jitcsde have paths of their own, so their reference is their own finest run. XMDS2 returns means only,
so its error is measured with the same rule in NumPy on the common paths. *Run time* is the processor time of a path
after a warm-up. It does not include compilation, whose time is given below.
"""


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
    height = (len(problems) + 1) // 2
    with look.drawing(path, 7.2, 0.8 + 2.9 * height, 120) as page:
        panels = page.subplots(height, 2, squeeze=False).ravel()
        handles = {}
        for axes, problem in zip(panels, problems, strict=False):
            draw(axes, [row for row in rows if row["problem"] == problem])
            axes.set_title(TITLES[problem], loc="left")
            axes.set_ylabel("strong error (rms)")
            handles |= dict(zip(*reversed(axes.get_legend_handles_labels()), strict=True))
        spare = panels[len(problems) :]
        for axes in spare:
            axes.set_axis_off()
        place, where = (spare[0], "center") if spare.size else (page, "outside lower center")
        place.legend(handles.values(), handles.keys(), loc=where, ncols=1 if spare.size else 4)
