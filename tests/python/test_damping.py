# SPDX-License-Identifier: BSD-3-Clause
"""Damped momenta, dp = .. - gamma p dt: the equations, orders, dp ^ dq times exp(-gamma h), bits, refusals."""

import copy
import pickle

import numpy as np
import pytest
import symsde as ss
from symsde.batch import scene
from symsde.errors import (
    IncompatibleError,
    InvalidArgumentError,
    MissingOperationError,
    OutOfMemoryError,
    SceneError,
    SymsdeError,
    WrongShapeError,
    WrongTypeError,
)

pytestmark = pytest.mark.usefixtures("quick_compiler")

RATE = 0.8
TIME = 1.0
FINEST = 9  #: the finest run has 8 2^k steps
#: two nonlinear noises in position, without damping and with it
SYNCHROTRON = ss.models.synchrotron(omega=2.0, sigma1=0.8, sigma2=0.5)
#: the same equations as a closed system that depends on time, P = exp(gamma t) p [Caldirola and Kanai]
CLOCK = ss.model_from_sympy(
    "exp(-g*t)*p**2/2 - exp(g*t)*4*cos(q)",
    noise=["exp(g*t)*0.8*sin(q)", "-exp(g*t)*0.5*cos(q)"],
    params={"g": RATE},
)
WELL = ss.model_from_sympy("p**2/2 + q**4/4 - q**2/2", noise=["-s*q"], params={"s": 1.4})
BILINEAR = ss.model_from_sympy("p**2/2 + cos(q)*(1 + p**2/8)", noise=["0.4*q*p", "0.3*sin(q)*p"])
#: strong orders with additive noise, and with two nonlinear noises in position
ORDERS = {
    "midpoint": (1, 1),
    "symplectic_euler": (1, 1),
    "symplectic_euler_adjoint": (1, 1),
    "stormer_verlet": (1, 1),
    "gauss2": (1, 1),
    "lobatto3": (1, 1),
    "gauss_dkdkd": (2, 1.5),
    "verlet_kdk": (2, 1.5),
    "chin4a": (3, 1.5),
    "gauss_dkdkd_strong2": (2, 2),
    "verlet_kdk_strong2": (2, 2),
    "chin4a_strong2": (3, 2),
}


def ends(model, scheme, k, paths=100):
    """Final states after 8 2^k steps on the paths of the finest level."""
    steps = 8 * 2**k
    run = ss.simulate(model, q0=0.7, p0=0.3, step=TIME / steps, steps=steps, save_every=steps, paths=paths, seed=3,
                      scheme=scheme, refine=FINEST - k)  # fmt: skip
    assert run.report.status == 0
    return np.concatenate([run.q[-1], run.p[-1]])


def distance(x, y):
    """Root mean square distance of final states."""
    return np.sqrt(np.mean(np.sum((x - y) ** 2, axis=0)))


@pytest.mark.parametrize("scheme", ["midpoint", "gauss2", "stormer_verlet", "lobatto3"])
def test_a_step_is_that_of_the_clock(scheme):
    """A tableau with decays is the tableau applied to the closed system in P: an identity, for every step length."""
    damped, clock = ends(SYNCHROTRON.damped(RATE), scheme, 1), ends(CLOCK, scheme, 1)
    clock[1] *= np.exp(-RATE * TIME)
    np.testing.assert_allclose(damped, clock, rtol=0, atol=2e-12)
    wrong = ends(SYNCHROTRON.damped(1.01 * RATE), scheme, 1)
    assert distance(wrong, clock) > 1e-3


