# SPDX-License-Identifier: BSD-3-Clause
"""Exact solutions of quadratic formulas whose flows commute, as references of studies; which flows do."""

import itertools
import math

import numpy as np
import pytest
import symsde as ss
from clock import calls_of
from symsde import errors
from symsde.model.formulas import compiler, emit_flow
from symsde.model.formulas.derivatives import Derivatives
from symsde.model.formulas.named_formulas import make_problem
from symsde.model.formulas.structure import Prover

pytest.importorskip("sympy")

pytestmark = pytest.mark.usefixtures("quick_compiler")
FLAGS, LONG = compiler.FLAGS, compiler.LONG  # the normal compiler options, also within these tests
PARAMS = {"a": 1.3, "s": 0.4, "b": 0.2}
RUN = {"step": 0.05, "steps": 40, "save_every": 20, "paths": 9, "seed": 3}


def test_kubo_from_its_formula():
    mine = ss.model_from_sympy("a*(p**2 + q**2)/2", ["s*(p**2 + q**2)/2"], params=PARAMS)
    known = ss.models.kubo(a=1.3, sigma=0.4)
    run = ss.simulate(mine, q0=1.0, p0=-0.5, **RUN)
    for one, other in zip(
        ss.diagnose.exact(run), ss.diagnose.exact(ss.simulate(known, q0=1.0, p0=-0.5, **RUN)), strict=True
    ):
        np.testing.assert_allclose(one, other, rtol=0, atol=2e-14)


# coupled oscillators rotated together by two noises; a drift along invariants, with linear terms; growth and decay
COMMUTING = [
    ("a*(x**2+y**2+u**2+v**2)/2", ["s*(x*v - y*u)", "b*(x**2+y**2+u**2+v**2)/2"], ["x", "y"], ["u", "v"]),
    ("a*u**2/2 + b*u + (y*v)/3", ["s*u", "b*y*v"], ["x", "y"], ["u", "v"]),
]


@pytest.mark.parametrize(("H", "noise", "q", "p"), COMMUTING)
def test_gauss3_comes_to_the_exact_solution(H, noise, q, p):
    model = ss.model_from_sympy(H, noise, q=q, p=p, params=PARAMS)
    assert model.formula.structure.flows_commute
    given = {"q0": [0.4, -0.3], "p0": [0.2, 0.7], **RUN}
    run = ss.simulate(model, scheme="gauss3", **given)
    q_exact, p_exact = ss.diagnose.exact(run)
    assert np.abs(q_exact[-1] - q_exact[0]).max() > 0.05
    np.testing.assert_allclose(run.q, q_exact, rtol=0, atol=1e-7)
    np.testing.assert_allclose(run.p, p_exact, rtol=0, atol=1e-7)
    table = ss.convergence(model, "midpoint", q0=[0.4, -0.3], p0=[0.2, 0.7], steps=(8, 16, 32, 64), paths=200, seed=1)
    assert table.reference == "the exact solution" and table.reference_error == 0
    assert 0.85 < table.order < 2.2


@pytest.mark.parametrize(
    ("H", "noise", "words"),
    [
        ("(p**2 + q**2)/2", ["s*q*p"], "has flows that do not commute"),
        ("(p**2 + q**2)/2", ["s*q", "s*q*p"], "has flows that do not commute, and noise that is not constant"),
        ("p**2/2 - cos(q)", ["s*q"], "is not declared quadratic"),
        ("(2 + sin(t))*(p**2 + q**2)/2", ["s*(p**2 + q**2)"], "changes in time"),
    ],
)
def test_others_have_none(H, noise, words):
    model = ss.model_from_sympy(H, noise, params=PARAMS)
    with pytest.raises(errors.MissingOperationError, match=f"{words}.*quadratic models whose flows commute"):
        ss.diagnose.exact(ss.simulate(model, q0=1.0, p0=0.0, **RUN))


def test_a_model_that_is_not_what_it_declares_has_none():
    def gradient(t, w, q, p):
        return w[0] * q + w[1] * 0.3 * q, w[0] * p + w[1] * 0.3 * p + 0.2 * w[0] * p**3 * (np.abs(p) > 1.2)

    model = ss.Model(ndof=1, nnoise=1, gradient=gradient, quadratic=True)
    with pytest.raises((errors.MissingOperationError, errors.FalseTraitError), match="quadratic"):
        ss.diagnose.exact(ss.simulate(model, q0=0.01, p0=0.01, **RUN))


def test_which_flows_commute():
    momentum = ss.model_from_sympy("p**2/2", ["s*q", "b*p"], params=PARAMS).formula.structure
    assert momentum.noises_commute and not momentum.flows_commute  # {q, p} is constant, {p^2/2, q} is p
    for noise in (["q", "p**2"], ["p**2", "q"]):
        assert not ss.model_from_sympy("p**2/2", noise).formula.structure.noises_commute


def test_a_noise_that_changes_in_time_commutes_with_no_flow():
    """{H, H_k} vanishes at every time, but the flow of t H + W H_k does not solve the equation."""
    spins = ["sin(3*t)*(p**2 + q**2)/2", "sin(3*t)"]
    still, moving = (ss.model_from_sympy("(p**2 + q**2)/2", spins[i]).formula.structure for i in (1, 0))
    assert still.flows_commute and moving.noises_commute and not moving.flows_commute
    driven = ss.model_from_sympy("cos(t)*(p**2 + q**2)/2", "(p**2 + q**2)/4").formula.structure
    assert driven.flows_commute


