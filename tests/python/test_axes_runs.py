# SPDX-License-Identifier: BSD-3-Clause
"""Whole runs along all axes against plain NumPy: parts of a run, subsets, second calls of prepared runs, observers."""

import axes
import numpy as np
import pytest
import symsde as ss
from symsde import observe

SCHEMES = (
    "midpoint",
    "stormer_verlet",
    "gauss2_strong32",
    "gauss_dkdkd_midpoint",
    "verlet_kdk_strong2",
    "symplectic_euler",
)
STEPS, H, T0, SEED = 6, 0.1, 0.35, 2**40 + 3
RUNS = axes.covering(
    **axes.AXES, scheme=SCHEMES, compensated=(False, True), paths=(1, 3, 40), refine=(-1, 0, 1), save_every=(1, 2)
)


def scene_of(row, kind="position"):
    """The Hamiltonians, as Ridges of `reference`, and the arguments of a run with a state for every path."""
    ridges = axes.ridges_of(kind, row["ndof"], row["nnoise"], row["time"])
    q0, p0 = axes.start(row["ndof"], row["paths"])
    how = {x: row[x] for x in ("scheme", "first_step", "first_path", "paths", "compensated", "refine") if x in row}
    return ridges, {"q0": q0, "p0": p0, "step": H * row["sign"], "t0": T0, "seed": SEED, **how}


def same(one, other):
    """Whether two runs or parts of runs have the same bits in q, p, times and paths."""
    for x, y in zip((one.q, one.p, one.t, one.path), other, strict=True):
        np.testing.assert_array_equal(x, y)


def part(run, at, paths=slice(None)):
    """Some saved times and paths of a run."""
    return run.q[at][:, :, paths], run.p[at][:, :, paths], run.t[at], run.path[paths]


@pytest.mark.parametrize("row", RUNS, ids=map(axes.ident, RUNS))
def test_a_run_is_its_parts(row):
    """A resumed run, fewer paths, a prepared run called again, and moments have the bits of the whole run."""
    ridges, how = scene_of(row)
    model, every = axes.model_of(ridges, "position"), row["save_every"]
    whole = ss.simulate(model, steps=STEPS, save_every=every, **how)
    first, h = row["first_step"], how["step"]
    np.testing.assert_allclose(whole.t, T0 + h * (first + np.arange(0, STEPS + 1, every)), rtol=1e-14)
    np.testing.assert_array_equal(whole.path, row["first_path"] + np.arange(row["paths"]))

    head = ss.simulate(model, steps=2, save_every=every, **how)
    low = {"q0_low": head.q_low, "p0_low": head.p_low} if row["compensated"] else {}
    start = {"q0": head.last_q, "p0": head.last_p, "first_step": first + 2, **low}
    cut = 2 // every
    same(head, part(whole, slice(0, cut + 1)))
    same(ss.simulate(model, steps=4, save_every=every, **{**how, **start}), part(whole, slice(cut, None)))

    last = row["paths"] - 1
    few = {"q0": how["q0"][:, last:], "p0": how["p0"][:, last:], "paths": 1, "first_path": row["first_path"] + last}
    same(
        ss.simulate(model, steps=STEPS, save_every=every, **{**how, **few}), part(whole, slice(None), slice(last, None))
    )

    scheme = how.pop("scheme")
    prepared = ss.prepare(model, scheme, **how)
    for _ in range(2):
        same(prepared.run(2, save_every=every), part(whole, slice(0, cut + 1)))
        assert prepared.next_step == first + 2 and prepared.t == whole.setup.options.t0 + h * (first + 2)
        same(prepared.run(4, save_every=every), part(whole, slice(cut, None)))
        prepared.reset()
    prepared.reset(few["q0"].repeat(row["paths"], 1), few["p0"].repeat(row["paths"], 1), first_path=few["first_path"])
    again = prepared.run(STEPS, save_every=every)
    np.testing.assert_array_equal(again.q[:, :, 0], whole.q[:, :, last])
    prepared.reset(head.last_q, head.last_p, first_path=row["first_path"], first_step=first + 2,
                   **({"q0_low": head.q_low, "p0_low": head.p_low} if low else {}))  # fmt: skip
    same(prepared.run(4, save_every=every), part(whole, slice(cut, None)))


