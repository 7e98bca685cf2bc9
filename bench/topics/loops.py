# SPDX-License-Identifier: BSD-3-Clause
"""The library beside plain loops in numba."""

import importlib.util

from .tools import ABSENT, Setting, at_most, lines_of_python, table

GROUPS = {
    "stages": "schemes of several stages, 256 paths",
    "step": "a step beside one of midpoint in the library (mild h = 0.1, stiff h = 5, lobatto3 1.25)",
    "many": "1000 paths",
    "rounding": "1000 paths, loops that iterate until nothing changes, as the library does",
    "few1": "1 path",
    "few2": "2 paths",
    "few8": "8 paths",
    "few32": "32 paths",
    "formula": "formulas beside the built-in model",
    "formula1": "formulas, 1 path",
    "formula_loop": "formulas, 1000 paths",
    "error": "1000 paths to an error, ns of a path",
    "saved": "1 path, every step saved",
    "saved1000": "1000 paths, every step saved",
    "given1": "1 path, increments given, beside those that the library draws",
    "given1000": "1000 paths, increments given, beside those that the library draws",
    "saved_unsaved": "1 path, every step saved, beside the library without",
    "moments": "1000 paths, moments at every step",
    "call": "µs of a call; the target is a bound of the library's",
}


def measure(setting: Setting) -> list[dict]:
    """Time all rows, or those asked for; nothing where numba is missing."""
    if importlib.util.find_spec("numba") is None:
        return []
    lines = lines_of_python(
        "loop_rows.py", setting.build, setting.repeats, 0.01 if setting.quick else 0.04, setting.rows
    )
    return [
        {"group": w[1], "name": w[2].replace("_", " "), "target": float(w[3]), "numbers": [float(x) for x in w[4:]]}
        for w in lines
    ]


def section(rows: list[dict]) -> str:
    """Write the section."""
    heads = ["rows", "scene", "library", "loop", "ratio", "target", "", "by pointer", "ratio"]
    title = "## Beside plain loops in numba\n\n"
    if not rows:
        return title + ("No row has such a name." if importlib.util.find_spec("numba") else f"numba: {ABSENT}.")
    cells = []
    for row in rows:
        ours, theirs, ratio, *through = row["numbers"]
        judged = ours if row["group"] == "call" else ratio
        figures = [f"{ours:.4g}", f"{theirs:.4g}", f"{ratio:.2f}"]
        by_pointer = [f"{through[0]:.4g}", f"{through[1]:.2f}"] if through else ["", ""]
        cells.append([GROUPS[row["group"]], row["name"], *figures, *at_most(judged, row["target"]), *by_pointer])
    return (
        title + "The table gives ns of processor time for a step of a path on one thread, the least of repeats that\n"
        "alternate between library and loop. The loops of `bench/loops.py` are what a user of numba would write:\n"
        "scalar loops over paths and steps, with normal numbers drawn in the loop by NumPy's generator (PCG64,\n"
        "ziggurat), and without -ffast-math. If not said otherwise, they solve for one unknown by Newton's method\n"
        "to rounding, and for several by fixed-point iteration until positions change by less than $10^{-14}$. The\n"
        'library iterates until its slopes no longer change, and draws its own normal numbers. "By pointer" is the\n'
        "same loop with a call of the compiled callback that the library gets, instead of a force that numba\n"
        'inlines. Where the first column says "beside", the column "loop" is the time of what is named there.\n\n'
        + table(heads, cells)
    )
