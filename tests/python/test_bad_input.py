# SPDX-License-Identifier: BSD-3-Clause
"""Bad input: the right exception, a message with the given value, and no damage to later calls."""

import re

import numpy as np
import pytest
import symsde as ss
from symsde import errors

GOOD = {"q0": 1.0, "p0": 0.0, "step": 0.1, "steps": 4, "paths": 3}
PLACE = {"q0": 1.0, "p0": 0.0}
LIKE_VERLET = ["the nearest is stormer_verlet; `symsde list schemes` shows all"]
NAN, INF, HUGE = float("nan"), float("inf"), 2**63

# changed options of simulate, exception, words of its message
RUNS = [
    ({"step": NAN}, errors.InvalidArgumentError, ["step", "NaN", "finite"]),
    ({"step": INF}, errors.InvalidArgumentError, ["step", "Inf", "finite"]),
    ({"step": 0.0}, errors.InvalidArgumentError, ["step", "not zero"]),
    ({"step": "0.1"}, errors.WrongTypeError, ["step", "'0.1'", "number"]),
    ({"step": 10**400}, errors.InvalidArgumentError, ["step", "too large"]),
    ({"step": True}, errors.WrongTypeError, ["step", "True"]),
    ({"step": [0.1, 0.2]}, errors.WrongTypeError, ["step", "[0.1, 0.2]"]),
    ({"t0": NAN}, errors.InvalidArgumentError, ["t0", "finite"]),
    ({"steps": -1}, errors.InvalidArgumentError, ["steps", "-1", "0"]),
    ({"steps": 2.5}, errors.WrongTypeError, ["steps", "2.5", "whole"]),
    ({"steps": NAN}, errors.WrongTypeError, ["steps", "nan"]),
    ({"steps": HUGE}, errors.InvalidArgumentError, ["steps", str(HUGE)]),
    ({"steps": 2**46}, errors.TooLargeError, ["GB", "save_every"]),
    ({"paths": 0}, errors.InvalidArgumentError, ["paths", "0", "1"]),
    ({"paths": -5}, errors.InvalidArgumentError, ["paths", "-5"]),
    ({"paths": 2**40}, errors.TooLargeError, ["GB", "fewer paths"]),
    ({"paths": None}, errors.WrongTypeError, ["paths", "None"]),
    ({"save_every": 0}, errors.InvalidArgumentError, ["save_every", "0"]),
    ({"save_every": 3}, errors.InvalidArgumentError, ["steps = 4", "save_every = 3", "multiple"]),
    ({"seed": -1}, errors.InvalidArgumentError, ["seed", "-1"]),
    ({"seed": 2**64}, errors.InvalidArgumentError, ["seed", str(2**64)]),
    ({"first_path": -1}, errors.InvalidArgumentError, ["first_path", "-1"]),
    ({"first_path": 2**47}, errors.TooLargeError, ["first_path", "2^47"]),
    ({"first_step": -1}, errors.InvalidArgumentError, ["first_step", "-1"]),
    ({"first_step": 2**47}, errors.TooLargeError, ["first_step", "2^47"]),
    ({"refine": 2**40}, errors.InvalidArgumentError, ["refine", str(2**40)]),
    ({"refine": 46}, errors.SymsdeError, ["refine"]),
    ({"lanes": 12}, errors.InvalidArgumentError, ["12", "multiple of 8"]),
    ({"lanes": -8}, errors.InvalidArgumentError, ["-8"]),
    ({"threads": 0}, errors.InvalidArgumentError, ["threads", "0", "1"]),
    ({"threads": 10**6}, errors.InvalidArgumentError, ["threads", "1024"]),
    ({"max_iter": -1}, errors.InvalidArgumentError, ["-1"]),
    ({"fixed_point": -1}, errors.InvalidArgumentError, ["-1"]),
    ({"scheme": "midpiont"}, errors.UnknownNameError, ["midpiont", "midpoint"]),
    ({"scheme": ""}, errors.UnknownNameError, ["no scheme '': `symsde list schemes` shows all"]),
    ({"scheme": "a\0b"}, errors.UnknownNameError, ["scheme", "a\\x00b", "list schemes"]),
    ({"scheme": 3}, errors.WrongTypeError, ["scheme", "3"]),
    ({"scheme": "lambda:2"}, errors.InvalidArgumentError, ["lambda"]),
    ({"correction": "averge"}, errors.UnknownNameError, ["correction", "averge", "mean"]),
    ({"correction": "mean"}, errors.IncompatibleError, ["correction", "midpoint"]),
    ({"truncation": 2.0}, errors.WrongTypeError, ["truncation", "pair"]),
    ({"truncation": (2.0, 0.0)}, errors.InvalidArgumentError, ["truncat"]),
    ({"truncation": (NAN, 1.0)}, errors.InvalidArgumentError, ["truncat"]),
    ({"compensated": 1}, errors.WrongTypeError, ["compensated", "True"]),
    ({"progress": "yes"}, errors.WrongTypeError, ["progress", "'yes'"]),
    ({"q0": NAN}, errors.InvalidArgumentError, ["initial state", "finite"]),
    ({"p0": [[1.0, INF, 2.0]]}, errors.InvalidArgumentError, ["initial state", "finite"]),
    ({"q0": [1.0, 2.0]}, errors.WrongShapeError, ["q0", "(2,)", "(1,)"]),
    ({"q0": [1.0, 2.0, 3.0]}, errors.WrongShapeError, ["q0", "q0[None, :]"]),
    ({"q0": np.zeros((3, 1))}, errors.WrongShapeError, ["q0", "(3, 1)", "q0.T"]),
    ({"q0": [[1.0], [2.0, 3.0]]}, errors.WrongShapeError, ["q0", "unequal"]),
    ({"q0": "one"}, errors.WrongTypeError, ["q0", "numbers"]),
    ({"q0": 1j}, errors.WrongTypeError, ["q0", "complex"]),
    ({"q0": None}, errors.WrongTypeError, ["q0"]),
    ({"increments": np.zeros((5, 1, 3))}, errors.WrongShapeError, ["5", "4", "increments"]),
    ({"increments": np.zeros((4, 5, 3))}, errors.WrongShapeError, ["5 noises", "1 noises"]),
    ({"increments": np.zeros((4, 2, 3))}, errors.IncompatibleError, ["2 columns", "1 noises", "dZ"]),
    ({"increments": np.zeros((4, 1, 2))}, errors.WrongShapeError, ["paths"]),
    ({"increments": np.zeros(4)}, errors.WrongShapeError, ["(4,)", "noise"]),
    ({"increments": np.full((4, 1), NAN)}, errors.InvalidArgumentError, ["increments", "finite"]),
    ({"increments": np.zeros((4, 1)), "refine": -1}, errors.IncompatibleError, ["refine", "-1"]),
    ({"q0_low": np.zeros((2, 2)), "compensated": True}, errors.WrongShapeError, ["q0_low"]),
    ({"q0": np.ma.array([[1.0, 2.0, 3.0]], mask=[[0, 1, 0]])}, errors.WrongTypeError, ["q0", "masked", "fill"]),
    ({"increments": np.ma.masked_less(np.zeros((4, 1)), 1)}, errors.WrongTypeError, ["increments", "masked"]),
]


