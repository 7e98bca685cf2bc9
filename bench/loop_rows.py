# SPDX-License-Identifier: BSD-3-Clause
"""Time the library beside plain loops in numba; prints "row GROUP NAME TARGET" and numbers for each.

loop_rows.py REPEATS SECONDS [REGEX]: rows whose "GROUP NAME" matches. Processor time on one thread, library and loop
in turn, each for about SECONDS; the numbers are ns per path-step, the least of the repeats: library, loop, ratio; of
compiled callbacks also the same loop that calls the callback through its pointer, and the ratio to that.
A row "step" measures a step of its scheme against one of midpoint, in the library. Rows "call" are us of a call.
"""

import math
import re
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import formula_models
import loop_models
import loop_pendulums
import loop_pointers
import loops
import numpy as np
import symsde as ss

Run = Callable[[int], Any]  # so many steps


@dataclass(frozen=True)
class Row:
    """What is compared: makers, so that only rows that are wanted are compiled."""

    group: str
    name: str
    paths: int
    target: float
    make: Callable[[], tuple[Run, ...]]
    per_call: int = 0  # steps of a call, for rows whose time is that of a call


def library(model, scheme, paths, step, q0=0.2, **how) -> Run:
    """Runs of the library that save their last state alone."""

    def run(steps):
        save = {"save_every": steps} | how
        ss.simulate(model, q0=q0, p0=0.0, step=step, steps=steps, scheme=scheme, paths=paths, threads=1, **save)

    return run


def loop(function, n, paths, step, q0=0.2) -> Run:
    """A loop of `loops`."""
    generator = np.random.default_rng(1)
    return lambda steps: function(generator, np.full(n, q0), np.zeros(n), step, steps, paths)


def henon_heiles():
    """So little noise that no path escapes in a long run."""
    return ss.models.henon_heiles(sigma1=1e-4, sigma2=1e-4)


def chain_model(n):
    """So little noise that it stays cool in a long run."""
    return ss.models.fpu_chain(n=n, sigma=1e-3)


EXPLICIT, IMPLICIT = ("symplectic_euler", "stormer_verlet"), ("midpoint", "gauss2")


def how_in_a_loop(scheme, force, n, m):
    """The loop of a scheme where H = p.p/2 + U(q) and the noises are in position."""
    explicit = {"symplectic_euler": loops.euler, "stormer_verlet": loops.verlet}
    if scheme in explicit:
        return explicit[scheme](force, n, m)
    return loops.collocation(force, n, m, scheme)


# compiled callbacks whose loops are given a force: (name, model, force, degrees of freedom, noises, schemes)
BY_FORCE = (
    ("synchrotron", loop_models.synchrotron, loops.synchrotron_force, 1, 2, (*EXPLICIT, "gauss2")),
    ("henon_heiles", loop_models.henon_heiles, loops.henon_heiles_force, 2, 2, (*EXPLICIT, *IMPLICIT)),
    ("16_noises", partial(loop_models.many_noises, 16), loops.many_noises_force, 1, 16, (*EXPLICIT, "gauss2")),
    ("mean_field16", partial(loop_models.mean_field, 16), loops.mean_field_force, 16, 1, ("midpoint",)),
)
NOISES = {f"cfunc {name} {scheme}": m for name, _, _, _, m, schemes in BY_FORCE for scheme in schemes}

