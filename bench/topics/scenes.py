# SPDX-License-Identifier: BSD-3-Clause
"""Scenes of the library beside hand-fused programs."""

import ctypes
import sys
from collections.abc import Callable
from functools import partial

import numpy as np
from scenes import SCENES, library, wave
from timing import in_turn

from .tools import Setting, at_least, ratio, spread, summary, table

#: name -> scene, scheme, function of bench/limits, its parameters, steps, fraction of its speed to reach
ROWS = {
    "kubo_midpoint": (SCENES["kubo"], "midpoint", "limit_kubo", ("a", "sigma"), 60000, 0.93),
    "synchrotron_midpoint": (
        *(SCENES["synchrotron"], "midpoint", "limit_synchrotron"),
        *(("omega", "sigma1", "sigma2"), 8000, 0.83),
    ),
    "fpu64_midpoint": (
        *(SCENES["fpu_chain"].of(sigma=0.1), "midpoint", "limit_fpu_chain"),
        *(("beta", "sigma"), 200, 0.95),
    ),
    "phi4_64_verlet": (SCENES["phi4_ring"], "stormer_verlet", "limit_phi4_verlet", ("sigma",), 400, 0.77),
    "phi4_64_gauss": (SCENES["phi4_ring"], "gauss_dkdkd", "limit_phi4_gauss", ("sigma",), 400, 0.77),
}
PATHS, STEP = 2048, 0.02
COMPARED = 800  #: steps at most after which both are compared: roundings part near the separatrix later on
LANES = {"limit_phi4_verlet": 8, "limit_phi4_gauss": 8}  #: paths of a block of states that a program returns, else 32


def measure(setting: Setting) -> list[dict]:
    """Run the scenes of the library and their limit programs in turn."""
    programs, found = setting.programs, []
    for name, (scene, scheme, function, parameters, usual, target) in ROWS.items():
        n, steps = scene.ndof, max(8, usual // (40 if setting.quick else 8) * 8)
        q0, given = wave(n), np.array([scene.values[x] for x in parameters])
        lanes = LANES.get(function, 32)
        ends = np.empty((2, PATHS // lanes, n, lanes))  # programs return states block by block
        arrays = [ctypes.c_void_p(x.ctypes.data) for x in (given, q0, *ends)]
        model = scene.model() if scene.name else scene.formula()
        ours = library(model, scheme, PATHS, STEP, q0=q0, seed=1)
        limit = partial(_limit, getattr(programs, function), n, arrays)
        compared = min(steps, COMPARED)
        limit(compared)
        apart = np.abs(ours(compared).q[-1] - ends[0].transpose(1, 0, 2).reshape(n, PATHS)).max()
        if not apart < 1e-6:
            sys.exit(f"{name}: library and limit program are {apart} apart after {compared} steps")
        times = in_turn((partial(ours, steps), partial(limit, steps)), setting.repeats)
        ns = [[1e9 * x / (PATHS * steps) for x in kind] for kind in times]
        found.append({"name": name, "library_ns": summary(ns[0]), "limit_ns": summary(ns[1]), "ratio": ratio(*ns),
                      "fraction": 1 / ratio(*ns), "target": target})  # fmt: skip
    return found


def _limit(program: Callable, n: int, arrays: list, steps: int) -> None:
    """Run so many steps of a limit program from its start."""
    sizes = (ctypes.c_int64(PATHS), ctypes.c_int64(steps), ctypes.c_int(n), ctypes.c_int64(1), ctypes.c_double(STEP))
    program(*sizes, *arrays)


def section(scenes: list[dict]) -> str:
    """Write the section."""
    rows = [
        [
            s["name"],
            spread(s["library_ns"]),
            spread(s["limit_ns"]),
            f"{s['ratio']:.2f}",
            f"{s['fraction']:.2f}",
            *at_least(s["fraction"], s["target"]),
        ]
        for s in scenes
    ]
    heads = ["scene", "library [ns]", "limit [ns]", "library/limit", "fraction", "target", ""]
    return (
        "## Scenes beside hand-fused programs\n\n"
        "The table gives ns of processor time for a step of a path on one thread: the median (least .. largest)\n"
        "of runs that alternate between library and [limit program](words.md#limit-program). Those of\n"
        "bench/limits have the same scheme, generator and arithmetic, but no status, checks and observers. The\n"
        "fraction is the time of the limit program over that of the library.\n\n" + table(heads, rows)
    )
