# SPDX-License-Identifier: BSD-3-Clause
"""The table of docs/formulas-inside.md: models from formulas beside those of the catalogue, and the cost of compiling
formulas.

formula_table.py [REPEATS [SECONDS]]: processor time of a path-step on one thread, in runs of about SECONDS, formula and
catalogue in turn; the ratio is the median of REPEATS such pairs. Formulas are compiled into an empty cache.
"""

import os
import resource
import sys
import tempfile
import warnings

import symsde as ss
from scenes import SCENES, Scene, library
from timing import ns_of_steps
from topics.tools import ratio

SCHEMES = ("symplectic_euler", "stormer_verlet", "midpoint", "gauss2")
MODELS = {
    "Kubo": "kubo",
    "linear oscillator": "linear_oscillator",
    "additive oscillator": "additive_oscillator",
    "noncommutative oscillator": "noncommutative_oscillator",
    "synchrotron": "synchrotron",
    "pendulum": "pendulum",
    "Hénon-Heiles": "henon_heiles",
    "chain of 64 sites, 1024 paths": "fpu_chain",
}


def compiled(scene: Scene) -> tuple[ss.Model, list[str]]:
    """A model from its formula, the processor time of its compilation, and the lines of its code."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    mine = scene.formula()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return mine, [f"{seconds:.1f}", str(len(mine.formula.source.splitlines()))]


def main():
    """Print both tables, row by row."""
    warnings.simplefilter("error", ss.PathsFailedWarning)
    how = int(sys.argv[1]) if len(sys.argv) > 1 else 9, float(sys.argv[2]) if len(sys.argv) > 2 else 0.05
    print("| model | " + " | ".join(SCHEMES) + " | compilation, s | lines |")
    print("|---" * (len(SCHEMES) + 3) + "|")
    with tempfile.TemporaryDirectory() as folder:
        os.environ["SYMSDE_CACHE"] = folder
        for name, model in MODELS.items():
            scene, ratios = SCENES[model], []
            mine, figures = compiled(scene)
            paths = 1024 if scene.sites else 4096
            for scheme in SCHEMES:
                runs = [library(each, scheme, paths, scene.step) for each in (mine, scene.model())]
                ratios.append(f"{ratio(*ns_of_steps(runs, paths, *how)):.2f}")
            print("| " + " | ".join([name, *ratios, *figures]) + " |", flush=True)


if __name__ == "__main__":
    main()
