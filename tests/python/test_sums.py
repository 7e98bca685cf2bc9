# SPDX-License-Identifier: BSD-3-Clause
"""Sums over sites in observables, against saved paths and against the energy."""

import numpy as np
import pytest
import symsde as ss
from symsde import observe
from symsde.cli import command_line
from symsde.errors import IncompatibleError, InvalidArgumentError
from symsde.model.formulas import formula_observables as formulas

pytestmark = pytest.mark.optimised

H = "Sum(p[i]**2/2 + (q[i+1] - q[i])**2/2 + k*(q[i+2] - q[i-1])**4/4 + cos(q[i] - q[i+1]), i) + 0.5*Sum(q[j]**2, j)"
N = 7


def chain(ends, n=N):
    return ss.model_from_sympy(H, ["-s*q[i]"], params={"k": 0.3, "s": 0.1}, n=n, ends=ends)


def start(n=N):
    sites = np.arange(n)
    return {"q0": 0.3 * np.cos(sites), "p0": 0.2 * np.sin(3 * sites)}


RUN = {"step": 0.02, "steps": 40, "save_every": 10, "paths": 300, "seed": 2}


@pytest.mark.parametrize("ends", ["free", "fixed", "periodic"])
def test_the_energy_as_an_observable(ends):
    """The model's own text as an observable has the values of the energy."""
    found = ss.moments(chain(ends), observables={"h": H}, **RUN, **start())
    np.testing.assert_allclose(found.mean["h"], found.mean_energy, rtol=1e-13)
    np.testing.assert_allclose(found.var["h"][1:], found.var_energy[1:], rtol=1e-10)
    assert found.var_energy[-1] > 0


MIXED = {
    "kinetic": "Sum(p[i]**2, i)/2",
    "speed": "sqrt(Sum(p[i]**2, i)) + t",
    "ratio": "Sum(q[i]*p[i], i)/(1 + Sum(q[i]**2, i)) - q_2",
    "ends": "Sum(q[i+1]*sin(q[i])*exp(-t), i)*beta",
    "beside": "Sum(cos(q[i] - q1)*p_3, i)",
    "plain": "q1*p2",
}


IN_TIME = ("Sum(q[i]*cos(3*t), i)", "t*Sum(q[i+1]*p[i], i)", "Sum(t + q[i], i)/(1 + Sum(p[i]**2, i))", "q1*sin(5*t)",
           "t", "Sum(q[i]**2, i)")  # fmt: skip


@pytest.mark.parametrize("formula", IN_TIME)
@pytest.mark.parametrize("paths", [1, 3, 20])
def test_formulas_beside_a_function_are_taken_at_their_times(formula, paths):
    """A Python function gets several saved times at once, unless a formula beside it uses the time, in a sum or
    outside. The formula's values are the same with and without a function beside it."""
    run = {**RUN, **start(), "paths": paths, "save_every": 1}
    alone = ss.moments(chain("periodic"), observables={"f": formula}, **run)
    beside = ss.moments(chain("periodic"), observables={"f": formula, "own": lambda q, p: q[0] + 0 * p[0]}, **run)
    for found in (alone, beside):
        np.testing.assert_allclose(found.mean["f"], alone.mean["f"], rtol=1e-13, atol=1e-15)
    np.testing.assert_allclose(beside.mean["own"], beside.mean_q[:, 0], rtol=1e-14)
    assert np.ptp(alone.mean["f"]) > 1e-4


@pytest.fixture(scope="module")
def beta():
    """A chain of the library with its own ends: sums over sites stop where its bonds do."""
    return ss.models.fpu_chain(n=5, beta=0.7)


def known(run):
    q, p, t = run.q.swapaxes(0, 1), run.p.swapaxes(0, 1), run.t[:, None]
    return {
        "kinetic": (p**2).sum(axis=0) / 2,
        "speed": np.sqrt((p**2).sum(axis=0)) + t,
        "ratio": (q * p).sum(axis=0) / (1 + (q**2).sum(axis=0)) - q[1],
        "ends": (q[1:] * np.sin(q[:-1])).sum(axis=0) * np.exp(-t) * 0.7,
        "beside": (np.cos(q - q[0]) * p[2]).sum(axis=0),
        "plain": q[0] * p[1],
    }


