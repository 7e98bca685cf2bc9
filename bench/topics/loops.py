# SPDX-License-Identifier: BSD-3-Clause
"""The library beside plain loops in numba."""

import functools
import importlib.util
import math
import re
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
import symsde as ss
from scenes import SCENES, Scene, library
from timing import Run, in_turn, ns_of_steps

from .tools import ABSENT, Setting, at_most, table, words

GROUPS = {
    "stages": "schemes of several stages, 256 paths",
    "many": "1000 paths",
    "few1": "1 path",
    "few2": "2 paths",
    "few8": "8 paths",
    "few32": "32 paths",
    "formula1": "formulas, 1 path",
    "formula_loop": "formulas, 1000 paths",
    "error": "1000 paths to an error, ns of a path",
    "saved": "1 path, every step saved",
    "saved1000": "1000 paths, every step saved",
    "given1": "1 path, increments given, beside those that the library draws",
    "given1000": "1000 paths, increments given, beside those that the library draws",
    "given_loop1": "1 path, increments given, beside a loop that reads them",
    "given_loop1000": "1000 paths, increments given, beside a loop that reads them",
    "saved_unsaved": "1 path, every step saved, beside the library without",
    "moments": "1000 paths, moments at every step",
    "call": "µs of a call; the target is a bound of the library's",
}
EXPLICIT, IMPLICIT = ("symplectic_euler", "stormer_verlet"), ("midpoint", "gauss2")
#: scenes and schemes that run with few paths
FEW = {
    "kubo": ("midpoint",),
    "synchrotron": (*IMPLICIT, "lobatto3", "symplectic_euler"),
    "additive_oscillator": ("symplectic_euler",),
    "linear_oscillator": ("midpoint",),
    "pendulum": ("stormer_verlet", *IMPLICIT),
    "noncommutative_oscillator": ("midpoint",),
    "henon_heiles": (*EXPLICIT, *IMPLICIT),
    "fpu64": (*IMPLICIT, "stormer_verlet"),
    "cfunc synchrotron": (*EXPLICIT, *IMPLICIT),
    "driven_pendulum": (*EXPLICIT, *IMPLICIT),
}
SAVED = (
    "kubo midpoint",
    "linear_oscillator midpoint",
    "pendulum stormer_verlet",
    "henon_heiles stormer_verlet",
)
GIVEN = (
    "kubo midpoint",
    "synchrotron stormer_verlet",
    *(f"pendulum {scheme}" for scheme in ("stormer_verlet", "midpoint", "gauss2")),
    "fpu8 stormer_verlet",
    "fpu64 stormer_verlet",
)
CALLS = 200  #: calls, for rows that time a call
# steps to T = 4 for a root-mean-square error of 1e-5 from q = 0.2, p = 0, against chin4a_strong2 with 2048 steps
STEPS = {"chin4a": 89, "taylor": 1500}


@dataclass(frozen=True)
class Row:
    """A comparison, with a function that makes its runs, so that only requested rows are compiled."""

    group: str
    name: str
    paths: int
    target: float
    make: Callable[[], tuple[Run, Run]]
    per_call: int = 0  # steps of a call, for rows that time a call


def rows() -> Iterator[Row]:
    """All comparisons."""
    for scheme in ("gauss2", "gauss3", "lobatto3"):
        for n in (2, 4, 8, 16, 64):
            yield Row("stages", f"{scheme} fpu{n}", 256, 1.0, partial(beside_loop, f"fpu{n} {scheme}", 256))
    for name in ("henon_heiles gauss2", "synchrotron lobatto3", "fpu64 midpoint"):
        yield Row("many", name, 1000, 1.0, partial(beside_loop, name, 1000))
    for name in (f"{model} {scheme}" for model, schemes in FEW.items() for scheme in schemes):
        for paths in (1, 2, 8, 32):
            yield Row(f"few{paths}", name, paths, 1.5, partial(beside_loop, name, paths))
        if not name.startswith("cfunc") and "lobatto" not in name:
            yield Row("formula1", name, 1, 1.2, partial(beside_loop, name, 1, formula=True))
    for group, paths, target in (("formula_loop", 1000, 1.0), ("formula1", 1, 1.2)):
        make = partial(beside_loop, "mean_field16 midpoint", paths, formula=True)
        yield Row(group, "mean_field16 midpoint", paths, target, make)
    for name in ("phi4_ring64 stormer_verlet", "fpu64 stormer_verlet"):
        yield Row("formula_loop", name, 1000, 0.556, partial(beside_loop, name, 1000, formula=True))
    yield Row("error", "synchrotron chin4a beside Taylor 3/2, rms 1e-5", 1000, 0.4, accurate)
    yield from rows_that_save()
    yield Row("moments", "kubo with an observable in Python", 1000, 1.5, observed)
    for name in ("kubo midpoint", "fpu64 midpoint"):
        yield Row("call", f"{name} 10 steps", 1, 40.0, partial(beside_loop, name, 1), per_call=10)


