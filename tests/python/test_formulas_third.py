# SPDX-License-Identifier: BSD-3-Clause
"""Third derivatives from formulas, and exact brackets of strong schemes by them, against differences of gradients.

The differences of the library are exact for cubic Hamiltonians, so that both must agree to rounding there.
"""

import numpy as np
import pytest
import symsde as ss
from symsde import errors

pytest.importorskip("sympy")

from symsde.model.formulas.in_numpy import InNumpy

pytestmark = pytest.mark.optimised

PARAMS = {"a": 0.7, "b": 0.4, "s": 0.3}
TWO = {"q": ["x", "y"], "p": ["u", "v"]}
SCHEME = "gauss2_strong32"


def by_differences(model, **more):
    """The same model without its third derivatives."""
    functions = InNumpy(model._derivatives, model.parameters).functions()
    assert functions.pop("third_derivative")
    traits = {x: getattr(model.traits, x) for x in ("ndof", "nnoise", "separable", "additive", "position_noise")}
    return ss.Model(**functions, **traits, **more)


def offers(model):
    return "formula_third_derivative" in model.formula.source


@pytest.mark.parametrize(
    ("H", "noise", "names"),
    [
        ("(p**2+q**2)/2 + a*q**3/3 - q**2*p", ["s*(q*p**2/2 + q**3)", "b*p**3/3"], {}),
        ("(p**2+q**2)/2 + a*q**3/3 - q**2*p", ["s*p", "b*q + p"], {}),
        ("(u**2+v**2+x**2)/2 + a*x**2*y - v*u*x", ["s*(x*u*v + y**3)", "b*v**2*u"], TWO),
        ("(u**2+v**2+x**2)/2 + a*x**2*y - v*u*x", ["s*u", "b*(v + x)"], TWO),
    ],
)
@pytest.mark.parametrize("scheme", [SCHEME, "gauss2_weak2"])
def test_brackets_of_cubic_hamiltonians_are_the_differences(H, noise, names, scheme):
    model = ss.model_from_sympy(H, noise, params=PARAMS, **names)
    assert offers(model)
    given = {"q0": 0.3, "p0": 0.2, "step": 0.05, "steps": 10, "paths": 9, "seed": 4, "scheme": scheme}
    exact, plain = ss.simulate(model, **given), ss.simulate(by_differences(model), threads=1, **given)
    np.testing.assert_allclose(exact.q, plain.q, rtol=0, atol=2e-11)
    np.testing.assert_allclose(exact.p, plain.p, rtol=0, atol=2e-11)
    assert exact.report.counters["gradients"] < plain.report.counters["gradients"]
    one = ss.simulate(model, **{**given, "paths": 1, "first_path": 5})
    assert (one.q[:, :, 0] == exact.q[:, :, 5]).all()  # without padding


@pytest.mark.usefixtures("quick_compiler")
@pytest.mark.parametrize(
    ("H", "noise"),
    [
        ("sqrt(1 + p**2) + q**4/4", ["s*q**3 + b*p**3"]),
        ("sqrt(1 + p**2) - cos(q)", ["s*q", "b*p"]),
        ("p**2/2 - cos(q)", ["s*q**3", "b*p**2 + cos(q)"]),
    ],
)
@pytest.mark.parametrize("paths", [1, 30])
def test_separable_hamiltonians_have_the_brackets_of_the_oracle(H, noise, paths):
    model = ss.model_from_sympy(H, noise, params=PARAMS)
    given = {"q0": 0.3, "p0": 0.7, "step": 0.1, "steps": 10, "paths": paths, "seed": 3, "scheme": SCHEME}
    special, oracle = (ss.simulate(model, general=general, **given) for general in (False, True))
    np.testing.assert_allclose(special.q, oracle.q, rtol=0, atol=1e-14)
    np.testing.assert_allclose(special.p, oracle.p, rtol=0, atol=1e-14)


BENT = ("(p**2 + q**2)**2/8 + a*cos(q)*p", ["s*sin(q)*p + b*p**3/3"])


def test_differences_come_to_the_brackets_and_both_have_the_order():
    model = ss.model_from_sympy(*BENT, params=PARAMS)
    plain = by_differences(model)
    given = {"q0": 0.3, "p0": 0.4, "scheme": SCHEME, "paths": 200, "seed": 2}
    apart = []
    for steps in (8, 32):
        runs = [ss.simulate(m, step=1 / steps, steps=steps, threads=1, **given) for m in (model, plain)]
        apart.append(np.sqrt(np.mean((runs[0].q[-1] - runs[1].q[-1]) ** 2)))
    assert apart[0] > 1e-9  # exact brackets and brackets by differences differ
    assert apart[1] < apart[0] / 8
    measured = ss.convergence(model, SCHEME, q0=0.3, p0=0.4, steps=(8, 16, 32, 64), paths=400, seed=3)
    assert measured.order_low > 1.35 and measured.order_high < 1.75
    assert measured.error[0] < 0.05


