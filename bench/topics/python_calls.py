# SPDX-License-Identifier: BSD-3-Clause
"""Time and memory that the Python package adds to a call.

Calls: ms of a run of one path and one step through `symsde` and through a C call with prepared arguments, in turn.
Steps: us of one call on one path. Observed: ns a path-step of moments of 1000 paths, every step saved, without and with
an observable in Python, or 50 by formula. Files: seconds of a run of 8 MB into a file. Memory: growth of this process's
peak resident memory in a large run, over the size of the results.
"""

import ctypes
import re
import statistics
import sys
import tempfile
from pathlib import Path

import numpy as np
import symsde as ss
from symsde.native import abi, handles
from symsde.native.checks import address
from symsde.native.library import library
from timing import in_turn, least

from .tools import Setting, at_most, spread, summary, table

MODEL = ss.models.kubo()
HOW = {"q0": 1.0, "p0": 0.0, "step": 0.02, "steps": 1, "threads": 1}
CALLS = 200
ADDED = 1.0  # ms of a call
STEPS = {
    "ss.simulate of one step": 40.0,
    "ss.step": 40.0,
    "prepared run.step()": 10.0,
    "prepared run.step(dw)": 10.0,
}  # us
OBSERVED = 17.6  # ns a path-step with every step saved and an observable in Python: twice a loop in numba
GROWN = 1.05  # allowed peak memory over the size of the results


def prepared_simulate():
    """The same run as a call of the C interface alone."""
    run = ss.simulate(MODEL, **HOW)
    paths = handles.new(abi.Paths, "paths")
    for name, *_ in abi.Paths._fields_[1:]:
        setattr(paths, name, address(getattr(run, name)))
    return prepared(run, library.symsde_simulate, paths)


def prepared_moments():
    """The same moments as a call of the C interface alone."""
    run = ss.moments(MODEL, **HOW)
    moments = handles.new(abi.Moments, "moments")
    moments.t, moments.n_ok = address(run.t), address(run.n_ok)
    for member, kind in (("mean", "mean"), ("variance", "var"), ("se_mean", "se_mean")):
        setattr(moments, member, address(run._tables[kind]))
    return prepared(run, library.symsde_compute_moments, moments)


def prepared(run, function, result):
    """A call without arguments that calls one function of the C interface."""
    setup, report = run.setup, handles.new(abi.Report, "report")
    given, model = setup.input(), setup.model._handles.take()
    arguments = (model.pointer, *setup.handles(), *(ctypes.byref(struct) for struct in (given, result, report)), None)

    def call(keep=(run, given, model, result, report, arguments)):
        if function(*arguments) != 0:
            sys.exit("a prepared call failed")
        return keep

    return call


def measure(setting: Setting) -> dict:
    """Time calls, and measure memory."""
    repeats = max(5, setting.repeats)
    return {
        "call": {
            "simulate": added(lambda: ss.simulate(MODEL, **HOW), prepared_simulate(), repeats),
            "moments": added(lambda: ss.moments(MODEL, **HOW), prepared_moments(), repeats),
        },
        "step": steps_of_few_paths(repeats),
        "observed": observed_steps(repeats),
        "files": files(repeats),
        "memory": large_runs(),
    }


def many(call):
    """Seconds of CALLS calls."""
    return lambda: [call() for _ in range(CALLS)]


def added(by_python, by_c, repeats) -> list[float]:
    """ms: the median of the differences; then median, least and largest of both."""
    times = [[1e3 * x / CALLS for x in kept] for kept in in_turn((many(by_python), many(by_c)), repeats)]
    difference = statistics.median(a - b for a, b in zip(*times, strict=True))
    return [difference, *summary(times[0]), *summary(times[1])]


def steps_of_few_paths(repeats) -> dict[str, float]:
    """us of one step, called in four ways."""
    how = {"q0": 1.0, "p0": 0.0, "step": 0.02, "threads": 1}
    run = ss.prepare(MODEL, **how)
    calls = (
        lambda: ss.simulate(MODEL, steps=1, **how),
        lambda: ss.step(MODEL, "midpoint", 1.0, 0.0, 0.02, 0.1, threads=1),
        run.step,
        lambda: run.step(0.1),
    )
    times = in_turn([many(call) for call in calls], repeats)
    return {name: 1e6 * min(kept) / CALLS for name, kept in zip(STEPS, times, strict=True)}


