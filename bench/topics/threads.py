# SPDX-License-Identifier: BSD-3-Clause
"""Two threads beside two independent processes of one thread."""

import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import symsde as ss

from .tools import Setting, at_least, spread, summary, table

STEPS = {"synchrotron": 4000, "kubo": 16000}
PATHS = 20480  #: paths for each thread
TARGET = 0.97  # least throughput, in units of two processes
PAIRS = 7


def load(scene: str, threads: int, steps: int) -> tuple[float, float, float]:
    """A steady run: path-steps per second, ns of processor time for a path-step, part of the time that threads ran."""
    how = {"q0": 1.0, "p0": 0.0, "step": 0.02, "steps": steps, "save_every": steps, "seed": 1}
    begin, processor = time.perf_counter(), time.process_time()
    run = ss.simulate(ss.models.get(scene), scheme="midpoint", paths=PATHS * threads, threads=threads, **how)
    wall, processor = time.perf_counter() - begin, time.process_time() - processor
    count = PATHS * threads * steps
    return count / wall, 1e9 * processor / count, run.report.timings["run"] / wall


def measure(setting: Setting) -> list[dict]:
    """Run threads and processes in turn, with the same work for every thread."""
    found = []
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        for scene, usual in STEPS.items():
            steps = usual // 5 if setting.quick else usual
            runs = {"threads": [], "processes": [], "ratio": [], "threads_ns": [], "processes_ns": [], "ns_ratio": []}
            list(pool.map(load, [scene] * 2, [1] * 2, [10] * 2))  # start both processes
            for _ in range(2 if setting.quick else max(PAIRS, setting.repeats)):
                rate, ns, inside = load(scene, 2, steps)
                both = list(pool.map(load, [scene] * 2, [1] * 2, [steps] * 2))
                runs["threads"].append(rate)
                runs["processes"].append(sum(b[0] for b in both))
                runs["ratio"].append(rate / sum(b[0] for b in both))
                runs["threads_ns"].append(ns)
                runs["processes_ns"].append(sum(b[1] for b in both) / 2)
                runs["ns_ratio"].append(sum(b[1] for b in both) / 2 / ns)
            found.append({"scene": scene, "inside": inside} | {key: summary(x) for key, x in runs.items()})
    return found


def section(found: list[dict]) -> str:
    """Write the section."""
    rows = []
    for f in found:
        for what, of, scale in (("", "path-steps per microsecond", 1e6), ("_ns", "ns of processor time", 1)):
            ratio = f["ratio" if not what else "ns_ratio"]
            cells = [spread([x / scale for x in f[kind + what]]) for kind in ("threads", "processes")]
            rows.append([f["scene"], of, *cells, spread(ratio), *at_least(ratio[0], None if what else TARGET)])
    heads = ["midpoint", "", "two threads", "two processes", "ratio", "target", ""]
    inside = min(f["inside"] for f in found)
    return (
        "## Threads\n\n"
        "The table compares two threads with two processes of one thread each, in alternating runs with the same work\n"
        "for each thread. The ratio of throughputs, by wall-clock time, also depends on everything else that runs\n"
        "on the machine. The ratio of processor times (for a step of a path) shows what the threads cost each other.\n"
        f"The threads run for {100 * inside:.2f} % of the time of a run.\n\n" + table(heads, rows)
    )
