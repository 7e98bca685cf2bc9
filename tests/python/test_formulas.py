# SPDX-License-Identifier: BSD-3-Clause
# ruff: noqa: PLR0917 - callbacks of C take what they take
"""Models from formulas of sympy: the catalogue again, every set of outputs, the cache, parameters, bad input."""

import copy
import ctypes
import itertools
import os
import pickle
import shutil
import subprocess
import sys
import time

import numpy as np
import pytest
import symsde as ss
from symsde import errors
from symsde.native import abi

sp = pytest.importorskip("sympy")

from symsde.model.formulas import compiler  # noqa: E402
from symsde.model.formulas.graph import Graph  # noqa: E402

if compiler.command() is None:
    pytest.skip("no C compiler", allow_module_level=True)

pytestmark = pytest.mark.optimised

q, p, t = sp.symbols("q p t")
a, g, s, s1, s2, w = sp.symbols("a gamma sigma sigma1 sigma2 omega")
q1, q2, p1, p2 = sp.symbols("q1 q2 p1 p2")
CATALOGUE = {
    "kubo": (a * (p**2 + q**2) / 2, [s * (p**2 + q**2) / 2], {"a": 1.1, "sigma": 0.3}),
    "linear_oscillator": ((p**2 + q**2) / 2, [-s * q], {"sigma": 0.7}),
    "additive_oscillator": ((p**2 + q**2) / 2, [s * p, -g * q], {"sigma": 0.4, "gamma": 0.9}),
    "synchrotron": (
        p**2 / 2 - w**2 * sp.cos(q),
        [s1 * sp.sin(q), -s2 * sp.cos(q)],
        {"omega": 1.9, "sigma1": 0.2, "sigma2": 0.1},
    ),
    "pendulum": (p**2 / 2 - sp.cos(q), [s * (p**2 + q**2) / 2], {"sigma": 0.5}),
    "noncommutative_oscillator": (
        (p**2 + q**2) / 2,
        [sp.Symbol("s1") * p**2 / 2, sp.Symbol("s2") * q**2 / 2],
        {"s1": 0.4, "s2": 0.6},
    ),
    "henon_heiles": (
        (p1**2 + p2**2 + q1**2 + q2**2) / 2 + a * (q1**2 * q2 - q2**3 / 3),
        [s1 * q1, s2 * q2],
        {"alpha": 1.2, "sigma1": 0.1, "sigma2": 0.2},
    ),
}
FLAGS = ("separable", "additive", "position_noise", "quadratic", "identity_mass")
FLAGS += ("has_value", "has_hessian", "has_hessian_vector")


def formula(name, factor=1):
    """A model of the catalogue from its formula, with a factor on H."""
    H, noise, params = CATALOGUE[name]
    if name == "henon_heiles":
        H = H.subs(a, sp.Symbol("alpha"))
        return ss.model_from_sympy(factor * H, noise, q=[q1, q2], p=[p1, p2], params=params)
    return ss.model_from_sympy(factor * H, noise, q=q, p=p, params=params)


def chain(n):
    """The Fermi-Pasta-Ulam chain, site by site."""
    x, y = sp.symbols(f"x0:{n}"), sp.symbols(f"y0:{n}")
    beta, ends = sp.Symbol("beta"), [0, *sp.symbols(f"x0:{n}"), 0]
    stretch = [ends[i + 1] - ends[i] for i in range(n + 1)]
    H = sum(v**2 for v in y) / 2 + sum(r**2 / 2 + beta * r**4 / 4 for r in stretch)
    return ss.model_from_sympy(H, [-s * v for v in x], q=x, p=y, params={"beta": 0.8, "sigma": 0.1})


def everything(model, x, y, weights):
    """Values and all derivatives, in sequence."""
    value = model.value(x, y, weights)
    return [value, *model.gradient(x, y, weights), *model.hessian(x, y, weights)]