@pytest.mark.parametrize(("changed", "kind", "words"), RUNS, ids=[str(case[0])[:40] for case in RUNS])
def test_run(changed, kind, words, kubo):
    before = ss.simulate(kubo, **GOOD)
    kept = before.q.copy()
    for function in (ss.simulate, ss.moments):
        if function is ss.moments and kind is errors.TooLargeError and "paths" in changed:
            continue  # moments save no paths
        with pytest.raises(kind) as caught:
            function(kubo, **{**GOOD, **changed})
        assert isinstance(caught.value, ValueError | MemoryError)
        for word in words:
            assert word.lower() in str(caught.value).lower(), str(caught.value)
    np.testing.assert_array_equal(before.q, kept)
    np.testing.assert_array_equal(ss.simulate(kubo, **GOOD).q, kept)


def gradient(t, w, q, p):
    return w[0] * q, w[0] * p


MODEL = ss.models.kubo()
ONE = {"q0": 1.0, "p0": 0.0}
TO_ONE = {**ONE, "horizon": 1.0, "abs": 0.1}

OTHERS = [
    (lambda: ss.models.parameters(3), errors.WrongTypeError, ["model = 3", "string"]),
    (lambda: ss.models.get(None), errors.WrongTypeError, ["model = None", "string"]),
    (lambda: ss.moments(MODEL, **GOOD, dt=0.1), errors.WrongTypeError, ["no option 'dt': it is called step here"]),
    (lambda: ss.simulate(MODEL, **PLACE, dt=0.1), errors.WrongTypeError, ["no option 'dt': it is called step here"]),
    (lambda: ss.moments(MODEL, **PLACE, dt=0.1), errors.WrongTypeError, ["no option 'dt': it is called step here"]),
    (lambda: ss.prepare(MODEL, **PLACE, dt=0.1), errors.WrongTypeError, ["no option 'dt': it is called step here"]),
    (lambda: ss.ensemble(MODEL, **GOOD, method="heun"), errors.WrongTypeError, ["'method': it is called scheme here"]),
    (lambda: ss.simulate(MODEL, **GOOD, scheme="verlet"), errors.UnknownNameError, LIKE_VERLET),
    (lambda: ss.simulate(MODEL, **GOOD, scheme="LeapFrog"), errors.UnknownNameError, LIKE_VERLET),
    (
        lambda: ss.expect(MODEL, "q", **PLACE, T=1.0),
        errors.WrongTypeError,
        ["no option 'T': it is called horizon here"],
    ),
    (
        lambda: ss.step(MODEL, "midpoint", 1.0, 0.0, 0.1, steps=3),
        errors.WrongTypeError,
        ["'steps'", "step: it makes one"],
    ),
    (lambda: ss.step(MODEL, "midpoint", 1.0, 0.0, 0.1, paths=3), errors.WrongTypeError, ["'paths'", "points"]),
    (
        lambda: ss.step(MODEL, "midpoint", 1.0, 0.0, 0.1, dw=np.ma.array([0.1], mask=[True])),
        errors.WrongTypeError,
        ["dw has masked values"],
    ),
    (
        lambda: ss.diagnose.symplecticity(MODEL, p=np.ma.array([0.1], mask=[True])),
        errors.WrongTypeError,
        ["p has masked values"],
    ),
    (lambda: ss.diagnose.symplecticity(MODEL, dt=0.1), errors.WrongTypeError, ["no option 'dt'"]),
    (lambda: ss.diagnose.symplecticity(MODEL, paths=2), errors.WrongTypeError, ["'paths'", "symplecticity", "points"]),
    (lambda: ss.diagnose.stationary_path(MODEL, q_start=1.0, q_end=0.0), errors.WrongTypeError, ["step is missing"]),
    (
        lambda: ss.diagnose.stationary_path(MODEL, q_start=1, q_end=0, step=1),
        errors.WrongTypeError,
        ["steps is missing"],
    ),
    (lambda: ss.convergence(MODEL, **ONE, steps=[4, 8], dt=1), errors.WrongTypeError, ["no option 'dt'"]),
    (
        lambda: ss.convergence(MODEL, **ONE, schemes=["gauss2"]),
        errors.WrongTypeError,
        ["no option 'schemes'"],
    ),
    (lambda: ss.convergence(MODEL, **ONE, horizon=-1.0), errors.InvalidArgumentError, ["horizon = -1", "above 0"]),
    (
        lambda: ss.work_precision(MODEL, **ONE, invariants={"I": 1}),
        errors.InvalidArgumentError,
        ["invariants", "f(q, p)"],
    ),
    (lambda: ss.commutator(MODEL, t="x"), errors.WrongTypeError, ["t = 'x'", "number"]),
    (lambda: ss.numba_signature("grad"), errors.UnknownNameError, ["'grad'", "gradient"]),
    (lambda: ss.numba_signature(None), errors.WrongTypeError, ["kind = None"]),
    (lambda: ss.schemes.composition("midpoint", [1.0]), errors.WrongTypeError, ["parts = 'midpoint'", "list"]),
    (lambda: ss.schemes.composition(3, [1.0]), errors.WrongTypeError, ["parts = 3"]),
    (lambda: ss.status_text(2**32), errors.InvalidArgumentError, ["code", str(2**32), "out of range"]),
    (lambda: ss.status_text("ok"), errors.WrongTypeError, ["code = 'ok'"]),
    (lambda: ss.simulate("kubo", **GOOD), errors.WrongTypeError, ["model", "'kubo'", "symsde.models"]),
    (lambda: ss.moments(None, **GOOD), errors.WrongTypeError, ["model", "None"]),
    (lambda: ss.increments(3, step=0.1, steps=1), errors.WrongTypeError, ["model", "3"]),
    (lambda: ss.models.get("kubbo"), errors.UnknownNameError, ["kubbo", "kubo"]),
    (lambda: ss.models.get("kubo", sigm=1.0), errors.UnknownNameError, ["sigm", "sigma"]),
    (lambda: ss.models.kubo(sigma=NAN), errors.InvalidArgumentError, ["sigma", "finite"]),
    (lambda: ss.models.kubo(a="1"), errors.WrongTypeError, ["a = '1'"]),
    (lambda: ss.models.fpu_chain(n=0), errors.InvalidArgumentError, ["n", "0"]),
    (lambda: ss.models.fpu_chain(n=2.5), errors.InvalidArgumentError, ["n", "2.5"]),
    (lambda: ss.schemes.get("gaus2"), errors.UnknownNameError, ["gaus2", "gauss2"]),
    (lambda: ss.schemes.from_quadrature([0.5], [0.5, 0.5], 1), errors.WrongShapeError, ["1 nodes", "2 weights"]),
    (lambda: ss.schemes.from_quadrature([], [], 1), errors.WrongShapeError, ["nodes", "(0,)"]),
    (lambda: ss.schemes.from_quadrature([0.5], [NAN], 1), errors.SymsdeError, ["weights"]),
    (lambda: ss.schemes.from_quadrature([0.5], [1.0], 2), errors.SymsdeError, ["degree"]),
    (lambda: ss.schemes.from_tableau([[1.0]], [[1.0, 2.0]], [1.0]), errors.WrongShapeError, ["abar", "(1, 2)"]),
    (lambda: ss.Model(ndof=0, nnoise=1, gradient=gradient), errors.InvalidArgumentError, ["ndof", "0"]),
    (lambda: ss.Model(ndof=1, nnoise=-1, gradient=gradient), errors.InvalidArgumentError, ["noises", "-1"]),
    (lambda: ss.Model(ndof=2**40, nnoise=0, gradient=gradient), errors.InvalidArgumentError, ["ndof"]),
    (lambda: ss.Model(ndof=1, nnoise=0, gradient=None), errors.WrongTypeError, ["gradient", "None"]),
    (lambda: ss.Model(ndof=1, nnoise=0, gradient=3), errors.WrongTypeError, ["gradient", "3"]),
    (lambda: ss.Model(ndof=1, nnoise=0, gradient=gradient, separable="yes"), errors.WrongTypeError, ["separable"]),
    (
        lambda: ss.Model(ndof=1, nnoise=0, gradient=lambda q, p: (q, p)),
        errors.WrongTypeError,
        ["gradient is a function of (q, p)", "f(t, w, q, p)"],
    ),
    (
        lambda: ss.Model(ndof=1, nnoise=0, gradient=gradient, hessian_vector=gradient),
        errors.WrongTypeError,
        ["hessian_vector is a function of (t, w, q, p)", "f(t, w, q, p, vq, vp)"],
    ),
    (
        lambda: ss.moments(MODEL, **GOOD, observables={"x": lambda t, q, p: q[0]}),
        errors.WrongTypeError,
        ["observable 'x' is a function of (t, q, p)", "f(q, p)"],
    ),
    (lambda: ss.expect(MODEL, "q", **ONE, tol=1), errors.WrongTypeError, ["no option 'tol': it is called abs here"]),
    (
        lambda: ss.expect(MODEL, "q", **ONE, metod=1),
        errors.WrongTypeError,
        ["nearest is method"],
    ),
    (lambda: ss.expect(MODEL, "q", **TO_ONE, paths=9), errors.WrongTypeError, ["'paths' is no option", "tolerance"]),
    (
        lambda: ss.expect(MODEL, "q", **TO_ONE, method="qmc"),
        errors.UnknownNameError,
        ["called 'multilevel quasi-Monte Carlo'"],
    ),
    (lambda: ss.models.kubo(sgma=0.1), errors.WrongTypeError, ["no option 'sgma': the nearest is sigma"]),
    (lambda: ss.Model(ndof=1, nnoise=0, grad=gradient), errors.WrongTypeError, ["no option 'grad'", "gradient"]),
    (lambda: ss.simulate(MODEL, **GOOD).plot(kind="line"), errors.WrongTypeError, ["no option 'kind'", "called what"]),
    (lambda: ss.moments(MODEL, **GOOD).plot(kind="line"), errors.WrongTypeError, ["no option 'kind'", "called what"]),
    (lambda: ss.models.kubo().value(1.0, 0.0, [1.0]), errors.WrongShapeError, ["w", "(2,)"]),
    (lambda: ss.moments(ss.models.kubo(), **GOOD, first_path=5), errors.InvalidArgumentError, ["first_path", "256"]),
    (lambda: ss.moments(ss.models.kubo(), **GOOD, observables=[1]), errors.WrongTypeError, ["observables", "dict"]),
    (lambda: ss.moments(ss.models.kubo(), **GOOD, observables={"x": 1}), errors.WrongTypeError, ["'x'"]),
    (lambda: ss.step(ss.models.kubo(), "midpoint", 1.0, 0.0, 0.1, [1.0, 2.0]), errors.WrongShapeError, ["dw"]),
    (lambda: ss.diagnose.action("run"), errors.WrongTypeError, ["'run'", "symsde.simulate"]),
    (
        lambda: ss.diagnose.action(ss.simulate(ss.models.kubo(), **GOOD, save_every=2)),
        errors.IncompatibleError,
        ["save_every = 2", "save_every = 1"],
    ),
    (
        lambda: ss.diagnose.exact(ss.simulate(ss.models.pendulum(), **GOOD)),
        errors.MissingOperationError,
        ["exact", "kubo"],
    ),
    (
        lambda: ss.simulate(ss.models.kubo(), scheme="P1N2Q2Lob", **GOOD),
        errors.IncompatibleError,
        ["P1N2Q2Lob"],
    ),
    (
        lambda: ss.convergence(ss.models.kubo(), q0=1.0, p0=0.0, steps=[10, 30]),
        errors.InvalidArgumentError,
        ["10", "30", "power of two"],
    ),
]


