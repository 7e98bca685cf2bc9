# SPDX-License-Identifier: BSD-3-Clause
"""The main path of CONTRIBUTING: the callers of a force, for one path and for a thousand."""

import bisect
import ctypes
import os
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
import symsde as ss

ROOT = Path(__file__).parents[2]
LIBRARY = os.path.realpath(ss.native.library.library._name)
DEEPEST = 13  # most nested calls between simulate and the model
DEEPER = {"_midpoint": 3}  # further calls of midpoint steps between kicks
Numbers = ctypes.POINTER(ctypes.c_double)
Gradient = ctypes.CFUNCTYPE(ctypes.c_int, *3 * [ctypes.c_int], ctypes.c_double, *5 * [Numbers], ctypes.c_void_p)
Both = ctypes.CFUNCTYPE(ctypes.c_int, *3 * [ctypes.c_int], ctypes.c_double, *8 * [Numbers], ctypes.c_void_p)


def symbols():
    """Addresses and names of the library's procedures, sorted; empty for a stripped library."""
    if shutil.which("nm") is None:
        return []
    told = subprocess.run(["nm", "-n", LIBRARY], capture_output=True, text=True, check=False).stdout
    rows = [line.split() for line in told.splitlines()]
    return [(int(row[0], 16), row[2]) for row in rows if len(row) == 3 and row[1] in "tT"]


SYMBOLS = symbols()
if not any("_MOD_" in name for _, name in SYMBOLS):
    pytest.skip("the library has no names of procedures, or there is no nm", allow_module_level=True)


def callers():
    """The library's procedures on the stack of this call, outermost first."""
    found = (ctypes.c_void_p * 64)()
    n = ctypes.CDLL(None).backtrace(found, 64)
    maps = Path("/proc/self/maps").read_text(encoding="utf-8").splitlines()
    begin = min(int(line.split("-")[0], 16) for line in maps if LIBRARY in line)
    end = max(int(line.split()[0].split("-")[1], 16) for line in maps if LIBRARY in line)
    starts = [start for start, _ in SYMBOLS]
    inside = [at - begin for at in found[:n] if at is not None and begin <= at < end]
    return [SYMBOLS[bisect.bisect(starts, at) - 1][1] for at in reversed(inside)]


def traced(scheme, paths):
    """Names of the procedures that call a pendulum's force, for every call during steps."""
    seen = []

    def gradient(nlane, ndof, nham, t, w, q, p, hq, hp, user):  # noqa: PLR0917 - as C calls it
        seen.append(tuple(callers()))
        for lane in range(nlane):
            if hq:
                hq[lane] = w[lane] * np.sin(q[lane]) + w[nlane + lane] * np.cos(q[lane])
            if hp:
                hp[lane] = w[lane] * p[lane]
        return 0

    def gradient_hessian(nlane, ndof, nham, t, w, q, p, hq, hp, hqq, hqp, hpp, user):  # noqa: PLR0917 - as C calls it
        gradient(nlane, ndof, nham, t, w, q, p, hq, hp, user)
        for lane in range(nlane):
            if hqq:
                hqq[lane] = w[lane] * np.cos(q[lane]) - w[nlane + lane] * np.sin(q[lane])
            if hqp:
                hqp[lane] = 0
            if hpp:
                hpp[lane] = w[lane]
        return 0

    model = ss.Model(
        ndof=1,
        nnoise=1,
        gradient=Gradient(gradient),
        gradient_hessian=Both(gradient_hessian),
        separable=True,
        position_noise=True,
        identity_mass=True,
        any_lanes=True,
    )
    seen.clear()
    run = ss.simulate(model, q0=0.3, p0=0.1, step=0.1, steps=4, scheme=scheme, paths=paths, threads=1)
    assert run.report.lanes == (1 if paths == 1 else 256)
    return [calls for calls in seen if any("advance" in name for name in calls)]


def module_of(name):
    """The module of a procedure; for an instance of one lane, the module for blocks."""
    found = re.match(r"__(symsde_\w+?)_MOD_", name)
    return found[1].removesuffix("_single_path") if found else name


def page():
    """Modules in the order of the table; in place of a body the module beside it."""
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    table = text.split("## The main path")[1].split("\n## ")[0]
    files = re.findall(r"^\| `src/([\w/]+)\.(f90|inc)`", table, re.MULTILINE)
    assert len(files) == table.count("\n| `")
    assert all((ROOT / "src" / f"{file}.{kind}").is_file() for file, kind in files)
    return ["symsde_" + file.replace("/", "_") for file, _ in files]


def of_library(call):
    """The modules of a call from the driver, which C calls, to the model."""
    modules = [module_of(name) for name in call]
    first = next(i for i, module in enumerate(modules) if module.startswith("symsde_ensemble"))
    return modules[first : next(i for i, module in enumerate(modules) if module.startswith("symsde_model"))]


@pytest.mark.parametrize("paths", [1, 1000])
@pytest.mark.parametrize("scheme", ["midpoint", "stormer_verlet"])
def test_the_page_is_the_way_of_a_step(scheme, paths):
    _, *known = page()  # without Fortran's `simulate`, which C replaces here
    calls = traced(scheme, paths)
    assert calls
    for call in calls:
        modules = list(dict.fromkeys(of_library(call)))
        assert [module for module in modules if module in known] == known[: None if scheme == "midpoint" else -1]
        assert all(module in known or re.match(r"symsde_step_[a-z]+_", module) for module in modules)  # only steppers


@pytest.mark.skipif(not any(".isra" in name for _, name in SYMBOLS), reason="nothing was put in its caller's place")
@pytest.mark.parametrize("paths", [1, 1000])
def test_every_scheme_has_few_callers(paths):
    tried = 0
    for scheme in ss.schemes.names():
        try:
            calls = traced(scheme, paths)
        except ss.errors.IncompatibleError:
            continue  # this scheme refuses the pendulum, whose noise is not additive and which declares no frequencies
        tried += 1
        assert calls
        most = DEEPEST + sum(more for part, more in DEEPER.items() if part in scheme)
        for call in calls:  # the lists leave out simulate and the model, which are outside of the library here
            assert len(of_library(call)) + 1 <= most, (scheme, call)
    assert tried > 30
