# SPDX-License-Identifier: BSD-3-Clause
"""The table of docs/formulas-inside.md: formulas beside the catalogue, and what it takes to compile them.

formula_table.py [REPEATS [SECONDS]]: processor time of a path-step on one thread, of runs of about SECONDS, formula and
catalogue in turn; the median of the ratios of REPEATS such pairs. Compilations are of a cache of their own.
"""

import os
import resource
import statistics
import sys
import tempfile
import warnings

import formula_models
import symsde as ss
from loop_rows import Run, chain_model, henon_heiles, library, repeat, timed

SCHEMES = ("symplectic_euler", "stormer_verlet", "midpoint", "gauss2")
MODELS = {  # how it is written -> model, step, paths
    "Kubo": (ss.models.kubo, 0.02, 4096),
    "linear oscillator": (ss.models.linear_oscillator, 0.02, 4096),
    "additive oscillator": (ss.models.additive_oscillator, 0.02, 4096),
    "noncommutative oscillator": (ss.models.noncommutative_oscillator, 1e-6, 4096),  # it grows without bound
    "synchrotron": (ss.models.synchrotron, 0.02, 4096),
    "pendulum": (ss.models.pendulum, 0.02, 4096),
    "Hénon-Heiles": (henon_heiles, 0.02, 4096),
    "chain of 64 sites, 1024 paths": (lambda: chain_model(64), 0.05, 1024),
}


def compiled(known: ss.Model) -> tuple[ss.Model, list[str]]:
    """A model by its formula, the processor time of its compilation, and the lines of its code."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    mine = formula_models.by_formula(known)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return mine, [f"{seconds:.1f}", str(len(mine.formula.source.splitlines()))]


def ratio(runs: list[Run], paths: int, repeats: int, seconds: float) -> float:
    """Time of a formula over that of the catalogue's model: the median of pairs."""
    steps = [repeat(run, paths, seconds) for run in runs]
    pairs = [[timed(run, n, 1) / n for run, n in zip(runs, steps, strict=True)] for _ in range(repeats)]
    return statistics.median(ours / theirs for ours, theirs in pairs)


def main():
    """Print both tables, row by row."""
    warnings.simplefilter("error", ss.PathsFailedWarning)
    how = int(sys.argv[1]) if len(sys.argv) > 1 else 9, float(sys.argv[2]) if len(sys.argv) > 2 else 0.05
    print("| model | " + " | ".join(SCHEMES) + " | compilation, s | lines |")
    print("|---" * (len(SCHEMES) + 3) + "|")
    with tempfile.TemporaryDirectory() as folder:
        os.environ["SYMSDE_CACHE"] = folder
        for name, (make, step, paths) in MODELS.items():
            known = make()
            mine, figures = compiled(known)
            ratios = []
            for scheme in SCHEMES:
                runs = [library(model, scheme, paths, step) for model in (mine, known)]
                ratios.append(f"{ratio(runs, paths, *how):.2f}")
            print("| " + " | ".join([name, *ratios, *figures]) + " |", flush=True)


if __name__ == "__main__":
    main()