ALONE = axes.covering(
    name=("synchrotron", "henon_heiles", "driven_pendulum", "fpu_chain"),  # models whose few paths run one by one
    scheme=("midpoint", "stormer_verlet", "gauss2_strong32", "gauss_dkdkd", "chin4a_strong2"),
    steps=range(1, 10), first_step=(0, 1, 2, 3, 4, 6, 13), refine=(-3, -2, -1, 0, 1, 2), compensated=(False, True),
    common=((), (2,)), cut=(None, (1.5, 20.0)), few=(1, 3),
)  # fmt: skip


@pytest.mark.parametrize("row", ALONE, ids=map(axes.ident, ALONE))
def test_few_paths_are_those_of_a_block(row):
    """Few paths have the bits of a block, with the noise they draw, for any number of steps and from any first step."""
    model = ss.models.get(row["name"], **({"n": 3} if row["name"] == "fpu_chain" else {}))
    q0, p0 = axes.start(model.ndof, 20)
    how = {x: row[x] for x in ("scheme", "steps", "first_step", "refine", "compensated")}
    how |= {"step": H, "t0": T0, "seed": SEED, "common_noise": row["common"], "truncation": row["cut"]}
    whole = ss.simulate(model, q0=q0, p0=p0, paths=20, **how)
    few = slice(5, 5 + row["few"])
    part = ss.simulate(model, q0=q0[:, few], p0=p0[:, few], paths=row["few"], first_path=5, **how)
    same(part, (whole.q[:, :, few], whole.p[:, :, few], whole.t, whole.path[few]))


FAILING = axes.covering(
    ndof=(1, 2, 3), nnoise=(1, 2), sign=(1, -1), first_step=(0, 7), scheme=SCHEMES, paths=(1, 3, 40), at=(0, 1, 3),
    compensated=(False, True), fail=("one", "all"),
)  # fmt: skip


@pytest.mark.parametrize("row", FAILING, ids=map(axes.ident, FAILING))
def test_a_reset_run_is_as_new(row):
    """Whatever failed in earlier calls, a run after a reset gives the same states, statuses, failed steps, counters
    and warnings.
    """
    ridges, how = scene_of({**row, "time": ""})
    now = [0.0]

    def gradient(t, w, q, p):
        hq, hp = ridges.gradient(t, w, q, p)
        ill = abs(q[0] - q[0, 0]) <= (0 if row["fail"] == "one" else np.inf)
        return np.where(ill & (row["sign"] * (t - now[0]) > 0), np.nan, hq), hp

    traits = {**axes.TRAITS["position"], "derived": True}
    more = {x: getattr(ridges, x) for x in ("hessian", "hessian_vector", "third_derivative")}
    model = ss.Model(ndof=row["ndof"], nnoise=row["nnoise"], gradient=gradient, **more, **traits)
    now[0] = T0 + how["step"] * (row["first_step"] + row["at"] - 0.2)
    run = ss.prepare(model, **how)

    def call():
        before = run.report.counters
        with pytest.warns(ss.PathsFailedWarning) as said:
            for _ in range(5):
                run.step()
        told = [str(x.message).partition(":")[0] for x in said]
        counted = {x: n - before[x] for x, n in run.report.counters.items()}
        return [np.array(x) for x in (run.q, run.p, run.status, run.failed_step)], told, counted

    first = call()
    assert first[0][2].any() and (first[0][3][first[0][2] != 0] >= row["first_step"]).all()
    run.reset()
    assert not run.status.any() and (run.failed_step == -1).all()
    again = call()
    np.testing.assert_equal(again, first)


DRIVEN = axes.covering(**axes.AXES, refine=(0, 1, 2), paths=(1, 3, 40))


@pytest.mark.parametrize("row", DRIVEN, ids=map(axes.ident, DRIVEN))
def test_increments_are_those_of_the_run(row):
    """The output of `increments` drives the same run; asked from another first step and path it gives the same
    increments.
    """
    ridges, how = scene_of(row)
    model, draws = axes.model_of(ridges, "position"), {"step": how["step"], "seed": SEED, "refine": row["refine"]}
    own = {**draws, **{x: row[x] for x in ("first_step", "first_path", "paths")}}
    dw = ss.increments(model, steps=STEPS, **own)
    given = ss.simulate(model, steps=STEPS, increments=dw, **{**how, "refine": 0})
    same(ss.simulate(model, steps=STEPS, **how), part(given, slice(None)))
    before = {"first_step": row["first_step"] + 1, "first_path": row["first_path"] + row["paths"] - 1, "paths": 1}
    np.testing.assert_array_equal(ss.increments(model, steps=STEPS - 1, **draws, **before), dw[1:, :, -1:])
    finer = ss.increments(
        model, steps=2 * STEPS, **{**own, "step": how["step"] / 2, "refine": 0, "first_step": 2 * row["first_step"]}
    )
    if row["refine"] == 1:
        np.testing.assert_allclose(finer.reshape(STEPS, 2, *finer.shape[1:]).sum(axis=1), dw, rtol=0, atol=1e-15)


