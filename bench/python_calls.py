# SPDX-License-Identifier: BSD-3-Clause
"""What calls from Python cost; prints lines "call FUNCTION ADDED PYTHON C", "step WAY US", "observed WAY NS" and
"memory RUN MB RATIO".

python_calls.py REPEATS: ms of a run of one path and one step through `symsde` and through a call of the C interface
that was prepared beforehand, in turn: the median of the differences, then median, least and largest of both.
Step: us of processor time of one call on one path. Observed: ns a path-step of moments of 1000 paths, every step saved,
without and with an observable in Python. Memory: by how much the peak resident memory of this process grows in a large
run, over the size of what it returns.
"""

import ctypes
import re
import statistics
import sys
import time
from pathlib import Path

import numpy as np
import symsde as ss
from symsde.native import abi, handles
from symsde.native.checks import address
from symsde.native.library import library

MODEL = ss.models.kubo()
HOW = {"q0": 1.0, "p0": 0.0, "step": 0.02, "steps": 1, "threads": 1}
CALLS = 200


def prepared_simulate():
    """The same run as a bare call of the C interface."""
    run = ss.simulate(MODEL, **HOW)
    paths = handles.new(abi.Paths, "paths")
    for name, *_ in abi.Paths._fields_[1:]:
        setattr(paths, name, address(getattr(run, name)))
    return prepared(run, library.symsde_simulate, paths)


def prepared_moments():
    """The same moments as a bare call of the C interface."""
    run = ss.moments(MODEL, **HOW)
    moments = handles.new(abi.Moments, "moments")
    moments.t, moments.n_ok = address(run.t), address(run.n_ok)
    for member, kind in (("mean", "mean"), ("variance", "var"), ("se_mean", "se_mean")):
        setattr(moments, member, address(run._tables[kind]))
    return prepared(run, library.symsde_compute_moments, moments)


def prepared(run, function, result):
    """A call without arguments of one function of the C interface."""
    setup, report = run.setup, handles.new(abi.Report, "report")
    given, model = setup.input(), setup.model._handles.take()
    arguments = (model.pointer, *setup.handles(), *(ctypes.byref(struct) for struct in (given, result, report)), None)

    def call(keep=(run, given, model, result, report, arguments)):
        if function(*arguments) != 0:
            sys.exit("a prepared call failed")
        return keep

    return call


def added(name, by_python, by_c, repeats):
    """Print the line of a function."""
    times = [[], []]
    for _ in range(repeats):
        for call, kept in zip((by_python, by_c), times, strict=True):
            start = time.process_time()
            for _ in range(CALLS):
                call()
            kept.append((time.process_time() - start) * 1e3 / CALLS)
    difference = statistics.median(a - b for a, b in zip(*times, strict=True))
    numbers = [x for kept in times for x in (statistics.median(kept), min(kept), max(kept))]
    print("call", name, *(f"{x:.6f}" for x in (difference, *numbers)))


def shortest(call, calls, repeats):
    """The least processor time of a call, in seconds."""
    times = []
    for _ in range(repeats):
        start = time.process_time()
        for _ in range(calls):
            call()
        times.append((time.process_time() - start) / calls)
    return min(times)


def steps_of_few_paths(repeats):
    """Print what one step takes, called in four ways."""
    how = {"q0": 1.0, "p0": 0.0, "step": 0.02, "threads": 1}
    run = ss.prepare(MODEL, **how)
    ways = {
        "ss.simulate_of_one_step": lambda: ss.simulate(MODEL, steps=1, **how),
        "ss.step": lambda: ss.step(MODEL, "midpoint", 1.0, 0.0, 0.02, 0.1, threads=1),
        "prepared_run.step()": run.step,
        "prepared_run.step(dw)": lambda: run.step(0.1),
    }
    for name, call in ways.items():
        print("step", name, f"{shortest(call, CALLS, repeats) * 1e6:.3f}")


def observed_steps(repeats):
    """Print what saving every step takes, without and with an observable in Python."""
    paths, steps = 1000, 500
    how = {"q0": 1.0, "p0": 0.0, "step": 0.02, "steps": steps, "paths": paths, "threads": 1}
    radius = {"radius": lambda q, p: q[0] ** 2 + p[0] ** 2}
    for name, chosen in (
        ("last_step_only", {"save_every": steps}),
        ("every_step", {}),
        ("every_step_and_observable", {"observables": radius}),
    ):
        seconds = shortest(lambda chosen=chosen: ss.moments(MODEL, **how, **chosen), 1, repeats)
        print("observed", name, f"{seconds / (paths * steps) * 1e9:.3f}")


def peak():
    """Peak resident memory of this process, in bytes; ru_maxrss would begin with that of its parent."""
    return 1024 * int(re.search(r"VmHWM:\s*(\d+)", Path("/proc/self/status").read_text())[1])


def growth_of_peak(name, run, returned):
    """Print by how much the peak grows in a run, over the bytes of the arrays it returns."""
    before = peak()
    result = run()
    grown = peak() - before
    size = returned(result)
    print("memory", name, f"{size / 2**20:.1f} {grown / size:.4f}")


def main():
    """Print all lines."""
    repeats = int(sys.argv[1])
    added("simulate", lambda: ss.simulate(MODEL, **HOW), prepared_simulate(), repeats)
    added("moments", lambda: ss.moments(MODEL, **HOW), prepared_moments(), repeats)
    steps_of_few_paths(repeats)
    observed_steps(repeats)
    many = {"step": 0.02, "paths": 4096, "threads": 1}
    growth_of_peak(
        "saved_paths",
        lambda: ss.simulate(MODEL, q0=1.0, p0=0.0, steps=3000, **many),
        lambda run: run.q.nbytes + run.p.nbytes,
    )
    increments = np.zeros((6000, 1, 4096))  # its pages are touched here, before the run
    increments[:] = 0.01
    growth_of_peak(
        "saved_paths,_increments_given",
        lambda: ss.simulate(MODEL, q0=1.0, p0=0.0, steps=6000, increments=increments, **many),
        lambda run: run.q.nbytes + run.p.nbytes + run.setup.increments.nbytes,  # the run's own
    )


if __name__ == "__main__":
    main()