@pytest.mark.parametrize(
    "scheme",
    ["midpoint", "symplectic_euler", "symplectic_euler_adjoint", "stormer_verlet", "lobatto2_swapped", "heun"],
)
def test_fast_steppers_agree_with_the_oracle(scheme):
    """The damped steppers agree with the general one, also with a correction and masses."""
    pair = ss.model_from_sympy("p1**2/2 + p2**2/6 + cos(q1 - q2) + q1**4/4", noise=["0.3*sin(q1)", "0.2*q2"])
    timed = ss.model_from_sympy("p**2/2*(1 + t/5) - cos(q)*(1 + t)", noise=["0.3*sin(q)"])
    three, long = ss.models.fpu_chain(n=3), ss.models.fpu_chain(n=12)
    cases = [(pair, [0.5, 1.5]), (pair, RATE), (BILINEAR, RATE), (ss.models.kubo(), RATE), (SYNCHROTRON, RATE)]
    cases += [(timed, RATE), (WELL, RATE), (three, [0.5, 1.0, 1.5]), (long, RATE), (long, np.linspace(0, 2, 12))]
    for model, rates in cases:
        given = {"q0": np.linspace(0.7, 0.9, model.ndof), "p0": 0.3, "step": 0.05, "steps": 10, "save_every": 10}
        given |= {"paths": 300 if model is long else 20, "seed": 5}  # strips of a block, whose states are moved
        fast, general = (ss.simulate(model.damped(rates), scheme=scheme, general=x, **given) for x in (False, True))
        assert "general" in general.report.stepper
        np.testing.assert_allclose(fast.q, general.q, rtol=0, atol=5e-13)
        np.testing.assert_allclose(fast.p, general.p, rtol=0, atol=5e-13)
        for path in (0, 19):
            alone = ss.simulate(model.damped(rates), scheme=scheme, **{**given, "paths": 1, "first_path": path})
            np.testing.assert_array_equal(fast.q[..., path], alone.q[..., 0])
            np.testing.assert_array_equal(fast.p[..., path], alone.p[..., 0])


@pytest.mark.parametrize("scheme", ["gauss2", "gauss3", "lobatto3", "lobatto3_swapped", "lobatto4"])
def test_implicit_stages_agree_with_the_oracle(scheme):
    """Sweeps, rows of chains and matrices with decays, with the general stepper; one path has its bits of a block."""
    pair = ss.model_from_sympy("p1**2/2 + p2**2/6 + cos(q1 - q2) + q1**4/4", noise=["0.3*sin(q1)", "0.2*q2"])
    linear = ss.model_from_sympy(
        "(p1**2 + p2**2 + p3**2 + q1**2 + q3**2 + 2*(q1 - q2)**2 + 2*(q2 - q3)**2)/2", noise=["0.3*q1", "0.2*q3"]
    )
    chain, additive, kubo = ss.models.fpu_chain(n=6), ss.models.additive_oscillator(), ss.models.kubo()
    for model in (SYNCHROTRON, BILINEAR, pair, linear, chain, additive, ss.models.henon_heiles(), kubo):
        for rate, step in ((RATE, 0.05), (-1.0, 0.1), (3.0, 0.3)):
            given = {"q0": np.linspace(0.3, 0.7, model.ndof), "p0": 0.3, "step": step, "steps": 6, "save_every": 3}
            given |= {"scheme": scheme, "seed": 5}
            damped = model.damped(rate, allow_gain=True)
            fast, general = (ss.simulate(damped, general=x, paths=20, **given) for x in (False, True))
            own = "whole steps" if scheme == "gauss2" and any(model is x for x in (pair, additive, kubo)) else "stages"
            assert own in fast.report.stepper and "general" in general.report.stepper
            np.testing.assert_allclose(fast.q, general.q, rtol=0, atol=2e-12)
            np.testing.assert_allclose(fast.p, general.p, rtol=0, atol=2e-12)
            alone = ss.simulate(damped, paths=1, first_path=7, **given)
            np.testing.assert_array_equal(fast.q[..., 7], alone.q[..., 0])
            np.testing.assert_array_equal(fast.p[..., 7], alone.p[..., 0])


