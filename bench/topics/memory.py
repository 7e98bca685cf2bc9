# SPDX-License-Identifier: BSD-3-Clause
"""Memory of runs that keep moments only."""

from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import symsde as ss

from .python_calls import grown
from .tools import Setting, at_most, table

RUNS = ((10**4, 100, 10), (10**6, 100, 10), (10**4, 10000, 1000))  # paths, steps, save_every
TARGET = 1.0  # MB


def peak(paths: int, steps: int, save_every: int) -> float:
    """kB by which the peak memory of this process grows in a run, after a run of few steps."""
    how = {"q0": 1.0, "p0": 0.0, "step": 0.02, "paths": paths, "threads": 2}
    model = ss.models.kubo()
    ss.moments(model, steps=10, save_every=1, **how | {"paths": 512})
    return grown(lambda: ss.moments(model, steps=steps, save_every=save_every, **how))[0] / 1024


def measure(_setting: Setting) -> list[dict]:
    """Run moments for few and many paths and steps, one process each."""
    rows = []
    for run in RUNS:
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
            rows.append({"paths": run[0], "steps": run[1], "grown_kb": pool.submit(peak, *run).result()})
    return rows


def section(found: list[dict]) -> str:
    """Write the section."""
    mb = [m["grown_kb"] / 1024 for m in found]
    rows = [[str(m["paths"]), str(m["steps"]), f"{x:.2f}", *at_most(x, TARGET)] for m, x in zip(found, mb, strict=True)]
    return (
        "## Memory of moments\n\nBy how much a run makes the peak resident memory of a process grow, two threads. The\n"
        "positions of 10000 paths at eleven times would take 0.84 MB, those of 1000000 paths 84 MB.\n\n"
        + table(["paths", "steps", "growth [MB]", "target", ""], rows)
    )
