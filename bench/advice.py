# SPDX-License-Identifier: BSD-3-Clause
"""Whether `symsde.advise` is near the measured front: its advice beside every scheme of the pages, on this machine.

    .venv/bin/python bench/advice.py                # every scene, as a table for docs/expect-inside.md
    .venv/bin/python bench/advice.py kubo fpu_chain # some of them

Errors by the number of steps are those of docs/figures/work-precision-*.json, which do not depend on the machine. Each
scheme there, and the advised one, is timed here at the fewest steps that keep the tolerance: all in turn, the least
processor time of several. A scheme that is not on that page cannot be judged, since its error is unknown.
"""

import json
import math
import sys
import time
from pathlib import Path

import numpy as np
import symsde as ss
from symsde.batch import scene

ROOT = Path(__file__).resolve().parents[1]
CASES = {
    "kubo": (1e-1, 1e-3, 1e-5),
    "synchrotron": (1e-1, 1e-3, 1e-5),
    "additive_oscillator": (1e-1, 1e-3, 1e-5),
    "pendulum": (1e-1, 1e-2, 1e-3),
    "noncommutative_oscillator": (1e-1, 3e-2),
    "henon_heiles": (1e-1, 1e-3, 1e-5),
    "fpu_chain": (1.0, 1e-1, 1e-2),
    "driven_pendulum": (1e-1, 1e-3, 1e-5),
    "stiff_chain": (1.0,),
}
TURNS = 5
WORK = 2**19  #: path-steps times degrees of freedom in a timed run


def front(name):
    """Horizon, and (steps, error) of every scheme on the page, longest step first."""
    data = json.loads((ROOT / f"docs/figures/work-precision-{name}.json").read_text())
    points = {}
    for row in data["rows"]:
        if row["status"] in ("ok", "reference", "rounding"):
            points.setdefault(row["scheme"], []).append((row["steps"], row["err_strong"]))
    return data["horizon"], {scheme: sorted(rows) for scheme, rows in points.items()}


def fewest(rows, tolerance):
    """Steps at which the error equals the tolerance, by logarithmic interpolation; None if no step keeps it."""
    steps, errors = (np.log(column) for column in zip(*rows, strict=True))
    kept = [i for i in range(len(rows)) if errors[i] <= math.log(tolerance)]
    if not kept:
        return None
    first = kept[0]
    if first == 0:
        return rows[0][0]
    part = (errors[first - 1] - math.log(tolerance)) / (errors[first - 1] - errors[first])
    return math.ceil(math.exp(steps[first - 1] + part * (steps[first] - steps[first - 1])) - 1e-9)


def error_at(rows, steps):
    """Error at this number of steps; None outside of the measured range."""
    if not rows or not rows[0][0] <= steps <= rows[-1][0]:
        return None
    return float(np.exp(np.interp(math.log(steps), *(np.log(column) for column in zip(*rows, strict=True)))))


def seconds(chosen, horizon, todo):
    """Seconds of a path for every (scheme, steps): the least of several turns, without the set-up of a run."""
    least = {}
    for _ in range(TURNS):
        for scheme, steps in todo:
            paths = max(64, WORK // (steps * chosen.model.ndof) // 64 * 64)
            for count in (paths, 8):
                begin = time.process_time()
                ss.moments(chosen.model, q0=chosen.run["q0"], p0=chosen.run["p0"], scheme=scheme, step=horizon / steps,
                           steps=steps, save_every=steps, paths=count, threads=1)  # fmt: skip
                spent = time.process_time() - begin
                least[scheme, steps, count > 8] = min(least.get((scheme, steps, count > 8), math.inf), spent)
            least[scheme, steps, "paths"] = paths
    return {
        (scheme, steps): max(least[scheme, steps, True] - least[scheme, steps, False], least[scheme, steps, True] / 4)
        / (least[scheme, steps, "paths"] - 8)
        for scheme, steps in todo
    }


def judged(name, tolerance):
    """One row of the table."""
    chosen = scene.load(ROOT / f"examples/scenes/{name}.toml")
    horizon, points = front(name)
    advice = ss.advise(chosen.model, q0=chosen.run["q0"], p0=chosen.run["p0"], horizon=horizon, tolerance=tolerance)
    wanted = {scheme: fewest(rows, tolerance) for scheme, rows in points.items()}
    todo = {(scheme, steps) for scheme, steps in wanted.items() if steps}
    costs = seconds(chosen, horizon, sorted(todo | {(advice.scheme, advice.steps)}))
    best = min(todo, key=costs.get)
    error = error_at(points.get(advice.scheme), advice.steps)
    return {
        "advice": advice,
        "error": error,
        "best": f"{best[0]}, {best[1]}",
        "ratio": costs[advice.scheme, advice.steps] / costs[best],
    }


def main() -> None:
    """Print the table."""
    names = sys.argv[1:] or CASES
    print("| scene | tolerance | advised | error | best of the page | cost over that |\n|---|---|---|---|---|---|")
    for name in names:
        for tolerance in CASES[name]:
            row = judged(name, tolerance)
            error = "-" if row["error"] is None else f"{row['error']:.1e}"
            advised = f"{row['advice'].scheme}, {row['advice'].steps}"
            print(
                f"| {name} | {tolerance:.0e} | {advised} | {error} | {row['best']} | {row['ratio']:.2f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
