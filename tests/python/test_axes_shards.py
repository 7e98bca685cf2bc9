# SPDX-License-Identifier: BSD-3-Clause
"""Shards, checkpoints, --error-check, pairs of paths and failing functions along all axes, against whole runs."""

import warnings

import axes
import numpy as np
import pytest
import reference
import symsde as ss
from symsde import observe
from symsde.answers.coupled import LevelSampler
from symsde.answers.expectation.estimators import Antithetic
from symsde.answers.expectation.problem import make_problem
from symsde.batch import error_check, execute, merged_results
from symsde.batch import pieces as plan
from symsde.native import abi, callbacks
from symsde.schemes import as_scheme
from test_batch_pieces import interrupted

STEPS, H, T0 = 6, 0.1, 0.35


def scene_of(row, paths, kind="position"):
    """A model, and options of `simulate` with a state for every path."""
    model = axes.model_of(axes.ridges_of(kind, row["ndof"], row["nnoise"], row["time"]), kind)
    q0, p0 = axes.start(row["ndof"], paths)
    how = {"q0": q0, "p0": p0, "step": H * row["sign"], "steps": STEPS, "t0": T0, "paths": paths, "seed": 5}
    first = row["first_path"] // 256 * 256  # first path of a shard
    return model, how | {"first_step": row["first_step"], "first_path": first, "threads": 1}


SHARDS = axes.covering(**axes.AXES, save_every=(1, 3), compensated=(False, True), scheme=("midpoint", "verlet_kdk"))


