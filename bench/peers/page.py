# SPDX-License-Identifier: BSD-3-Clause
"""The page docs/peers.md and its figure, from the measurements."""

from __future__ import annotations

from pathlib import Path

from symsde.show import look
from symsde.show.tables import markdown
from symsde.studies.pages import Page, wrapped

from .compared import TITLES, curves, draw, sentence

COMMAND = "bench/peers/run.py --page docs/peers.md"
CAPTION = "error against run time of a path"


def write(target: Path, found: dict) -> None:
    """Write the page and its figure from the measurements."""
    page = Page(target, COMMAND)
    page.put(
        "measured",
        *measured(found),
        page.figure("peers", {"peers": found["rows"]}, save, CAPTION),
        *tables(found["rows"]),
    )
    page.write()


def measured(found: dict) -> list[str]:
    """Sentences on versions, the machine, and missing packages."""
    machine = f", {found['machine']}" if "machine" in found else ""
    parts = [f"symsde {found['symsde']}{machine}; " + ", ".join(found["versions"].values()) + "."]
    return parts + [f"{name} was not there ({why}) and is left out." for name, why in found["skipped"].items()]


def tables(rows: list[dict]) -> list[str]:
    """For every problem, who is faster, and the errors and run times."""
    parts = []
    for problem in dict.fromkeys(row["problem"] for row in rows):
        parts += [f"## {TITLES[problem]}", wrapped(sentence(rows, problem)), _table(rows, problem)]
    return [*parts, "## What is compiled first", _firsts(rows)]


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
    """Draw a panel for each problem."""
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