def distance(mine, known):
    """Largest difference in ulps of the number, or in ulps of one for numbers below one."""
    pairs = zip(mine, known, strict=True)
    return max(float(np.max(np.abs(m - k) / np.spacing(np.maximum(np.abs(k), 1.0)))) for m, k in pairs)


def points(model, seed=3, count=500):
    """States and weights."""
    rng = np.random.default_rng(seed)
    x, y = rng.normal(size=(2, model.ndof, count))
    return x, y, rng.normal(size=(model.nnoise + 1, count))


@pytest.mark.parametrize("name", CATALOGUE)
def test_derivatives_and_traits_are_those_of_the_catalogue(name):
    mine, known = formula(name), ss.models.get(name, **CATALOGUE[name][2])
    at = points(known)
    assert distance(everything(mine, *at), everything(known, *at)) <= 16
    assert distance(everything(formula(name, sp.Rational(101, 100)), *at), everything(known, *at)) > 1e12
    assert {k: getattr(mine.traits, k) for k in FLAGS} == {k: getattr(known.traits, k) for k in FLAGS}
    assert mine.traits.rotation == known.traits.rotation or known.traits.rotation is None
    mine.probe()


def test_terms_that_differ_by_their_parameters_alone_add_up():
    model = ss.model_from_sympy(p**2 / 2 + a * q**2 / 2 + w * q**2, q=q, p=p, params={"a": 1.5, "omega": 0.25})
    assert model.gradient(3.0, 0.0)[0] == 6.0 and model.value(3.0, 0.0) == 9.0 and model.hessian(3.0, 0.0)[0] == 2.0


def test_a_chain_is_that_of_the_catalogue():
    mine, known = chain(6), ss.models.fpu_chain(n=6, beta=0.8, sigma=0.1)
    at = points(known)
    assert distance(everything(mine, *at), everything(known, *at)) <= 64
    assert mine.formula.structure.bandwidth == 1


@pytest.mark.parametrize("name", CATALOGUE)
@pytest.mark.parametrize("scheme", ["midpoint", "symplectic_euler", "gauss2", "stormer_verlet"])
def test_runs_are_those_of_the_catalogue(name, scheme):
    run = {"q0": 0.3, "p0": 0.2, "step": 0.05, "steps": 40, "paths": 30, "seed": 4, "scheme": scheme}
    mine, known = (ss.simulate(m, **run) for m in (formula(name), ss.models.get(name, **CATALOGUE[name][2])))
    np.testing.assert_allclose(mine.q, known.q, rtol=0, atol=1e-12)
    np.testing.assert_allclose(mine.p, known.p, rtol=0, atol=1e-12)


def test_bits_do_not_depend_on_threads_or_blocks():
    run = {"q0": 0.3, "p0": 0.2, "step": 0.05, "steps": 20, "paths": 300, "seed": 4, "scheme": "midpoint"}
    model = formula("pendulum")
    one, other = (ss.simulate(model, threads=n, lanes=k, **run) for n, k in ((1, 0), (2, 8)))
    assert (one.q == other.q).all() and (one.p == other.p).all()
    for first, paths in ((0, 1), (5, 3), (17, 9)):  # numbers of paths that do not fill whole vectors
        some = ss.simulate(model, first_path=first, **{**run, "paths": paths})
        assert (some.q == one.q[:, :, first : first + paths]).all()


# ---- sets of outputs ---------------------------------------------------------------------------------------

BLOCKS = ("hq", "hp", "hqq", "hqp", "hpp")