def observed_steps(repeats) -> dict[str, float]:
    """ns of a path-step that saving every step adds, without and with an observable in Python."""
    paths, steps = 1000, 500
    how = {"q0": 1.0, "p0": 0.0, "step": 0.02, "steps": steps, "paths": paths, "threads": 1}
    radius = {"radius": lambda q, p: q[0] ** 2 + p[0] ** 2}
    many = {f"f{k}": f"q**2 + {k}*p" for k in range(50)}
    ways = {
        "last step only": {"save_every": steps},
        "every step": {},
        "every step and observable": {"observables": radius},
        "every step, 50 formulas": {"observables": many},
    }
    times = in_turn([lambda chosen=chosen: ss.moments(MODEL, **how, **chosen) for chosen in ways.values()], repeats)
    return {name: 1e9 * min(kept) / (paths * steps) for name, kept in zip(ways, times, strict=True)}


def files(repeats) -> dict[str, float]:
    """Seconds that a run of 8 MB takes into a file, for each kind that can be written here."""
    run = ss.simulate(MODEL, **HOW | {"steps": 1023, "paths": 512})
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        for ending in (".npz", ".nc"):
            target = Path(folder) / f"run{ending}"
            try:
                run.save(target)
            except ss.SymsdeError:
                continue  # netCDF needs xarray or scipy
            found[ending] = least({ending: lambda target=target: run.save(target)}, repeats)[ending]
    return found


def peak() -> int:
    """Peak resident memory of this process, in bytes; ru_maxrss would begin with the peak of its parent."""
    return 1024 * int(re.search(r"VmHWM:\s*(\d+)", Path("/proc/self/status").read_text())[1])


def grown(run) -> tuple:
    """Bytes by which the peak grows in a run, and the run's result."""
    before = peak()
    result = run()
    return peak() - before, result


def large_runs() -> dict[str, list[float]]:
    """MB that a run returns, and growth of the peak over the size of what it returns."""
    found = {}
    for name, steps in (("saved paths", 3000), ("saved paths, increments given", 6000)):
        given = {}
        if "given" in name:
            given["increments"] = np.full((steps, 1, 4096), 0.01)  # touches its pages before the run
        how = {"step": 0.02, "paths": 4096, "threads": 1, "steps": steps, **given}
        growth, run = grown(lambda how=how: ss.simulate(MODEL, q0=1.0, p0=0.0, **how))
        size = run.q.nbytes + run.p.nbytes
        found[name] = [size / 2**20, growth / size]
        del run
    return found


def section(found: dict) -> str:
    """Write the section."""
    calls = [
        [name, spread(x[1:4]), spread(x[4:7]), f"{x[0]:.3f}", *at_most(x[0], ADDED)]
        for name, x in found["call"].items()
    ]
    steps = [[name, f"{us:.1f}", *at_most(us, STEPS[name])] for name, us in found["step"].items()]
    observed = [
        [name, f"{ns:.1f}", *at_most(ns, OBSERVED if name.endswith("observable") else None)]
        for name, ns in found["observed"].items()
    ]
    kept = " and ".join(f"{1e3 * seconds:.3g} ms as `{ending}`" for ending, seconds in found["files"].items())
    memory = [[name, f"{mb:.0f}", f"{x:.3f}", *at_most(x, GROWN)] for name, (mb, x) in found["memory"].items()]
    return (
        "## Calls from Python\n\n"
        "The table gives ms of processor time for a run of one path and one step. Runs alternate with a call of the C "
        "interface that was prepared beforehand.\n\n"
        + table(["function", "from Python [ms]", "C interface [ms]", "added [ms]", "target", ""], calls)
        + "\n\n"
        "The next table gives µs of processor time for one step of one path (kubo, midpoint), the least of all "
        "repeats.\n\n" + table(["call", "time [µs]", "target", ""], steps) + "\n\n"
        "The next table gives ns for a step of a path, for moments of 1000 paths (kubo, midpoint) over 500 steps.\n\n"
        + table(["what is saved", "time [ns]", "target", ""], observed)
        + "\n\n"
        f"A run of 8 MB is written to a file in {kept}.\n\n"
        "The last table gives the growth of the peak memory of the process in a large run, divided by the size of the "
        "arrays that it returns. A ratio of 1 means that memory holds the results once, and nothing else that is large."
        "\n\n" + table(["run", "returned [MB]", "growth of peak / returned", "target", ""], memory)
    )
