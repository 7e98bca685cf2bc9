# SPDX-License-Identifier: BSD-3-Clause
"""How the time of a run grows."""

import math
import statistics

from .tools import Setting, lines_of, table

# Exponent of time, and the point from which it is fitted.
AXES = {
    "paths": (1.0, 1000, "Kubo midpoint, 100 steps, moments; full blocks from 256 paths on"),
    "steps": (1.0, 10000, "Kubo midpoint, 8 paths, moments"),
    "ndof": (1.0, 16, "FPU chain, midpoint, 64 paths, 20 steps, without set-up"),
    "setup": (1.0, 256, "Set-up of the runs of `ndof`, which probes the model's derivatives"),
    "dense": (1.0, 64, "Rotators in their mean field, midpoint, 64 paths: seconds of a path-step without set-up"),
    "matrices": (3.0, 32, "The runs of `dense` by the general stepper, which forms and factorises its matrices"),
    "noises": (1.0, 4, "Oscillator with n additive noises, Stormer-Verlet, 1024 paths, 500 steps"),
    "saved": (None, 100, "Kubo midpoint, 256 paths, 20000 steps, n of them saved"),
    "threads": (-1.0, 1, "Kubo midpoint, 20480 paths, 500 steps"),
}


def measure(setting: Setting) -> list[dict]:
    """Time runs along every axis and fit the exponent."""
    found = []
    for axis, (expected, start, scene) in AXES.items():
        rows = lines_of(setting.bench / "bench_growth", axis, 1 if setting.quick else setting.repeats)
        points = [(int(w[2]), [float(x) for x in w[3:6]]) for w in rows]
        exponent = slope([(x, times[0]) for x, times in points if x >= start])
        found.append(
            {
                "axis": axis,
                "scene": scene,
                "expected": expected,
                "from": start,
                "exponent": exponent,
                "points": points,
            }
        )
    return found


def slope(points: list[tuple[float, float]]) -> float:
    """Exponent of the least-squares power law."""
    x = [math.log(a) for a, _ in points]
    y = [math.log(b) for _, b in points]
    mx, my = statistics.fmean(x), statistics.fmean(y)
    squares = sum((a - mx) ** 2 for a in x)
    return sum((a - mx) * (b - my) for a, b in zip(x, y, strict=True)) / squares


def section(found: list[dict]) -> str:
    """Write the section."""
    parts = []
    for axis in found:
        rows = [[str(x), *(f"{t:.3g}" for t in times)] for x, times in axis["points"]]
        parts.append(
            f"### {axis['axis']}\n\n{axis['scene']}. Fitted exponent from {axis['from']} on: "
            f"{axis['exponent']:.2f}"
            + (f", expected {axis['expected']:g}." if axis["expected"] is not None else ".")
            + "\n\n"
            + table([axis["axis"], "seconds", "least", "largest"], rows)
        )
    return "## Growth\n\nThe tables show how the time of a run grows, in seconds.\n\n" + "\n\n".join(parts)
