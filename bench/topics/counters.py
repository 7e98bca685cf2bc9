# SPDX-License-Identifier: BSD-3-Clause
"""What runs leave out, by their counters."""

from .tools import Setting, lines_of, table

COUNTERS = ("normals", "gradients", "Hessians", "iterations", "solves")


def measure(setting: Setting) -> list[dict]:
    """Read the counters and verdicts of what scenes leave out."""
    return [
        {
            "claim": words[1],
            "model": words[2],
            "scheme": words[3],
            "counts": [float(word) for word in words[4:9]],
            "verdict": words[9],
        }
        for words in lines_of(setting.bench / "bench_counters")
        if words[0] == "counters"
    ]


def section(found: list[dict]) -> str:
    """Write the section."""
    rows = [
        [c["claim"].replace("_", " "), c["model"], c["scheme"], *(f"{count:g}" for count in c["counts"]), c["verdict"]]
        for c in found
    ]
    heads = ["claim", "model", "scheme", *COUNTERS, "verdict"]
    return (
        "## What is left out\n\n"
        "The counters show, for a step of a path, what the library skips because a problem does not need it.\n\n"
        + table(heads, rows)
    )
