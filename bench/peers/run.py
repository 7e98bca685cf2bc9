# SPDX-License-Identifier: BSD-3-Clause
"""Error against run time of other packages beside symsde, on five problems.

    .venv/bin/python bench/peers/run.py [--only WORD] [--python PACKAGE=COMMAND ..] [--out FILE.json] [--page FILE.md]
    .venv/bin/python bench/peers/run.py --from FILE.json --page docs/peers.md

Packages that take increments, and symsde in the rows "given", get the increments of one set of paths: all errors are on
the same paths, and no random number is timed. In rows "own", symsde draws the increments and functionals of its scheme.
Errors are root mean squares of the distance in (q, p) at the horizon to symsde's best scheme at many steps; packages
that draw their own paths are compared with their own finest run on these paths. Seconds are processor time for a path
on one thread, the least of three warm runs; compilation and set-up are printed separately. Every package runs in a
process of its own, by this interpreter or by the one that --python names, such as --python diffrax=/venv/bin/python:
missing packages are skipped with a sentence.
"""

from __future__ import annotations

import argparse
import json
import os
import shlex
import subprocess
import sys
import tempfile
import time
from functools import partial
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
import symsde as ss
from symsde.studies.pages import machine

from peers.equations import PROBLEMS, Problem
from peers.models import MODELS
from peers.page import write

PACKAGES = ("numba_loop", "numpy_steps", "diffrax", "torchsde", "sdeint", "jitcsde", "xmds2")
WORKER = Path(__file__).resolve().with_name("worker.py")
REPEATS = 3
GIVEN = ("midpoint", "stormer_verlet", "heun")


def timed(function) -> tuple[Any, float]:
    """Result of a function, and least seconds of its warm runs."""
    function()
    least = np.inf
    for _ in range(REPEATS):
        begin = time.process_time()
        result = function()
        least = min(least, time.process_time() - begin)
    return result, least