def call(model, kind, names, outputs, at, vectors=()):
    """Call a callback by its address; gives the arrays of the wanted outputs."""
    x, y, weights = (np.ascontiguousarray(v) for v in at)
    n, lanes = x.shape
    shapes = {"value": (lanes,), "hq": (n, lanes), "hp": (n, lanes), "uq": (n, lanes), "up": (n, lanes)}
    made = {name: np.full(shapes.get(name, (n, n, lanes)), np.nan) for name in names if name in outputs}
    library = ctypes.CDLL(model.formula.file)
    function = ctypes.cast(getattr(library, f"formula_{kind}"), abi.CALLBACKS[kind])
    values = np.array([*model.parameters.values(), 0.0])
    addresses = [made[name].ctypes.data if name in made else None for name in names]
    given = [v.ctypes.data for v in (weights, x, y, *vectors)]
    assert function(lanes, n, weights.shape[0], 0.7, *given, *addresses, values.ctypes.data) == 0
    return made


def mixed():
    """A model with functions and time, whose blocks of derivatives all differ."""
    H = p1**2 / (2 + sp.cos(q1 - q2)) + p2**2 / 2 + sp.exp(-(q1**2)) * p1 * q2 + sp.log(2 + q2**2) * sp.cos(w * t)
    noise = [s * sp.tanh(q1) * p2, sp.sqrt(1 + q1**2 + p1**2), q2**3 * p1]
    return ss.model_from_sympy(H, noise, q=[q1, q2], p=[p1, p2], params={"omega": 1.5, "sigma": 0.3})


def test_every_set_of_outputs_has_the_same_bits():
    model = mixed()
    at = points(model, count=37)
    whole = call(model, "gradient_hessian", BLOCKS, BLOCKS, at)
    for size in range(1, 6):
        for chosen in itertools.combinations(BLOCKS, size):
            some = call(model, "gradient_hessian", BLOCKS, chosen, at)
            assert all((some[name] == whole[name]).all() for name in chosen), chosen
    for kind, names in (("gradient", BLOCKS[:2]), ("hessian", BLOCKS[2:])):
        some = call(model, kind, names, names, at)
        assert all((some[name] == whole[name]).all() for name in names), kind


def test_derivatives_agree_with_differences_of_values_in_every_direction():
    """The value is the formula itself; mpmath's exact arithmetic gives all derivatives from it."""
    model = mixed()
    x, y, weights = points(model, count=3)
    made = call(model, "gradient_hessian", BLOCKS, BLOCKS, (x, y, weights))
    value = call(model, "value", ("value",), ("value",), (x, y, weights))["value"]
    H = p1**2 / (2 + sp.cos(q1 - q2)) + p2**2 / 2 + sp.exp(-(q1**2)) * p1 * q2 + sp.log(2 + q2**2) * sp.cos(w * t)
    noise = [s * sp.tanh(q1) * p2, sp.sqrt(1 + q1**2 + p1**2), q2**3 * p1]
    for lane in range(3):
        total = sum(float(c) * h for c, h in zip(weights[:, lane], (H, *noise), strict=True))
        state = dict(zip((q1, q2, p1, p2), (*x[:, lane], *y[:, lane]), strict=True))
        state |= {w: 1.5, s: 0.3, t: 0.7}
        known = lambda e, state=state: float(e.evalf(30, subs=state))  # noqa: E731
        assert value[lane] == pytest.approx(known(total), rel=1e-14)
        for i, u in enumerate((q1, q2)):
            assert made["hq"][i, lane] == pytest.approx(known(total.diff(u)), rel=1e-13, abs=1e-14)
            for j, v in enumerate((p1, p2)):
                assert made["hqp"][j, i, lane] == pytest.approx(known(total.diff(u, v)), rel=1e-13, abs=1e-14)
            for j, v in enumerate((q1, q2)):
                assert made["hqq"][j, i, lane] == pytest.approx(known(total.diff(u, v)), rel=1e-13, abs=1e-14)


