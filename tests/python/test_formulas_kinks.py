# SPDX-License-Identifier: BSD-3-Clause
"""Formulas with kinks and jumps: values and derivatives of each case, traits, orders, refusals, other ways to code."""

import math
import pickle
import warnings

import numpy as np
import pytest
import symsde as ss
from symsde.errors import IncompatibleError, InvalidArgumentError, KinkWarning

sp = pytest.importorskip("sympy")

from symsde.model.formulas import compiler, in_numpy  # noqa: E402

pytestmark = [
    pytest.mark.filterwarnings("ignore::symsde.errors.KinkWarning"),
    pytest.mark.usefixtures("quick_compiler"),
]
Q = np.array([-1.7, -0.6, -0.2, 0.3, 0.9, 1.4])
P = np.array([0.4, -0.3, 0.8, -1.1, 0.2, 0.7])
#: formula -> (value, derivative by q, by p), as functions of q and p
CASES = {
    "Abs(q)": (lambda q, p: abs(q), lambda q, p: np.sign(q), lambda q, p: 0 * q),
    "abs(q - p)*p": (
        lambda q, p: abs(q - p) * p,
        lambda q, p: np.sign(q - p) * p,
        lambda q, p: abs(q - p) - np.sign(q - p) * p,
    ),
    "q**2*sign(q)": (lambda q, p: q * abs(q), lambda q, p: 2 * abs(q), lambda q, p: 0 * q),
    "Heaviside(q)*q**3": (
        lambda q, p: np.where(q > 0, q**3, 0),
        lambda q, p: np.where(q > 0, 3 * q**2, 0),
        lambda q, p: 0 * q,
    ),
    "Max(q, p, 0.25)**2": (
        lambda q, p: np.maximum(np.maximum(q, p), 0.25) ** 2,
        lambda q, p: np.where((q > p) & (q > 0.25), 2 * q, 0),
        lambda q, p: np.where((p > q) & (p > 0.25), 2 * p, 0),
    ),
    "Min(q, q**2)": (
        lambda q, p: np.minimum(q, q * q),
        lambda q, p: np.where(q < q * q, 1, 2 * q),
        lambda q, p: 0 * q,
    ),
    "Piecewise((q**2, q > 1), (p*q, (q > 0) | (p >= 0.8)), (3, True))": (
        lambda q, p: np.where(q > 1, q**2, np.where((q > 0) | (p >= 0.8), p * q, 3)),
        lambda q, p: np.where(q > 1, 2 * q, np.where((q > 0) | (p >= 0.8), p, 0)),
        lambda q, p: np.where(q > 1, 0, np.where((q > 0) | (p >= 0.8), q, 0)),
    ),
    "Piecewise((log(q), q > 0 and q < 1), (0, True))": (
        lambda q, p: np.where((q > 0) & (q < 1), np.log(abs(q)), 0),
        lambda q, p: np.where((q > 0) & (q < 1), 1 / q, 0),
        lambda q, p: 0 * q,
    ),
    "Piecewise((q, Abs(q - p) < 1), (p*sign(Abs(q) - 0.5), True))": (
        lambda q, p: np.where(abs(q - p) < 1, q, p * np.sign(abs(q) - 0.5)),
        lambda q, p: np.where(abs(q - p) < 1, 1, 0),
        lambda q, p: np.where(abs(q - p) < 1, 0, np.sign(abs(q) - 0.5)),
    ),
    "Mod(q, 0.7)**2": (
        lambda q, p: np.mod(q, 0.7) ** 2,
        lambda q, p: 2 * np.mod(q, 0.7),
        lambda q, p: 0 * q,
    ),
    "Mod(q - p, -1.5)*p": (
        lambda q, p: np.mod(q - p, -1.5) * p,
        lambda q, p: p,
        lambda q, p: np.mod(q - p, -1.5) - p,
    ),
    "floor(3*q)*p + ceiling(q)*q**2 + frac(p)": (
        lambda q, p: np.floor(3 * q) * p + np.ceil(q) * q**2 + p - np.floor(p),
        lambda q, p: 2 * q * np.ceil(q),
        lambda q, p: np.floor(3 * q) + 1,
    ),
    "sqrt(q**2)": (lambda q, p: abs(q), lambda q, p: np.sign(q), lambda q, p: 0 * q),
    "atan2(p, q + 3)": (
        lambda q, p: np.arctan2(p, q + 3),
        lambda q, p: -p / ((q + 3) ** 2 + p**2),
        lambda q, p: (q + 3) / ((q + 3) ** 2 + p**2),
    ),
    "sec(q/2) + csc(q + 3)": (
        lambda q, p: 1 / np.cos(q / 2) + 1 / np.sin(q + 3),
        lambda q, p: np.sin(q / 2) / np.cos(q / 2) ** 2 / 2 - np.cos(q + 3) / np.sin(q + 3) ** 2,
        lambda q, p: 0 * q,
    ),
    "cot(q + 2) - acot(q + 3)": (
        lambda q, p: 1 / np.tan(q + 2) - np.arctan(1 / (q + 3)),
        lambda q, p: -1 / np.sin(q + 2) ** 2 + 1 / (1 + (q + 3) ** 2),
        lambda q, p: 0 * q,
    ),
    "asec(q + 4) + acsc(q + 4)*p": (
        lambda q, p: np.arccos(1 / (q + 4)) + np.arcsin(1 / (q + 4)) * p,
        lambda q, p: (1 - p) / ((q + 4) * np.sqrt((q + 4) ** 2 - 1)),
        lambda q, p: np.arcsin(1 / (q + 4)),
    ),
    "asech(1/(q + 3)) + acsch(q + 3) + acoth(q + 3)": (
        lambda q, p: np.arccosh(q + 3) + np.arcsinh(1 / (q + 3)) + np.arctanh(1 / (q + 3)),
        lambda q, p: 1 / np.sqrt((q + 3) ** 2 - 1) - 1 / ((q + 3) * np.sqrt(1 + (q + 3) ** 2)) - 1 / ((q + 3) ** 2 - 1),
        lambda q, p: 0 * q,
    ),
}