@pytest.mark.parametrize("paths", [1, 40])
@pytest.mark.filterwarnings("ignore::symsde.errors.DoubtfulRunWarning")
def test_stiff_chains_agree_with_the_oracle(paths):
    """In steps too long for the equation of V, dq is the unknown, and half of the decay comes before."""
    how = {"q0": 3 * np.sin(3.0 * np.arange(32)), "p0": 1.0, "step": 1.0, "steps": 6, "seed": 2, "paths": paths}
    fast, plain = (ss.simulate(ss.models.fpu_chain(n=32).damped(RATE), general=g, **how) for g in (False, True))
    assert fast.report.stepper == "midpoint, momenta eliminated, tridiagonal, damped"
    np.testing.assert_allclose([fast.q, fast.p], [plain.q, plain.p], rtol=0, atol=1e-13)


@pytest.mark.parametrize("noise", ["0.3*q*p", "0.3*q**2"])
def test_lanes_that_are_gathered_keep_their_decays(noise):
    """Of a block the lanes that need more corrections are finished in a small one, with the bits of single paths."""
    model = ss.model_from_sympy("p**2/2 + q**4/4 + sin(t)*q", noise=[noise]).damped(RATE)
    given = {"q0": 1.4, "p0": 0.3, "step": 0.4, "steps": 6, "scheme": "gauss2", "seed": 5}
    many, general = (ss.simulate(model, paths=200, general=x, **given) for x in (False, True))
    assert many.report.stepper == "stages, one degree of freedom"
    np.testing.assert_allclose(many.p, general.p, rtol=0, atol=2e-12)
    for path in range(0, 200, 40):
        alone = ss.simulate(model, paths=1, first_path=path, **given)
        np.testing.assert_array_equal(many.p[..., path], alone.p[..., 0])


#: built-in models with noise in q, in p, in both, and of quadratic strength
WHOLE = (
    ss.models.kubo(),
    ss.models.linear_oscillator(),
    ss.models.additive_oscillator(),
    ss.models.additive_oscillator(sigma=0.7, gamma=0.4),
    ss.models.noncommutative_oscillator(),
    SYNCHROTRON,
    ss.models.pendulum(sigma=0.3),
    ss.models.henon_heiles(),
)


@pytest.mark.parametrize(
    "scheme",
    ["midpoint", "symplectic_euler", "symplectic_euler_adjoint", "stormer_verlet", "lobatto2_swapped", "gauss2",
     "gauss_dkdkd", "verlet_kdk"],
)  # fmt: skip
def test_whole_steps_decay(scheme):
    """Whole steps of built-in models decay like steps by steppers, in blocks, alone, and step by step."""
    whole = 0
    for model in WHOLE:
        kicks = scheme in ("gauss_dkdkd", "verlet_kdk")
        if kicks and not model.traits.position_noise:
            continue
        for rate, step in ((RATE, 0.05), (40.0, 0.2), (-1.0, 0.1), (1e-9, 0.1), (0.7, -0.1)):
            given = {"q0": 0.2, "p0": -0.1, "step": step, "steps": 12, "scheme": scheme, "seed": 5}
            damped = model.damped(rate, allow_gain=True)
            many = ss.simulate(damped, paths=300, save_every=4, **given)
            other = {"compensated": True} if kicks else {"general": True}  # with neither option whole steps are taken
            slow = ss.simulate(damped, paths=300, save_every=4, **given, **other)
            assert "whole" not in slow.report.stepper
            whole += "whole" in many.report.stepper
            np.testing.assert_allclose(many.q, slow.q, rtol=0, atol=1e-13)
            np.testing.assert_allclose(many.p, slow.p, rtol=0, atol=1e-13)
            for path, every in ((0, 1), (7, 4), (299, 12)):
                alone = ss.simulate(damped, paths=1, first_path=path, save_every=every, **given)
                np.testing.assert_array_equal(many.q[-1, :, path], alone.q[-1, :, 0])
                np.testing.assert_array_equal(many.p[-1, :, path], alone.p[-1, :, 0])
    least = {"midpoint": 4, "gauss2": 4, "gauss_dkdkd": 1, "verlet_kdk": 1, "stormer_verlet": 7}
    assert whole >= 5 * least.get(scheme, 5)