@pytest.mark.parametrize(("function", "kind", "words"), OTHERS)
def test_other(function, kind, words):
    with pytest.raises(kind) as caught:
        function()
    for word in words:
        assert word.lower() in str(caught.value).lower(), str(caught.value)


def test_a_false_trait_is_named():
    model = ss.Model(ndof=1, nnoise=0, gradient=lambda t, w, q, p: (w[0] * q**3, w[0] * p), quadratic=True)
    with pytest.raises(errors.FalseTraitError, match="quadratic"):
        ss.simulate(model, **GOOD)
    with pytest.raises(errors.FalseTraitError, match="quadratic"):
        model.probe(q0=0.7)


def test_a_false_hessian_is_named():
    model = ss.Model(
        ndof=1,
        nnoise=0,
        gradient=gradient,
        hessian=lambda t, w, q, p: (1.01 * w[0][None, None], 0.0, w[0][None, None]),
    )
    with pytest.raises(errors.FalseTraitError, match=r"(?i)hessian"):
        ss.simulate(model, **GOOD)


def test_unknown_keyword():
    with pytest.raises(TypeError, match="sheme"):
        ss.simulate(ss.models.kubo(), **GOOD, sheme="midpoint")


def test_masks_that_hide_nothing_are_no_obstacle(kubo):
    start = np.ma.array([[1.0, 2.0, 3.0]], mask=False)
    np.testing.assert_array_equal(ss.simulate(kubo, **{**GOOD, "q0": start}).q[0], [[1.0, 2.0, 3.0]])