def test_a_noise_for_each_of_many_degrees_of_freedom():
    n = 64
    energy = [f"p{i}**2/2" for i in range(1, n + 1)] + [f"cos(q{i}-q{i + 1})" for i in range(1, n)]
    given = {"H": "+".join(energy), "noise": [f"s*sin(q{i})" for i in range(1, n + 1)], "params": {"s": 0.3}}
    found = []
    calls = calls_of(lambda: found.append(Prover(make_problem(**given, q=None, p=None, t=None)).structure()))
    assert calls < 3e7  # measured 1.2e7; it was ten times as many when all derivatives were computed
    (structure,) = found
    assert structure.noises_commute and not structure.flows_commute
    assert structure.nonzero == {"qq": 3 * n - 2, "qp": 0, "pp": n}


def test_distances_of_bodies_are_not_simplified(monkeypatch):
    """Derivatives of functions of distances vanish where coordinates are equal: each symbol has a value of its own."""
    n = 5
    energy = [f"p{i}**2/2" for i in range(1, 3 * n + 1)]
    for a, b in itertools.combinations(range(n), 2):
        energy.append("1/sqrt(" + "+".join(f"(q{3 * a + k} - q{3 * b + k})**2" for k in (1, 2, 3)) + ")")
    prover = Prover(make_problem(H="+".join(energy), noise=["q1"], q=None, p=None, params=None, t=None))

    def simplified(e, **_):
        raise AssertionError(f"{e} is simplified")

    monkeypatch.setattr(prover.sympy, "simplify", simplified)
    structure = prover.structure()
    assert structure.nonzero == {"qq": (3 * n) ** 2, "qp": 0, "pp": 3 * n} and structure.identity_mass


def test_what_leaves_floating_point_is_not_simplified():
    """35 nested exp: sympy has no largest number and did not return; whole steps with 12 took gcc 13 s."""
    nested = {n: f"p**2/2 + {'exp(' * n}q/9{')' * n}" for n in (12, 35)}
    made = {n: make_problem(H=h, noise="sin(q)", q=None, p=None, params=None, t=None) for n, h in nested.items()}
    prover = Prover(made[35])
    structure = prover.structure()
    assert structure.identity_mass and structure.separable and structure.rotation is None
    assert Derivatives(made[35], prover.vanishing()).third() is None  # too many operations: differences are used
    assert emit_flow.flows(Derivatives(made[12])) == []
    few = make_problem(H="p**2/2 - cos(q)", noise="sin(q)", q=None, p=None, params=None, t=None)
    assert "midpoint" in emit_flow.flows(Derivatives(few))


def test_too_many_noises():
    with pytest.raises(errors.InvalidArgumentError, match=r"257 noises beside 'p\*\*2/2': .* 256 at most"):
        ss.model_from_sympy("p**2/2", ["q"] * 257)


@pytest.mark.skipif(compiler.command() is None, reason="no compiler")
def test_long_texts_are_compiled_in_less_time(monkeypatch, tmp_path):
    """Texts longer than the text of 35 nested exp, and all other formulas of this suite are shorter, are compiled with
    -O1; the bits are the same.
    """
    monkeypatch.setenv("SYMSDE_CACHE", str(tmp_path))
    monkeypatch.setattr(compiler, "FLAGS", FLAGS)
    asked = []
    compile_ = compiler._compile
    monkeypatch.setattr(compiler, "_compile", lambda *a: asked.append(compiler.flags(a[1])) or compile_(*a))
    run = {"q0": np.linspace(-1, 1, 9)[None], "p0": 0.3, "step": 0.1, "steps": 10, "paths": 9, "scheme": "gauss2"}
    ends = []
    for longest in (LONG, 10**4):
        monkeypatch.setattr(compiler, "LONG", longest)
        ends.append(ss.simulate(ss.model_from_sympy("p**2/2 + log(1 + exp(sin(q)))*q**2"), **run))
    assert ["-O1" in flags for flags in asked] == [False, True] and all("-O3" not in x or "-O1" not in x for x in asked)
    np.testing.assert_array_equal(ends[0].q, ends[1].q)
    monkeypatch.undo()
    monkeypatch.setenv("SYMSDE_CACHE", str(tmp_path))
    monkeypatch.setattr(compiler, "_compile", lambda *a: asked.append(compiler.flags(a[1])) or compile_(*a))
    ss.model_from_sympy(f"p**2/2 + {'exp(' * 35}q/9{')' * 35}", noise=["sin(q)"])
    assert "-O1" in asked[-1] and len(asked) == 3


def proved(h, noise, **params):
    """The structure found for formulas, without compiling."""
    return Prover(make_problem(H=h, noise=noise, q=None, p=None, params=params, t="t")).structure()


@pytest.mark.parametrize("noises", [1, 2])
@pytest.mark.parametrize(
    ("factor", "commute"), [("1", True), ("(1 + t)", False), ("sin(t)", False), ("exp(-t)", False)]
)
def test_flows_of_noise_in_time_do_not_commute(noises, factor, commute):
    """All brackets vanish, yet noise that depends on time limits every scheme to the order of its time integral."""
    still, moving = "s*(q**2 + p**2)", f"s*{factor}*(q**2 + p**2)"
    found = proved("(q**2 + p**2)/2", [still] * (noises - 1) + [moving], s=0.2)
    assert found.noises_commute and found.flows_commute == commute


@pytest.mark.parametrize("squares", [(0, 4), (4, 0), (0, 0), (1, 4), (-1, 4)])
def test_frequencies_of_the_linear_part(squares):
    """Zero frequencies are listed beside others; unstable directions have none."""
    h = f"(p1**2 + p2**2)/2 + ({squares[0]}*q1**2 + {squares[1]}*q2**2)/2 + q1*q2**3"
    wanted = None if min(squares) < 0 or not any(squares) else tuple(math.sqrt(x) for x in squares)
    assert proved(h, []).rotation == wanted
