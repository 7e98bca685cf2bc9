# SPDX-License-Identifier: BSD-3-Clause
"""Memory of runs that keep moments only."""

from .tools import Setting, lines_of, table

RUNS = ((10**4, 100, 10), (10**6, 100, 10), (10**4, 10000, 1000))  # paths, steps, save_every
TARGET = 1.05  # of the largest peak over the least


def measure(setting: Setting) -> list[dict]:
    """Run moments for few and many paths and steps, one process each."""
    rows = []
    for paths, steps, save_every in RUNS:
        words = lines_of(setting.bench / "bench_memory", paths, steps, save_every)[0]
        rows.append({"paths": paths, "steps": steps, "peak_kb": int(words[3])})
    return rows


def section(found: list[dict]) -> str:
    """Write the section."""
    rows = [[str(m["paths"]), str(m["steps"]), f"{m['peak_kb'] / 1024:.2f}"] for m in found]
    peaks = [m["peak_kb"] for m in found]
    ratio = max(peaks) / min(peaks)
    return (
        "## Memory of moments\n\nPeak resident memory of a Fortran program, two threads.\n\n"
        + table(["paths", "steps", "peak [MB]"], rows)
        + f"\n\nLargest over least: {ratio:.3f}; target <= {TARGET}: {'met' if ratio <= TARGET else 'missed'}."
    )