def test_no_private_function_is_named_by_a_refusal(kubo):
    """Every public function that takes options of a run gets one that does not exist."""
    calls = {
        ss.moments: lambda f: f(kubo, **GOOD, nonsense=1),
        ss.step: lambda f: f(kubo, "midpoint", 1.0, 0.0, 0.1, nonsense=1),
        ss.convergence: lambda f: f(kubo, q0=1.0, p0=0.0, steps=[4, 8], nonsense=1),
        ss.work_precision: lambda f: f(kubo, q0=1.0, p0=0.0, nonsense=1),
        ss.diagnose.symplecticity: lambda f: f(kubo, nonsense=1),
        ss.diagnose.stationary_path: lambda f: f(kubo, q_start=1.0, q_end=0.0, step=0.1, steps=2, nonsense=1),
    }
    for function, call in calls.items():
        with pytest.raises((TypeError, ValueError), match="nonsense") as caught:
            call(function)
        assert "make_" not in str(caught.value) and "_setup" not in str(caught.value)


def test_traits_are_probed_around_the_state_that_is_given():
    asked = []

    def gradient(t, w, q, p):
        asked.append((q.copy(), p.copy()))
        return w[0] * q, w[0] * p

    model = ss.Model(ndof=1, nnoise=0, gradient=gradient, separable=True)
    asked.clear()
    model.probe(5.0, -5.0)
    q, p = (np.concatenate([x.ravel() for x in points]) for points in zip(*asked, strict=True))
    assert (q[0], p[0]) == (5.0, -5.0) and (np.abs(q - 5) < 2).all() and (np.abs(p + 5) < 2).all()


@pytest.mark.parametrize(
    ("of_p", "of_q", "words"),
    [
        (0.3, 0.0, "dp_2 by p_1 is 0, and of dH_0/dp_1 by p_2 0.3"),
        (0.0, 0.2, "dp_2 by q_1 is 0.2, and of dH_0/dq_1 by p_2 0"),
    ],
)
def test_the_pair_that_is_no_gradient_is_named(of_p, of_q, words):
    model = ss.Model(
        ndof=2,
        nnoise=0,
        gradient=lambda t, w, q, p: (w[0] * q, w[0] * np.stack([p[0] + of_p * p[1], p[1] + of_q * q[0]])),
    )
    with pytest.raises(errors.FalseTraitError, match=re.escape(f"the derivative of dH_0/{words}, at")):
        model.probe([0.3, 0.4], [0.1, 0.2])
