# SPDX-License-Identifier: BSD-3-Clause
"""Implicit schemes of several stages beside the midpoint rule.

Chains begin from a smooth wave; steps are those at which h times the fastest frequency of small waves, 2, is mild (0.2,
0.5) and stiff (10).
"""

import warnings
from functools import partial

import numpy as np
from scenes import SCENES, library
from timing import least, seconds_of

from .tools import Setting, at_most, table, words

SCHEMES = ("midpoint", "gauss2", "gauss3", "lobatto3", "gauss2_strong32")
STIFF = ("midpoint", "gauss2", "gauss3", "gauss2_strong32")  # lobatto3 is unstable there
LONG = (64, 256, 1024, 4096)
LASTING = 200.0  # longest time of a run: noise heats the chain, so mild steps become stiff
#: Allowed cost of a step in midpoint steps, for mild and for stiff steps.
TARGETS = {"gauss2": (4.0, 8.0)}
OTHERS = (10.0, 20.0)


def chain(n: int) -> tuple:
    """A chain of n sites and its first state."""
    i = np.arange(n)
    return SCENES["fpu_chain"].of(sites=n, sigma=0.1), 0.3 * np.sin(0.7 * i + 0.3), 0.3 * np.cos(1.3 * i)


#: (scene, first state, noise), and steps
ROWS = [
    ((SCENES["synchrotron"], 0.5, 0.2), (0.1, 0.25)),
    ((SCENES["driven_pendulum"], 0.5, 0.2), (0.02, 0.1)),
    ((SCENES["pendulum"], 0.5, 0.2), (0.02, 0.1)),
    ((SCENES["henon_heiles"].of(alpha=0.1, sigma1=0.1, sigma2=0.1), [0.3, 0.2], [0.1, 0.3]), (0.1, 0.5)),
    *((chain(n), (0.1, 0.25, 5.0)) for n in (2, 4, 8, 16, 64)),
]


def measure(setting: Setting) -> dict:
    """Ratios to the midpoint rule, and the growth of time with long chains."""
    warnings.simplefilter("ignore")
    found: dict = {"rows": [], "growth": []}
    repeats = 3 if setting.quick else setting.repeats
    for scene, steps in ROWS:
        for h in steps:
            ns, reports = times(scene, SCHEMES if h < 1 else STIFF, h, 256, repeats)
            for scheme in [name for name in ns if name != "midpoint"]:
                c = reports[scheme].counters
                found["rows"].append(
                    {
                        "model": scene[0].name,
                        "ndof": scene[0].ndof,
                        "h": h,
                        "scheme": scheme,
                        "ns": ns[scheme],
                        "ratio": ns[scheme] / ns["midpoint"],
                        "iterations": c["iterations"] / c["path_steps"],
                        "lapack": c["lapack_solves"],
                    }
                )
    for n in LONG:
        ns, _ = times(chain(n), SCHEMES[:4], 0.25, 16, max(3, repeats // 2))
        found["growth"] += [{"ndof": n, "scheme": scheme, "ns": ns[scheme] / n} for scheme in SCHEMES[:4]]
    return found


def times(scene: tuple, schemes: tuple[str, ...], h: float, paths: int, repeats: int) -> tuple[dict, dict]:
    """Least ns of a path-step for every scheme, all in turn, and the reports."""
    it, q0, p0 = scene
    model = it.model()
    runs = {scheme: library(model, scheme, paths, h, q0=q0, p0=p0) for scheme in schemes}
    slowest = max(seconds_of(partial(run, 10)) for run in runs.values()) / (10 * paths)
    steps = int(min(2000, LASTING / h, max(10, 0.03 / (slowest * paths))))
    found = least({scheme: partial(run, steps) for scheme, run in runs.items()}, repeats)
    reports = {scheme: run(steps).report for scheme, run in runs.items()}
    return {scheme: 1e9 * seconds / (steps * paths) for scheme, seconds in found.items()}, reports


def section(found: dict) -> str:
    """Write the section."""
    return (
        "## Several implicit stages\n\n"
        "The table gives ns of processor time for a step of a path, with 256 paths on one thread, the least of\n"
        'repeats that alternate with the midpoint rule. The column "midpoints" is the ratio to the midpoint rule.\n'
        "Steps of $h = 5$ are stiff ($h\\omega\\ge 10$); `lobatto3` is unstable there.\n\n"
        + table_of(found["rows"])
        + "\n\n"
        + growth_of(found["growth"])
    )


def table_of(rows: list[dict]) -> str:
    """The table of all scenes."""
    heads = ["model", "ndof", "h", "scheme", "ns", "midpoints", "iterations", "LAPACK", "target", ""]
    return table(
        heads,
        [
            [
                words(r["model"]),
                str(r["ndof"]),
                f"{r['h']:g}",
                r["scheme"],
                f"{r['ns']:.3g}",
                f"{r['ratio']:.2f}",
                f"{r['iterations']:.1f}",
                str(r["lapack"]),
                *at_most(r["ratio"], TARGETS.get(r["scheme"], OTHERS)[r["h"] > 1]),
            ]
            for r in rows
        ],
    )


def growth_of(rows: list[dict]) -> str:
    """The table of time a site in long chains."""
    schemes = list(dict.fromkeys(r["scheme"] for r in rows))
    sizes = list(dict.fromkeys(r["ndof"] for r in rows))
    times = {(r["ndof"], r["scheme"]): f"{r['ns']:.3g}" for r in rows}
    return "Long chains, 16 paths, $h = 0.25$, ns for a step of a path and a site:\n\n" + table(
        ["sites", *schemes], [[str(n), *(times[n, s] for s in schemes)] for n in sizes]
    )