@pytest.mark.parametrize("scheme", ORDERS)
def test_strong_orders(scheme):
    """Errors fall with the closed system's order; the reference of kicks is the closed system in P, that of tableaux
    kicks.
    """
    for which, model in enumerate((WELL.damped(RATE), SYNCHROTRON.damped(RATE))):
        fine = ends(model, "chin4a_strong2", FINEST)
        errors = [distance(ends(model, scheme, k), fine) for k in (1, 4)]
        slope = np.log2(errors[0] / errors[1]) / 3
        assert slope > ORDERS[scheme][which] - 0.15, (scheme, which, slope)


def test_kicks_solve_the_equation():
    """Kicks, and the midpoint rule on the closed system in P, converge to the same solution."""
    clock = ends(CLOCK, "gauss2", FINEST)
    clock[1] *= np.exp(-RATE * TIME)
    for scheme in ("gauss_dkdkd_strong2", "verlet_kdk_strong2", "chin4a_strong2"):
        assert distance(ends(SYNCHROTRON.damped(RATE), scheme, 6), clock) < 2e-4
        assert distance(ends(SYNCHROTRON.damped(1.01 * RATE), scheme, 6), clock) > 1e-3
        assert distance(ends(SYNCHROTRON.damped(0.99 * RATE), scheme, 6), clock) > 1e-3


@pytest.mark.parametrize("step", [0.1, -0.07, 0.5])
@pytest.mark.parametrize("rate", [1e-9, 0.4, 5.0])
def test_the_form_shrinks_by_one_factor(rate, step):
    """M^T J M = exp(-gamma h) J for every scheme, Hamiltonian and increment."""
    for model, schemes in (
        (SYNCHROTRON, ORDERS),
        (BILINEAR, ("midpoint", "symplectic_euler", "gauss2", "lobatto2")),
        (ss.models.henon_heiles(sigma1=0.2, sigma2=0.1), ("midpoint", "gauss2", "stormer_verlet", "chin4a")),
    ):
        for scheme in schemes:
            q, p = np.full(model.ndof, 0.3), np.full(model.ndof, -0.4)
            dw = np.full((model.nnoise, 1), 0.1)
            defect = ss.diagnose.symplecticity(model.damped(rate), scheme, q=q, p=p, step=step, dw=dw)
            assert defect.max() < 1e-11 * max(1, np.exp(-rate * step)), (model.name, scheme)
    assert ss.diagnose.symplecticity(SYNCHROTRON.damped(0.4), "heun", step=0.5).max() > 1e-6


def test_rates_of_each_degree():
    """Unequal rates: two uncoupled oscillators are each damped by their own; equal rates are one rate."""
    two = ss.model_from_sympy("(p1**2 + p2**2)/2 - cos(q1) - cos(q2)", noise=["-0.3*q1", "-0.3*q2"])
    one = ss.model_from_sympy("p**2/2 - cos(q)", noise=["-0.3*q"])
    given = {"step": 0.1, "steps": 8, "save_every": 8}
    dw = np.random.default_rng(1).normal(size=(8, 2, 5)) * np.sqrt(0.1)
    for scheme in ("midpoint", "gauss2", "stormer_verlet"):
        pair = ss.simulate(two.damped([0.5, 2.0]), q0=0.7, p0=0.3, scheme=scheme, increments=dw, paths=5, **given)
        for i, rate in enumerate((0.5, 2.0)):
            alone = ss.simulate(one.damped(rate), q0=0.7, p0=0.3, scheme=scheme, increments=dw[:, i : i + 1], paths=5,
                                **given)  # fmt: skip
            np.testing.assert_allclose(pair.q[-1, i], alone.q[-1, 0], rtol=1e-12)
            np.testing.assert_allclose(pair.p[-1, i], alone.p[-1, 0], rtol=1e-12)
    same = [ss.simulate(two.damped(x), q0=0.7, p0=0.3, seed=1, paths=3, **given) for x in (0.5, [0.5, 0.5])]
    np.testing.assert_array_equal(same[0].p, same[1].p)
    with pytest.raises(IncompatibleError, match="a form that a step keeps up to one factor"):
        ss.diagnose.symplecticity(two.damped([0.5, 2.0]))


