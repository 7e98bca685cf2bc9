# SPDX-License-Identifier: BSD-3-Clause
"""Functions that the C library computes lane by lane: gamma, its logarithm, Bessel functions, against mpmath."""

import numpy as np
import pytest
import symsde as ss
from symsde.errors import InvalidArgumentError

sp = pytest.importorskip("sympy")
mp = pytest.importorskip("mpmath")

from symsde.model.formulas import compiler, in_numpy  # noqa: E402

pytestmark = pytest.mark.usefixtures("quick_compiler")
Q = np.array([0.31, 0.93, 1.46, 1.7, 2.4, 5.1, 15.9, 33.3])
#: formula -> the same by mpmath, and the largest q
CASES = {
    "gamma(q)": (mp.gamma, 40),
    "gamma(-q/10 - 1/10)": (lambda x: mp.gamma(-x / 10 - mp.mpf(1) / 10), 40),
    "loggamma(q)": (mp.loggamma, 40),
    "besselj(0, q)": (lambda x: mp.besselj(0, x), 40),
    "besselj(1, 2*q)": (lambda x: mp.besselj(1, 2 * x), 40),
    "besselj(7, q)": (lambda x: mp.besselj(7, x), 40),
    "besselj(37, q)": (lambda x: mp.besselj(37, x), 40),
    "besseli(0, q)": (lambda x: mp.besseli(0, x), 40),
    "besseli(3, -q)": (lambda x: mp.besseli(3, -x), 40),
    "besselk(1, q/90)": (lambda x: mp.besselk(1, x / 90), 40),
    "besselk(9, 2*q)": (lambda x: mp.besselk(9, 2 * x), 40),
    "bessely(0, q)": (lambda x: mp.bessely(0, x), 40),
    "bessely(3, q)": (lambda x: mp.bessely(3, x), 40),
}


@pytest.mark.parametrize("text", CASES)
@pytest.mark.parametrize("way", ["text", "sympy", "sum", "NumPy"])
def test_values_and_derivatives(text, way, monkeypatch):
    """Value, force, stiffness and, with noise in both q and p, third derivatives, by those of mpmath."""
    function = CASES[text][0]
    if way != "NumPy" and compiler.command() is None:
        pytest.skip("no C compiler")
    if way == "NumPy":
        pytest.importorskip("scipy")
        monkeypatch.setattr(compiler, "build", lambda *_: None)
        with pytest.warns(ss.errors.SlowFormulaWarning):
            model = ss.model_from_sympy(f"p**2/2 + {text}")
    elif way == "sum":
        local = text.replace("q", "q[i]")
        model = ss.model_from_sympy(f"Sum(p[i]**2/2 + {local}, i)", n=2)
    else:
        H = f"p**2/2 + {text}"
        model = ss.model_from_sympy(sp.sympify(H) if way == "sympy" else H)
    with mp.workdps(40):
        rows = [[float(mp.diff(function, mp.mpf(x), k)) for x in Q] for k in range(3)]
    still = np.zeros((model.ndof, len(Q)))
    x = np.broadcast_to(Q, still.shape)
    found = [model.value(x, still) / model.ndof, model.gradient(x, still)[0][0], model.hessian(x, still)[0][0, 0]]
    for a, b in zip(found, rows, strict=True):
        scale = np.abs(rows).max(axis=0)  # an error of some ulp of the largest of these, beside a zero of one
        np.testing.assert_array_less(np.abs(np.ravel(a) - b) / scale, 2e-14)
    if way == "text":
        assert model._code.whole_steps == []
        model.probe(0.9, 0.2)


def test_third_derivatives():
    """Nested brackets take third derivatives, which hold polygamma of order 2, or 3 for noise by its slope."""
    for f in ("loggamma(q + 2)", "gamma(q + 2)", "besselj(1, q)", "besseli(1, q)", "besselk(2, q)"):
        ss.model_from_sympy(f"p**2/2 + {f}", [f"p*{f}/10"]).probe(0.4, 0.2)
    q, p = sp.symbols("q p")
    for x in (0.7, -0.4):  # polygamma of order 3, beside its reflection
        ss.model_from_sympy(p**2 / 2, [p * sp.polygamma(0, q)], q=q, p=p).probe(x, 0.2)