@pytest.mark.parametrize("text", CASES)
@pytest.mark.parametrize("way", ["text", "sympy", "NumPy"])
def test_values_and_derivatives(text, way, monkeypatch):
    """H is p**2/2 + 2 f; the same as text, as an expression of sympy, and without a compiler."""
    value, by_q, by_p = CASES[text]
    H = f"p**2/2 + 2*({text})"
    if way == "sympy":
        if "abs" in text or " and " in text:
            pytest.skip("no text of sympy")
        H = sp.sympify(H, locals={x: sp.Symbol(x, real=True) for x in "qp"})
    if way == "NumPy":
        monkeypatch.setattr(compiler, "build", lambda *_: None)
        with pytest.warns(ss.errors.SlowFormulaWarning):
            model = ss.model_from_sympy(H)
    else:
        model = ss.model_from_sympy(H, q="q", p="p")
    assert model.formula.backend == ("NumPy" if way == "NumPy" or compiler.command() is None else "C")
    np.testing.assert_allclose(np.ravel(model.value(Q[None], P[None])), P**2 / 2 + 2 * value(Q, P), rtol=1e-14)
    hq, hp = (np.ravel(x) for x in model.gradient(Q[None], P[None]))
    np.testing.assert_allclose(hq, 2 * by_q(Q, P), rtol=1e-13, atol=1e-15)
    np.testing.assert_allclose(hp, P + 2 * by_p(Q, P), rtol=1e-13, atol=1e-15)


def test_at_a_kink():
    """At the kink itself Abs has the slope zero, and Heaviside is one half."""
    model = ss.model_from_sympy("p**2/2 + Abs(q) + Heaviside(q)")
    assert np.ravel(model.value(0.0, 0.0)) == 0.5 and np.ravel(model.gradient(0.0, 0.0)[0]) == 0


def test_traits():
    """What vanishes on every side is not said to vanish: steps would be chosen by it."""
    kinked = ss.model_from_sympy("p**2/2 + Abs(q)", ["0.3*Abs(q)"])
    found = kinked.formula.structure
    assert found.kinked == (0, 1) and found.separable and found.identity_mass and found.position_noise
    assert not (found.quadratic or found.additive or found.noises_commute or found.flows_commute)
    assert kinked._code.whole_steps == []
    mixed = ss.model_from_sympy("p**2/2 + Piecewise((q, p > 0), (-q, True))").formula.structure
    assert not mixed.separable and not mixed.constant_mass
    assert not ss.model_from_sympy("Abs(p) + q**2/2").formula.structure.constant_mass
    n = 12
    far = "+".join(f"p{i}**2/2" for i in range(1, n + 1)) + f"+ Max(q1, q{n})"
    assert ss.model_from_sympy(far).formula.structure.bandwidth == n - 1
    factors = ss.model_from_sympy("p**2/2 + p*sign(q)").formula.structure
    steps = ss.model_from_sympy("p**2/2 + p*floor(q)").formula.structure
    assert not (factors.separable or factors.constant_mass or steps.separable or steps.constant_mass)
    assert ss.model_from_sympy("(p**2 + Abs(q))/m", params={"m": 3.0}).formula.structure.separable
    plain = ss.model_from_sympy("p**2/2 + Piecewise((q**2, t > 3), (2*q**2, True))").formula.structure
    assert plain.kinked == () and plain.quadratic and plain.time_dependent
    again = pickle.loads(pickle.dumps(kinked))
    assert again.formula.structure.kinked == (0, 1) and again.traits == kinked.traits