class Bench:
    """One problem with its increments, and the reference states at the horizon."""

    def __init__(self, problem: Problem):
        """Draw and integrate the reference."""
        self.problem, self.model = problem, MODELS[problem.name]
        self.best = "gauss3" if problem.name == "kubo" else "chin4a"
        self.fine = ss.increments(
            self.model, step=problem.horizon / problem.fine, steps=problem.fine, paths=problem.paths, seed=11
        )
        self.exact = self.by_symsde(self.best, problem.fine)

    def by_symsde(self, scheme: str, steps: int, **more) -> np.ndarray:
        """Final states of the paths by a scheme of symsde."""
        problem = self.problem
        run = ss.simulate(
            self.model, q0=np.array(problem.q0), p0=np.array(problem.p0), step=problem.horizon / steps, steps=steps,
            save_every=steps, scheme=scheme, paths=problem.paths, seed=11, threads=1, **more,
        )  # fmt: skip
        return np.concatenate([run.q[-1], run.p[-1]])

    def error(self, found: np.ndarray) -> float:
        """Root mean square distance of the first paths' final states from the reference."""
        return float(np.sqrt(np.square(found - self.exact[:, : found.shape[1]]).sum(axis=0).mean()))

    def increments(self, steps: int) -> np.ndarray:
        """Increments summed for longer steps, (step, noise, path)."""
        return self.fine.reshape(steps, self.problem.fine // steps, *self.fine.shape[1:]).sum(axis=1)

    def ours(self, steps: int) -> list[dict]:
        """Rows of symsde for this number of steps."""
        problem, dw, rows = self.problem, self.increments(steps), []
        for scheme in GIVEN:
            found, seconds = timed(partial(self.by_symsde, scheme, steps, increments=dw))
            rows.append(self.row("symsde, given", scheme, steps, self.error(found), seconds / problem.paths))
        shared = self.by_symsde(self.best, steps, refine=(problem.fine // steps).bit_length() - 1)
        _, seconds = timed(partial(self.by_symsde, self.best, steps))
        rows.append(self.row("symsde, own", self.best, steps, self.error(shared), seconds / problem.paths))
        return rows

    def theirs(self, package: str, command: list[str], steps: int) -> list[dict]:
        """Rows of a package for this number of steps."""
        found, ends = asked(package, command, {"problem": self.problem.name, "steps": steps}, self.increments(steps))
        rows = []
        for row, end in zip(found["rows"], ends, strict=True):
            error = row["error"] if end is None else self.error(end)
            rows.append(self.row(package, row["scheme"], steps, error, row["seconds"], row["first"]))
        return rows

    def row(self, package: str, scheme: str, steps: int, error: float, seconds: float, first: float = 0.0) -> dict:  # noqa: PLR0917
        """A row as it is saved."""
        return {
            "problem": self.problem.name,
            "package": package,
            "scheme": scheme,
            "steps": steps,
            "error": error,
            "seconds": seconds,
            "first": first,
        }


def asked(package: str, command: list[str], task: dict, dw: np.ndarray | None) -> tuple[dict, list]:
    """The result and final states from a package's process; PackageError if the package is missing or fails."""
    module = package if package.startswith("num") else f"{package}_package"
    with tempfile.TemporaryDirectory(dir=os.environ.get("PEERS_TMP")) as folder:
        place = Path(folder)
        (place / "task.json").write_text(json.dumps(task))
        if dw is not None:
            np.save(place / "dw.npy", dw)
        done = subprocess.run(
            [*command, str(WORKER), module, folder], cwd=folder, capture_output=True, text=True, check=False
        )
        if done.returncode:
            raise PackageError(done.stderr.strip().splitlines()[-1] if done.stderr.strip() else "it says nothing")
        found = json.loads((place / "result.json").read_text())
        files = (place / f"end-{i}.npy" for i in range(len(found["rows"])))
        return found, [np.load(file) if file.exists() else None for file in files]


class PackageError(Exception):
    """A package is missing or does not work."""


def measured(only: str, commands: dict[str, list[str]]) -> dict:
    """All rows, versions, and what was skipped."""
    found: dict[str, Any] = {"symsde": ss.__version__, "machine": machine(), "versions": {}, "skipped": {}, "rows": []}
    for package in PACKAGES:
        try:
            found["versions"][package] = asked(package, commands[package], {}, None)[0]["version"]
            print(f"{package}: {found['versions'][package]}")
        except PackageError as error:
            found["skipped"][package] = str(error)
            print(f"{package}: skipped ({error}); --python {package}=COMMAND names an interpreter that has it")
    for problem in PROBLEMS.values():
        if only not in problem.name:
            continue
        bench = Bench(problem)
        for steps in problem.steps:
            rows = bench.ours(steps)
            for package in found["versions"]:
                rows += bench.theirs(package, commands[package], steps)
            for row in rows:
                print(
                    f"{row['problem']:14s} {row['package']:14s} {row['scheme']:16s} {row['steps']:5d} "
                    f"{row['error']:10.2e} {1e6 * row['seconds']:10.3g} us",
                    flush=True,
                )
            found["rows"] += rows
    return found


def main() -> None:
    """Measure, or read measurements from a file; write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default="")
    parser.add_argument("--python", action="append", default=[], metavar="PACKAGE=COMMAND")
    parser.add_argument("--from", dest="source", type=Path, metavar="FILE.json")
    parser.add_argument("--out", type=Path, metavar="FILE.json")
    parser.add_argument("--page", type=Path, metavar="FILE.md")
    options = parser.parse_args()
    commands = {package: [sys.executable] for package in PACKAGES}
    for given in options.python:
        package, _, command = given.partition("=")
        if package not in commands or not command:
            parser.error(f"--python {given}: give PACKAGE=COMMAND, PACKAGE one of {', '.join(PACKAGES)}")
        commands[package] = shlex.split(command)
    found = json.loads(options.source.read_text()) if options.source else measured(options.only, commands)
    if options.out:
        options.out.write_text(json.dumps(found, indent=1) + "\n")
    if options.page:
        write(options.page, found)


if __name__ == "__main__":
    main()