WEAK = axes.covering(
    scheme=tuple(x for x in ss.schemes.names() if ss.schemes.get(x).info.law != "Gaussian"), nnoise=(1, 2, 3),
    sign=(1, -1), first_step=(0, 7), first_path=(0, 2**31 + 5), refine=(0, 1, 2), paths=(1, 3, 40),
)  # fmt: skip


@pytest.mark.parametrize("row", WEAK, ids=map(axes.ident, WEAK))
def test_increments_of_weak_schemes_are_those_of_the_run(row):
    """Increments have the law that the scheme draws: +-sqrt(h), or +-sqrt(3 h) and 0."""
    law = {"two-point": (1.0,), "three-point": (0.0, 3**0.5)}[ss.schemes.get(row["scheme"]).info.law]
    ridges, how = scene_of({**row, "ndof": 2, "time": ""})
    model, draws = axes.model_of(ridges, "position"), {x: how[x] for x in ("step", "seed", "refine", "first_step")}
    draws |= {x: how[x] for x in ("first_path", "paths", "scheme")}
    dw = ss.increments(model, steps=STEPS, **draws)
    np.testing.assert_array_equal(dw, ss.diagnose.driving_increments(ss.simulate(model, steps=STEPS, **how)))
    if not ss.schemes.get(row["scheme"]).info.uses_areas:
        given = ss.simulate(model, steps=STEPS, increments=dw, **{**how, "refine": 0})
        same(ss.simulate(model, steps=STEPS, **how), part(given, slice(None)))
    if row["refine"] == 0 and row["paths"] == 40:
        sizes = np.unique((np.abs(dw) / H**0.5).round(12))
        assert set(sizes) <= set(np.round(law, 12)) and len(sizes) == len(law) and (dw > 0).any() and (dw < 0).any()


def test_increments_have_their_law():
    """The mean squares of 4 noises are |h|, all other products 0: 20 numbers within 5.2 of their errors (4e-6)."""
    model = axes.model_of(axes.ridges_of("kick", 1, 4), "kick")
    for h in (0.3, -0.3):
        dw = ss.increments(model, step=h, steps=1, paths=20000, first_path=2**31 + 5, first_step=7)[0] / np.sqrt(abs(h))
        error = (dw @ dw.T / 20000 - np.eye(4)) * np.sqrt(20000 / (1 + np.eye(4)))
        assert np.abs(error).max() < 5.2


KINDS = ("kick", "both", "position", "coupled")
OBSERVED = axes.covering(**axes.AXES, kind=KINDS, save_every=(1, 3), absorb=(False, True), of=(0, 1), threads=(1, 2))