def test_formulas_of_sums(beta):
    wanted = {"far": observe.Extremes("speed"), "loss": observe.Passage("kinetic", high=0.4, absorb=False)}
    found = ss.moments(beta, observables=MIXED, observers=wanted, **RUN, **start(5))
    run = ss.simulate(beta, **RUN, **start(5))
    for name, x in known(run).items():
        np.testing.assert_allclose(found.mean[name], x.mean(axis=1), rtol=1e-12, atol=1e-15, err_msg=name)
    highest = np.maximum.accumulate(known(run)["speed"], axis=0).mean(axis=1)
    np.testing.assert_allclose(found.observed["far"].mean_highest, highest, rtol=1e-12)
    every = ss.simulate(beta, **{**RUN, "save_every": 1}, **start(5))
    lost = np.logical_or.accumulate(known(every)["kinetic"] >= 0.4, axis=0)[::10].mean(axis=1)
    np.testing.assert_allclose(found.observed["loss"].lost, lost, rtol=1e-14)
    for options in ({"threads": 3}, {"lanes": 8}):
        again = ss.moments(beta, observables=MIXED, observers=wanted, **RUN, **start(5), **options)
        np.testing.assert_array_equal(again.to_arrays()[0], found.to_arrays()[0])
    parts = ss.ensemble(beta, observables=MIXED, observers=wanted, shard_paths=256, **RUN, **start(5))
    np.testing.assert_array_equal(parts.to_arrays()[0], found.to_arrays()[0])


def test_lanes_far_away(beta):
    """One path far from zero, where the sine is slow, leaves the other paths their bits."""
    q0 = np.tile(start(5)["q0"][:, None], (1, 20))
    run = {"p0": 0.0, "step": 1e-3, "steps": 0, "paths": 20}
    shown = {"observables": {"sines": "Sum(sin(q[i]), i)"}, "observers": {"x": observe.Paths((3, 7), of=("sines",))}}
    near = ss.moments(beta, q0=q0, **shown, **run).observed["x"].values
    q0[2, 7] = 1e12
    far = ss.moments(beta, q0=q0, **shown, **run).observed["x"].values
    np.testing.assert_array_equal(far[0], near[0])
    np.testing.assert_allclose(far[1, 0, 0], np.sin(q0[:, 7]).sum(), rtol=1e-14)


def test_without_a_compiler(beta, monkeypatch):
    fast = ss.moments(beta, observables=MIXED, **RUN, **start(5))
    monkeypatch.setattr("symsde.model.formulas.compiler.command", lambda: None)
    formulas._read.cache_clear()
    try:
        slow = ss.moments(beta, observables=MIXED, **RUN, **start(5))
    finally:
        formulas._read.cache_clear()
    for name in MIXED:
        np.testing.assert_allclose(slow.mean[name], fast.mean[name], rtol=1e-13, atol=1e-15, err_msg=name)


PAIRS = {"c": "Sum(2 + q[i]*p[i+1], i)"}


@pytest.mark.parametrize("ends", ["free", "fixed", "periodic"])
def test_without_a_compiler_at_the_ends(ends, monkeypatch):
    model = chain(ends)
    wanted = formulas.FormulaObservables(model, {"h": H, **PAIRS})
    rng = np.random.default_rng(1)
    q, p = rng.normal(size=(2, N, 5))
    fast = wanted(0.0, q, p)
    np.testing.assert_allclose(fast[0], model.value(q, p), rtol=1e-13)
    pairs = {"free": q[:-1] * p[1:], "fixed": np.vstack([0 * q[:1], q[:-1] * p[1:], 0 * q[:1]])}
    pairs["periodic"] = q * np.roll(p, -1, axis=0)
    np.testing.assert_allclose(fast[1], (2 + pairs[ends]).sum(axis=0), rtol=1e-13)
    monkeypatch.setattr("symsde.model.formulas.compiler.command", lambda: None)
    formulas._read.cache_clear()
    try:
        slow = formulas.FormulaObservables(model, {"h": H, **PAIRS})(0.0, q, p)
    finally:
        formulas._read.cache_clear()
    np.testing.assert_allclose(slow, fast, rtol=1e-13)


def test_any_number_of_sites():
    """The same code serves 100,000 sites, with names for some of them."""
    n = 100_000
    model = chain("periodic", n)
    q = np.cos(0.1 * np.arange(n))[:, None] * [1.0, 2.0]
    wanted = {"s": "Sum((q[i+1] - q[i-1])**2, i)/k", "x": "q_99999*p100000 + Sum(p[i], i)"}
    found = formulas.FormulaObservables(model, wanted)(0.0, q, 2 * q)
    differences = np.roll(q, -1, axis=0) - np.roll(q, 1, axis=0)
    np.testing.assert_allclose(found[0], (differences**2).sum(axis=0) / 0.3, rtol=1e-11)
    np.testing.assert_allclose(found[1], 2 * q[-2] * q[-1] + 2 * q.sum(axis=0), rtol=1e-9)
    with pytest.raises(InvalidArgumentError, match="q100001, which is not given"):
        formulas.FormulaObservables(model, {"x": "Sum(q[i], i) + q100001"})