# name -> (model, scheme, step, degrees of freedom, loop)
SCENES = {
    "kubo midpoint": (ss.models.kubo, "midpoint", 0.02, 1, lambda: loops.kubo_midpoint),
    "synchrotron midpoint": (
        *(ss.models.synchrotron, "midpoint", 0.02, 1),
        lambda: loops.scalar_midpoint(loops.synchrotron_slope, 2),
    ),
    "synchrotron gauss2": (
        *(ss.models.synchrotron, "gauss2", 0.02, 1),
        lambda: loops.collocation(loops.synchrotron_force, 1, 2, "gauss2"),
    ),
    "synchrotron lobatto3": (
        *(ss.models.synchrotron, "lobatto3", 0.02, 1),
        lambda: loops.collocation(loops.synchrotron_force, 1, 2, "lobatto3"),
    ),
    "additive_oscillator symplectic_euler": (
        *(ss.models.additive_oscillator, "symplectic_euler", 0.02, 1),
        lambda: loops.additive_euler,
    ),
    "linear_oscillator midpoint": (
        *(ss.models.linear_oscillator, "midpoint", 0.02, 1),
        lambda: loops.linear_midpoint(1),
    ),
    "pendulum stormer_verlet": (ss.models.pendulum, "stormer_verlet", 0.02, 1, lambda: loops.pendulum_verlet),
    "noncommutative_oscillator midpoint": (
        *(ss.models.noncommutative_oscillator, "midpoint", 1e-6, 1),  # it grows without bound
        lambda: loops.noncommutative_midpoint,
    ),
    "henon_heiles stormer_verlet": (
        *(henon_heiles, "stormer_verlet", 0.02, 2),
        lambda: loops.verlet(loops.henon_heiles_force, 2, 2),
    ),
    "henon_heiles midpoint": (
        *(henon_heiles, "midpoint", 0.02, 2),
        lambda: loops.collocation(loops.henon_heiles_force, 2, 2, "midpoint"),
    ),
    "henon_heiles gauss2": (
        *(henon_heiles, "gauss2", 0.02, 2),
        lambda: loops.collocation(loops.henon_heiles_force, 2, 2, "gauss2"),
    ),
    "fpu64 midpoint": (
        *(lambda: chain_model(64), "midpoint", 0.05, 64),
        lambda: loops.collocation(loops.fpu_force, 64, 64, "midpoint"),
    ),
    "fpu64 stormer_verlet": (
        *(lambda: chain_model(64), "stormer_verlet", 0.05, 64),
        lambda: loops.verlet(loops.fpu_force, 64, 64),
    ),
    "cfunc synchrotron midpoint": (
        *(loop_models.synchrotron, "midpoint", 0.02, 1),
        lambda: loops.scalar_midpoint(loops.synchrotron_slope, 2),
    ),
    "cfunc 16_noises midpoint": (
        *(lambda: loop_models.many_noises(16), "midpoint", 0.02, 1),
        lambda: loops.linear_midpoint(16),
    ),
    **{
        f"cfunc {name} {scheme}": (model, scheme, 0.02, n, partial(how_in_a_loop, scheme, force, n, m))
        for name, model, force, n, m, schemes in BY_FORCE
        for scheme in schemes
    },
}


def pendulum_scene(model, terms, m, scheme):
    """A pendulum beside the loop of its terms and m noises."""
    return model, scheme, 0.02, 1, lambda: loop_pendulums.pendulum_loop(terms, m, scheme)


# scenes of few paths alone
FEW = {
    f"driven_pendulum {scheme}": pendulum_scene(ss.models.driven_pendulum, loop_pendulums.driven_terms, 2, scheme)
    for scheme in ("symplectic_euler", "stormer_verlet", "midpoint", "gauss2")
}
FEW |= {
    f"pendulum {scheme}": pendulum_scene(ss.models.pendulum, loop_pendulums.pendulum_terms, 1, scheme)
    for scheme in ("midpoint", "gauss2")
}
FEW |= {
    "synchrotron symplectic_euler": (
        *(ss.models.synchrotron, "symplectic_euler", 0.02, 1),
        lambda: loops.synchrotron_euler,
    ),
    "henon_heiles symplectic_euler": (
        *(henon_heiles, "symplectic_euler", 0.02, 2),
        lambda: loops.euler(loops.henon_heiles_force, 2, 2),
    ),
    "fpu64 gauss2": (
        *(lambda: chain_model(64), "gauss2", 0.05, 64),
        lambda: loops.collocation(loops.fpu_force, 64, 64, "gauss2"),
    ),
}


def scene(name, paths) -> tuple[Run, ...]:
    """The library and the loop of a scene; of compiled callbacks the loop by their pointer, too."""
    maker, scheme, step, n, function = (SCENES | FEW)[name]
    model, runs = maker(), [function()]
    if name in NOISES:
        runs.append(how_in_a_loop(scheme, loop_pointers.force(model), n, NOISES[name]))
    return library(model, scheme, paths, step), *(loop(run, n, paths, step) for run in runs)


def formula(name, paths) -> tuple[Run, Run]:
    """A model by its formula beside the loop."""
    model, scheme, step, n, function = SCENES[name]
    mine = formula_models.by_formula(model())
    return library(mine, scheme, paths, step), loop(function(), n, paths, step)


def formula_beside_built_in(name, paths) -> tuple[Run, Run]:
    """A model by its formula beside the one of the catalogue."""
    maker, scheme, step, _, _ = SCENES[name]
    known = maker()
    return library(formula_models.by_formula(known), scheme, paths, step), library(known, scheme, paths, step)


def chain(scheme, n) -> tuple[Run, Run]:
    """A chain, 256 paths."""
    function = loops.collocation(loops.fpu_force, n, n, scheme)
    return library(chain_model(n), scheme, 256, 0.05), loop(function, n, 256, 0.05)


