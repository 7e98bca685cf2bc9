# SPDX-License-Identifier: BSD-3-Clause
"""One package on one task, in a process and an interpreter of its own: worker.py MODULE FOLDER.

FOLDER/task.json and FOLDER/dw.npy (step, noise, path) hold the task; FOLDER/result.json and end.npy get the result.
A module has VERSION and SCHEMES, name -> prepare(problem, steps, dw), which gives a `Prepared`, or None if the package
cannot do the task.
"""

from __future__ import annotations

import importlib
import json
import os
import sys
import time
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
if __name__ == "__main__":
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})  # all threads share one processor
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np

from peers.equations import PROBLEMS

REPEATS = 3


def main(module: str, folder: str) -> None:
    """Run and time every scheme."""
    package = importlib.import_module(f"peers.{module}")
    place = Path(folder)
    task = json.loads((place / "task.json").read_text())
    found = {"version": package.VERSION, "rows": []}
    if task:
        dw = np.load(place / "dw.npy")
        for name, prepare in package.SCHEMES.items():
            prepared = prepare(PROBLEMS[task["problem"]], task["steps"], dw)
            if prepared is None:
                continue
            begin = time.process_time()
            end = prepared.run()
            first = time.process_time() - begin
            seconds = prepared.seconds or min(_timed(prepared.run) for _ in range(REPEATS)) / prepared.paths
            found["rows"].append({"scheme": name, "seconds": seconds, "first": first, "error": prepared.error})
            if end is not None:
                np.save(place / f"end-{len(found['rows']) - 1}.npy", end)
    (place / "result.json").write_text(json.dumps(found))


def _timed(run) -> float:
    begin = time.process_time()
    run()
    return time.process_time() - begin


if __name__ == "__main__":
    main(*sys.argv[1:])