def test_hessian_times_vector():
    model = mixed()
    at = points(model, count=37)
    vq, vp = np.random.default_rng(8).normal(size=(2, 2, 37))
    made = call(model, "gradient_hessian", BLOCKS, BLOCKS, at)
    product = call(model, "hessian_vector", ("uq", "up"), ("uq", "up"), at, (vq, vp))
    uq = np.einsum("jil,jl->il", made["hqq"], vq) + np.einsum("jil,jl->il", made["hqp"], vp)
    up = np.einsum("ijl,jl->il", made["hqp"], vq) + np.einsum("jil,jl->il", made["hpp"], vp)
    np.testing.assert_allclose(product["uq"], uq, rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose(product["up"], up, rtol=1e-13, atol=1e-13)


def test_a_far_lane_changes_no_other():
    model = formula("synchrotron")
    at = points(model, count=40)
    alone = everything(model, *at)
    at[0][0, 7] = 3.3e6
    at[0][0, 9] = np.nan
    beside = everything(model, *at)
    others = [i for i in range(40) if i not in (7, 9)]
    assert all((x[..., others] == y[..., others]).all() for x, y in zip(alone, beside, strict=True))
    known = ss.models.get("synchrotron", **CATALOGUE["synchrotron"][2]).gradient(3.3e6, at[1][:, 7], at[2][:, 7])
    assert beside[1][0, 7] == pytest.approx(known[0][0, 0], rel=1e-14)
    assert np.isnan(beside[1][0, 9])


def in_numpy_of(model):
    """The NumPy functions of a model without a compiler."""
    from symsde.model.formulas import derivatives, in_numpy, named_formulas

    _, (given,) = model._remade
    own = ("name", "n", "ends", "damping", "force", "noise_force", "split")
    chosen = {key: value for key, value in given.items() if key not in own}
    return in_numpy.InNumpy(derivatives.Derivatives(named_formulas.make_problem(**chosen)), model.parameters)


def test_without_a_compiler_numpy_computes_the_same(monkeypatch):
    known = mixed()
    monkeypatch.setattr(compiler, "command", lambda: None)
    with pytest.warns(errors.SlowFormulaWarning, match="there is no C compiler.* 40 to 70 times as long .*: install"):
        mine = mixed()
    assert mine.formula.backend == "NumPy" and mine.in_python and mine.traits == known.traits
    at = points(known, count=37)
    for one, other in zip(everything(mine, *at), everything(known, *at), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-13, atol=1e-13)
    vq, vp = np.random.default_rng(8).normal(size=(2, 2, 37))
    product = call(known, "hessian_vector", ("uq", "up"), ("uq", "up"), at, (vq, vp))
    mine_product = in_numpy_of(mine).hessian_vector(0.7, at[2], at[0], at[1], vq, vp)
    np.testing.assert_allclose(mine_product[0], product["uq"], rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(mine_product[1], product["up"], rtol=1e-12, atol=1e-12)
    with pytest.raises(errors.InvalidArgumentError, match="sums over sites need a C compiler"):
        ss.model_from_sympy("Sum(q[i], i)", n=8)


# ---- parameters, names, time -------------------------------------------------------------------------------


def test_parameters_are_given_at_run_time():
    first = formula("pendulum")
    other = first.with_parameters(sigma=0.25)
    assert other.formula.file == first.formula.file and other.formula.seconds_compilation == 0
    assert repr(other) == "formula(sigma=0.25)" and first.parameters == {"sigma": 0.5}
    run = {"q0": 0.3, "p0": 0.2, "step": 0.05, "steps": 10, "paths": 3, "seed": 4}
    known = ss.simulate(ss.models.pendulum(sigma=0.25), **run)
    np.testing.assert_allclose(ss.simulate(other, **run).q, known.q, rtol=0, atol=1e-14)
    silent = first.with_parameters(sigma=0)
    assert silent.traits.additive and silent.traits.position_noise and not first.traits.additive
    with pytest.raises(errors.UnknownNameError, match="there are sigma"):
        first.with_parameters(sigmo=1)
    with pytest.raises(TypeError):  # numbers given as text could be printed and saved, but not run
        first.parameters["sigma"] = 0.25


def test_models_can_be_copied_and_pickled():
    model = formula("pendulum")
    again = pickle.loads(pickle.dumps(model))
    assert copy.copy(model) is model and again.parameters == model.parameters
    assert (again.gradient(0.3, 0.4)[0] == model.gradient(0.3, 0.4)[0]).all()


@pytest.mark.usefixtures("quick_compiler")
def test_names_mean_nothing():
    names = sp.symbols("E pi A0 double")
    E, pi, A0, double = names
    mine = ss.model_from_sympy(
        pi**2 / 2 - double**2 * sp.cos(E), [A0 * sp.sin(E)], q=E, p=pi, params={"A0": 0.2, "double": 1.9}
    )
    known = ss.model_from_sympy(
        p**2 / 2 - w**2 * sp.cos(q), [s * sp.sin(q)], q=q, p=p, params={"sigma": 0.2, "omega": 1.9}
    )
    at = points(known)
    assert distance(everything(mine, *at), everything(known, *at)) == 0
    assert "double**" not in mine.formula.source and "A0" not in mine.formula.source


def test_symbols_of_mechanics_and_functions_of_time():
    mechanics = pytest.importorskip("sympy.physics.mechanics")
    x, y = mechanics.dynamicsymbols("x y")
    time = mechanics.dynamicsymbols._t
    H = y**2 / 2 - sp.cos(x) - a * x * sp.cos(w * time)
    model = ss.model_from_sympy(H, q=x, p=y, params={"a": 0.4, "omega": 2.0})
    assert model.formula.structure.time_dependent and model.traits.separable
    force, _ = model.gradient(0.3, 0.0, t=0.7)
    assert force[0, 0] == pytest.approx(np.sin(0.3) - 0.4 * np.cos(1.4), rel=1e-15)
    renamed = ss.model_from_sympy(H.subs({x: q, y: p}).subs(time, s), q=q, p=p, params={"a": 0.4, "omega": 2.0}, t=s)
    assert (renamed.gradient(0.3, 0.0, t=0.7)[0] == force).all()


# ---- proofs about formulas ------------------------------------------------------------------------------


def test_invariants_are_proved_or_not():
    x, y, u, v = q1, q2, p1, p2
    r = sp.sqrt(x**2 + y**2)
    spin = x * v - y * u
    model = ss.model_from_sympy(
        (u**2 + v**2) / 2 - 1 / r,
        [s * spin],
        q=[x, y],
        p=[u, v],
        params={"sigma": 0.1},
        invariants=[spin, (u**2 + v**2) / 2 - 1 / r, x],
    )
    assert list(model.formula.structure.invariants.values()) == [True, True, False]
    assert model.formula.structure.flows_commute and model.formula.structure.noises_commute
    assert not formula("pendulum").formula.structure.flows_commute
    assert not formula("noncommutative_oscillator").formula.structure.noises_commute
    moving = ss.model_from_sympy(p**2 / 2, q=q, p=p, invariants=[p, q - t * p, q])
    assert list(moving.formula.structure.invariants.values()) == [True, True, False]


@pytest.mark.usefixtures("quick_compiler")
def test_masses():
    assert ss.model_from_sympy(p**2 / (2 * a), q=q, p=p, params={"a": 2.0}).formula.structure.constant_mass
    assert not ss.model_from_sympy(p**2 / (2 * a), q=q, p=p, params={"a": 2.0}).traits.identity_mass
    assert ss.model_from_sympy(p**2 / (2 * a), q=q, p=p, params={"a": 1.0}).traits.identity_mass
    heavy = ss.model_from_sympy(p**2 / (2 * a) - sp.cos(q), [sp.sin(q) / 2], q=q, p=p, params={"a": 4.0})
    assert heavy.traits.constant_mass and heavy.traits.kicked
    # in coordinates q -> 2 q, p -> p/2 the mass is one
    light = ss.model_from_sympy(p**2 / 2 - sp.cos(q / 2), [sp.sin(q / 2) / 2], q=q, p=p)
    assert light.traits.identity_mass and not light.traits.constant_mass and light.traits.kicked
    run = {"step": 0.1, "steps": 30, "paths": 20, "seed": 1, "scheme": "chin4a"}
    one, other = ss.simulate(heavy, q0=0.3, p0=0.8, **run), ss.simulate(light, q0=0.6, p0=0.4, **run)
    np.testing.assert_allclose(2 * one.q, other.q, rtol=0, atol=1e-13)
    np.testing.assert_allclose(one.p, 2 * other.p, rtol=0, atol=1e-13)
    assert not ss.model_from_sympy(p**2 / 2 + p, q=q, p=p).formula.structure.constant_mass
    assert not ss.model_from_sympy(p**2 * sp.exp(-t) / 2, q=q, p=p).formula.structure.constant_mass


# ---- the cache ---------------------------------------------------------------------------------------------

MAKE = """
import sympy as sp, symsde as ss
q, p = sp.symbols("q p")
model = ss.model_from_sympy(p**2/2 + q**4/4 - p*q, [0.1*q**2], q=q, p=p)
print(float(model.gradient(0.3, 0.4)[0][0, 0]).hex(), model.formula.file)
"""


def test_many_processes_want_the_same_at_once(tmp_path):
    environment = {**os.environ, "SYMSDE_CACHE": str(tmp_path / "cache")}
    words = [sys.executable, "-c", MAKE]
    started = [subprocess.Popen(words, env=environment, stdout=subprocess.PIPE, text=True) for _ in range(3)]
    answers = {process.communicate()[0] for process in started}
    assert all(process.returncode == 0 for process in started) and len(answers) == 1
    assert len(list((tmp_path / "cache").glob("*.so"))) == 2  # steps of kicks between flows of q*p are one of them
    assert not list((tmp_path / "cache").glob(".part*"))


@pytest.mark.usefixtures("quick_compiler")
def test_a_damaged_file_is_made_again(tmp_path, monkeypatch):
    monkeypatch.setenv("SYMSDE_CACHE", str(tmp_path))
    H = p**2 / 2 + q**6
    file = ss.model_from_sympy(H, q=q, p=p).formula.file
    target = tmp_path / "other"
    monkeypatch.setenv("SYMSDE_CACHE", str(target))
    target.mkdir()
    (target / os.path.basename(file)).write_bytes(b"no library")
    again = ss.model_from_sympy(H, q=q, p=p)
    assert again.formula.seconds_compilation > 0 and again.gradient(1.0, 0.0)[0][0, 0] == 6.0


def test_a_folder_that_cannot_be_written_is_no_hindrance(tmp_path, monkeypatch):
    monkeypatch.setenv("SYMSDE_CACHE", str(tmp_path / "file" / "below"))
    (tmp_path / "file").write_text("")
    assert ss.model_from_sympy(p**2 / 2 + q**8, q=q, p=p).gradient(1.0, 0.0)[0][0, 0] == 8.0


# ---- bad input ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("H", "more", "words"),
    [
        (p**2 / 2 + s * q, {}, "'p.*sigma.*which is not given: there are .*params"),
        (p**2 / 2 + sp.I * q, {}, "'.*I.*' is not real"),
        (p**2 / 2 + sp.sqrt(-2) * q, {}, "is not real"),
        (sp.oo * p, {}, "is not real and finite"),
        (p**2 / 2 + sp.DiracDelta(q), {}, "has no derivative everywhere"),
        (p**2 / 2 + sp.Function("V")(q), {}, r"holds V\(q\), which is no coordinate"),
        (p**2 / 2 + sp.Derivative(sp.Function("x")(t), t), {}, "holds a derivative"),
        (sp.Matrix([p]), {}, "is no scalar formula"),
        (sp.Eq(q, p), {}, "is no scalar formula"),
        (object(), {}, "is no formula"),
        (None, {}, "is no formula"),
        (p**2 / 2, {"q": [q1, q2]}, "q names 2 coordinates and p 1 momenta"),
        (p**2 / 2, {"q": [], "p": []}, "q names 0 coordinates"),
        (p**2 / 2, {"q": p}, "p is at place 1 of q, which results, observables and files call q_1"),
        (p**2 / 2, {"params": {"q": 1.0}}, "the name 'q' is given twice"),
        (p**2 / 2, {"params": {"a": float("nan")}}, "the parameter a = nan is not finite"),
        (p**2 / 2, {"params": {"a": "1"}}, "the parameter a = '1' is not a number"),
        (p**2 / 2, {"params": [1.0]}, "is no table"),
        (p**2 / 2, {"q": {q}}, "has no order"),
        (p**2 / 2, {"q": 3}, "3 is no name"),
        (p**2 / 2, {"q": sp.symbols("x0:100"), "p": sp.symbols("y0:100")}, "q names 100 coordinates: .* 64 at most"),
    ],
)
def test_bad_input_gets_a_sentence(H, more, words):
    with pytest.raises(errors.InvalidArgumentError, match=words):
        ss.model_from_sympy(H, **{"q": q, "p": p, **more})


@pytest.mark.usefixtures("quick_compiler")
@pytest.mark.parametrize("H", ["p**2/2 - 1/q", "p**2/2 + log(q)", "sqrt(q**2 + p**2 - 1)", "p**2/2 + q**2/(q - t)"])
def test_singular_starts_are_told_with_the_formula(H):
    """A singular start is refused, also if a step would jump over the singularity; if paths have different starts, a
    singular path gets a status instead.
    """
    model = ss.model_from_sympy(H, ["0.1*q"])
    start = {"q0": 1.0, "p0": 0.0, "t0": 1.0} if "sqrt" in H or "t" in H else {"q0": 0.0, "p0": 1.0}
    for function, more in ((ss.simulate, {"steps": 3}), (ss.moments, {"steps": 3}), (ss.prepare, {})):
        with pytest.raises(errors.InvalidArgumentError, match=r"not finite at q0 = .*: begin elsewhere .*H = '"):
            function(model, **start, step=0.1, **more)
    assert ss.simulate(model, q0=2.0, p0=1.0, step=0.01, steps=3).status[0] == 0
    with pytest.warns(errors.PathsFailedWarning):
        many = {
            **start,
            "q0": [[start["q0"], 2.0]],
            "scheme": "stormer_verlet" if "sqrt" not in H else "symplectic_euler",
        }
        assert (ss.simulate(model, **many, step=0.01, steps=3, paths=2).status != 0).tolist() == [True, False]


def test_noises_that_a_scheme_forbids_are_quoted():
    model = ss.model_from_sympy("p**2/2 + cos(q)", ["0.1*q*p"])
    for scheme in ("chin4a", "verlet_dz"):
        with pytest.raises(errors.IncompatibleError, match=r"needs .*noise.*H_1 = '0.1\*q\*p'"):
            ss.simulate(model, q0=0.0, p0=1.0, step=0.1, steps=3, scheme=scheme)


def test_compilation_is_bounded_in_processor_time(monkeypatch):
    """A compiler that computes too long is stopped, with its child processes; one that waits is waited for."""
    monkeypatch.setattr(compiler, "TIME_LIMIT", 1.0)
    busy = compiler._bounded(
        [sys.executable, "-c", "import subprocess, sys; subprocess.run([sys.executable, '-c', 'while 1: 1'])"]
    )
    assert busy is not None  # the computing child was ended
    patient = compiler._bounded([sys.executable, "-c", "import time; time.sleep(1.5); print('done')"])
    assert patient.stdout == "done\n"


def test_compilation_is_told_in_processor_time(tmp_path, monkeypatch):
    """A compiler that waits one second before it computes: the wait is no time of the processor."""
    script = tmp_path / "late-cc"
    script.write_text(f'#!/bin/sh\n[ "$1" = --version ] || sleep 1\nexec {shutil.which("cc")} "$@"\n')
    script.chmod(0o755)
    monkeypatch.setenv("SYMSDE_CC", str(script))
    monkeypatch.setenv("SYMSDE_CACHE", str(tmp_path / "cache"))
    begin = time.perf_counter()
    model = ss.model_from_sympy(p**2 / 2 + q**6, q=q, p=p)
    assert 0 < model.formula.seconds_compilation < time.perf_counter() - begin - 0.9


def test_signs_stand_before_products_and_sums():
    graph = Graph()
    a, b = graph.leaf("q0", True), graph.leaf("q1", True)
    minus_a, minus_b, product = graph.negative(a), graph.negative(b), graph.multiply(a, b)
    assert graph.multiply(minus_a, minus_b) == product
    assert graph.multiply(minus_a, b) == graph.multiply(a, minus_b) == graph.negative(product)
    assert graph.multiply(graph.number(-2.0), minus_a) == graph.multiply(graph.number(2.0), a)
    assert graph.multiply(graph.number(-1.0), a) == minus_a
    assert graph.sum([minus_a, minus_b]) == graph.negative(graph.sum([a, b]))
    difference = graph.nodes[graph.sum([minus_a, b])]
    assert (difference.kind, difference.arguments) == ("-", (b, a))


def test_nothing_is_drawn_for_a_noise_of_strength_zero():
    """The paths of the built-in model, which draws one of two noises, are the same; with another strength the noise
    is drawn again.
    """
    mine = ss.model_from_sympy("p**2/2 + q**2/2", ["s*p", "-g*q"], params={"s": 0.0, "g": 1.0})
    assert mine.traits.silent == mine.formula.structure.silent == (1,)
    known = ss.models.additive_oscillator(sigma=0.0, gamma=1.0)
    runs = [ss.simulate(m, q0=0.3, p0=0.1, step=0.1, steps=20, paths=9, seed=3) for m in (mine, known)]
    assert [r.report.counters["normals"] for r in runs] == [180, 180]
    np.testing.assert_allclose(runs[0].q, runs[1].q, rtol=0, atol=1e-14)
    assert mine.with_parameters(s=0.1).traits.silent == ()
    assert ss.model_from_sympy("p**2/2", ["cos(t)"]).traits.silent == (1,)


def test_a_model_says_which_noises_are_zero():
    def gradient(t, w, q, p):
        return w[0] * q + w[2], w[0] * p

    given = {"ndof": 1, "nnoise": 2, "gradient": gradient}
    mine = ss.Model(**given, silent=[1])
    mine.probe()
    assert pickle.loads(pickle.dumps(ss.Model(**{**given, "gradient": np.clip}, silent=[1]))).traits.silent == (1,)
    run = ss.simulate(mine, q0=0.3, p0=0.1, step=0.1, steps=20, paths=9)
    assert run.report.counters["normals"] == 180
    with pytest.raises(errors.FalseTraitError, match="declares silent"):
        ss.Model(**given, silent=[2]).probe()
    with pytest.raises(errors.InvalidArgumentError, match="silent holds 3: the noises are 1 to 2"):
        ss.Model(**given, silent=[3])
    with pytest.raises(errors.WrongTypeError, match="is no list"):
        ss.Model(**given, silent=1)


def test_a_time_that_is_none_is_called_so():
    """The message names the time as the cause, not a singularity of the formula."""
    with pytest.raises(errors.InvalidArgumentError, match="t0 = NaN is not a time"):
        ss.simulate(ss.model_from_sympy("p**2/2 + q*cos(t)"), q0=1.0, p0=0.3, t0=np.nan, step=0.01, steps=2)
