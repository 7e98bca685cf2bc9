# SPDX-License-Identifier: BSD-3-Clause
"""The page docs/performance.md: how fast a step is, in a sentence, a picture and a table; all else is in its tables."""

from __future__ import annotations

import importlib
from pathlib import Path

#: rows of the section loops -> their names on the page
ROWS = {
    "kubo midpoint": "Kubo's oscillator, midpoint",
    "linear oscillator midpoint": "oscillator with additive noise, midpoint",
    "synchrotron midpoint": "synchrotron, two noises, midpoint",
    "henon heiles stormer verlet": "Hénon-Heiles, two noises, stormer_verlet",
    "fpu64 midpoint": "chain of 64 masses, 64 noises, midpoint",
}
LARGE = "fpu64 midpoint"  #: the row that the sentence does not mention
MANY, ONE = "few32", "few1"

PAGE = """\
# Performance

In a run of 32 paths, a step of one path takes {least:.2g} to {most:.2g} ns on one thread for systems of one or two
degrees of freedom. This is {best:.2g} to {worst:.2g} of the time of a plain loop in numba. A path that runs alone takes
{alone_best:.2g} to {alone_worst:.2g} of the time of the loop.

![Time of a step beside a plain loop in numba](figures/performance.png)

{table}

The table gives ns for a step of a path, random numbers and checks included. Times depend on the machine: compare
ratios. [The tables](performance-tables.md) say on which machine this was measured, and how.

## What decides how fast a run is

- **Many paths.** Paths are computed side by side in vector registers. From about eight paths on a run gains from
  this; one path alone cannot ([beside plain loops in numba](performance-tables.md#beside-plain-loops-in-numba)).
- **Scheme.** An explicit step is cheaper than an implicit one, and every further stage costs
  ([several implicit stages](performance-tables.md#several-implicit-stages)). What counts is the time to a given error:
  [Error against run time](work-precision.md).
- **How the model is written.** Formulas are as fast as built-in models, compiled functions nearly; NumPy functions take
  many times as long ([a model of your own](own-model.md#how-fast-each-way-is)).
- **Threads.** Throughput grows with the number of threads, as paths are independent
  ([threads](performance-tables.md#threads)).
- **Size.** Time grows in proportion to paths, steps, noises and, in chains and mean fields, degrees of freedom
  ([growth](performance-tables.md#growth)).
- **Structure.** Formulas show what has an exact flow: magnetic fields, couplings of lattices, noise at each site. In
  such scenes a given error takes a half to a seventh of the time of an expert's loop with the same normals
  ([scenes that users bring](performance-tables.md#scenes-that-users-bring)).
- **Damping.** It takes little time; kicks come to a given error in a fraction of the time of splittings such as BAOAB
  ([damped systems](performance-tables.md#damped-systems-beside-other-packages)).
- **What is saved.** Moments take no memory for paths ([memory](performance-tables.md#memory-of-moments)).

Most comparisons in the tables have a target that the project sets itself. {met} of {judged} are met; the others are
marked "missed".
"""


def data(loops: list[dict]) -> dict | None:
    """The numbers of the picture, from the rows of the section loops; None if one was not measured."""
    found = {(row["group"], row["name"]): row["numbers"][:2] for row in loops}
    keys = [(group, name) for name in ROWS for group in (MANY, ONE)]
    if any(key not in found for key in keys):
        return None
    return {"rows": [{"scene": name, "group": group, "times": found[group, name]} for group, name in keys]}


def page(given: dict, tables: str) -> str:
    """The page, from the data of its picture and the text of the tables."""
    times = {(row["group"], row["scene"]): row["times"] for row in given["rows"]}
    small = [times[MANY, name] for name in ROWS if name != LARGE]
    alone = [ours / loop for (group, _), (ours, loop) in times.items() if group == ONE]
    of_small = [ours / loop for ours, loop in small]
    lines = ["| scene and scheme | 32 paths: symsde | loop | one path: symsde | loop |", "| --- " * 5 + "|"]
    for name, words in ROWS.items():
        cells = [f"{float(f'{x:.3g}'):g}" for group in (MANY, ONE) for x in times[group, name]]
        lines.append(f"| {words} | " + " | ".join(cells) + " |")
    met, missed = (tables.count(f"| {word} ") for word in ("met", "missed"))
    return PAGE.format(
        least=min(ours for ours, _ in small),
        most=max(ours for ours, _ in small),
        best=min(of_small),
        worst=max(of_small),
        alone_best=min(alone),
        alone_worst=max(alone),
        table="\n".join(lines),
        met=met,
        judged=met + missed,
    )


def save(path: Path, given: dict) -> None:
    """Draw the bars: symsde beside the loop, for many paths and for one."""
    look = importlib.import_module("symsde.show.look")  # bench/run.py must work without packages
    with look.drawing(path, 5.4, 3.2, 160) as picture:
        panels = picture.subplots(1, 2, sharey=True, sharex=True)
        for axes, group, title in zip(panels, (MANY, ONE), ("32 paths", "one path alone"), strict=True):
            rows = [row for row in given["rows"] if row["group"] == group]
            for shift, colour, label, which in (
                (-0.18, look.BLUE, "symsde", 0),
                (0.18, look.ORANGE, "loop in numba", 1),
            ):
                places = [i + shift for i in range(len(rows))]
                axes.barh(places, [row["times"][which] for row in rows], 0.34, color=colour, label=label)
            axes.set(xscale="log", xlim=(1, None), title=title, xlabel="ns for a step of a path")
            axes.set_yticks(range(len(rows)), [ROWS[row["scene"]].replace(", ", "\n", 1) for row in rows])
            axes.grid(axis="y", visible=False)
        panels[0].invert_yaxis()
        picture.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