def test_runs_and_observables():
    """The energy is kept, also as an observable, and a single path has the bits of a lane."""
    H = "p**2/2 + loggamma(q) + besselj(0, q)"
    model = ss.model_from_sympy(H)
    run = {"q0": 2.0, "p0": 0.3, "step": 0.05, "steps": 40}
    for scheme in ("midpoint", "stormer_verlet"):
        found = ss.moments(model, **run, paths=3, scheme=scheme, observables={"h": H})
        np.testing.assert_allclose(found.mean["h"], found.mean_energy, rtol=1e-14)
        assert np.ptp(found.mean_energy) < 1e-4 and np.ptp(found.mean_q) > 0.5
        one, many = (ss.simulate(model, **run, paths=n, scheme=scheme).q[..., 0] for n in (1, 9))
        np.testing.assert_array_equal(one, many)


@pytest.mark.parametrize(
    ("H", "words"),
    [
        ("besselj(q, 1)", "besselj of an order that is no whole number from 0 to 37"),
        ("besselj(0.5, q)", "an order that is no whole number"),
        ("besselj(38, q)", "an order that is no whole number"),
        ("bessely(-1, q)", "an order that is no whole number"),
        ("besselj(q)", "gives besselj 1 arguments: it takes two"),
        ("gamma(q, 1)", "gives gamma 2 arguments: it takes one"),
        ("gamma(0)*q", "gamma of a constant, which is not a finite real number"),
        ("gamma(-2)*q", "gamma of a constant, which is not a finite real number"),
        ("loggamma(-0.5)*q", "loggamma of a constant, which is not a finite real number"),
        ("bessely(0, 0)*q", "a constant that is not a finite real number"),
        ("sum(q)", r"calls sum: sums over sites are written Sum\(formula, i\), beside n"),
        ("airyai(q)", "calls airyai, which is no function here"),
        (sp.airyai(sp.Symbol("q")), "airyai in a formula has no derivative everywhere, or no code here"),
        ("besselk(0, 0)*q", "besselk of constants, which is not a finite real number"),
        ("besselk(1, -2)*q", "a constant that is not a finite real number"),
        (sp.besseli(-1.5, sp.Symbol("q")), "besseli of order -1.5.* in a formula has no code here"),
        (sp.besselj(sp.Rational(1, 3), sp.Symbol("q")), "besselj of order 1/3 in a formula has no code here"),
        (sp.polygamma(3, sp.Symbol("q")), "derivatives of gamma of order 4 in a formula"),
    ],
)
def test_refusals(H, words):
    with pytest.raises(InvalidArgumentError, match=words):
        ss.model_from_sympy(H, q="q", p="p")


def test_beyond_the_domain():
    """Where the functions are not real, a start is refused."""
    for H in ("loggamma(q)", "bessely(0, q)", "besselk(0, q)"):
        with pytest.raises(InvalidArgumentError, match=r"not finite at q0 = -1\.5"):
            ss.simulate(ss.model_from_sympy(f"p**2/2 + {H}"), q0=-1.5, p0=0.0, step=0.1, steps=1)


def test_operations_of_numpy():
    pytest.importorskip("scipy")
    assert np.isnan(in_numpy._operation("loggamma")(np.array(-0.5)))
    assert in_numpy._operation("besselj")(1, 0.0) == 0


def test_far_arguments():
    """Tiny and large arguments of besseli and besselk: powers, logarithms, and beyond the range of numbers."""
    if compiler.command() is None:
        pytest.skip("no C compiler")
    x = np.array([1e-300, 1e-12, 8.999, 9.001, 120.0, 699.0])
    for name in ("besseli", "besselk"):
        for order in (0, 1, 2, 30):
            model = ss.model_from_sympy(f"p**2/2 + {name}({order}, q)")
            with mp.workdps(40):
                known = np.array([float(getattr(mp, name)(order, mp.mpf(a))) for a in x])
            found = np.ravel(model.value(x[None], 0 * x[None]))
            np.testing.assert_allclose(found, known, rtol=2e-14, atol=0)
    ends = {"besseli": {0.0: 1.0, 720.0: np.inf, np.nan: np.nan}, "besselk": {0.0: np.nan, 801.0: 0.0, np.nan: np.nan}}
    for name, known in ends.items():
        q = np.array([list(known)])
        found = np.ravel(ss.model_from_sympy(f"p**2/2 + {name}(0, q)").value(q, 0 * q))
        np.testing.assert_array_equal(found, list(known.values()))
