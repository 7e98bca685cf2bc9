# SPDX-License-Identifier: BSD-3-Clause
"""Tests of tame formulas of exponentials far from zero: values and derivatives against sixty digits, without overflow.
Also words of Python as names, and the refusal of a power of a square."""

import numpy as np
import pytest
import symsde as ss
from symsde import errors

sympy = pytest.importorskip("sympy")
mpmath = pytest.importorskip("mpmath")

from symsde.model.formulas import compiler  # noqa: E402
from symsde.model.formulas.derivatives import Derivatives  # noqa: E402
from symsde.model.formulas.in_numpy import InNumpy  # noqa: E402
from symsde.model.formulas.named_formulas import make_problem  # noqa: E402

pytestmark = pytest.mark.optimised

TAME = (
    "1/(1 + exp((q - 1)/0.05))",
    "log(1 + exp(q))",
    "log(cosh(q))",
    "1/cosh(q)**2",
    "sinh(q)/cosh(q)",
    "cosh(q)/(2 + cosh(q))",
    "cosh(q)*exp(-q**2)",
    "sinh(q)*exp(-q)/(1 + exp(-2*q))",
    "exp(q)/(2 + exp(q) + exp(2*q))",
    "(exp(2*q) - 1)/(exp(2*q) + 1)",
    "2**q/(1 + 2**q)",
    "exp(q)/sqrt(1 + exp(2*q))",
    "atan(exp(q))",
    "q*log(1 + exp(-q))",
    "(1 + exp(q))**(-a)",
    "exp(q)*sinh(q)/cosh(2*q)",
    "log(1 + 2*sinh(q)**2)",
    "log(exp(0.7*q) + exp(q) + exp(-q/2) + 3)",
    "1/(1 + exp(a*q)*cosh(q))",
    "asinh(exp(q))",
    "asinh(sinh(a*q)*exp(q/3))",
    "tanh(exp(q))",
    "exp(q/2)*(1 - tanh(q)**2)",
)
PLACES = (-1e4, -800.0, -40.3, -3.0, -0.3, 0.0, 0.01, 0.5, 2.0, 37.0, 39.73, 40.0, 720.0, 800.0, 1e4)
PARAMS = {"a": 0.7}


def truth(text, times):
    """The derivative at all places."""
    q = sympy.Symbol("q")
    exact = sympy.sympify(text, locals={"q": q}).subs(sympy.Symbol("a"), sympy.Rational(7, 10))
    function = sympy.lambdify(q, exact.diff(q, times) if times else exact, "mpmath")
    with mpmath.workdps(60):
        return np.array([float(mpmath.re(function(mpmath.mpf(x)))) for x in PLACES])


@pytest.mark.parametrize("text", TAME)
def test_nothing_overflows_inside(text):
    problem = make_problem(H=text, noise=(), q="q", p="p", params=PARAMS, t=None)
    functions = InNumpy(Derivatives(problem), PARAMS).functions()
    at = 0.0, np.ones((1, len(PLACES))), np.array([PLACES]), np.zeros((1, len(PLACES)))
    found = functions["value"](*at), functions["gradient"](*at)[0][0], functions["hessian"](*at)[0][0, 0]
    for times, given in enumerate(found):
        np.testing.assert_allclose(given, truth(text, times), rtol=1e-8, atol=1e-12, err_msg=f"{times} derivatives")


@pytest.mark.skipif(compiler.command() is None, reason="no compiler")
@pytest.mark.parametrize("text", TAME[:3])
def test_runs_far_out(text):
    """Beyond the step of a potential a path moves freely or with constant force; every lane has the bits it has
    alone.
    """
    model = ss.model_from_sympy(f"p**2/2 + {text}")
    force = -float(text.startswith("log"))
    run = {"p0": 0.5, "step": 0.1, "steps": 20, "save_every": 20}
    for scheme in ("stormer_verlet", "midpoint", "gauss2"):
        for start in (42.0, 800.0, 1e4):
            found = ss.simulate(model, q0=start, scheme=scheme, paths=9, **run)
            np.testing.assert_allclose(found.p[-1], 0.5 + 2 * force, rtol=1e-12)
            alone = ss.simulate(model, q0=start, scheme=scheme, **run)
            assert (found.q[-1, 0] == alone.q[-1, 0, 0]).all()


def test_what_overflows_itself_does():
    """No limit is invented: exp(q) is infinite at 800, and a quotient by zero is NaN."""
    problem = make_problem(H="exp(q) + 1/(exp(q) - 1)", noise=(), q="q", p="p", params=None, t=None)
    value = InNumpy(Derivatives(problem), {}).functions()["value"]
    np.testing.assert_array_equal(value(0.0, np.ones((1, 2)), np.array([[800.0, 0.0]]), np.zeros((1, 2))), np.inf)


@pytest.mark.parametrize("name", ["lambda", "as", "in", "is", "def", "None", "True"])
def test_words_of_python_are_names_too(name):
    """Any name may be a parameter; if its value is missing, the message is the one for unknown names."""
    text = f"p1**2/2 + {name}*cos(q1) + {name}**2*q2**2 + p2**2"
    problem = make_problem(H=text, noise=(), q=None, p=None, params={name: 2.0}, t=None)
    plain = make_problem(H=text.replace(name, "a"), noise=(), q=None, p=None, params={"a": 2.0}, t=None)
    assert problem.hamiltonians == plain.hamiltonians
    if name not in ("None", "True"):  # these words are constants for Python
        with pytest.raises(errors.InvalidArgumentError, match=f"it holds {name}, which is not given: there are q1"):
            make_problem(H=text, noise=(), q=None, p=None, params=None, t=None)


@pytest.mark.parametrize(("text", "power"), [("(q**2)**1.5", 3), ("sqrt(q**2)", 1), ("(q**2)**a", 3)])
def test_powers_of_squares_have_cases(text, power):
    """sympy writes them in Abs."""
    with pytest.warns(errors.KinkWarning, match="has a kink or jump"):
        model = ss.model_from_sympy(f"p**2/2 + {text}", params={"a": 1.5} if "a" in text else None)
    np.testing.assert_allclose(model.value([[-0.7, 0.4]], 0.0).ravel(), [0.7**power, 0.4**power], rtol=1e-14)
    np.testing.assert_allclose(model.gradient([[-0.7]], 0.0)[0].ravel(), -power * 0.7 ** (power - 1), rtol=1e-14)