def stages(scheme, n, step) -> tuple[Run, Run]:
    """A scheme of several stages beside midpoint, both of the library."""
    model = chain_model(n)
    return tuple(library(model, s, 256, step, q0=0.01) for s in (scheme, "midpoint"))


def mean_field(n, paths, maker, rounding=loops.ROUNDING) -> tuple[Run, Run]:
    """Sites that all pull at each other: dense callbacks, or a formula."""
    function = loops.collocation(loops.mean_field_force, n, 1, "midpoint", rounding)
    q0 = 0.2 * np.cos(np.arange(n))
    return library(maker(n), "midpoint", paths, 0.02, q0), loop(function, n, paths, 0.02, q0)


# name of a scene -> the loop that keeps every step: it pays for fresh pages of memory, too
SAVED = {
    "kubo midpoint": loops.kubo_midpoint_saved,
    "linear_oscillator midpoint": loops.linear_midpoint_saved,
    "pendulum stormer_verlet": loops.pendulum_verlet_saved,
    "henon_heiles stormer_verlet": loops.henon_heiles_verlet_saved,
}


def saved(name, paths) -> tuple[Run, Run]:
    """Every step is kept."""
    model, scheme, step, n, _ = SCENES[name]
    return library(model(), scheme, paths, step, save_every=1), loop(SAVED[name], n, paths, step)


def saved_or_not(name) -> tuple[Run, Run]:
    """Every step of one path is kept, beside none."""
    model, scheme, step, _, _ = SCENES[name]
    model = model()
    return library(model, scheme, 1, step, save_every=1), library(model, scheme, 1, step)


def given_or_own(name, paths) -> tuple[Run, Run]:
    """Increments that are given, drawn beforehand, beside those of the library."""
    model, scheme, step, _, _ = SCENES[name]
    model, drawn = model(), {}

    def run(steps):
        if steps not in drawn:
            drawn.clear()
            drawn[steps] = np.random.default_rng(1).normal(0, math.sqrt(step), (steps, model.nnoise, paths))
        library(model, scheme, paths, step, increments=drawn[steps])(steps)

    return run, library(model, scheme, paths, step)


def observed() -> tuple[Run, Run]:
    """Moments of q, p, the energy and an observable in Python at every step."""
    model = ss.models.kubo()

    def run(steps):
        observables = {"qp": lambda q, p: q[0] * p[0]}
        ss.moments(
            model, q0=0.2, p0=0.0, step=0.02, steps=steps, paths=1000, threads=1, save_every=1, observables=observables
        )

    return run, loop(loops.kubo_midpoint_moments, 1, 1000, 0.02)


# steps to T = 4 for a root-mean-square error of 1e-5 from q = 0.2, p = 0, against chin4a_strong2 with 2048 steps
STEPS = {"chin4a": 89, "taylor": 1500}


def accurate() -> tuple[Run, Run]:
    """Each as many steps as it needs for the same error; a "step" is a path to T = 4."""
    kicks = library(ss.models.synchrotron(), "chin4a", 1000, 4 / STEPS["chin4a"])
    taylor = loop(loops.synchrotron_taylor, 1, 1000, 4 / STEPS["taylor"])
    return lambda n: kicks(n * STEPS["chin4a"]), lambda n: taylor(n * STEPS["taylor"])


def rows() -> Iterator[Row]:
    """All of them."""
    for scheme in ("gauss2", "gauss3", "lobatto3"):
        for n in (2, 4, 8, 16, 64):
            yield Row("stages", f"{scheme} fpu{n}", 256, 1.0, partial(chain, scheme, n))
    for scheme, mild, stiff in (
        ("gauss2", 4, 8),
        ("gauss3", 10, 20),
        ("lobatto3", 10, 20),
        ("gauss2_strong32", 10, 20),
    ):
        yield Row("step", f"{scheme} fpu16 mild", 256, mild, partial(stages, scheme, 16, 0.1))
        step = 1.25 if scheme == "lobatto3" else 5.0  # its stability ends at h omega = sqrt 8
        yield Row("step", f"{scheme} fpu16 stiff", 256, stiff, partial(stages, scheme, 16, step))
    for name, paths in (("henon_heiles gauss2", 1000), ("synchrotron lobatto3", 1000), ("fpu64 midpoint", 1000)):
        yield Row("many", name, paths, 1.0, partial(scene, name, paths))
    for n in (2, 8, 16):
        make = partial(mean_field, n, 1000, loop_models.mean_field)
        yield Row("many", f"cfunc mean_field{n} midpoint", 1000, 1.0, make)
        yield Row("rounding", f"cfunc mean_field{n} midpoint", 1000, 1.0, partial(make, rounding=0.0))
    for name in SCENES:
        for paths in (1, 2, 8, 32):
            yield Row(f"few{paths}", name, paths, 1.5, partial(scene, name, paths))
    for name in FEW:
        for paths in (1, 2, 8):
            yield Row(f"few{paths}", name, paths, 1.5, partial(scene, name, paths))
    yield from rows_of_formulas()
    yield Row("error", "synchrotron chin4a beside Taylor 3/2, rms 1e-5", 1000, 0.4, accurate)
    yield from rows_that_save()
    yield Row("moments", "kubo with an observable in Python", 1000, 1.5, observed)
    for name in ("kubo midpoint", "fpu64 midpoint"):
        yield Row("call", f"{name} 10 steps", 1, 40.0, partial(scene, name, 1), per_call=10)