@pytest.mark.usefixtures("quick_compiler")
def test_the_gradient_is_that_of_a_hamiltonian():
    model = ss.model_from_sympy(*BENT, params=PARAMS)
    defect = ss.diagnose.symplecticity(model, SCHEME, q=[[0.3, 1.0, -0.7]], p=[[0.4, -0.2, 0.8]], step=0.1, seed=1)
    assert defect.max() < 1e-8


@pytest.mark.usefixtures("quick_compiler")
def test_a_chain():
    chain = ss.model_from_sympy(
        "Sum(p[i]**2/2 + p[i]**2*q[i]*a, i) + Sum((q[i+1]-q[i])**2*p[i], i)", ["s*q[k]**2*p[k]", "b*p[k]**3"],
        params=PARAMS, n=9, ends="fixed",
    )  # fmt: skip
    assert offers(chain)
    written = ss.model_from_sympy(
        "+".join(f"p{i}**2/2 + p{i}**2*q{i}*a" for i in range(1, 10)) + "+q1**2*0"
        + "".join(f"+({f'q{i + 1}' if i < 9 else '0'}-q{i})**2*p{i}" for i in range(1, 10)),
        [*(f"s*q{i}**2*p{i}" for i in range(1, 10)), *(f"b*p{i}**3" for i in range(1, 10))],
        params=PARAMS, **{x: [f"{x}{i}" for i in range(1, 10)] for x in "qp"},
    )  # fmt: skip
    given = {"q0": 0.2, "p0": 0.1, "step": 0.05, "steps": 4, "paths": 3, "seed": 4, "scheme": SCHEME}
    np.testing.assert_allclose(ss.simulate(chain, **given).q, ss.simulate(written, **given).q, rtol=0, atol=1e-11)


@pytest.mark.usefixtures("quick_compiler")
@pytest.mark.parametrize(
    ("H", "noise"),
    [
        ("p**2/2 + cos(q)", ["s*sin(q)"]),  # squares
        ("p**2/2 + a*q**2", ["s*q*p"]),  # zero brackets
        ("p**4 + cos(q)", []),
    ],
)
def test_what_no_scheme_asks_for_is_not_generated(H, noise):
    assert not offers(ss.model_from_sympy(H, noise, params=PARAMS))


def test_quadratic_models_take_brackets_as_they_are():
    """The catalogue's models against the same models with differences, which are exact for quadratic Hamiltonians."""
    known = ss.models.noncommutative_oscillator(s1=0.4, s2=0.3)
    plain = ss.Model(ndof=1, nnoise=2, gradient=lambda t, w, q, p: known.gradient(q, p, w),
                     hessian=lambda t, w, q, p: known.hessian(q, p, w))  # fmt: skip
    given = {"q0": 0.3, "p0": 0.2, "step": 0.05, "steps": 10, "paths": 9, "seed": 4, "scheme": SCHEME, "threads": 1}
    exact, other = ss.simulate(known, **given), ss.simulate(plain, **given)
    np.testing.assert_allclose(exact.q, other.q, rtol=0, atol=1e-11)
    assert exact.report.counters["gradients"] < other.report.counters["gradients"] / 4


@pytest.mark.usefixtures("quick_compiler")
def test_false_third_derivatives_are_refused():
    model = ss.model_from_sympy(*BENT, params=PARAMS)
    functions = InNumpy(model._derivatives, model.parameters).functions()
    right = functions.pop("third_derivative")

    def with_third(function):
        return ss.Model(ndof=1, nnoise=1, third_derivative=function, **functions)

    with_third(right).probe(0.3, 0.4)
    for q in (1e3, 1e4, 3e5, 1e6):  # states at which an increment in proportion to the state exceeds the period
        with_third(right).probe(q, 0.4)
    wrong = [
        lambda *x: tuple(1.01 * y for y in right(*x)),
        lambda t, w, q, p, aq, ap, bq, bp: right(t, w, q, p, aq, ap, aq, ap),
        lambda *x: right(*x)[::-1],
    ]
    for function in wrong:
        with pytest.raises(errors.FalseTraitError, match="offers third_derivative, but by it the third derivative of"):
            with_third(function).probe(0.3, 0.4)
    with pytest.raises(errors.FalseTraitError, match="offers third_derivative"):
        with_third(wrong[0]).probe(1e3, 0.4)
    with pytest.raises(errors.WrongTypeError, match="third_derivative"):
        ss.simulate(with_third(lambda *x: None), q0=0.3, p0=0.4, step=0.1, steps=1, scheme=SCHEME)


@pytest.mark.usefixtures("quick_compiler")
@pytest.mark.parametrize("q", [1e3, 1e4, 1e5, 3e5, 1e6])
def test_angles_far_from_the_origin_are_not_refused(q):
    noise = ["0.1*sin(q1)*p1", "0.1*p2*cos(q1)", "0.3*sin(q2)"]
    model = ss.model_from_sympy("p1**2/2 + p2**2/2 - cos(q1) - cos(q2) - cos(q1-q2)", noise)
    assert offers(model)
    for more in np.linspace(0, 6, 13):
        model.probe(q + more, 0.4)