@pytest.mark.parametrize("row", SHARDS, ids=map(axes.ident, SHARDS))
def test_shards_are_the_run(row):
    """Moments in shards are those of one run; saved paths that were stopped repeatedly are those of `simulate`."""
    model, how = scene_of(row, 600)
    how |= {x: row[x] for x in ("save_every", "compensated", "scheme")}
    wanted = {"far": observe.Extremes("q_1"), "loss": observe.Passage("p_1", within=1.0, absorb=False)}
    one = ss.moments(model, observers=wanted, **how)
    many = ss.ensemble(model, observers=wanted, shard_paths=256, **how)
    for name in ("t", "n_ok", "mean_q", "var_p"):
        np.testing.assert_array_equal(getattr(many, name), getattr(one, name))
    for name, part in one.kept.items():
        np.testing.assert_array_equal(many.kept[name].counts, part.counts)
        np.testing.assert_array_equal(many.kept[name].sums, part.sums)

    whole, task = ss.simulate(model, **how), execute.Task(model, how)
    first = how["first_path"]
    saved = [first + i for i in (250, 251, 257, 259, 260, 599)]
    extent = plan.Extent(first, 600, STEPS, STEPS // row["save_every"] + 1, row["ndof"])
    pieces = plan.plan(extent, 256, moments=False, saved=saved)
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(execute, "_FIRST", 2 * row["ndof"])
        patched.setattr(execute._Clock, "next_length", lambda _, length: 3 - length % 3)
        shards = {piece.name: interrupted(task, piece, 2)[0] for piece in pieces}
    found = merged_results.run_of(task, pieces, lambda piece: shards[piece.name], seconds=0.0, threads=1)
    at = np.array(saved) - first
    np.testing.assert_array_equal(found.path, saved)
    np.testing.assert_array_equal(found.t, whole.t)
    np.testing.assert_array_equal([found.q, found.p], [whole.q[:, :, at], whole.p[:, :, at]])
    np.testing.assert_array_equal(found.setup.q0, how["q0"][:, at])


CHECKS = axes.covering(**axes.AXES, save_every=(1, 3))


@pytest.mark.parametrize("row", CHECKS, ids=map(axes.ident, CHECKS))
def test_the_error_check_is_half_the_step_of_the_same_paths(row):
    """The error check agrees with increments halved by hand, from the time of the first step on."""
    model, how = scene_of(row, 30)
    how |= {"save_every": row["save_every"]}
    first = how["first_step"]
    extent = plan.Extent(how["first_path"], 30, STEPS, STEPS // row["save_every"] + 1, row["ndof"])
    found = error_check.error_check(execute.Task(model, how), extent)
    draws = {"seed": 5, "paths": 30, "first_path": how["first_path"]}
    full = ss.increments(model, step=how["step"], steps=STEPS, first_step=first, **draws)
    half = ss.increments(model, step=how["step"] / 2, steps=2 * STEPS, first_step=2 * first, refine=-1, **draws)
    np.testing.assert_allclose(half[::2] + half[1::2], full, rtol=0, atol=1e-15)
    plain = {"q0": how["q0"], "p0": how["p0"], "paths": 30, "t0": T0 + first * how["step"]}
    every = row["save_every"]
    one = ss.simulate(model, step=how["step"], steps=STEPS, save_every=every, increments=full, **plain)
    two = ss.simulate(model, step=how["step"] / 2, steps=2 * STEPS, save_every=2 * every, increments=half, **plain)
    distance = np.concatenate([one.q - two.q, one.p - two.p], axis=1)
    np.testing.assert_allclose(found.rms, np.sqrt((distance**2).sum(axis=1).mean(axis=1)), rtol=1e-9, atol=1e-14)
    np.testing.assert_allclose(found.mean[:, 0], distance[:, 0].mean(axis=1), rtol=1e-8, atol=1e-13)
    assert found.rms[-1] > 1e-5 and (found.n == 30).all()


WAYS = ("turned", "coarse", "exchanged")
PAIRS = axes.covering(nnoise=(1, 2, 3, 4), ndof=(1, 2, 3), time=axes.AXES["time"], way=WAYS)


@pytest.mark.parametrize("row", PAIRS, ids=map(axes.ident, PAIRS))
def test_a_unit_counts_where_all_its_paths_are_ok(row):
    """The force is NaN where q_1 is low, so that different paths of a unit fail."""
    ridges = axes.ridges_of("position", row["ndof"], row["nnoise"], row["time"])
    end = [-np.inf]

    def gradient(t, w, q, p):
        hq, hp = ridges.gradient(t, w, q, p)
        return np.where(q[0] < end[0], np.nan, hq), hp

    model = ss.Model(ndof=row["ndof"], nnoise=row["nnoise"], gradient=gradient, **axes.TRAITS["position"])
    start, scheme, first = {"q0": 0.1, "p0": 0.0}, as_scheme("stormer_verlet"), 2**41  # first path of level 1
    problem = make_problem(model, lambda q, p: q[0] + p[-1] ** 2, horizon=0.8, seed=5, **start)
    paths = {"paths": 200, "seed": 5, "first_path": first}
    fine, coarse = (ss.increments(model, step=0.1 * 2**x, steps=8 >> x, refine=x, **paths) for x in (0, 1))
    swapped = fine.reshape(4, 2, *fine.shape[1:])[:, ::-1].reshape(fine.shape)
    drives = {"turned": (fine, -fine), "coarse": (fine, coarse), "exchanged": (fine, coarse, swapped)}[row["way"]]

    def runs():
        for dw in drives:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", ss.PathsFailedWarning)
                given = {"step": 0.8 / len(dw), "steps": len(dw), "increments": dw, "scheme": scheme}
                yield ss.simulate(model, paths=200, **start, **given)

    end[0] = np.quantile([run.q[1:, 0].min(axis=0) for run in runs()], 0.4)
    ends = [(run.q[-1, 0] + run.p[-1, -1] ** 2, run.status == 0) for run in runs()]
    values, oks = zip(*ends, strict=True)
    ok = np.logical_and.reduce(oks)
    assert 3 < ok.sum() < max(x.sum() for x in oks)
    if row["way"] != "turned":
        drawn = LevelSampler(problem, scheme, 4, antithetic=row["way"] == "exchanged").draw(1, 200)
        mean = (values[0] + values[-1]) / 2 - values[1] if row["way"] == "exchanged" else values[0] - values[1]
        assert (drawn.difference.n, drawn.failed) == (ok.sum(), 200 - ok.sum())
        assert drawn.difference.mean == pytest.approx(mean[ok].mean(), rel=1e-9)
        return
    mean = (values[0] + values[1]) / 2
    drawn = Antithetic(problem, scheme, 8, first).draw(200)
    assert (drawn.units.n, drawn.failed, drawn.paths) == (ok.sum(), 200 - ok.sum(), 400)
    assert drawn.units.mean == pytest.approx(mean[ok].mean(), rel=1e-9)


def failing(ridges, kind, **traits):
    """A model of compiled functions, one of which counts its calls and returns 7 in one of them."""
    calls, bad = [0], [-1]
    kinds = ("gradient", "value", "hessian", "hessian_vector", "third_derivative")

    def compiled(name):
        inner = callbacks.from_python(name, getattr(ridges, name), callbacks.Failures())

        def function(*given):
            code = inner(*given)
            if name == kind:
                calls[0] += 1
                return 7 if calls[0] == bad[0] else code
            return code

        return abi.CALLBACKS[name](function)

    functions = {name: compiled(name) for name in kinds}
    return ss.Model(ndof=ridges.ndof, nnoise=ridges.nnoise, **functions, **traits), calls, bad


FUNCTIONS = axes.covering(ndof=(1, 2, 3), nnoise=(1, 2, 3), at=("middle", "last"),
                          kind=("gradient", "value", "hessian", "hessian_vector", "third_derivative"))  # fmt: skip


@pytest.mark.parametrize("row", FUNCTIONS, ids=map(axes.ident, FUNCTIONS))
def test_a_code_of_a_function_ends_the_run(row):
    """An error code may come from any compiled function, in the middle of a run or at its last call."""
    model, calls, bad = failing(axes.ridges_of("coupled", row["ndof"], row["nnoise"]), row["kind"])
    run = {"q0": 0.3, "p0": 0.2, "step": 0.1, "steps": 20, "paths": 3, "threads": 1}
    scheme = {"third_derivative": "gauss2_strong32", "hessian_vector": "lambda:0.3"}.get(row["kind"], "gauss2")
    run |= {"scheme": scheme, "general": row["kind"] == "hessian"}
    ss.moments(model, **run)
    calls[0], bad[0] = 0, calls[0] - (calls[0] // 4 if row["at"] == "middle" else 0)
    assert bad[0] > 0
    with pytest.raises(ss.errors.CallbackError, match="7"):
        ss.moments(model, **run)


CALLS = {
    "step": lambda model, run: ss.step(model, "gauss2", 0.3, 0.2, 0.1, 0.05),
    "prepared": lambda model, run: ss.prepare(model, "gauss2", q0=0.3, p0=0.2, step=0.1).run(3),
    "symplecticity": lambda model, run: ss.diagnose.symplecticity(model, "gauss2", q=0.3),
    "action": lambda model, run: ss.diagnose.action(run),
    "residual": lambda model, run: ss.diagnose.euler_lagrange_residual(run),
    "stationary": lambda model, run: ss.diagnose.stationary_path(model, q_start=0.3, q_end=0.4, step=0.1, steps=4),
    "exact": lambda model, run: ss.diagnose.exact(run),
    "commutator": lambda model, run: ss.commutator(model),
    "value": lambda model, run: model.value(0.3, 0.2),
    "gradient": lambda model, run: model.gradient(0.3, 0.2),
    "hessian": lambda model, run: model.hessian(0.3, 0.2),
    "mean_square": lambda model, run: ss.mean_square(model, step=0.1),
}
ASKED = axes.covering(call=tuple(CALLS), ndof=(1, 2), nnoise=(1, 2), at=("first", "middle", "last"),
                      kind=("gradient", "value", "hessian", "hessian_vector"))  # fmt: skip


@pytest.mark.parametrize("row", ASKED, ids=map(axes.ident, ASKED))
def test_a_code_of_a_function_ends_every_call(row):
    """Every call that evaluates the model raises with the code; the next call is unaffected."""
    n, m, call = row["ndof"], row["nnoise"], CALLS[row["call"]]
    units, noises = np.eye(2 * n), [(k, 2, 0.3) for k in range(1, row["nnoise"] + 1)]
    found = [(j, f, s, 0, 0, a, 0) for j, f, s in ((0, 2, 0.5), *noises) for a in units]
    runs = row["call"] in {"step", "prepared", "mean_square"}  # calls before the run may fail, too
    kind, at = ("gradient", "last") if runs else (row["kind"], row["at"])
    model, calls, bad = failing(reference.Ridges(n, m, found), kind, quadratic=True, derived=True)
    run = ss.simulate(model, q0=0.3, p0=0.2, step=0.1, steps=3)
    call(model, run)  # the first call makes probes that are not repeated
    calls[0] = 0
    call(model, run)
    count = calls[0]
    if not count:
        return
    calls[0], bad[0] = 0, {"first": 1, "middle": (count + 1) // 2, "last": count}[at]
    with pytest.raises(ss.errors.CallbackError, match="7"):
        call(model, run)
    bad[0] = -1
    call(model, run)


TAKEN = axes.covering(kind=tuple(callbacks.RETURNS), ndof=(1, 2), nnoise=(1, 3), paths=(1, 9),
                      scheme=("midpoint", "gauss2_strong32", "lambda:0.3", "stormer_verlet"))  # fmt: skip


@pytest.mark.parametrize("row", TAKEN, ids=map(axes.ident, TAKEN))
def test_what_functions_are_given_is_theirs(row):
    """Weights, states and vectors that functions get: arrays that a function keeps stay unchanged, and a function that
    changes them changes no run."""
    ridges, kept = axes.ridges_of("coupled", row["ndof"], row["nnoise"]), []
    q0, p0 = axes.start(row["ndof"], row["paths"])
    given = {"q0": q0, "p0": p0, "step": 0.1, "steps": 3, "paths": row["paths"], "scheme": row["scheme"], "seed": 3}
    functions = {x: getattr(ridges, x, None) for x in callbacks.RETURNS}
    functions["gradient_hessian"] = lambda *x: (*ridges.gradient(*x), *ridges.hessian(*x))
    if row["kind"].startswith("force"):  # brackets refuse forces
        given["scheme"] = given["scheme"].replace("gauss2_strong32", "gauss2")
        functions["force"] = lambda q, p, t: -0.1 * p * q**2
        functions["force_derivative"] = lambda q, p, t: tuple(
            np.eye(len(q))[:, :, None] * x for x in (-0.2 * p * q, -0.1 * q**2)
        )
    if row["kind"] in ("drift", "kick"):  # two exact flows are a model without other functions
        given["scheme"] = "gauss_dkdkd"
        functions = {"drift": lambda t, tau, q, p: (q + tau * p, p)}
        functions["kick"] = lambda t, w, q, p: (q, p - w[0] * q**3 - 0.1 * w[1:].sum(axis=0) * np.cos(q))

    def taking(function, change):
        def taken(*asked):
            arrays = [x for x in asked if isinstance(x, np.ndarray)]
            before = [x.copy() for x in arrays]
            copies = iter(before)
            found = function(*(next(copies) if isinstance(x, np.ndarray) else x for x in asked))
            kept.append((arrays, before))
            for x in arrays if change else ():
                x[...] = np.nan
            return found

        return taken

    runs = []
    for change in (False, True):
        own = {**functions, row["kind"]: taking(functions[row["kind"]], change)}
        del kept[:]
        runs.append(ss.moments(ss.Model(ndof=row["ndof"], nnoise=row["nnoise"], **own), **given))
        if not change:
            for arrays, before in kept:
                np.testing.assert_equal(arrays, before)
    assert kept
    np.testing.assert_array_equal(*(run.table("mean") for run in runs))