BAD = {
    "Sum(q[i+4]*q[i-1], i)": "its neighbours reach over 6 of 5 sites: give more sites",
    "Sum(2, i)": r"holds a sum without q\[i\] or p\[i\]",
    "Sum(q[i])": r"a Sum that is not written Sum\(formula, i\)",
    "Sum(q[i]*Sum(q[j], j), i)": "a Sum in a Sum",
    "Sum(q[i], i) + q[i]": r"q\[i\] outside of a sum",
    "Sum(q[j], i)": "the index j, where there is i",
    "Sum(q[i], beta)": "sums over beta, which means something else",
    "Sum(q[i+9], i)": "an index that is not i, i \\+ 1",
    "Sum(x[i], i)": r"an index of something that is not q\[i\] or p\[i\]",
    "Sum(q[i] > 0, i)": "comparison",
    "Sum(foo(q[i]), i)": "calls foo",
    "Sum": "Sum",
    "q[2]": "index in brackets",
}


@pytest.mark.parametrize(("text", "sentence"), BAD.items())
def test_bad_sums(text, sentence, beta):
    with pytest.raises(InvalidArgumentError, match=f"observable 'x': .*{sentence}"):
        ss.moments(beta, observables={"x": text}, **RUN, **start(5))


def test_sums_in_scenes(beta, tmp_path):
    (tmp_path / "scene.toml").write_text(
        '[model]\nname = "fpu_chain"\nn = 5\nbeta = 0.7\n[run]\nstep = 0.02\nsteps = 40\nsave_every = 10\n'
        "paths = 300\nseed = 2\n"
        f"q0 = {start(5)['q0'].tolist()}\np0 = {start(5)['p0'].tolist()}\n"
        '[observables]\nkinetic = "Sum(p[i]**2, i)/2"\n'
    )
    assert command_line.main(["run", str(tmp_path / "scene.toml"), "--out", str(tmp_path / "out"), "--quiet"]) == 0
    found = ss.moments(beta, observables={"kinetic": MIXED["kinetic"]}, **RUN, **start(5))
    np.testing.assert_array_equal(ss.open_run(tmp_path / "out").moments.mean["kinetic"], found.mean["kinetic"])


def bodies(n=5):
    return ss.model_from_sympy(
        "Sum((u[i]**2 + v[i]**2)/(2*m[i]), i) - Sum(g*m[i]*m[j]/sqrt((x[i]-x[j])**2 + (y[i]-y[j])**2 + 0.1), i < j)",
        ["s*x[k]"],
        q="x y",
        p="u v",
        n=n,
        params={"g": 0.7, "s": 0.1, "m": np.linspace(0.5, 1.5, n)},
    )


OF_BODIES = {
    "kinetic": "Sum((u[i]**2 + v[i]**2)/(2*m[i]), i)",
    "potential": "-g*Sum(m[i]*m[j]/sqrt((x[i]-x[j])**2 + (y[i]-y[j])**2 + 0.1), i < j)",
    "turning": "Sum(x[i]*v[i] - y[i]*u[i], i) + 0*t",
    "beside": "Sum(m[j]*exp(x[i] - y[j] - x_2), i < j)/(1 + Sum(x[k+1]*m[k], k)**2)",
    "every": "Sum(q[i]*q[i+1], i) + Sum(q[i]*p[j], i < j)",
}


def of_bodies(model, q, p):
    """The values of OF_BODIES on states (dof, lane)."""
    m, g = np.array(model.parameters["m"])[:, None], model.parameters["g"]
    (x, y), (u, v) = (np.moveaxis(a.reshape(len(m), 2, -1), 1, 0) for a in (q, p))
    pairs = [(i, j) for i in range(len(m)) for j in range(i + 1, len(m))]
    near = sum(m[i] * m[j] / np.sqrt((x[i] - x[j]) ** 2 + (y[i] - y[j]) ** 2 + 0.1) for i, j in pairs)
    above = sum(m[j] * np.exp(x[i] - y[j] - x[1]) for i, j in pairs)
    every = sum(q[i] * p[j] for i in range(len(q)) for j in range(i + 1, len(q)))
    return {
        "kinetic": ((u**2 + v**2) / (2 * m)).sum(axis=0),
        "potential": -g * near,
        "turning": (x * v - y * u).sum(axis=0),
        "beside": above / (1 + (x[1:] * m[:-1]).sum(axis=0) ** 2),
        "every": (q[:-1] * q[1:]).sum(axis=0) + every,
    }


