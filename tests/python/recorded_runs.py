# SPDX-License-Identifier: BSD-3-Clause
"""Runs whose numbers are recorded: every scheme, kind of model and number of paths, along all axes."""

import functools
import itertools
import random
import warnings

import axes
import numpy as np
import symsde as ss
from recorded import code, exact_of, facts, number, tallied
from symsde import observe
from test_axes_models import FORMULAS, MODELS, TURNS, compiled
from test_axes_steps import KINDS, NO_GENERAL, ONE_SIDED, own_noise

WHERE = {
    "sign": (1, -1),
    "size": (0.05, 0.2),
    "first_step": (0, 7),
    "first_path": (0, 2**31 + 5),
    "seed": (0, 2**40 + 3),
}
HOW = {
    "save_every": (1, 1, 2, 4), "refine": (0, 0, 1, 2, -1, -2), "compensated": (False, True),
    "general": (False, False, True), "correction": ("auto", "none", "mean", "increments"), "areas": ("path", "law"),
    "area_time": (None, 0.3), "common_noise": ((), (), (1,), (2, 3)), "truncation": (None, None, (2.0, 1.0)),
    "fixed_point": (0, 0, 3), "max_iter": (100, 100, 100, 100, 2), "lanes": (None, None, 8, 16), "threads": (1, 2),
    "given": ("", "", "own", "one"), "start": ("each", "one"),
}  # fmt: skip
SHAPE = {
    "time": axes.AXES["time"],
    "nnoise": (1, 2, 3, 4),
    "ndof": (1, 2, 3),
    "third": (True, False),
    "flat": (True, False),
}
PATHS = (1, 4, 300)
EACH = 4  # runs of each combination, with other options each time
STEPS, T0 = 4, 0.35
MADE = {
    "own noise": own_noise,
    "triple jump": lambda: ss.schemes.triple_jump("stormer_verlet"),
    "composition": lambda: ss.schemes.composition(["lobatto3", "symplectic_euler"], [0.4, 0.6]),
    "adjoint": lambda: ss.schemes.adjoint("lambda:0.3"),
    "symmetric": lambda: ss.schemes.symmetric_composition("P2N2Q2Otr"),
    "quadrature": lambda: ss.schemes.from_quadrature([0.1, 0.9], [0.5, 0.5], 1, noise_weights=[0.45, 0.55]),
}  # fmt: skip
SCHEMES = (*KINDS, "lobatto2", "P2N2Q2Lob", *MADE)
#: options that some models or schemes refuse
REFUSED = (
    "truncation",
    "area_time",
    "areas",
    "correction",
    "refine",
    "common_noise",
    "fixed_point",
    "general",
    "increments",
)


def kinds_of(scheme):
    """Kinds of axes.TRAITS that a scheme accepts."""
    return KINDS.get({"lobatto2": "midpoint", "P2N2Q2Lob": "P2N2Q2Otr"}.get(scheme, scheme), ("position", "coupled"))


@functools.cache
def scheme_of(name):
    """A scheme of the catalogue by name, or one that is constructed."""
    return MADE[name]() if name in MADE else ss.schemes.get(name)


def rounds(number_of, **chosen):
    """Rows of a covering design, in a new order each time."""
    rows, chance = axes.covering(**chosen), random.Random(number_of)
    while True:
        chance.shuffle(rows)
        yield from rows


def arguments(row, ndof, nnoise, paths, scheme):
    """Arguments of `simulate` from a row of WHERE and HOW, without options that are meaningless for the scheme."""
    h = row["size"] * row["sign"]
    q0, p0 = axes.start(ndof, paths if row["start"] == "each" else 1)
    how = {name: row[name] for name in (*WHERE, *HOW) if name not in {"sign", "size", "given", "start"}}
    how |= {"q0": q0[:, 0] if row["start"] == "one" else q0, "p0": p0[:, 0] if row["start"] == "one" else p0}
    how |= {"step": h, "steps": STEPS, "t0": T0, "scheme": scheme_of(scheme), "paths": paths}
    how["common_noise"] = tuple(k for k in row["common_noise"] if k <= nnoise)
    if not how["scheme"].info.uses_areas:
        how["areas"] = "path"
    how["area_time"] = row["area_time"] if how["areas"] == "path" else None
    if scheme in NO_GENERAL:
        how["general"] = False
    if scheme not in {*ONE_SIDED, "adjoint"}:
        how["correction"] = "none" if scheme == "own noise" else "auto"
    if row["given"]:
        how |= {
            "refine": max(0, how["refine"]),
            "common_noise": (),
            "truncation": None,
            "area_time": None,
            "areas": "path",
        }
        many = paths if row["given"] == "own" else 1
        how["increments"] = axes.rows_of(h, STEPS, 2 ** how["refine"], nnoise, many)
    return how