@pytest.mark.skipif(compiler.command() is None, reason="no C compiler")
@pytest.mark.parametrize("ends", ["free", "fixed", "periodic"])
def test_sums_over_sites(ends):
    """Kinks in summands, of sites, bonds and pairs, against the formula written out."""
    n, rng = 4, np.random.default_rng(3)
    pairs = "Sum(Max(1 - Abs(q[i] - q[j]), 0)**2, i < j) + Sum(Mod(q[i] - q[j], 1.3), i < j)"
    H = f"Sum(p[i]**2/2 + Abs(q[i]), i) + Sum(Max(q[i+1] - q[i] - 1, 0)**2, i) + {pairs}"
    with pytest.warns(KinkWarning, match="have a kink or jump"):
        model = ss.model_from_sympy(H, ["0.1*Max(q[k], 0)"], n=n, ends=ends)
    bonds = [(f"q{i}", f"q{i + 1}") for i in range(1, n)]
    bonds += {"free": [], "fixed": [("0", "q1"), (f"q{n}", "0")], "periodic": [(f"q{n}", "q1")]}[ends]
    terms = [f"p{i}**2/2 + Abs(q{i})" for i in range(1, n + 1)] + [f"Max({b} - {a} - 1, 0)**2" for a, b in bonds]
    for i in range(1, n + 1):
        between = [f"q{i} - q{j}" for j in range(i + 1, n + 1)]
        terms += [f"Max(1 - Abs({x}), 0)**2 + Mod({x}, 1.3)" for x in between]
    other = ss.model_from_sympy("+".join(terms), [f"0.1*Max(q{i}, 0)" for i in range(1, n + 1)])
    x, y, w = rng.normal(size=(n, 50)), rng.normal(size=(n, 50)), rng.normal(size=(n + 1, 50))
    for a, b in (
        (model.value(x, y, w), other.value(x, y, w)),
        *zip(model.gradient(x, y, w), other.gradient(x, y, w), strict=True),
        *zip(model.hessian(x, y, w), other.hessian(x, y, w), strict=True),
    ):
        np.testing.assert_allclose(a, b, rtol=1e-13, atol=1e-13)
    assert model.kinked == (0, 1) and model.traits.separable and model.traits.identity_mass
    assert not (model.traits.additive or model.traits.quadratic)
    run = {"q0": x[:, 0], "p0": y[:, 0], "step": 0.1, "steps": 10, "paths": 3, "scheme": "stormer_verlet"}
    np.testing.assert_allclose(ss.simulate(model, **run).q, ss.simulate(other, **run).q, rtol=1e-12, atol=1e-13)
    with pytest.raises(IncompatibleError, match="not differentiable"):
        ss.gradient(model, "q_1", wrt=["q0"], **run)


@pytest.mark.skipif(compiler.command() is None, reason="no C compiler")
def test_traits_of_sums_with_kinks():
    """A kink of momenta is no mass, and one that momenta multiply couples them to it."""
    one, other, ring = (
        ss.model_from_sympy(H, n=9, ends="fixed").traits
        for H in (
            "Sum(Abs(p[i]) + q[i]**2/2, i)",
            "Sum(p[i]**2/2 + p[i]*sign(q[i]), i)",
            "Sum(p[i]**2/2 + Max(q[i+1]-q[i], 0)**2, i)",
        )
    )
    assert one.separable and not (one.constant_mass or one.identity_mass or one.quadratic)
    assert not other.separable and not other.identity_mass
    assert ring.identity_mass and ring.separable and ring.bandwidth == 1