@pytest.mark.parametrize("compiled", [True, False])
def test_sites_of_the_model(compiled, monkeypatch):
    """Observables read the coordinates and parameters of the model's sites, and pairs of them, on any number of lanes;
    q[i] and p[i] go over all coordinates."""
    model, rng = bodies(), np.random.default_rng(3)
    if not compiled:
        monkeypatch.setattr("symsde.model.formulas.compiler.command", lambda: None)
        formulas._read.cache_clear()
    try:
        read = formulas.FormulaObservables(model, OF_BODIES)
        assert read.is_compiled == compiled
        for lanes in (1, 8, 21):
            q, p = rng.normal(size=(2, 10, lanes))
            found, known = read(0.0, q, p), of_bodies(model, q, p)
            for name, row in zip(OF_BODIES, found, strict=True):
                np.testing.assert_allclose(row, known[name], rtol=1e-12, atol=1e-13, err_msg=name)
            np.testing.assert_allclose(found[0] + found[1], model.value(q, p), rtol=1e-12)
            alone = read(0.0, np.ascontiguousarray(q[:, -1:]), np.ascontiguousarray(p[:, -1:]))
            np.testing.assert_array_equal(alone[:, 0], found[:, -1])
    finally:
        formulas._read.cache_clear()


def test_energies_of_bodies(tmp_path):
    """Kinetic and pair energies by formulas add up to the energy, in moments, expectations and scenes, with other
    parameters of sites too."""
    run = {"q0": np.cos(np.arange(10)), "p0": 0.1, "step": 0.01, "steps": 20, "paths": 40, "seed": 4}
    wanted = {x: OF_BODIES[x] for x in ("kinetic", "potential")}
    for model in (bodies(), bodies().with_parameters(m=[1.0, 0.2, 3.0, 0.4, 1.5], g=1.1)):
        found = ss.moments(model, observables=wanted, **run)
        np.testing.assert_allclose(found.mean["kinetic"] + found.mean["potential"], found.mean_energy, rtol=1e-13)
        last = ss.simulate(model, **run)
        np.testing.assert_allclose(
            found.mean["potential"][-1], of_bodies(model, last.q[-1], last.p[-1])["potential"].mean(), rtol=1e-12
        )
        assert np.ptp(found.mean["kinetic"]) > 0.01
    start = {x: run[x] for x in ("q0", "p0", "seed")}
    mean = ss.expect(bodies(), wanted["potential"], horizon=0.2, abs=0.01, **start)
    found = ss.moments(bodies(), observables=wanted, **run)
    assert abs(mean.value - found.mean["potential"][-1]) < 0.01 + 5 * found.se_mean["potential"][-1]
    (tmp_path / "scene.toml").write_text(
        '[model]\nH = "Sum((u[i]**2 + v[i]**2)/(2*m[i]), i) - Sum(g*m[i]*m[j]/sqrt((x[i]-x[j])**2'
        ' + (y[i]-y[j])**2 + 0.1), i < j)"\nnoise = ["s*x[k]"]\n'
        'q = "x y"\np = "u v"\nn = 5\n[model.params]\ng = 0.7\ns = 0.1\n'
        f"m = {np.linspace(0.5, 1.5, 5).tolist()}\n[run]\nstep = 0.01\nsteps = 20\npaths = 40\nseed = 4\n"
        f"q0 = {np.cos(np.arange(10)).tolist()}\np0 = 0.1\n"
        + "[observables]\n"
        + "".join(f'{name} = "{text}"\n' for name, text in wanted.items())
    )
    assert command_line.main(["run", str(tmp_path / "scene.toml"), "--out", str(tmp_path / "out"), "--quiet"]) == 0
    np.testing.assert_array_equal(ss.open_run(tmp_path / "out").moments.mean["kinetic"], found.mean["kinetic"])


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("m*x_1", "holds m, whose values differ from site to site"),
        ("m*x_1 + Sum(x[i], i)", r"takes m as a number, which is a parameter .*: write m\[i\]"),
        ("Sum(x[i]*m, i)", r"write m\[i\]"),
        ("Sum(x[i] + q[i], i)", r"index of q: .* as in x\[i\] or y\[i\] or u\[i\] or v\[i\]; of q there are q_1"),
        ("Sum(x[i], i < j)", "sums over pairs what does not depend on both"),
        ("Sum(m[i]*m[j], i < j)", r"a sum without q\[i\] or p\[i\]"),
        ("Sum(x[i+1]*x[j], i < j)", "neighbours in a sum over pairs"),
    ],
)
def test_bad_sums_over_sites_of_the_model(text, sentence):
    with pytest.raises((InvalidArgumentError, IncompatibleError), match=f"observable 'o'.*{sentence}"):
        ss.moments(bodies(), observables={"o": text}, q0=0.1, p0=0.0, step=0.1, steps=1)