@pytest.mark.parametrize("scheme", ["midpoint", "symplectic_euler", "gauss2", "gauss_dkdkd", "chin4a_strong2"])
@pytest.mark.parametrize("compensated", [False, True])
def test_a_path_has_its_bits(scheme, compensated):
    """The same bits in blocks, alone and with other threads; a rate of zero gives the closed system."""
    for model in (WELL, SYNCHROTRON):
        given = {"q0": 0.7, "p0": 0.3, "step": 0.05, "steps": 20, "save_every": 10, "seed": 5, "scheme": scheme}
        given["compensated"] = compensated
        many = ss.simulate(model.damped(RATE), paths=300, threads=2, **given)
        for path in (0, 7, 299):
            alone = ss.simulate(model.damped(RATE), paths=1, first_path=path, threads=1, **given)
            np.testing.assert_array_equal(many.q[..., path], alone.q[..., 0])
            np.testing.assert_array_equal(many.p[..., path], alone.p[..., 0])
        closed, zero = (ss.simulate(x, paths=20, **given) for x in (model, model.damped(RATE).damped(0.0)))
        np.testing.assert_array_equal(closed.p, zero.p)
        assert np.abs(many.p[-1, :, :20] - closed.p[-1]).max() > 1e-3


def test_means_of_a_damped_oscillator():
    """E p^2 of dp = -q dt - p/2 dt + dW, dq = p dt from rest at t = 4, within an interval of probability 1 - 1e-6."""
    model = ss.models.linear_oscillator(sigma=1.0).damped(0.5)
    run = ss.moments(model, q0=0.0, p0=0.0, step=0.25, steps=16, save_every=16, paths=40000, seed=2, scheme="chin4a",
                     observables={"square": lambda q, p: p[0] ** 2})  # fmt: skip
    exact = 0.8913547910283172  # exponential of the equations of second moments
    assert abs(run.mean["square"][-1] - exact) < 4.9 * run.se_mean["square"][-1] + 1e-3


def test_models_keep_their_damping():
    """Text, parameters and pickles contain the damping; a second damping replaces the first."""
    model = WELL.damped(RATE)
    assert model.damping == (RATE,)
    assert WELL.damping == ()
    assert "damping=0.8" in repr(model)
    assert model.damped(0.0) is WELL
    assert model.damped(0.3).damping == (0.3,)
    assert model.with_parameters(s=0.2).damping == (RATE,)
    by_keyword = ss.model_from_sympy("p**2/2 + q**4/4 - q**2/2", noise=["-s*q"], params={"s": 1.4}, damping=RATE)
    given = {"q0": 0.7, "p0": 0.3, "step": 0.05, "steps": 4, "seed": 5, "scheme": "midpoint"}
    first = ss.simulate(model, **given)
    for other in (by_keyword, pickle.loads(pickle.dumps(model)), copy.deepcopy(model)):
        np.testing.assert_array_equal(ss.simulate(other, **given).p, first.p)
    pair = ss.models.henon_heiles().damped([0.1, 0.2])
    assert pickle.loads(pickle.dumps(pair)).damping == (0.1, 0.2)
    assert "damping=[0.1, 0.2]" in repr(pair)


def test_models_of_ones_own():
    """A model of Python functions gets its damping in the constructor."""

    def gradient(t, w, q, p):
        return w[0] * np.sin(q), w[0] * p

    own = ss.Model(ndof=1, nnoise=0, gradient=gradient, separable=True, identity_mass=True, damping=RATE)
    pendulum = ss.models.pendulum(sigma=0.0).damped(RATE)
    given = {"q0": 0.7, "p0": 0.3, "step": 0.05, "steps": 40}
    for scheme in ("gauss_dkdkd", "midpoint"):
        runs = [ss.simulate(model, scheme=scheme, **given) for model in (own, pendulum)]
        np.testing.assert_allclose(runs[0].p, runs[1].p, rtol=1e-10)


