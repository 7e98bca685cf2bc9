# SPDX-License-Identifier: BSD-3-Clause
"""variants.py LIBRARY OTHER...: nine scenes by several builds of the library, as ratios to the first one's time.

    .venv/bin/python bench/variants.py build/native/libsymsde.so SITE/symsde/glibc-hwcaps/x86-64-v4/libsymsde.so

compares a wheel unpacked in SITE with the native build. Each library runs in a process of its own, one
thread; the runs of a scene are taken in turn, and the least processor time of each counts. About twenty seconds for
each library. A library for older processors lacks fused multiply-add: a build for this machine with
-DSYMSDE_FP_CONTRACT=off shows how much of a ratio is due to it.
"""

import math
import os
import subprocess
import sys
import time
from pathlib import Path

SCENES = [
    ("kubo", "midpoint"),
    ("synchrotron", "midpoint"),
    ("synchrotron", "gauss2"),
    ("synchrotron", "lobatto3"),
    ("pendulum", "gauss2_strong32"),
    ("driven_pendulum", "chin4a"),
    ("henon_heiles", "stormer_verlet"),
    ("fpu_chain", "midpoint"),
    ("noncommutative_oscillator", "midpoint_areas"),
]
PATHS, STEP, TIME = 2048, 0.02, 8.0
ROUNDS, SECONDS = 7, 0.12  #: rounds of a scene, and seconds of each round


def main() -> int:
    """Start a process for each library, let them run in turn, print the table."""
    libraries = sys.argv[1:]
    if len(libraries) < 2 or not all(Path(name).is_file() for name in libraries):
        sys.exit(__doc__)
    workers = [start(name) for name in libraries]
    print(f"ns a path-step by {libraries[0]}, and times that by", *libraries[1:], sep="\n  ")
    worst = 0.0
    for scene, (model, scheme) in enumerate(SCENES):
        rounds = [[ask(worker, scene) for worker in workers] for _ in range(ROUNDS)]
        times = [min(column) for column in zip(*rounds, strict=True)]
        ratios = [mine / times[0] for mine in times[1:]]
        worst = max(worst, *ratios)
        print(f"{model + ', ' + scheme:42s}{times[0]:8.4g}", *(f"{ratio:7.3f}" for ratio in ratios), flush=True)
    for worker in workers:
        worker.stdin.close()
    print(f"at most {worst:.3f}")
    return 0


def start(library: str) -> subprocess.Popen:
    """A process with this library, which times scenes."""
    python = str(Path(__file__).resolve().parents[1] / "python")
    environment = os.environ | {"SYMSDE_LIBRARY": str(Path(library).resolve()), "PYTHONPATH": python}
    return subprocess.Popen(
        [sys.executable, __file__, "--work"], env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )


def ask(worker: subprocess.Popen, scene: int) -> float:
    """Nanoseconds of a path-step of a scene, measured once."""
    worker.stdin.write(f"{scene}\n")
    worker.stdin.flush()
    return float(worker.stdout.readline())


def work() -> None:
    """Time the requested scenes, one per line."""
    import symsde as ss  # noqa: PLC0415 - the library that the environment names

    steps = round(TIME / STEP)
    options = {"q0": 0.1, "p0": 0.1, "step": STEP, "steps": steps, "save_every": steps, "paths": PATHS, "seed": 1}
    runs: dict[str, int] = {}
    for line in sys.stdin:
        name, scheme = SCENES[int(line)]
        model = ss.models.get(name)

        def seconds(count: int, model: ss.Model = model, scheme: str = scheme) -> float:
            begin = time.process_time()
            for _ in range(count):
                found = ss.moments(model, scheme=scheme, threads=1, **options)
            assert found.n_ok[-1] == PATHS, model
            return time.process_time() - begin

        if line not in runs:
            seconds(1)  # a cold run, which does everything that is done once
            runs[line] = math.ceil(SECONDS / seconds(1))
        print(1e9 * seconds(runs[line]) / (runs[line] * steps * PATHS), flush=True)


if __name__ == "__main__":
    sys.exit(work() if sys.argv[1:] == ["--work"] else main())
