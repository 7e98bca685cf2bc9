# SPDX-License-Identifier: BSD-3-Clause
"""The building blocks of a step, each alone, and what the machine can do."""

from .tools import Setting, lines_of, spread, table


def measure(setting: Setting) -> list[dict]:
    """Time the building blocks and the machine."""
    return [
        {"kind": words[0], "name": words[1].replace("_", " "), "values": [float(word) for word in words[2:]]}
        for words in lines_of(setting.bench / "bench_blocks", setting.repeats)
    ]


def section(found: list[dict]) -> str:
    """Write the section."""
    blocks = [[b["name"], spread(b["values"])] for b in found if b["kind"] == "block"]
    rates = [[b["name"], spread(b["values"])] for b in found if b["kind"] == "machine"]
    return (
        "## Building blocks\n\n"
        "The times are ns of processor time for each item, in blocks of 256 [lanes](words.md#lane) on one thread.\n\n"
        + table(["block", "ns"], blocks)
        + "\n\nRates of the machine on one thread:\n\n"
        + table(["machine", "rate"], rates)
    )