def test_scenes(tmp_path):
    """`damping` in [model], for built-in models and formulas; a wrong value is refused with the file's name."""
    text_of = '[model]\n{model}\n[run]\nstep = 0.05\nsteps = 4\nq0 = 0.7\np0 = 0.3\nseed = 5\nscheme = "midpoint"\n'
    file = tmp_path / "scene.toml"
    for text, model in (
        ('name = "synchrotron"\nomega = 2.0\nsigma1 = 0.8\nsigma2 = 0.5\ndamping = 0.8', SYNCHROTRON.damped(RATE)),
        ('H = "p**2/2 + q**4/4 - q**2/2"\nnoise = ["-s*q"]\nparams = {s = 1.4}\ndamping = [0.8]', WELL.damped(RATE)),
    ):
        file.write_text(text_of.format(model=text), encoding="utf-8")
        read = scene.load(file)
        assert read.model.damping == (RATE,)
        found = ss.simulate(read.model, **read.run)
        np.testing.assert_array_equal(found.p, ss.simulate(model, q0=0.7, p0=0.3, step=0.05, steps=4, seed=5).p)
    file.write_text(text_of.format(model='name = "kubo"\ndamping = -1'), encoding="utf-8")
    with pytest.raises(SceneError, match=r"scene.toml: \[model\]: a rate of damping is negative"):
        scene.load(file)


def test_gain_at_every_door(tmp_path):
    """Negative rates are refused, and taken with allow_gain, where a model or a scene is given damping."""
    table = "[model]\n{}\n[run]\nstep = 0.05\nsteps = 4\nq0 = 0.7\np0 = 0.3\nscheme = 'midpoint'\n"
    file = tmp_path / "scene.toml"

    def read(text, gains):
        file.write_text(table.format(text + ("\nallow_gain = true" if gains else "")), encoding="utf-8")
        return scene.load(file).model

    def of_formulas(damping, force=None):
        return lambda **how: ss.model_from_sympy("p**2/2 + q**2/2", damping=damping, force=force, **how)

    def own(damping):
        return lambda **how: ss.Model(ndof=1, nnoise=0, gradient=lambda t, w, q, p: (w[0] * q, w[0] * p),
                                      separable=True, identity_mass=True, damping=damping, **how)  # fmt: skip

    free = ss.model_from_sympy("p**2/2 + q**2/2")
    turning = 'name = "noncommutative_oscillator"\ns1 = 0.0\ns2 = 0.0\n'
    doors = {
        "damped": lambda **how: free.damped(-0.3, **how),
        "formulas, number": of_formulas(-0.3),
        "formulas, matrix": of_formulas([[-0.3]]),
        "formulas, function": of_formulas(lambda t: -0.3 + 0 * t),
        "formulas, formula": of_formulas("-0.3 + 0*q"),
        "formulas, formula of q": of_formulas("-0.3 + q**2 - q**2*(1 + 0*t)"),
        "friction in formulas, matrix": of_formulas([[-0.4]], force="-0.1*p - q + q"),
        "own, number": own(-0.3),
        "own, matrix": own([[-0.3]]),
        "own, function": own(lambda t: -0.3 + 0 * t),
        "scene, built-in": lambda allow_gain=False: read(turning + "damping = -0.3", allow_gain),
        "scene, formula": lambda allow_gain=False: read('H = "p**2/2 + q**2/2"\ndamping = "-0.3"', allow_gain),
        "scene, numbers": lambda allow_gain=False: read('H = "p**2/2 + q**2/2"\ndamping = [-0.3]', allow_gain),
    }
    given = {"q0": 0.7, "p0": 0.3, "step": 0.005, "steps": 400, "save_every": 400, "scheme": "midpoint", "paths": 1}
    # q'' = .3 q' - q
    turn = np.sqrt(1 - 0.15**2)
    q = np.exp(0.3) * (0.7 * np.cos(2 * turn) + (0.3 - 0.15 * 0.7) / turn * np.sin(2 * turn))
    for name, door in doors.items():
        run = ss.simulate(door(allow_gain=True), **given)
        assert run.report.status == 0, name
        assert run.q[-1, 0, 0] == pytest.approx(q, abs=2e-5), name
        with pytest.raises(SymsdeError):
            assert ss.simulate(door(), **given).report.status == 0, name
    with pytest.raises(SceneError, match="allow_gain = True says that rates may be negative: give damping"):
        read(turning, gains=True)
    with pytest.raises(WrongTypeError, match="allow_gain"):
        of_formulas(-0.3)(allow_gain="yes")
    again = pickle.loads(pickle.dumps(doors["formulas, formula of q"](allow_gain=True)))
    np.testing.assert_allclose(ss.simulate(again, **given).q[-1], q, rtol=0, atol=2e-5)