@pytest.mark.parametrize("row", OBSERVED, ids=map(axes.ident, OBSERVED))
def test_observers_tell_of_the_paths(row):
    """Observers of every saved step are compared with NumPy, also for paths that left by a bridge, as the generator's
    number decides.
    """
    row = {**row, "paths": 300, "first_path": row["first_path"] // 256 * 256}  # first path of a shard
    ridges, how = scene_of(row, row["kind"])
    model, n = axes.model_of(ridges, row["kind"]), row["ndof"]
    how |= {"scheme": "midpoint", "q0": 0.3 * how["q0"], "p0": 0.3 * how["p0"]}
    run = ss.simulate(model, steps=STEPS, **how)
    of = row["of"] * n + n - 1
    name = f"{'qp'[row['of']]}_{n}"
    acts = row["of"] == 1 or row["kind"] in {"both", "coupled"}
    ends = np.quantile(np.concatenate([run.q, run.p], axis=1)[:, of], [0.04, 0.96])
    when = axes.passages(ridges, run, of, *ends)
    wanted = {
        "loss": observe.Passage(name, low=ends[0], high=ends[1], absorb=row["absorb"]),
        "far": observe.Extremes(name),
        "some": observe.Paths((row["first_path"], row["first_path"] + 299)),
        "cov": observe.Covariance((name, "q_1")),
    }
    found = ss.moments(
        model, steps=STEPS, save_every=row["save_every"], observers=wanted, threads=row["threads"], **how
    )
    loss, first = found.observed["loss"], row["first_step"]
    listed = np.flatnonzero(when >= 0)
    assert 20 < len(listed) < 300 and (loss.bridged is None) == (not acts)
    np.testing.assert_array_equal(loss.path, row["first_path"] + listed)
    np.testing.assert_array_equal(loss.step, when[listed])
    at = when[listed] - first
    states = [[run.t[i], *run.q[i, :, j], *run.p[i, :, j]] for i, j in zip(at, listed, strict=True)]
    np.testing.assert_array_equal(loss.state, states)

    saved = np.arange(0, STEPS + 1, row["save_every"])
    there = (when < 0) | (when - first > saved[:, None]) | (not row["absorb"])
    x = np.concatenate([run.q, run.p], axis=1)[saved]
    np.testing.assert_array_equal(found.t, run.t[saved])
    np.testing.assert_array_equal(found.n_ok, there.sum(axis=1))
    mean = np.where(there[:, None], x[:, :n], 0).sum(axis=2) / there.sum(axis=1)[:, None]
    np.testing.assert_allclose(found.mean_q, mean, rtol=1e-12, atol=1e-14)
    far = found.observed["far"]
    values = np.where(there, x[:, of], np.nan)
    for reached, best in ((far.lowest, np.nanmin(values)), (far.highest, np.nanmax(values))):
        i, j = np.argwhere(values == best)[0]
        assert reached == (best, row["first_path"] + j, run.t[saved[i]])
    if not row["absorb"]:
        np.testing.assert_array_equal(
            found.observed["some"].values, np.moveaxis(x[:, :, [0, 299]], 2, 0)[:, :, : 2 * n]
        )
        np.testing.assert_allclose(found.observed["cov"].covariance[-1], np.cov([x[-1, of], x[-1, 0]]), rtol=1e-10)


COUNTED = axes.covering(
    scheme=tuple(ss.schemes.names()), paths=(1, 3, 5), refine=(-1, 0, 1), sign=(1, -1), first_step=(0, 7)
)


@pytest.mark.parametrize("row", COUNTED, ids=map(axes.ident, COUNTED))
def test_counters_count_paths_and_no_padding(row):
    """With linear equations every path-step counts equally, up to one sweep: few paths count their share of a full
    block.
    """
    model = ss.Model(ndof=1, nnoise=2, gradient=lambda t, w, q, p: (w[0] * q + w[1] - 0.5 * w[2], w[0] * p),
                     **axes.TRAITS["kick"], quadratic=True, rotation=[1.0])  # fmt: skip
    how = {
        "step": H * row["sign"],
        "steps": STEPS,
        "first_step": row["first_step"],
        "scheme": row["scheme"],
        "lanes": 8,
    }
    how["refine"] = row["refine"] if ss.schemes.get(row["scheme"]).info.law == "Gaussian" else max(row["refine"], 0)
    few, all_ = (ss.simulate(model, q0=0.4, p0=0.1, paths=n, **how).report.counters for n in (row["paths"], 8))
    assert few["path_steps"] == STEPS * row["paths"]
    part = {x: n * row["paths"] / 8 for x, n in all_.items()}
    assert few["normals"] == part["normals"] > 0
    for name, n in few.items():
        assert abs(n - part[name]) <= 0.1 * part[name], name


@pytest.mark.parametrize("scheme", ["stormer_verlet", "symplectic_euler", "verlet_kdk", "heun", "chin4a"])
def test_a_path_that_fails_beside_others_stays_at_its_last_good_state(scheme):
    """Two of sixteen paths overflow, in different steps: their last states are the states saved before the failed
    step."""
    q0 = np.full((2, 16), 0.1)
    q0[1, 3], q0[0, 7] = 40.0, 30.0
    with pytest.warns(ss.PathsFailedWarning, match="2 paths"):
        run = ss.simulate(ss.models.henon_heiles(), q0=q0, p0=0.03, step=0.1, steps=100, scheme=scheme, paths=16)
    first, second = run.failed_step[[3, 7]]
    assert 0 < first < second and np.count_nonzero(run.status) == 2
    for path, step in ((3, first), (7, second)):
        np.testing.assert_array_equal(run.last_q[:, path], run.q[step, :, path])
        np.testing.assert_array_equal(run.last_p[:, path], run.p[step, :, path])
        assert np.isfinite(run.p[step, :, path]).all() and np.isnan(run.p[step + 1, :, path]).all()
