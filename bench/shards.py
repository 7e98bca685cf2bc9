# SPDX-License-Identifier: BSD-3-Clause
"""The cost of shards, several processes and observers, in processor time, for docs/cluster.md and docs/observers.md.

    .venv/bin/python bench/shards.py shards      # folders of 1 shard and of as many as are chosen beside one call
    .venv/bin/python bench/shards.py longer      # the same for 5 and 30 times the paths, one run each
    .venv/bin/python bench/shards.py weak        # 2 processes, and 2 ranks of MPI, with twice the paths beside one
    .venv/bin/python bench/shards.py observers   # ns a path and saved time of each observer

Processor time of the process and its children, the least of REPEATS runs in turn (SYMSDE_REPEATS, 5 by default): other
work on the machine disturbs it less than the clock, but a figure for a page wants a quiet machine.
"""

import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import symsde as ss
from symsde.cli import command_line
from timing import least

REPEATS = int(os.environ.get("SYMSDE_REPEATS", "5"))
PATHS, STEPS, EVERY = 131072, 4000, 200
SCENE = """
[model]
name = "synchrotron"
[run]
step = 0.02
steps = {STEPS}
save_every = {EVERY}
paths = {paths}
q0 = 0.0
p0 = 0.1
seed = 1
threads = 1
"""


def seconds() -> float:
    """Processor time of this process and of its children that have ended."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(x.ru_utime + x.ru_stime for x in used)


def shards(paths: int = PATHS, repeats: int = REPEATS) -> None:
    """One call of the library, a folder with one shard, and a folder with the default number of shards."""
    run = {"q0": 0.0, "p0": 0.1, "step": 0.02, "steps": STEPS, "save_every": EVERY, "paths": paths, "seed": 1}
    model = ss.models.synchrotron()

    def folder(size: int) -> None:
        with tempfile.TemporaryDirectory() as place:
            scene = Path(place) / "scene.toml"
            scene.write_text(SCENE.format(STEPS=STEPS, EVERY=EVERY, paths=paths))
            chosen = ["--shard-paths", str(size)] if size else []
            assert command_line.main(["run", str(scene), "--out", f"{place}/out", *chosen, "--quiet"]) == 0

    ways = {
        "one call": lambda: ss.moments(model, threads=1, **run),
        "1 shard": lambda: folder(1 << (paths - 1).bit_length()),
        "its choice": lambda: folder(0),
    }
    found = least(ways, repeats, seconds)
    for name, x in found.items():
        print(f"{name:10s} {x:7.3f} s   {x / found['one call']:.3f} of one call, {x / found['1 shard']:.3f} of 1 shard")


def longer() -> None:
    """Runs of 10 s and of a minute."""
    shards(5 * PATHS, 1)
    shards(30 * PATHS, 1)


def weak() -> None:
    """Processor time and elapsed time per path for one process, for two processes that share a folder, and for two MPI
    ranks.
    """

    def processes(count: int, launcher: tuple[str, ...] = ()) -> None:
        with tempfile.TemporaryDirectory() as place:
            scene = Path(place) / "scene.toml"
            scene.write_text(SCENE.format(STEPS=STEPS, EVERY=EVERY, paths=count * PATHS))
            given = [*launcher, sys.executable, "-m", "symsde", "run", str(scene), "--out", f"{place}/out", "--quiet"]
            given += ["--shard-paths", str(PATHS // 8)]
            started = [subprocess.Popen(given) for _ in range(1 if launcher else count)]
            assert all(process.wait() == 0 for process in started)

    ways = {"1 process": lambda: processes(1), "2 processes": lambda: processes(2)}
    beside = Path(sys.executable).with_name("mpirun")  # the mpirun of mpi4py's wheels, or else the system's
    if mpirun := str(beside) if beside.exists() else shutil.which("mpirun"):
        os.environ |= {"OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1"}
        ways["1 rank"] = lambda: processes(1, (mpirun, "-n", "1"))
        ways["2 ranks"] = lambda: processes(2, (mpirun, "-n", "2"))
    for what, clock in (("processor time", seconds), ("by the clock", time.perf_counter)):
        found = least(ways, REPEATS, clock)
        one = found["1 process"]
        for name, x in found.items():
            work = int(name[0]) if clock is seconds else 1  # two processes work at a time
            print(f"{what:15s} {name:12s} {x:.3f} s, weak efficiency {work * one / x:.3f} of one process")


def observers() -> None:
    """Measure moments with each observer, and without observers."""
    o = ss.observe
    wanted = {
        "histogram, 100 bins": o.Histogram("q_1", -3, 3, 100),
        "quantiles, 5120 bins": o.Quantiles("q_1"),
        "covariance of 2 values": o.Covariance(("q_1", "p_1")),
        "autocorrelation, 20 lags": o.Autocorrelation("q_1", lags=20),
        "extremes": o.Extremes("q_1"),
        "4 chosen paths": o.Paths((0, 1, 1000, 4000)),
        "passage, a step, with bridges": o.Passage("p_1", within=50.0, absorb=False),
        "passage, a step, without": o.Passage("p_1", within=50.0, absorb=False, bridge=False),
    }
    model, run = ss.models.synchrotron(), {"q0": 0.0, "p0": 0.1, "step": 0.02, "steps": 200, "paths": 4096}

    def times(many: int, **options) -> float:
        """Seconds of repeated runs, so many that the system's clock is fine enough."""
        for _ in range(many):
            ss.moments(model, threads=1, **run, **options)

    ways = {"moments alone": lambda: times(10)}
    ways |= {name: lambda x=x: times(10, observers={"it": x}) for name, x in wanted.items()}
    formula = {"r": "sqrt(q1**2 + p1**2)"}
    ways["an observable by a formula"] = lambda: times(10, observables=formula)
    ways["the same in Python"] = lambda: times(10, observables={"r": lambda q, p: (q[0] ** 2 + p[0] ** 2) ** 0.5})
    ways["no saved time"] = lambda: times(10, save_every=200)
    found = least(ways, REPEATS, seconds)
    each = 1e9 / (10 * 4096 * 201)
    print(f"{'moments, over steps alone':32s} {each * (found['moments alone'] - found.pop('no saved time')):6.1f} ns")
    alone = found.pop("moments alone")
    for name, x in found.items():
        print(f"{name:32s} {each * (x - alone):6.1f} ns")


if __name__ == "__main__":
    chosen = {"shards": shards, "weak": weak, "observers": observers, "longer": longer}
    for name in sys.argv[1:] or ("shards", "weak", "observers"):
        chosen[name]()
