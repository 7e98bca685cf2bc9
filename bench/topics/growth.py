# SPDX-License-Identifier: BSD-3-Clause
"""The time of a run as its size grows."""

import math
import statistics
import time
from dataclasses import replace

import numpy as np
import symsde as ss
from scenes import SCENES, wave

from .tools import Setting, summary, table

#: axis -> expected exponent of time, first point of the fit, points, scene
AXES = {
    "paths": (1.0, 1000, [10**i for i in range(7)],
        "Kubo midpoint, 100 steps, moments; full blocks from 256 paths on"),
    "steps": (1.0, 10000, [10**i for i in range(2, 8)], "Kubo midpoint, 8 paths, moments"),
    "ndof": (1.0, 16, [4**i for i in range(7)], "FPU chain, midpoint, 64 paths, 20 steps, without set-up"),
    "setup": (1.0, 256, [4**i for i in range(7)],
        "Set-up of the runs of `ndof`, which probes the model's derivatives"),
    "dense": (1.0, 64, [4**i for i in range(2, 7)],
        "Rotators in their mean field, by a formula, midpoint, 64 paths: seconds of a path-step without set-up"),
    "matrices": (3.0, 32, [2**i for i in range(3, 8)],
        "The runs of `dense` by the general stepper, which forms and factorises its matrices"),
    "noises": (1.0, 4, [2**i for i in range(7)],
        "Oscillator with n additive noises, Stormer-Verlet, 1024 paths, 500 steps"),
    "sites": (1.0, 16, [4**i for i in range(2, 5)],
        "Ring of phi^4 with the noise .1 q^2 at each of n sites, by formula, chin4a, 128 paths, 20 steps"),
    "strong32": (1.0, 8, [8, 32, 128],
        "The ring, gauss2_strong32, 32 paths: seconds of a path-step without set-up"),
    "angles": (None, 4, [4**i for i in range(4)],
        "Oscillator with n noises cos(q + k), by formula, chin4a, 512 paths, 50 steps"),
    "saved": (None, 100, [10**i for i in range(5)], "Kubo midpoint, 256 paths, 20000 steps, n of them saved"),
    "threads": (-1.0, 1, [1, 2], "Kubo midpoint, 20480 paths, 500 steps"),
}  # fmt: skip


def noisy(x: int) -> ss.Model:
    """An oscillator with x noises."""
    scene = SCENES["noisy_oscillator"]
    return replace(scene, noises=x * scene.noises).formula()


def turned(x: int) -> ss.Model:
    """An oscillator with x noises of different angles."""
    return ss.model_from_sympy("(p**2 + q**2)/2", [f"0.1*cos(q + {k})" for k in range(x)])


def run_of(axis: str, x: int):
    """The call at a point of the axis with everything else fixed, and which seconds of its report count; None: all."""
    kubo, how = SCENES["kubo"].model(), {"scheme": "midpoint", "step": 0.02, "threads": 1, "q0": 1.0, "p0": 0.0}

    def simulated(model, steps, paths=64, save_every=0, **more):
        save = save_every or steps
        return lambda: ss.simulate(model, steps=steps, paths=paths, save_every=save, **{**how, **more})

    def summed(steps, paths):
        return lambda: ss.moments(kubo, steps=steps, paths=paths, save_every=steps, **how)

    if axis in ("ndof", "setup"):
        model, steps = SCENES["fpu_chain"].of(sites=x, sigma=0.1).model(), max(20, 2000 // x)
        seconds = {"ndof": lambda of: of["run"] * 20 / steps, "setup": lambda of: of["setup"]}[axis]
        return simulated(model, steps, q0=wave(x)), seconds
    if axis in ("sites", "strong32"):
        model, begin = SCENES["phi4_ring"].of(sites=x).formula(), {"q0": wave(x)}
        if axis == "sites":
            return simulated(model, 20, 128, scheme="chin4a", **begin), None
        return simulated(model, 4, 32, scheme="gauss2_strong32", **begin), lambda of: of["run"] / (32 * 4)
    if axis in ("dense", "matrices"):
        model, steps = SCENES["mean_field"].of(sites=x, N=x).formula(), 20 if axis == "dense" else 4
        begin = {"q0": np.sin(0.7 * np.arange(1, x + 1)), "p0": np.cos(1.3 * np.arange(1, x + 1)), "step": 0.1}
        return simulated(model, steps, general=axis == "matrices", **begin), lambda of: of["run"] / (64 * steps)
    return {
        "paths": lambda: summed(100, x),
        "steps": lambda: summed(x, 8),
        "noises": lambda: simulated(noisy(x), 500, 1024, scheme="stormer_verlet"),
        "angles": lambda: simulated(turned(x), 50, 512, scheme="chin4a"),
        "saved": lambda: simulated(kubo, 20000, 256, 20000 // x),
        "threads": lambda: simulated(kubo, 500, 20480, threads=x),
    }[axis](), None


def measure(setting: Setting) -> list[dict]:
    """Time runs along every axis and fit the exponent."""
    found = []
    for axis, (expected, start, xs, scene) in AXES.items():
        points = []
        for x in xs:
            run, counts = run_of(axis, x)
            run()  # compile, and do everything that is done once
            times = []
            for _ in range(1 if setting.quick else setting.repeats):
                begin = time.perf_counter()
                result = run()
                times.append(counts(result.report.timings) if counts else time.perf_counter() - begin)
            points.append((x, summary(times)))
        exponent = slope([(x, times[0]) for x, times in points if x >= start])
        found.append({"axis": axis, "scene": scene, "expected": expected, "from": start, "exponent": exponent,
                      "points": points})  # fmt: skip
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
