# SPDX-License-Identifier: BSD-3-Clause
"""The page docs/performance.md: how fast a step is, in a sentence, a picture and a table; all else is in its tables."""

from __future__ import annotations

import importlib
import re
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
#: scenes of the section brought -> their names in the picture
SCENES = {
    "double well": "double well, two noises",
    "Duffing, 2 degrees": "two Duffing oscillators",
    "3 bodies": "three bodies in a plane",
    "phi^4 ring of 64": "ring of 64 sites, noise at each",
    "magnetic field": "charge in a magnetic field",
    "Schroedinger lattice of 16": "Schrödinger ring of 16",
}

PAGE = """\
# Performance

Scenes that users bring come to a strong error of 0.001 in {gauss_best:.2g} to {gauss_worst:.2g} of the time of an
expert's loop in numba, and in {usual_best:.2g} to {usual_worst:.2g} of the time of a loop by one increment a step.

![Time to an error of 0.001, and time of a step, beside loops in numba](figures/performance.png)

In a run of 32 paths, a step of one path takes {least:.2g} to {most:.2g} ns on one thread for systems of one or two
degrees of freedom. This is {best:.2g} to {worst:.2g} of the time of a plain loop in numba. A path that runs alone takes
{alone_best:.2g} to {alone_worst:.2g} of the time of the loop.

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


def rows(loops: list[dict]) -> list[dict] | None:
    """The times of steps, from the rows of the section loops; None if one was not measured."""
    found = {(row["group"], row["name"]): row["numbers"][:2] for row in loops}
    keys = [(group, name) for name in ROWS for group in (MANY, ONE)]
    if any(key not in found for key in keys):
        return None
    return [{"scene": name, "group": group, "times": found[group, name]} for group, name in keys]


def brought(tables: str) -> list[dict]:
    """For each scene that users bring the us of a path to an error of 0.001, from the tables: by the library, by the
    loop with dZ, and by the faster loop without. Empty if the tables lack the section.
    """
    wide = re.search(r"^\| scene +\| scheme +\| steps to 0\.001 .*?\n\n", tables, re.MULTILINE | re.DOTALL)
    if wide is None:
        return []
    cells_of = [[x.strip() for x in line.split("|")[1:-1]] for line in wide[0].splitlines()[2:] if line]
    found = []
    for scene in SCENES:
        times = {scheme: float(cells[2]) for name, scheme, *cells in cells_of if name == scene}
        ours = [x for scheme, x in times.items() if scheme.startswith("symsde")]
        usual = [times[x] for x in ("numba Strang", "numba Heun") if x in times]
        found.append({"scene": scene, "times": [*ours, times["numba Gauss"], min(usual)]})
    return found


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
    shares = [(ours / gauss, ours / usual) for ours, gauss, usual in (row["times"] for row in given["brought"])]
    met, missed = (tables.count(f"| {word} ") for word in ("met", "missed"))
    return PAGE.format(
        gauss_best=min(x for x, _ in shares),
        gauss_worst=max(x for x, _ in shares),
        usual_best=min(x for _, x in shares),
        usual_worst=max(x for _, x in shares),
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
    """Draw the bars: time to an error in the scenes that users bring, and time of a step in a run of 32 paths."""
    look = importlib.import_module("symsde.show.look")  # bench/run.py must work without packages
    steps = {row["scene"]: row["times"] for row in given["rows"] if row["group"] == MANY}
    errors = {row["scene"]: row["times"] for row in given["brought"]}
    left = ("to an error of 0.001", "us of a path", errors, SCENES)
    right = ("a step, 32 paths", "ns for a step of a path", steps, ROWS)
    with look.drawing(path, 7.6, 3.6, 160) as picture:
        for axes, (title, label, times, names) in zip(picture.subplots(1, 2), (left, right), strict=True):
            several = len(next(iter(times.values()))) > 2
            kinds = ["symsde", "loop, two normals a step", "loop, one normal a step"] if several else ["symsde", ""]
            colours = [look.BLUE, look.ORANGE, look.GREEN] if several else [look.BLUE, look.GREEN]
            width = 0.8 / len(kinds)
            for which, (kind, colour) in enumerate(zip(kinds, colours, strict=True)):
                places = [i + (which - (len(kinds) - 1) / 2) * width for i in range(len(times))]
                axes.barh(places, [x[which] for x in times.values()], 0.9 * width, color=colour, label=kind)
            axes.set(xscale="log", title=title, xlabel=label)
            axes.set_yticks(range(len(times)), [names[x].replace(", ", "\n", 1) for x in times])
            axes.grid(axis="y", visible=False)
            axes.invert_yaxis()
        handles, labels = picture.axes[0].get_legend_handles_labels()
        picture.legend(handles, labels, loc="outside lower center", ncols=3)
