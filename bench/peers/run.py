# SPDX-License-Identifier: BSD-3-Clause
"""Error against run time of other packages beside symsde, all on the same Brownian increments.

    .venv/bin/python bench/peers/run.py [--paths 2048] [--steps 32,128,512] [--only WORD]

Every package gets the increments as an array, and so does symsde in the rows "given", so that errors are those of one
set of paths and no random number is timed; rows "own" let symsde draw its own. Errors are root mean squares of the
distance in (q, p) at the horizon to symsde at 4096 steps, by gauss3 (kubo) or chin4a. Seconds are those of the
processor for a path, the least of three warm runs, one thread. What is not installed is skipped with a sentence. A
package joins by a module of its own beside numba_loop.py; sdeint, diffrax, torchsde, jitcsde and XMDS2 have none yet.
"""

from __future__ import annotations

import argparse
import importlib
import os
import sys
import time
from functools import partial
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
import symsde as ss

from peers.problems import PROBLEMS, Problem

PACKAGES = {"numba loop": "numba_loop"}  #: name -> module with VERSION, SCHEME and run(problem, h, dw)
FINE = 4096
REPEATS = 3


def timed(function) -> tuple[np.ndarray, float]:
    """Result and least seconds of warm runs."""
    function()
    least = np.inf
    for _ in range(REPEATS):
        begin = time.process_time()
        result = function()
        least = min(least, time.process_time() - begin)
    return result, least


def reference(problem: Problem, scheme: str, paths: int) -> tuple[np.ndarray, np.ndarray]:
    """Increments (step, noise, path) of FINE steps, and the end of the paths that they are of, by a better scheme."""
    fine = ss.increments(problem.model, step=problem.horizon / FINE, steps=FINE, paths=paths, seed=11)
    return fine, own(problem, scheme, FINE, paths)


def own(problem: Problem, scheme: str, steps: int, paths: int, **more) -> np.ndarray:
    """The end of paths by symsde."""
    run = ss.simulate(
        problem.model, q0=problem.q0, p0=problem.p0, step=problem.horizon / steps, steps=steps, save_every=steps,
        scheme=scheme, paths=paths, seed=11, threads=1, **more,
    )  # fmt: skip
    return np.concatenate([run.q[-1], run.p[-1]])


class Bench:
    """One problem with its increments, and the end of their paths."""

    def __init__(self, problem: Problem, paths: int):
        """Draw and integrate the reference."""
        self.problem, self.paths = problem, paths
        self.best = "gauss3" if problem.name == "kubo" else "chin4a"
        self.fine, self.exact = reference(problem, self.best, paths)

    def error(self, found: np.ndarray) -> float:
        """Root mean square distance of the first paths."""
        return float(np.sqrt(np.square(found - self.exact[:, : found.shape[1]]).sum(axis=0).mean()))

    def rows(self, steps: int, packages: dict):
        """(package, scheme, steps, error, seconds a path)."""
        dw = self.fine.reshape(steps, FINE // steps, *self.fine.shape[1:]).sum(axis=1)
        for scheme in ("midpoint", "stormer_verlet", "heun"):
            found, seconds = timed(partial(own, self.problem, scheme, steps, self.paths, increments=dw))
            yield "symsde, given", scheme, steps, self.error(found), seconds / self.paths
        shared = own(self.problem, self.best, steps, self.paths, refine=(FINE // steps).bit_length() - 1)
        _, seconds = timed(partial(own, self.problem, self.best, steps, self.paths))
        yield "symsde, own", self.best, steps, self.error(shared), seconds / self.paths
        for name, package in packages.items():
            part = np.ascontiguousarray(dw[:, :, : getattr(package, "MOST_PATHS", self.paths)])
            found, seconds = timed(partial(package.run, self.problem, self.problem.horizon / steps, part))
            yield name, package.SCHEME, steps, self.error(found), seconds / part.shape[2]


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--paths", type=int, default=2048)
    parser.add_argument("--steps", default="32,128,512")
    parser.add_argument("--only", default="")
    options = parser.parse_args()
    packages = {}
    for name, module in PACKAGES.items():
        try:
            packages[name] = importlib.import_module(f"peers.{module}")
            print(f"{name}: {packages[name].VERSION}")
        except ImportError as error:
            print(f"{name}: skipped, it is not installed ({error})")
    print(f"symsde: {ss.__version__}, {options.paths} paths")
    for problem in PROBLEMS:
        if options.only not in problem.name:
            continue
        print(f"\n## {problem.name}, T = {problem.horizon:g}\n\n| package | scheme | steps | error | us a path |")
        print("|---|---|---|---|---|")
        bench = Bench(problem, options.paths)
        for steps in map(int, options.steps.split(",")):
            for name, scheme, _, error, seconds in bench.rows(steps, packages):
                print(f"| {name} | {scheme} | {steps} | {error:.2e} | {1e6 * seconds:.3g} |", flush=True)


if __name__ == "__main__":
    main()
