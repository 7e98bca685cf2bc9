# SPDX-License-Identifier: BSD-3-Clause
"""Implicit schemes of several stages beside the midpoint rule."""

import importlib.util

from .tools import ABSENT, Setting, at_most, lines_of_python, table

#: Most midpoints that a step may cost, where it is mild and where it is stiff.
TARGETS = {"gauss2": (4.0, 8.0)}
OTHERS = (10.0, 20.0)


def measure(setting: Setting) -> dict:
    """Ratios to the midpoint rule, and how the time of long chains grows; nothing where NumPy is missing."""
    found: dict = {"rows": [], "growth": []}
    if not importlib.util.find_spec("numpy"):
        return found
    for words in lines_of_python("stages.py", setting.build, 3 if setting.quick else setting.repeats):
        if words[0] == "stages":
            found["rows"].append(
                {
                    "model": words[1],
                    "ndof": int(words[2]),
                    "h": float(words[3]),
                    "scheme": words[4],
                    "ns": float(words[5]),
                    "ratio": float(words[6]),
                    "iterations": float(words[7]),
                    "lapack": int(words[8]),
                }
            )
        else:
            found["growth"].append({"ndof": int(words[1]), "scheme": words[2], "ns": float(words[3])})
    return found


def section(found: dict) -> str:
    """Write the section."""
    head = (
        "## Several implicit stages\n\n"
        "The table gives ns of processor time for a step of a path, with 256 paths on one thread, the least of\n"
        'repeats that alternate with the midpoint rule. The column "midpoints" is the ratio to the midpoint rule.\n'
        "Steps of $h = 5$ are stiff ($h\\omega\\ge 10$); `lobatto3` is unstable there.\n\n"
    )
    if not found["rows"]:
        return head + f"NumPy: {ABSENT}."
    return head + table_of(found["rows"]) + "\n\n" + growth_of(found["growth"])


def table_of(rows: list[dict]) -> str:
    """All scenes."""
    heads = ["model", "ndof", "h", "scheme", "ns", "midpoints", "iterations", "LAPACK", "target", ""]
    return table(
        heads,
        [
            [
                r["model"].replace("_", " "),
                str(r["ndof"]),
                f"{r['h']:g}",
                r["scheme"],
                f"{r['ns']:.3g}",
                f"{r['ratio']:.2f}",
                f"{r['iterations']:.1f}",
                str(r["lapack"]),
                *at_most(r["ratio"], TARGETS.get(r["scheme"], OTHERS)[r["h"] > 1]),
            ]
            for r in rows
        ],
    )


def growth_of(rows: list[dict]) -> str:
    """Time of a site of long chains."""
    schemes = list(dict.fromkeys(r["scheme"] for r in rows))
    sizes = list(dict.fromkeys(r["ndof"] for r in rows))
    times = {(r["ndof"], r["scheme"]): f"{r['ns']:.3g}" for r in rows}
    return "Long chains, 16 paths, $h = 0.25$, ns for a step of a path and a site:\n\n" + table(
        ["sites", *schemes], [[str(n), *(times[n, s] for s in schemes)] for n in sizes]
    )
