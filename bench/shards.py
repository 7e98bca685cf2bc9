# SPDX-License-Identifier: BSD-3-Clause
"""What shards, several processes and observers cost, in processor time, for docs/cluster.md and docs/observers.md.

    .venv/bin/python bench/shards.py shards      # folders of 1 shard and of as many as are chosen beside one call
    .venv/bin/python bench/shards.py weak        # 2 processes with twice the paths beside one
    .venv/bin/python bench/shards.py observers   # ns a path and saved time of each observer

Processor time of the process and its children, the least of REPEATS runs in turn (SYMSDE_REPEATS, 5 by default): other
work on the machine disturbs it less than the clock, but a figure for a page wants a quiet machine.
"""

import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

import symsde as ss
from symsde import cli

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


def least(ways: dict) -> dict[str, float]:
    """Seconds of each way, the least of several in turn."""
    found = dict.fromkeys(ways, float("inf"))
    for _ in range(REPEATS):
        for name, way in ways.items():
            begin = seconds()
            way()
            found[name] = min(found[name], seconds() - begin)
    return found


def shards() -> None:
    """One call of the library, a folder of one shard, and of as many as it chooses."""
    run = {"q0": 0.0, "p0": 0.1, "step": 0.02, "steps": STEPS, "save_every": EVERY, "paths": PATHS, "seed": 1}
    model = ss.models.synchrotron()

    def folder(size: int) -> None:
        with tempfile.TemporaryDirectory() as place:
            scene = Path(place) / "scene.toml"
            scene.write_text(SCENE.format(STEPS=STEPS, EVERY=EVERY, paths=PATHS))
            chosen = ["--shard-paths", str(size)] if size else []
            assert cli.main(["run", str(scene), "--out", f"{place}/out", *chosen, "--quiet"]) == 0

    ways = {
        "one call": lambda: ss.moments(model, threads=1, **run),
        "1 shard": lambda: folder(PATHS),
        "its choice": lambda: folder(0),
    }
    found = least(ways)
    for name, x in found.items():
        print(f"{name:10s} {x:7.3f} s   {x / found['one call']:.3f} of one call, {x / found['1 shard']:.3f} of 1 shard")


def weak() -> None:
    """Processor time a path of two processes that share a folder, beside one."""

    def processes(count: int) -> None:
        with tempfile.TemporaryDirectory() as place:
            scene = Path(place) / "scene.toml"
            scene.write_text(SCENE.format(STEPS=STEPS, EVERY=EVERY, paths=count * PATHS))
            given = [sys.executable, "-m", "symsde", "run", str(scene), "--out", f"{place}/out", "--quiet"]
            started = [subprocess.Popen([*given, "--shard-paths", str(PATHS // 8)]) for _ in range(count)]
            assert all(process.wait() == 0 for process in started)

    found = least({"1 process": lambda: processes(1), "2 processes": lambda: processes(2)})
    one, two = found.values()
    print(f"1 process {one:.3f} s, 2 processes with twice the paths {two:.3f} s: weak efficiency {2 * one / two:.3f}")


def observers() -> None:
    """Each observer beside moments alone."""
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
        """Again and again, so that the clock of the system is fine enough."""
        for _ in range(many):
            ss.moments(model, threads=1, **run, **options)

    ways = {"moments alone": lambda: times(10)}
    ways |= {name: lambda x=x: times(10, observers={"it": x}) for name, x in wanted.items()}
    formula = {"r": "sqrt(q1**2 + p1**2)"}
    ways["an observable by a formula"] = lambda: times(10, observables=formula)
    ways["the same in Python"] = lambda: times(10, observables={"r": lambda q, p: (q[0] ** 2 + p[0] ** 2) ** 0.5})
    ways["no saved time"] = lambda: times(10, save_every=200)
    found = least(ways)
    each = 1e9 / (10 * 4096 * 201)
    print(f"{'moments, over steps alone':32s} {each * (found['moments alone'] - found.pop('no saved time')):6.1f} ns")
    alone = found.pop("moments alone")
    for name, x in found.items():
        print(f"{name:32s} {each * (x - alone):6.1f} ns")


if __name__ == "__main__":
    chosen = {"shards": shards, "weak": weak, "observers": observers}
    for name in sys.argv[1:] or chosen:
        chosen[name]()