def test_refusals():
    """Functions without a damped version refuse damped models with a sentence."""
    model = SYNCHROTRON.damped(RATE)
    given = {"q0": 0.7, "p0": 0.3, "step": 0.05, "steps": 4, "seed": 5}
    for scheme, why in (
        ("gauss2_strong32", "adds brackets of H"),
        ("midpoint_weak1", "draws increments for means alone"),
        ("euler_maruyama", "neither a tableau, whose coefficients decay, nor made of kicks and of flows that decay"),
    ):
        with pytest.raises(IncompatibleError, match=f"model synchrotron is damped, and scheme {scheme} .*{why}"):
            ss.simulate(model, scheme=scheme, **given)
    unequal = ss.models.noncommutative_oscillator().damped(RATE)
    assert ss.simulate(unequal, **given).report.status == 0
    pair = ss.model_from_sympy("(p1**2 + p2**2)/2 + q1*q2", noise=["0.2*q1*p2"]).damped([0.1, 0.2])
    assert ss.simulate(pair, **{**given, "scheme": "symplectic_euler"}).report.status == 0
    one_sided = ss.schemes.composition(["symplectic_euler"] * 2, [0.5, 0.5])
    with pytest.raises(IncompatibleError, match="products of gradients, which keep their form where all rates are eq"):
        ss.simulate(pair, **{**given, "scheme": one_sided})
    chain = ss.models.fpu_chain(n=20_000).damped(np.linspace(0.1, 0.2, 20_000))
    with pytest.raises(OutOfMemoryError, match=r"20000 degrees of freedom.* bytes of memory"):
        ss.simulate(chain, q0=0.1, p0=0.0, step=0.05, steps=1, seed=1, scheme="gauss2")
    run = ss.simulate(chain.damped(RATE), q0=0.1, p0=0.0, step=0.05, steps=1, seed=1, scheme="gauss2")
    assert run.report.status == 0
    linear = ss.models.kubo().damped(RATE)
    run = ss.simulate(linear, **given)
    with pytest.raises(MissingOperationError, match="flows that do not commute, and noise that is not constant"):
        ss.diagnose.exact(run)
    for refused in (ss.diagnose.action, ss.diagnose.euler_lagrange_residual):
        with pytest.raises(IncompatibleError, match="is damped"):
            refused(run)
    for bad, error, told in (
        (-1.0, InvalidArgumentError, "give rates of zero or more, or allow gain .*allow_gain=True"),
        (np.inf, InvalidArgumentError, "is not finite"),
        ([0.1, 0.2], WrongShapeError, r"damping has shape \(2,\): give a number, or \(1,\)"),
    ):
        with pytest.raises(error, match=told):
            SYNCHROTRON.damped(bad)
    assert SYNCHROTRON.damped(-0.1, allow_gain=True).damping == (-0.1,)