def lenient(call, model, how):
    """The result after dropping refused options, beginning with the one named in the message; and all warnings."""
    said, left = [], [*REFUSED]
    while True:
        try:
            with warnings.catch_warnings(record=True) as warned:
                warnings.simplefilter("always")
                found = call(model, **how)  # warnings of doubt are recorded with the report
                kept = [w for w in warned if not issubclass(w.category, ss.errors.DoubtfulRunWarning)]
                return found, [*said, *(str(w.message) for w in kept)]
        except ValueError as error:
            said.append(f"{type(error).__name__}: {error}")
            left = [name for name in left if name in how]
            if not left:
                return None, said
            gone = next((name for name in left if name in said[-1]), left[0])
            how = {name: value for name, value in how.items() if name != gone}


def told(*groups):
    """For each group of runs (model, arguments): one number. For all groups together: checksums and counters."""
    numbers, loose, exact = [], [], []
    for group in groups:
        arrays = []
        for model, how in group:
            run, said = lenient(ss.simulate, model, how)
            exact.append(said)
            if run is not None:
                low = [] if run.q_low is None else [1 + run.q_low, 1 + run.p_low]
                arrays += [run.q, run.p, run.t, run.last_q, run.last_p, run.energy if run.has_energy else None, *low]
                loose.append((run.report.counters, how["paths"]))
                exact += [exact_of(run.report), run.status.tolist(), run.failed_step.tolist(), run.path.tolist()]
        numbers.append(number(*arrays))
    return [*numbers, code(*exact)], loose


@tallied
def own_models():
    """Every scheme with Python models of every kind that it accepts."""
    rows, paths = rounds(1, **WHERE, **HOW, **SHAPE), itertools.cycle((4, 1, 20))
    for scheme in SCHEMES:
        for kind in kinds_of(scheme):
            runs = []
            for row, many in itertools.islice(zip(rows, paths, strict=False), 4):
                ridges = axes.ridges_of(kind, row["ndof"], row["nnoise"], row["time"])
                given = arguments(row, row["ndof"], row["nnoise"], many, scheme)
                runs.append((axes.model_of(ridges, kind, third=row["third"]), given))
            yield scheme, f"{scheme}/{kind}", *told(runs)


def of_each(seed, models):
    """Every scheme with all models, given as name -> (kind, model, noises, ...): one path, a few and many."""
    rows = rounds(seed, **WHERE, **HOW)
    for (name, (kind, model, nnoise, *more)), scheme in itertools.product(models.items(), SCHEMES):
        turns = scheme in TURNS and not (more and more[-1])
        if kind in kinds_of(scheme) and not turns:
            runs = [
                [(model, arguments(next(rows), model.ndof, nnoise, paths, scheme)) for _ in range(EACH)]
                for paths in PATHS
            ]
            yield scheme, f"{scheme}/{name}", *told(*runs)


@tallied
def built_in():
    """The library's own models."""
    eight = ("kick", ss.models.fpu_chain(8, 0.8, 0.3), 8, None)
    yield from of_each(2, {**MODELS, "fpu_chain of 8": eight})


@tallied
def formulas():
    """Compiled models from formulas."""
    yield from of_each(3, {kind: (kind, compiled(kind)[0], FORMULAS[kind][1]) for kind in FORMULAS})


