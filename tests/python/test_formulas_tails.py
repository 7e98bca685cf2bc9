# SPDX-License-Identifier: BSD-3-Clause
"""Derivatives of functions that reach a limit, in ulps: against hundreds of digits, in C and in NumPy."""

import numpy as np
import pytest
import symsde as ss

sympy = pytest.importorskip("sympy")
mpmath = pytest.importorskip("mpmath")

from symsde.model.formulas import derivatives  # noqa: E402
from symsde.model.formulas.derivatives import Derivatives  # noqa: E402
from symsde.model.formulas.graph import FUNCTIONS  # noqa: E402
from symsde.model.formulas.in_numpy import InNumpy, values_of  # noqa: E402
from symsde.model.formulas.named_formulas import make_problem  # noqa: E402

Q = sympy.Symbol("q")
#: formula -> largest errors of its first, second and third derivative in ulps
BOUNDS = dict.fromkeys(
    (
        "log(cosh(q))",
        "tanh(q)",
        "tanh(q)**2",
        "sinh(q)/cosh(q)",
        "log(1+exp(q))",
        "log(1+exp(-q))",
        "erf(q)",
        "erfc(q)",
    ),
    (4, 4, 5),  # the third derivative has zeros, near which it is a difference
) | {
    "sech(q)": (4, 4, 4),
    "csch(q)": (4, 4, 8),
    "coth(q)": (4, 4, 8),
    "1/cosh(q)**2": (4, 4, 5),
    "1/(1+exp(q))": (4, 5, 8),
    "exp(q)/(1+exp(q))": (4, 5, 8),
    "(exp(2*q)-1)/(exp(2*q)+1)": (4, 5, 8),
    "tanh(q)**3": (5, 5, 8),
    "tanh(q)*log(cosh(q))": (4, 8, 8),
    "log(cosh(q))*log(1+exp(q))": (4, 6, 10),
    "tanh(q)*tanh(2*q)": (5, 8, 12),
    "q*tanh(q)": (4, 4, 6),
}


def places(bound=120.0):
    """Arguments from the middle to the tails, of both signs."""
    rng = np.random.default_rng(7)
    sides = [-50.0, 50.0, 18.0, -18.0, 25.0, -25.0, 1e-3]
    return np.concatenate([rng.uniform(-3, 3, 9), rng.uniform(-60, 60, 12), rng.uniform(-bound, bound, 8), sides])


def exact(text, times):
    """The derivative, as a function of mpmath."""
    return sympy.lambdify(Q, sympy.sympify(text, locals={"q": Q}).diff(Q, times), "mpmath")


def worst(function, x, found):
    """Largest error in ulps, except near zeros of the derivative, where every sum loses digits."""
    largest = 0.0
    with mpmath.workdps(400):  # three hundred digits are lost at 120
        for at, value in zip(x.tolist(), found.tolist(), strict=True):
            here, *beside = (mpmath.mpf(function(mpmath.mpf(at + shift))) for shift in (0, -1, 1))
            if abs(here) < 1e-290 or min(here * other for other in beside) <= 0:
                continue
            unit = np.spacing(abs(float(here)))
            largest = max(largest, float(abs(mpmath.mpf(value) - here) / mpmath.mpf(float(unit))))
    return largest


def third(made, x):
    """The third derivative, by the model's functions."""
    given = {"t": 0.0, "w0": 1.0, "w1": 0.0, "q0": x, "p0": 0 * x, "aq0": 1.0, "bq0": 1.0, "ap0": 0.0, "bp0": 0.0}
    return values_of(made.graph, made.third()["tq"], given, len(x))[0]


@pytest.mark.parametrize("text", BOUNDS)
def test_derivatives_in_ulps(text):
    x = places()
    model = ss.model_from_sympy(f"p**3/3 + {text}", ["q*p"])
    at = x[None], 0 * x[None], np.array([1.0, 0.0])
    found = [model.gradient(*at)[0][0], model.hessian(*at)[0][0, 0], third(model._derivatives, x)]
    for times, (values, bound) in enumerate(zip(found, BOUNDS[text], strict=True), 1):
        assert worst(exact(text, times), x, values) < bound, f"{times} derivatives"
    assert worst(exact(text, 1), x, found[0] * (1 + 3e-15)) > 8  # the twin: an error of this size is found


