# SPDX-License-Identifier: BSD-3-Clause
"""A model of a user beside the built-in one."""

import ctypes
import sys
from functools import partial

import numpy as np
import user_model
from scenes import library
from timing import in_turn

from .tools import ABSENT, Setting, at_most, ratio, spread, summary, table, words

NAMES = {
    "built-in": "built-in",
    "Fortran": "Fortran type",
    "C": "C functions",
    "numba": "numba cfunc",
    "numba_plain": "numba cfunc, plain",
    "numba_bare": "numba cfunc, plain, gradient alone",
    "NumPy": "NumPy functions",
    "hand": "NumPy loop by hand",
}
# Largest allowed ratio to the built-in model, or for NumPy functions to the loop by hand.
TARGETS = {"Fortran": 1.2, "C": 1.2, "numba": 1.5, "NumPy": 1.5}
STEPS = {"symplectic_euler": 5000, "midpoint": 2500}  #: number of steps of compiled models
SLOW = 100  #: steps of models in NumPy
STEP, PATHS, LANES = 0.02, 4096, 2048


def measure(setting: Setting) -> list[dict]:
    """Time all descriptions of the model in turn, with an explicit and an implicit scheme."""
    return [row for scheme in STEPS for row in compared(scheme, setting)]


def compared(scheme: str, setting: Setting) -> list[dict]:
    """ns of a path-step of each description, and the median ratio to the description it is compared with."""
    runs = {kind: run for kind, run in runs_of(scheme, setting).items() if run}
    expected = runs["built-in"](SLOW).q[-1, 0]
    for kind, run in runs.items():
        end = run(SLOW)
        end = end.q[-1, 0] if hasattr(end, "q") else end
        if end is not None and not np.abs(end - expected).max() <= 1e-10:
            sys.exit(f"the model of {kind} differs from the built-in one")
    steps = [SLOW if kind in ("NumPy", "hand") else STEPS[scheme] for kind in runs]
    calls = [partial(run, n) for run, n in zip(runs.values(), steps, strict=True)]
    times = in_turn(calls, max(5, setting.repeats))
    ns = {kind: [1e9 * x / (PATHS * n) for x in seconds] for kind, seconds, n in zip(runs, times, steps, strict=True)}
    return [
        {
            "scheme": words(scheme),
            "kind": kind,
            "ns": summary(values),
            "ratio": ratio(values, ns["hand" if kind == "NumPy" else "built-in"]),
        }
        for kind, values in ns.items()
    ]


def runs_of(scheme: str, setting: Setting) -> dict:
    """Runs of so many steps from (1, 0); None for numba if it is missing."""
    programs, numba = setting.programs, user_model.numba
    models = {
        "built-in": user_model.SCENE.model(),
        "C": user_model.in_c(programs),
        "numba": user_model.in_numba() if numba else None,
        "numba_plain": user_model.in_numba(plain=True) if numba else None,
        "numba_bare": user_model.in_numba(plain=True, bare=True) if numba else None,
        "NumPy": user_model.in_numpy(),
    }
    runs = {kind: model and library(model, scheme, PATHS, STEP, q0=1.0, seed=1) for kind, model in models.items()}

    def fortran(steps: int) -> np.ndarray:
        q, name = np.empty(PATHS), scheme.encode()
        size, paths, count = ctypes.c_int(len(name)), ctypes.c_int64(PATHS), ctypes.c_int64(steps)
        to = ctypes.c_void_p(q.ctypes.data)
        if programs.run_user_model(size, name, ctypes.c_double(STEP), paths, count, to) != 0:
            sys.exit(f"the Fortran model failed under {scheme}")
        return q

    return runs | {"Fortran": fortran, "hand": user_model.by_hand(scheme, STEP, PATHS, LANES)}


def section(found: list[dict]) -> str:
    """Write the section."""
    cells = [
        [
            r["scheme"],
            NAMES[r["kind"]],
            spread(r["ns"]),
            f"{r['ratio']:.2f}",
            *at_most(r["ratio"], TARGETS.get(r["kind"])),
        ]
        for r in sorted(found, key=lambda r: (r["scheme"] == "midpoint", list(NAMES).index(r["kind"])))
    ]
    return (
        "## Models of one's own\n\n"
        "The table compares the built-in synchrotron with the same model written by a user: ns of processor time for\n"
        "a step of a path, with 4096 paths on one thread. All variants alternate. The ratio is to the built-in\n"
        "model; for NumPy functions it is to the same NumPy loop written by hand, with arrays of the library's size.\n"
        "`bench/user_model.f90` and `bench/user_model.c` are compiled with -O3 -march=native, without -ffast-math.\n"
        "They and numba take sine and cosine from the library (`sincos_lanes`, `symsde_sincos`, `numba_sincos`) and\n"
        "give gradient and Hessian in one function, which an implicit scheme calls in every iteration. The plain\n"
        "variant takes sine and cosine from numba, which calls scalar ones for each [lane](words.md#lane). The\n"
        "gradient alone declares nothing: Hessians are differences, and no stepper knows what it may leave out.\n\n"
        + table(["scheme", "written as", "ns", "ratio", "target", ""], cells)
        + ("" if any(r["kind"] == "numba" for r in found) else f"\n\nnumba: {ABSENT}.")
    )