def rows_that_save() -> Iterator[Row]:
    """Time runs that save, loops that save, and runs of the library that do not."""
    for name in SAVED:
        yield Row("saved", name, 1, 1.5, partial(beside_loop, name, 1, keep="states"))
    for name in ("kubo midpoint", "pendulum stormer_verlet"):
        yield Row("saved1000", name, 1000, 1.5, partial(beside_loop, name, 1000, keep="states"))
    for paths, target in ((1, 1.5), (1000, 2.0)):
        for name in ("kubo midpoint", "fpu64 stormer_verlet"):
            yield Row(f"given{paths}", name, paths, target, partial(given_or_own, name, paths))
        for name in GIVEN:
            yield Row(f"given_loop{paths}", name, paths, 1.0, partial(given_to_both, name, paths))
    for name in (*SAVED, "synchrotron midpoint", "cfunc synchrotron midpoint"):
        yield Row("saved_unsaved", name, 1, 1.5, partial(saved_or_not, name))


def found(name: str) -> tuple[Scene, Callable[[], ss.Model], str]:
    """Scene, function that makes its model, and scheme of a row's name; digits in the name are the number of sites."""
    *kinds, model, scheme = name.split()
    model, sites = re.fullmatch(r"(.*?)_?(\d*)", model).groups()
    scene = SCENES["fpu_chain" if model == "fpu" else model]
    scene = scene.of(sites=int(sites), **({"N": int(sites)} if "N" in scene.parameters else {})) if sites else scene
    if not kinds:
        return scene, scene.model, scheme
    import user_model  # noqa: PLC0415 - it needs numba

    return scene, partial(user_model.in_numba, plain=True), scheme


def beside_loop(name: str, paths: int, keep: str = "nothing", formula: bool = False) -> tuple[Run, Run]:
    """Time the library and a loop of the same scheme; keep: as in `loops.loop`."""
    scene, maker, scheme = found(name)
    save = {} if keep == "nothing" else {"save_every": 1}
    q0 = 0.2 * np.cos(np.arange(scene.ndof)) if "mean_field" in name else 0.2
    ours = library(scene.formula() if formula else maker(), scheme, paths, scene.step, q0=q0, **save)
    return ours, loop(scene, scheme, paths, scene.step, q0=q0, keep=keep)


def loop(scene: Scene, scheme: str, paths: int, step: float, *, q0=0.2, keep: str = "nothing") -> Run:
    """Runs of a numba loop."""
    import loops  # noqa: PLC0415 - it needs numba

    generator, run = np.random.default_rng(1), loops.loop(scene, scheme, keep)
    q0, p0 = np.broadcast_to(q0, scene.ndof).copy(), np.zeros(scene.ndof)
    return lambda steps: run(generator, q0, p0, step, steps, paths)


def saved_or_not(name: str) -> tuple[Run, Run]:
    """Time one path with every step saved, and the path without saving."""
    scene, maker, scheme = found(name)
    model = maker()
    return library(model, scheme, 1, scene.step, save_every=1), library(model, scheme, 1, scene.step)


def given_or_own(name: str, paths: int) -> tuple[Run, Run]:
    """Time increments drawn beforehand and given, and increments that the library draws."""
    scene, maker, scheme = found(name)
    model = maker()
    of = drawn(scene.step, model.nnoise, paths)
    return given(model, scheme, paths, scene.step, of), library(model, scheme, paths, scene.step)


def given(model: ss.Model, scheme: str, paths: int, step: float, of: Callable[[int], np.ndarray]) -> Run:
    """Runs with increments drawn beforehand, (path, step, noise)."""
    return lambda steps: library(model, scheme, paths, step, increments=of(steps).transpose(1, 2, 0))(steps)