@tallied
def chains():
    """Chains with couplings of neighbours: banded matrices, and matrices that turn out to be dense."""
    chosen = axes.covering(
        **SHAPE | {"ndof": (4, 7, 12)}, kind=tuple(axes.TRAITS), reach=(1, 2), scheme=range(8), paths=(1, 3, 9)
    )
    turns = itertools.product(range(3), chosen)
    for (turn, row), how in zip(turns, rounds(4, **WHERE, **HOW), strict=False):
        fitting = [scheme for scheme in SCHEMES if row["kind"] in kinds_of(scheme) and scheme not in TURNS]
        scheme = fitting[(row["scheme"] * 5 + row["ndof"] + turn) % len(fitting)]
        ridges = axes.chain_of(row["kind"], row["ndof"], row["nnoise"], row["reach"], row["time"])
        model = axes.model_of(ridges, row["kind"], third=row["third"], bandwidth=row["reach"])
        given = arguments(how, row["ndof"], row["nnoise"], row["paths"], scheme)
        yield scheme, f"{axes.ident(row)}-{scheme}", *told([(model, given)])


def every_third(**chosen):
    """A covering design: in each round a third of the schemes meets all other options."""
    for first in range(3):
        yield from axes.covering(scheme=SCHEMES[first::3], **chosen)


@tallied
def calls():
    """Prepared runs: steps, steps with given increments, second calls, resets, assigned states."""
    names = ("synchrotron", "henon_heiles", "driven_pendulum", "fpu_chain of 3", "own")
    hows = rounds(5, **WHERE, **HOW | {"max_iter": (100,), "given": ("",)})
    for row, how in zip(every_third(of=names, paths=(1, 4, 40)), hows, strict=False):
        if row["of"] == "own":
            model, kind = axes.model_of(axes.ridges_of("kick", 2, 3, "both"), "kick"), "kick"
        else:
            kind, model, *_ = MODELS[row["of"]]
        if kind not in kinds_of(row["scheme"]) or row["scheme"] in TURNS:
            continue
        given = arguments(how, model.ndof, model.nnoise, row["paths"], row["scheme"])
        every = {given.pop(x): 1 for x in ("save_every", "steps")} and how["save_every"]
        run, said = lenient(ss.prepare, model, given)
        found = [run.run(2 * every, save_every=every)]
        try:
            run.step(0.01 * np.arange(1, model.nnoise + 1))
        except ValueError as error:
            said.append(str(error))
        run.step()
        run.p[...] *= 0.9
        found.append(run.run(4 * every, save_every=every))
        run.reset(first_path=given["first_path"] + 1, first_step=3, seed=5)
        found.append(run.run(4, save_every=2))
        run.reset(q0=0.3 + 0 * run.q, p0=0.2)
        found.append(run.run(every))
        arrays = [x for one in found for x in (one.q, one.p, one.last_q, one.t)]
        exact = [(one.status, one.failed_step, one.path) for one in found]
        numbers = [number(*arrays), code(exact_of(run.report), run.next_step, repr(run), said, *sum(exact, ()))]
        yield row["scheme"], axes.ident(row), numbers, [(run.report.counters, row["paths"])]


def ill_of(ridges, row, q):
    """A gradient that is NaN from the second step on, for states with q_1 near one."""
    near = {"one": 0.0, "some": 0.3, "all": 9.0}.get(row["ill"], -1.0)
    when = 0.2 * (row["first_step"] + 1.3)

    def gradient(t, w, *x):
        ill = (abs(x[0][0] - q) <= near) & (row["sign"] * (t - T0) > when)
        return tuple(np.where(ill, np.nan, x) for x in ridges.gradient(t, w, *x))

    return gradient