@pytest.mark.parametrize("text", ["log(cosh(q))", "tanh(q)**2", "log(1+exp(q))", "erfc(q)", "csch(q)"])
@pytest.mark.parametrize("name", ["symengine", "sympy"])
def test_without_a_compiler_and_without_symengine(text, name, monkeypatch):
    monkeypatch.setattr(derivatives, "engine", lambda *_: pytest.importorskip(name))
    made = Derivatives(make_problem(H=f"p**3/3 + {text}", noise=["q*p"], q="q", p="p", params=None, t=None))
    functions, x = InNumpy(made, {}).functions(), places()
    at = 0.0, np.array([[1.0], [0.0]]) + 0 * x, x[None], 0 * x[None]
    found = functions["gradient"](*at)[0][0], functions["hessian"](*at)[0][0, 0], third(made, x)
    for times, values in enumerate(found, 1):
        assert worst(exact(text, times), x, values) < 8


@pytest.mark.parametrize(
    "text", ["log(cosh(q))", "tanh(q)", "log(1+exp(q))", "1/(1+exp(q))", "erfc(q)", "sech(q)", "coth(q)"]
)
def test_far_out_nothing_is_lost_or_left(text):
    """Results that are denormal, zero or at a limit are right to one smallest number."""
    x = np.array([-1e308, -1e4, -746.5, -720.0, -709.0, 709.0, 720.0, 746.5, 1e4, 1e308, 26.5, 27.35, -26.5, -27.35])
    model = ss.model_from_sympy(f"p**2/2 + {text}")
    found = model.gradient(x[None], 0 * x[None])[0][0], model.hessian(x[None], 0 * x[None])[0][0, 0]
    for times, values in enumerate(found, 1):
        function = exact(text, times)
        with mpmath.workdps(700):
            known = [
                float(function(mpmath.mpf(at))) if abs(at) < 1e5 else float(function(mpmath.mpf(1e4) * np.sign(at)))
                for at in x
            ]
        np.testing.assert_allclose(values, known, rtol=1e-15, atol=1e-320 if text != "erfc(q)" else 1e-316)


@pytest.mark.parametrize("ends", ["free", "periodic"])
def test_sums_over_sites_keep_their_digits(ends):
    """Densities, rows, and functions of sums use the same derivatives."""
    x = np.array([-50.0, -18.0, 3.0, 25.0])
    kinetic = "Sum(p[i]**2/2, i)"
    chain = ss.model_from_sympy(f"{kinetic} + Sum(log(cosh(q[i])), i)", n=4, ends=ends)
    with mpmath.workdps(60):
        known = np.array([float(mpmath.sech(z) ** 2) for z in x])
    found = chain.hessian(x[:, None], 0 * x[:, None])[0][:, :, 0]
    np.testing.assert_allclose(np.diag(found), known, rtol=1e-15)
    mean = ss.model_from_sympy(f"{kinetic} + log(cosh(Sum(q[i], i)))", n=4, ends=ends)
    found = mean.hessian(x[:, None] + 5, 0 * x[:, None])[0][:, :, 0]  # the sum is -20
    with mpmath.workdps(60):
        np.testing.assert_allclose(found, float(mpmath.sech(-20) ** 2), rtol=1e-15)


def test_what_holds_no_such_function_is_as_it_was():
    """An expression without such a function is returned as the very same object."""
    for text in ("p**2/2 + exp(q)*sin(q)", "cosh(q)*exp(-q**2)", "q**2/(1+q**2)", "exp(q)/q + q*sinh(q)"):
        made = Derivatives(make_problem(H=text, noise=(), q="q", p="p", params=None, t=None))
        assert made._of()[0] is made.hamiltonians[0] and not made._tails.known


@pytest.mark.parametrize("name", ["erfc", "sech", "csch", "coth"])
def test_new_functions_in_texts_expressions_and_constants(name):
    assert name in FUNCTIONS
    function, q, p = getattr(sympy, name), sympy.Symbol("q"), sympy.Symbol("p")
    texts = ss.model_from_sympy(f"p**2/2 + {name}(q/2) + {name}(0.5)*q")
    given = ss.model_from_sympy(p**2 / 2 + function(q / 2) + function(sympy.Float(0.5)) * q, q=q, p=p)
    parameter = ss.model_from_sympy(f"p**2/2 + {name}(q/2) + {name}(a)*q", params={"a": 0.5})
    known = float(getattr(mpmath, name)(0.4) + getattr(mpmath, name)(0.5) * mpmath.mpf(0.8))
    for model in (texts, given, parameter):
        np.testing.assert_allclose(model.value(0.8, 0.0), known, rtol=3e-16)
    found = ss.moments(texts, q0=0.8, p0=0.0, step=0.1, steps=1, observables={"o": f"{name}(q)"}).mean["o"][0]
    np.testing.assert_allclose(found, float(getattr(mpmath, name)(0.8)), rtol=1e-15)