def drawn(step: float, noises: int, paths: int) -> Callable[[int], np.ndarray]:
    """Increments of so many steps, (path, step, noise), drawn once for each of two runs."""

    @functools.lru_cache(maxsize=2)
    def of(steps):
        return np.random.default_rng(1).normal(0, math.sqrt(step), (paths, steps, noises))

    return of


def given_to_both(name: str, paths: int) -> tuple[Run, Run]:
    """Time the library and a loop with the same increments, path after path in memory."""
    import loops  # noqa: PLC0415 - it needs numba

    scene, maker, scheme = found(name)
    model, run = maker(), loops.loop_of_increments(scene, scheme)
    of = drawn(scene.step, model.nnoise, paths)
    return given(model, scheme, paths, scene.step, of), lambda steps: run(of(steps), 0.2, 0.0, scene.step)


def observed() -> tuple[Run, Run]:
    """Moments of q, p, the energy and an observable in Python at every step."""
    scene, model = SCENES["kubo"], SCENES["kubo"].model()
    how = {"q0": 0.2, "p0": 0.0, "step": scene.step, "paths": 1000, "threads": 1, "save_every": 1}

    def run(steps):
        ss.moments(model, steps=steps, observables={"qp": lambda q, p: q[0] * p[0]}, **how)

    return run, loop(scene, "midpoint", 1000, scene.step, keep="moments")


def accurate() -> tuple[Run, Run]:
    """The library and a loop, each with the steps it needs for the same error; a "step" is a path to T = 4."""
    scene = SCENES["synchrotron"]
    kicks = library(scene.model(), "chin4a", 1000, 4 / STEPS["chin4a"])
    taylor = loop(scene, "taylor", 1000, 4 / STEPS["taylor"])
    return lambda n: kicks(n * STEPS["chin4a"]), lambda n: taylor(n * STEPS["taylor"])


def measured(row: Row, repeats: int, seconds: float) -> list[float]:
    """The least times of library and loop, in ns of a path-step, or us of a call, and their ratio."""
    runs = row.make()
    if row.per_call:
        for run in runs:
            run(row.per_call)  # compile
        calls = [lambda run=run: [run(row.per_call) for _ in range(CALLS)] for run in runs]
        times = [[1e6 * x / CALLS for x in kind] for kind in in_turn(calls, repeats)]
    else:
        times = ns_of_steps(runs, row.paths, repeats, seconds)
    ours, theirs = map(min, times)
    return [float(f"{x:.4g}") for x in (ours, theirs, ours / theirs)]


def measure(setting: Setting) -> list[dict]:
    """Time all rows, or the requested ones; nothing if numba is missing."""
    if importlib.util.find_spec("numba") is None:
        return []
    warnings.simplefilter("error", ss.PathsFailedWarning)  # a failed path stops early and looks cheap
    seconds = 0.01 if setting.quick else 0.04
    return [
        {
            "group": row.group,
            "name": words(row.name),
            "target": row.target,
            "numbers": measured(row, setting.repeats, seconds),
        }
        for row in rows()
        if re.search(setting.rows, f"{row.group} {row.name}")
    ]


def section(rows: list[dict]) -> str:
    """Write the section."""
    heads = ["rows", "scene", "library", "loop", "ratio", "target", ""]
    title = "## Beside plain loops in numba\n\n"
    if not rows:
        return title + ("No row has such a name." if importlib.util.find_spec("numba") else f"numba: {ABSENT}.")
    cells = []
    for row in rows:
        ours, theirs, over = row["numbers"]
        judged = ours if row["group"] == "call" else over
        figures = [f"{ours:.4g}", f"{theirs:.4g}", f"{over:.2f}"]
        cells.append([GROUPS[row["group"]], row["name"], *figures, *at_most(judged, row["target"])])
    return (
        title + "The table gives ns of processor time for a step of a path on one thread, the least of repeats that\n"
        "alternate between library and loop. The loops of `bench/loops.py` are what a user of numba would write:\n"
        "scalar loops over paths and steps, with normal numbers drawn in the loop by NumPy's generator (PCG64,\n"
        "ziggurat), and without -ffast-math. If not said otherwise, they solve for one unknown by Newton's method\n"
        "to rounding, and for several by fixed-point iteration until positions change by less than $10^{-14}$. The\n"
        "library iterates until its slopes no longer change, and draws its own normal numbers. Where the first\n"
        'column says "beside", the column "loop" is the time of what is named there.\n\n' + table(heads, cells)
    )
