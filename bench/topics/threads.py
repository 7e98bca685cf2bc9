# SPDX-License-Identifier: BSD-3-Clause
"""Two threads beside two independent processes of one thread."""

import statistics
import subprocess

from .tools import Setting, lines_of, spread, summary, table


def measure(setting: Setting) -> dict:
    """Run both in turn."""
    program = setting.bench / "bench_growth"
    threads, processes = [], []
    for _ in range(2 if setting.quick else max(5, setting.repeats)):
        threads.append(float(lines_of(program, "load", 2)[0][2]))
        pair = [subprocess.Popen([str(program), "load", "1"], stdout=subprocess.PIPE, text=True) for _ in range(2)]
        processes.append(sum(float(p.communicate()[0].split()[2]) for p in pair))
    return {
        "two_threads_per_s": statistics.median(threads),
        "two_processes_per_s": statistics.median(processes),
        "ratio": summary([a / b for a, b in zip(threads, processes, strict=True)]),
    }


def section(found: dict) -> str:
    """Write the section."""
    row = [f"{found['two_threads_per_s']:.3e}", f"{found['two_processes_per_s']:.3e}", spread(found["ratio"])]
    return "## Threads\n\nSynchrotron midpoint, path-steps per second; medians of runs in turn.\n\n" + table(
        ["two threads", "two processes of one thread", "ratio"], [row]
    )