@tallied
def failing():
    """Runs with steps that are too long, solved with damping, by continuation or not at all; with few iterations;
    NaN in some lanes.
    """
    chosen = {"paths": (1, 4, 40), "kind": ("position", "coupled", "kick"), "nnoise": (1, 3)}
    chosen |= {"ndof": (1, 2, 4), "ill": ("steep", "one", "some", "all", "few"), "sign": (1, -1), "first_step": (0, 7)}
    chosen |= {"time": axes.AXES["time"], "general": (False, True), "compensated": (False, True), "save_every": (1, 2)}
    for row in every_third(**chosen):
        if row["kind"] not in kinds_of(row["scheme"]) or row["scheme"] in TURNS:
            continue
        ridges, h = axes.ridges_of(row["kind"], row["ndof"], row["nnoise"], row["time"]), 0.2 * row["sign"]
        q0, p0 = axes.start(row["ndof"], row["paths"])
        more = {x: getattr(ridges, x) for x in ("hessian", "hessian_vector", "third_derivative")}
        model = ss.Model(
            ndof=row["ndof"],
            nnoise=row["nnoise"],
            gradient=ill_of(ridges, row, q0[0, 0]),
            **more,
            **axes.TRAITS[row["kind"]],
        )
        big = {"steep": 2.5, "few": 3.0}.get(row["ill"], 1.0)
        given = {x: row[x] for x in ("first_step", "paths", "general", "compensated", "save_every")}
        given |= {"scheme": scheme_of(row["scheme"]), "step": h * big, "steps": STEPS, "t0": T0, "q0": q0, "p0": p0}
        given |= {"max_iter": 3} if row["ill"] == "few" else {}
        yield row["scheme"], axes.ident(row), *told([(model, given)])


def observers(n, ends):
    """An observer of each kind, and two that absorb paths."""
    return {
        "h": observe.Histogram(f"p_{n}", -1.5, 1.2, 7), "k": observe.Quantiles("q_1", (0.1, 0.5, 0.8), parts=16),
        "c": observe.Covariance((f"q_{n}", "p_1", "square")), "a": observe.Autocorrelation("p_1", 1, about=0.2),
        "e": observe.Extremes(f"q_{n}"), "w": observe.Paths((3, 2**31 + 6, 5), ("p_1", "square")),
        "x": observe.Passage(f"q_{n}", *ends["q"], absorb=ends["absorb"], bridge=ends["bridge"]),
        "y": observe.Passage("p_1", within=1.1, absorb=False, bridge=ends["bridge"]),
        "z": observe.Passage("square", high=1.4, absorb=ends["absorb"], bridge=False),
    }  # fmt: skip


def square(q, p):
    """An observable as a Python function."""
    return (q**2 + 0.3 * p**2).sum(axis=0)


@tallied
def moments():
    """Moments, energies, observables and all observers."""
    names = ("kubo", "linear_oscillator", "driven_pendulum", "henon_heiles", "fpu_chain of 3", "own", "both", "coupled")
    chosen = {
        "of": names,
        "paths": (1, 5, 300, 600),
        "absorb": (False, True),
        "bridge": (False, True),
    }
    less = WHERE | HOW | {"first_path": (0, 2**31), "max_iter": (100,), "lanes": (None, 8), "save_every": (1, 2, 4)}
    for row, how in zip(every_third(**chosen), rounds(6, **less), strict=False):
        if row["of"] in MODELS:
            kind, model, *_ = MODELS[row["of"]]
        else:
            kind = {"own": "position"}.get(row["of"], row["of"])
            model = axes.model_of(axes.ridges_of(kind, 1 + row["absorb"], 2 + row["bridge"], "both"), kind)
        fitting = [x for x in (row["scheme"], "gauss2_strong32", "midpoint") if kind in kinds_of(x) and x not in TURNS]
        paths = row["paths"] if row["of"] in MODELS else row["paths"] // 15 + 1
        given = arguments(how, model.ndof, model.nnoise, paths, fitting[0])
        ends = {"q": (-0.6, 0.9), "absorb": row["absorb"], "bridge": row["bridge"]}
        given |= {"observers": observers(model.ndof, ends), "observables": {"square": square}}
        found, said = lenient(ss.moments, model, given)
        if found is None and "bridge" in said[-1]:
            given["observers"] = observers(model.ndof, ends | {"bridge": False})
            found, said = lenient(ss.moments, model, given)
        if found is None:
            yield fitting[0], axes.ident(row), [code(said)], []
            continue
        exact = (exact_of(found.report), found.n_ok, found.failed, found.failed_step, found.remarks(), said)
        numbers = [*facts([vars(x) for x in found.observed.values()]), number(found.m2, *found._tables.values())]
        yield fitting[0], axes.ident(row), [*numbers, code(*exact)], [(found.report.counters, paths)]


GROUPS = (calls, failing, built_in, formulas, moments, chains, own_models)