@pytest.mark.parametrize(("H", "order"), [("Abs(q)", 1), ("Max(q, 0)**2", 2)])
@pytest.mark.parametrize("scheme", ["stormer_verlet", "chin4a"])
def test_orders_across_kinks(H, order, scheme):
    """101 starts cross the kink at any place in a step: where the force jumps errors are of order 1, where its slope
    jumps of order 2, also by a scheme of order 4.
    """
    model = ss.model_from_sympy(f"p**2/2 + q**2/2 + {H}")
    run = {"q0": np.linspace(0.5, 1.5, 101)[np.newaxis], "p0": 0.0, "paths": 101}

    def end(steps, by=scheme):
        return ss.simulate(model, **run, step=3.7 / steps, steps=steps, save_every=steps, scheme=by).q[-1, 0]

    right = end(2**15, "stormer_verlet")
    first, last = (np.sqrt(((end(n) - right) ** 2).mean()) for n in (32, 512))
    found = math.log2(first / last) / 4
    assert found < 2.5 if (scheme, order) == ("chin4a", 2) else abs(found - order) < 0.25


def test_told_and_refused():
    """Kinks are told with their orders; noises in q and p, forces, functions of sums and gradients take none."""
    with pytest.warns(KinkWarning, match=r"'p\*\*2/2 \+ Abs\(q\)' has a kink or jump: orders of schemes hold on each"):
        model = ss.model_from_sympy("p**2/2 + Abs(q)", ["0.3*q"])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ss.model_from_sympy("p**2/2 + cot(q) + Piecewise((q, t > 1), (0, True))")
        model.with_parameters()
    run = {"q0": 1.0, "p0": 0.0, "step": 0.1, "steps": 3}
    for call in (lambda: ss.gradient(model, "q", **run), lambda: ss.tangent(model, **run)):
        with pytest.raises(IncompatibleError, match="not differentiable"):
            call()
    ss.model_from_sympy("p**2/2", ["Abs(q)", "q"])
    for given, words in (
        ({"H": "p**2/2", "noise": ["Abs(q)", "p"]}, r"'Abs\(q\)' has a kink or jump, and Stratonovich"),
        ({"H": "p**2/2", "force": ["-Abs(p)*p"]}, "which Hamiltonians alone may have"),
        ({"H": "Sum(p[i]**2/2, i) + Abs(Sum(q[i], i))", "n": 4}, "a kink or jump in a function of sums"),
        ({"H": "Sum(p[i]**2/2, i) + Sum(Abs(q[i]), i)**2", "n": 4}, "a kink or jump in a function of sums"),
        ({"H": "Sum(p[i]**2, i)", "noise": ["p[k]*Abs(q[k])"], "n": 4}, "has a kink or jump, and Stratonovich"),
        ({"H": "Sum(Piecewise((q[i], q[i] > 0)), i)", "n": 4}, r"end Piecewise by \(.., True\)"),
        ({"H": "p**2/2", "noise": ["p*floor(q)"]}, "has a kink or jump, and Stratonovich"),
        ({"H": "p**2/2 + Piecewise((q, q > 0))"}, r"end Piecewise by \(.., True\)"),
        ({"H": "p**2/2 + Piecewise((q, q == 0), (0, True))"}, "something other than a comparison"),
        ({"H": sp.Symbol("p") ** 2 + sp.Piecewise((1, sp.Eq(sp.Symbol("q"), 0)), (0, True))}, "holds nowhere else"),
        ({"H": "p**2/2 + Piecewise(q, 0)"}, "other than pairs"),
        ({"H": "p**2/2 + atan2(q)"}, "gives atan2 1 arguments: it takes two"),
        ({"H": "p**2/2 + Max()"}, "gives Max 0 arguments"),
        ({"H": "p**2/2 + Mod(q)"}, "gives Mod 1 arguments: it takes two"),
        ({"H": "p**2/2 + Mod(q, 0)"}, "divides by zero"),
    ):
        with pytest.raises(InvalidArgumentError, match=words):
            ss.model_from_sympy(**given)


def test_observables():
    """Observables may have kinks: nothing is told."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run = {"q0": 1.0, "p0": 0.0, "step": 0.1, "steps": 20, "paths": 8}
        found = ss.moments(ss.models.kubo(), observables={"out": "Heaviside(Abs(q) - 0.5)"}, **run)
        paths = ss.simulate(ss.models.kubo(), **run)
    np.testing.assert_allclose(found.mean["out"], (abs(paths.q[:, 0]) > 0.5).mean(axis=1), rtol=1e-15)


def test_operations_of_numpy():
    """The operations that C has for cases."""
    operations = in_numpy._OPERATIONS
    assert operations["less"](1.0, 1.0) == 0 and operations["upto"](1.0, 1.0) == 1
    assert operations["select"](1.0, 2.0, math.nan) == 2 and operations["select"](0.0, math.nan, 3.0) == 3
