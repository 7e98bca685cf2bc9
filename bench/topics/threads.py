# SPDX-License-Identifier: BSD-3-Clause
"""Two threads beside two independent processes of one thread."""

import subprocess

from .tools import Setting, at_least, lines_of, spread, summary, table

SCENES = ("synchrotron", "kubo")
TARGET = 0.97  # of the throughput of two processes
PAIRS = 7


def measure(setting: Setting) -> list[dict]:
    """Run both in turn, the same work for every thread."""
    program, percent = setting.bench / "bench_load", 20 if setting.quick else 100
    found = []
    for scene in SCENES:
        runs = {"threads": [], "processes": [], "ratio": [], "threads_ns": [], "processes_ns": [], "ns_ratio": []}
        for _ in range(2 if setting.quick else max(PAIRS, setting.repeats)):
            rate, ns, inside = (float(x) for x in lines_of(program, scene, 2, percent)[0][3:])
            both = two_processes(program, scene, percent)
            runs["threads"].append(rate)
            runs["processes"].append(sum(b[0] for b in both))
            runs["ratio"].append(rate / sum(b[0] for b in both))
            runs["threads_ns"].append(ns)
            runs["processes_ns"].append(sum(b[1] for b in both) / 2)
            runs["ns_ratio"].append(sum(b[1] for b in both) / 2 / ns)
        found.append({"scene": scene, "inside": inside} | {key: summary(values) for key, values in runs.items()})
    return found


def two_processes(program, scene: str, percent: int) -> list[list[float]]:
    """The numbers of two processes of one thread that run at the same time."""
    command = [str(program), scene, "1", str(percent)]
    pair = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True) for _ in range(2)]
    return [[float(x) for x in p.communicate()[0].split()[3:]] for p in pair]


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