def rows_of_formulas() -> Iterator[Row]:
    """Beside the catalogue, and beside loops."""
    for name in SCENES:
        if not name.startswith("cfunc") and "lobatto" not in name:
            paths = 1024 if "fpu" in name else 4096
            yield Row("formula", name, paths, 1.05, partial(formula_beside_built_in, name, paths))
            yield Row("formula1", name, 1, 1.2, partial(formula, name, 1))
    for paths, target in ((1000, 1.0), (1, 1.2)):
        group = "formula1" if paths == 1 else "formula_loop"
        yield Row(
            group, "mean_field16 midpoint", paths, target, partial(mean_field, 16, paths, formula_models.mean_field)
        )


def rows_that_save() -> Iterator[Row]:
    """Beside loops that save, and beside the library without."""
    for name in SAVED:
        yield Row("saved", name, 1, 1.5, partial(saved, name, 1))
    for name in ("kubo midpoint", "pendulum stormer_verlet"):
        yield Row("saved1000", name, 1000, 1.5, partial(saved, name, 1000))
    for paths, target in ((1, 1.5), (1000, 2.0)):  # of many, memory is read twice: to look for NaN, and to use it
        for name in ("kubo midpoint", "fpu64 stormer_verlet"):
            yield Row(f"given{paths}", name, paths, target, partial(given_or_own, name, paths))
    for name in (*SAVED, "synchrotron midpoint", "cfunc synchrotron midpoint"):
        yield Row("saved_unsaved", name, 1, 1.5, partial(saved_or_not, name))


def repeat(run: Run, paths: int, seconds: float) -> int:
    """Compile, and find the steps of a run of so many seconds."""
    steps = 16
    run(steps)
    while True:
        took = min(timed(run, steps, 1) for _ in range(2))  # the first one may wait for memory
        if took > 0.3 * seconds or steps * paths > 10**9:
            return steps
        steps = steps * 4 if took < 0.05 * seconds else int(steps * seconds / took) + 1


def timed(run: Run, steps: int, calls: int) -> float:
    """Seconds of a call."""
    start = time.process_time()
    for _ in range(calls):
        run(steps)
    return (time.process_time() - start) / calls


def measure(row: Row, repeats: int, seconds: float) -> list[float]:
    """The least times, in ns per path-step, or us of a call."""
    runs = row.make()
    if row.per_call:
        steps, calls = (row.per_call,) * len(runs), 200
        for run in runs:
            run(row.per_call)  # compiles
    else:
        steps, calls = [repeat(run, row.paths, seconds) for run in runs], 1
    best = [float("inf")] * len(runs)
    for _ in range(repeats):
        for i, run in enumerate(runs):
            best[i] = min(best[i], timed(run, steps[i], calls))
    if row.per_call:
        return [b * 1e6 for b in best]
    return [b * 1e9 / (row.paths * s) for b, s in zip(best, steps, strict=True)]


def main():
    """Measure the rows that are asked for; a path that fails would stop early and cheaply."""
    warnings.simplefilter("error", ss.PathsFailedWarning)
    repeats, seconds = int(sys.argv[1]), float(sys.argv[2])
    wanted = re.compile(sys.argv[3] if len(sys.argv) > 3 else "")
    for row in rows():
        if wanted.search(f"{row.group} {row.name}"):
            ours, *others = measure(row, repeats, seconds)
            name = row.name.replace(" ", "_")
            beside = (f"{theirs:.4g} {ours / theirs:.4g}" for theirs in others)
            print("row", row.group, name, row.target, f"{ours:.4g}", *beside, flush=True)


if __name__ == "__main__":
    main()
