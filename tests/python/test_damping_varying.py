# SPDX-License-Identifier: BSD-3-Clause
"""Rates of damping that are functions gamma(q, t): steps, orders, what shrinks, bits, files, refusals."""

import functools
import pickle
import warnings

import numpy as np
import pytest
import symsde as ss
from symsde.batch import scene
from symsde.errors import (
    FalseTraitError,
    IncompatibleError,
    InvalidArgumentError,
    SceneError,
    WrongShapeError,
    WrongTypeError,
)

pytestmark = pytest.mark.usefixtures("quick_compiler")

H = "(p1**2 + p2**2)/2 + cos(q1 - q2) + q1**4/4 + q2**2"
ADDITIVE = ("-0.5*q1", "-0.4*q2 + 0.1*q1")
POSITION = ("0.3*sin(q1) + 0.1*q2", "0.2*q1*q2")
#: damping as formulas, and the same as a function of NumPy
KINDS = {
    "q": ("0.8 + 0.5*sin(q1 + q2)", lambda q: 0.8 + 0.5 * np.sin(q[0] + q[1])),
    "t": ("0.8 + 0.7*sin(3*t)", lambda t: 0.8 + 0.7 * np.sin(3 * t)),
    "each q": (["1 + 0.8*sin(q1 - q2)", "0.5 + 0.4*cos(q1)"],
               lambda q: np.stack([1 + 0.8 * np.sin(q[0] - q[1]), 0.5 + 0.4 * np.cos(q[0])])),
    "each qt": (["1 + 0.8*sin(q1 + 2*t)", "0.5 + 0.4*cos(q2 - t)"],
                lambda q, t: np.stack([1 + 0.8 * np.sin(q[0] + 2 * t), 0.5 + 0.4 * np.cos(q[1] - t)])),
}  # fmt: skip
TABLEAUS = {"midpoint": 0.5, "symplectic_euler": 0.0, "symplectic_euler_adjoint": 1.0, "gauss2": 0.5, "lobatto3": 0.5}
KICKS = ("gauss_dkdkd", "verlet_kdk", "chin4a", "gauss_dkdkd_strong2", "verlet_kdk_strong2", "chin4a_strong2")
START = {"q0": [0.7, -0.2], "p0": [0.3, 0.4]}


@functools.cache
def made(kind, noise=POSITION, *, formulas=True):
    """The model with this damping."""
    texts, function = KINDS[kind]
    if formulas:
        return ss.model_from_sympy(H, noise=list(noise), damping=texts)
    return ss.model_from_sympy(H, noise=list(noise)).damped(function, each=kind.startswith("each"))


@functools.cache
def forced(kind, noise):
    """The same equation with a force."""
    texts = KINDS[kind][0] if kind.startswith("each") else [KINDS[kind][0]] * 2
    return ss.model_from_sympy(H, noise=list(noise), force=[f"-({x})*p{i + 1}" for i, x in enumerate(texts)])


def gamma(kind, q, t):
    """The rates gamma_i(q, t), (dof, lane)."""
    function = KINDS[kind][1]
    found = function(*({"q": q, "t": t}[x] for x in function.__code__.co_varnames))
    return np.broadcast_to(found, q.shape)


def decayed(kind, x, t, tau, factor=1.0):
    """p after a decay at the position q over the time tau from t on; the rate is integrated by twelve nodes of
    Gauss.
    """
    nodes, weights = np.polynomial.legendre.leggauss(12)
    q, p = x
    total = sum(w / 2 * gamma(kind, q, t + tau * (x + 1) / 2) for x, w in zip(nodes, weights, strict=True))
    return np.exp(-factor * tau * total) * p


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("scheme", TABLEAUS)
@pytest.mark.parametrize("step", [0.1, -0.1])
def test_tableaus_stand_between_decays(kind, scheme, step):
    """Every step is that of the closed system between exp(-G(q_n)) and exp(-G(q_n+1)); a rate larger by 1 % shows."""
    model = made(kind)
    closed = ss.model_from_sympy(H, noise=list(POSITION))
    c, dw = TABLEAUS[scheme], np.random.default_rng(1).normal(size=(1, 2, 5)) * np.sqrt(0.1)
    q, p, t = np.array([[0.7], [-0.2]]) + np.zeros(5), np.array([[0.3], [0.4]]) + np.zeros(5), 0.3
    how = {"scheme": scheme, "step": step, "steps": 1, "t0": t, "paths": 5, "increments": dw}
    run = ss.simulate(model, q0=q, p0=p, **how)
    for factor in (1.0, 1.01):
        inner = ss.simulate(closed, q0=q, p0=decayed(kind, (q, p), t, c * step, factor), **how)
        end = decayed(kind, (inner.q[-1], inner.p[-1]), t + c * step, (1 - c) * step, factor)
        difference = max(np.abs(run.q[-1] - inner.q[-1]).max(), np.abs(run.p[-1] - end).max())
        # the difference left is the error of three nodes of Gauss, gamma^(6) h^7/2016000
        assert difference < 1e-9 if factor == 1.0 else difference > 1e-5, (factor, difference)


@pytest.mark.parametrize("kind", ["q", "each q", "each qt"])
@pytest.mark.parametrize("step", [0.1, -0.1])
def test_kicks_stand_between_drifts_with_decay(kind, step):
    """verlet_kdk without noise by hand: kick, decay, drift, decay, kick."""
    model = made(kind, ())
    q, p, t = np.array([[0.7, 0.1], [-0.2, 0.4]]), np.array([[0.3, -0.2], [0.4, 0.5]]), 0.3
    run = ss.simulate(model, scheme="verlet_kdk", q0=q, p0=p, t0=t, step=step, steps=1, paths=2)
    for factor in (1.0, 1.01):
        y = p - step / 2 * model.gradient(q, p)[0]
        y = decayed(kind, (q, y), t, step / 2, factor)
        x = q + step * y
        y = decayed(kind, (x, y), t + step / 2, step / 2, factor)
        y = y - step / 2 * model.gradient(x, y)[0]
        difference = max(np.abs(run.q[-1] - x).max(), np.abs(run.p[-1] - y).max())
        assert difference < 1e-9 if factor == 1.0 else difference > 1e-5, (factor, difference)


@pytest.mark.parametrize("rate", [1e-12, 1e-3, 1.0, 400.0])
@pytest.mark.parametrize("step", [0.1, -0.1])
@pytest.mark.parametrize("scheme", ["midpoint", "symplectic_euler", "gauss_dkdkd", "verlet_kdk", "chin4a"])
def test_a_constant_function_is_a_number(rate, step, scheme):
    """gamma h from 1e-13 to 40, as a function of time that is constant; kicks then have no law of free motion, so the
    model has no noise."""
    if step * rate < -30:
        pytest.skip("momenta grow by exp(40) in each step")
    closed = ss.model_from_sympy(H, noise=[])
    one = closed.damped(rate)
    two = closed.damped(lambda t: rate + 0 * t)
    runs = [ss.simulate(x, scheme=scheme, step=step, steps=5, **START) for x in (one, two)]
    np.testing.assert_allclose(runs[0].q, runs[1].q, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(runs[0].p, runs[1].p, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("change", [0.5, 3.0])
@pytest.mark.parametrize("mean", [1e-9, 1.0, 40.0])
def test_a_drift_with_a_rate_in_time(mean, change):
    """Free motion, gamma = mean (1 + change t), against a sum over a million times: q moves by int exp(-G) p."""
    model = ss.model_from_sympy("p**2/2", params={"g": mean, "c": change}, damping="g*(1 + c*t)")
    h = 0.25
    run = ss.simulate(model, scheme="verlet_kdk", q0=0.0, p0=1.0, step=h, steps=1)
    s = (np.arange(2**20) + 0.5) * h / 2**20
    reach = np.exp(-mean * (s + change * s**2 / 2)).mean() * h
    # errors of Gauss' nodes fall as h^7, and are large where gamma h grows from 10 to 17 in a step
    room = 1e-11 if mean < 1 else 2e-6 if mean == 1 else 0.1
    assert run.q[-1, 0, 0] == pytest.approx(reach, rel=room)
    assert run.p[-1, 0, 0] == pytest.approx(np.exp(-mean * (h + change * h**2 / 2)), rel=1e-13)


def ends(model, scheme, power, finest):
    """States at time one after 2^power steps on paths that are the same for every power."""
    steps = 2**power
    run = ss.simulate(model, scheme=scheme, q0=[0.7, -0.2], p0=0.3, step=1 / steps, steps=steps, seed=3,
                      save_every=steps, paths=40, refine=finest - power)  # fmt: skip
    return np.concatenate([run.q[-1], run.p[-1]])


def rms(x):
    return np.sqrt(np.mean(np.sum(x**2, axis=0)))


@pytest.mark.parametrize("kind", ["q", "each qt"])
def test_the_equation_is_that_of_the_force(kind):
    """Kicks with 2^7 steps agree with heun for the force -gamma p with 2^11 steps, to heun's error of order one."""
    model = made(kind)
    kicked = ends(model, "chin4a_strong2", 7, 11)
    assert rms(ends(forced(kind, POSITION), "heun", 11, 11) - kicked) < 3e-4
    wrong = ends(model.damped([0.8, 0.6]), "chin4a_strong2", 8, 12)
    assert rms(wrong - kicked) > 3e-3


@pytest.mark.parametrize("noise", ["additive", "position"])
def test_strong_orders_in_time_against_the_clock(noise):
    """gamma(t): (q, P = exp(G) p) is a closed system, which gauss2_strong32 runs with 2^10 steps."""
    rate, total = "(0.8 + 0.7*sin(3*t))", "(0.8*t + 0.7/3*(1 - cos(3*t)))"
    terms = ADDITIVE if noise == "additive" else POSITION
    clock = f"exp(-{total})*(p1**2 + p2**2)/2 + exp({total})*(cos(q1 - q2) + q1**4/4 + q2**2)"
    closed = ss.model_from_sympy(clock, noise=[f"exp({total})*({x})" for x in terms])
    model = ss.model_from_sympy(H, noise=list(terms), damping=rate)
    end = ends(closed, "gauss2_strong32", 10, 10)
    end[2:] *= np.exp(-(0.8 + 0.7 / 3 * (1 - np.cos(3.0))))
    orders = {"midpoint": 1, "gauss2": 1, "stormer_verlet": 1, "gauss_dkdkd": 1.5, "verlet_kdk": 1.5,
              "gauss_dkdkd_strong2": 2, "chin4a_strong2": 2}  # fmt: skip
    for scheme, order in orders.items():
        coarse, fine = (rms(ends(model, scheme, power, 10) - end) for power in (2, 4))
        assert np.log2(coarse / fine) / 2 > order - 0.2, scheme
        assert fine < 0.05


@pytest.mark.parametrize("kind", ["each q"])
def test_noise_in_momenta_and_areas(kind):
    """For noises in q and p that do not commute midpoint_areas has order one; for one noise in both the corrected
    Euler pair has, too.
    """

    def end(model, scheme, power):
        run = ss.simulate(model, scheme=scheme, q0=[0.7, -0.2], p0=0.3, step=1 / 2**power, steps=2**power, seed=3,
                          save_every=2**power, paths=40, refine=8 - power)  # fmt: skip
        return np.concatenate([run.q[-1], run.p[-1]])

    noises = ("0.3*p1*q2", "0.2*q1**2 + 0.1*p2")
    reference = end(forced(kind, noises), "midpoint_areas", 8)
    coarse, fine = (rms(end(made(kind, noises), "midpoint_areas", power) - reference) for power in (2, 5))
    assert np.log2(coarse / fine) / 3 > 0.85
    noises = ("0.3*p1*q2 + 0.2*q1**2",)
    reference = end(forced(kind, noises), "midpoint", 8)
    for scheme in ("symplectic_euler", "symplectic_euler_adjoint"):
        coarse, fine = (rms(end(made(kind, noises), scheme, power) - reference) for power in (2, 5))
        assert np.log2(coarse / fine) / 3 > 0.85, scheme


@pytest.mark.parametrize("scheme", ["midpoint", "gauss3", "stormer_verlet", "gauss_dkdkd", "chin4a"])
@pytest.mark.parametrize("step", [0.2, -0.2])
def test_the_form_shrinks_by_one_factor_in_time(scheme, step):
    """gamma(t): dp ^ dq falls by exp(-int gamma dt), up to the rest of Gauss' nodes and of differences."""
    model = made("t", ())
    defect = ss.diagnose.symplecticity(model, scheme, q=[0.7, 0.2], p=[0.1, 0.3], step=step, t=0.3)
    assert defect.max() < 1e-8
    wrong = ss.model_from_sympy(H, damping="1.01*(0.8 + 0.7*sin(3*t))")
    other = ss.diagnose.symplecticity(wrong, scheme, q=[0.7, 0.2], p=[0.1, 0.3], step=step, t=0.3)
    assert other.max() < 1e-8
    with pytest.raises(IncompatibleError, match="is damped"):
        ss.diagnose.symplecticity(made("q", ()), scheme, q=[0.7, 0.2], p=[0.1, 0.3], step=step)


@pytest.mark.parametrize("scheme", ["midpoint", "gauss2", "symplectic_euler", "gauss_dkdkd", "verlet_kdk", "chin4a"])
@pytest.mark.parametrize("kind", ["q", "each q"])
def test_volume_shrinks_by_the_rates_on_the_path(scheme, kind):
    """log det of a step is minus the sum of gamma_i(q) times the durations, at the positions where momenta decay."""
    model, h, e = made(kind, ()), 0.2, 1e-5
    x = np.array([0.7, -0.2, 0.3, 0.4])
    ends = x[:, None] + e * np.concatenate([np.eye(4), -np.eye(4), np.zeros((4, 4))], axis=1)

    def stepped(given, where=model):
        run = ss.simulate(where, scheme=scheme, q0=given[:2], p0=given[2:], step=h, steps=1, paths=given.shape[1])
        return np.concatenate([run.q[-1], run.p[-1]])

    moved = stepped(ends)
    det = np.linalg.det((moved[:, :4] - moved[:, 4:8]) / (2 * e))
    c = TABLEAUS.get(scheme)
    sums = {"gauss_dkdkd": (0.5 - np.sqrt(3) / 6, np.sqrt(3) / 3), "chin4a": (0.5, 0.5)}
    first, last = gamma(kind, x[:2, None], 0).sum(), gamma(kind, moved[:2, 8:9], 0).sum()
    if c is not None or scheme == "verlet_kdk":
        c = 0.5 if c is None else c
        assert np.log(det) == pytest.approx(-h * (c * first + (1 - c) * last), abs=1e-8)
    else:  # inner drifts end between both positions
        assert len(sums[scheme]) == 2
        assert np.log(det) == pytest.approx(-h * (first + last) / 2, rel=0.05)
        assert np.log(det) < -0.1


@pytest.mark.parametrize("scheme", ["midpoint", "gauss2", "verlet_kdk", "gauss_dkdkd", "chin4a"])
@pytest.mark.parametrize("kind", KINDS)
def test_symmetric_steps_are_taken_back(scheme, kind):
    """A step of h and one of -h with the same increments end where they began."""
    model, dw = made(kind), np.random.default_rng(2).normal(size=(1, 2, 3)) * 0.3
    increments = dw if scheme in TABLEAUS else None
    model = model if increments is not None else made(kind, ())
    how = {"scheme": scheme, "steps": 1, "paths": 3}
    there = ss.simulate(model, step=0.1, q0=[0.7, -0.2], p0=[0.3, 0.4],
                        **({"increments": dw} if increments is not None else {}), **how)  # fmt: skip
    back = ss.simulate(model, step=-0.1, t0=0.1, q0=there.q[-1], p0=there.p[-1],
                       **({"increments": -dw} if increments is not None else {}), **how)  # fmt: skip
    assert np.abs(back.q[-1] - there.q[0]).max() < 1e-12
    assert np.abs(back.p[-1] - there.p[0]).max() < 1e-12


@pytest.mark.parametrize("formulas", [True, False])
@pytest.mark.parametrize("scheme", ["midpoint", "gauss2", "gauss_dkdkd", "chin4a_strong2"])
@pytest.mark.parametrize("kind", ["t", "each qt"])
def test_a_path_has_its_bits(kind, scheme, formulas):
    """A path has the same bits in a block, alone, in other blocks and in a run that goes on."""
    model = made(kind, formulas=formulas)
    how = {"scheme": scheme, "step": 0.1, "steps": 6, "seed": 4, **START}
    run = ss.simulate(model, paths=37, **how)
    one = ss.simulate(model, paths=1, first_path=5, **how)
    np.testing.assert_array_equal(one.q[:, :, 0], run.q[:, :, 5])
    np.testing.assert_array_equal(one.p[:, :, 0], run.p[:, :, 5])
    few = ss.simulate(model, paths=37, threads=2, lanes=8, **how)
    np.testing.assert_array_equal(few.p, run.p)
    half = ss.simulate(model, paths=37, **{**how, "steps": 3})
    rest = ss.simulate(model, paths=37, first_step=3, **{**how, "steps": 3, "q0": half.q[-1],
                                                                   "p0": half.p[-1]})  # fmt: skip
    np.testing.assert_allclose(rest.p[-1], run.p[-1], rtol=1e-14, atol=1e-15)


@pytest.mark.parametrize("kind", KINDS)
def test_formulas_are_functions(kind):
    """Formulas, with a compiler and without, and functions of Python give the same paths to rounding."""
    for scheme in ("midpoint", "gauss_dkdkd"):
        how = {"scheme": scheme, "step": 0.1, "steps": 20, "seed": 4, "paths": 9, **START}
        by_formulas, by_function = (ss.simulate(made(kind, formulas=x), **how) for x in (True, False))
        np.testing.assert_allclose(by_formulas.p, by_function.p, rtol=0, atol=1e-13)


def test_formulas_follow_parameters_and_pickles():
    """g in damping is a parameter as any other; constants in formulas are numbers; new damping replaces the old one."""
    given = {"params": {"s": 0.3, "g": 0.7}, "noise": ["s*q"]}
    model = ss.model_from_sympy("p**2/2 + q**4/4", damping="g*(1 + q**2)", **given)
    how = {"scheme": "midpoint", "q0": 0.5, "p0": 0.3, "step": 0.1, "steps": 20, "seed": 1}

    def p(model):
        return ss.simulate(model, **how).p

    other = model.with_parameters(g=1.4)
    again = ss.model_from_sympy("p**2/2 + q**4/4", damping="2*g*(1 + q**2)", **given)
    np.testing.assert_allclose(p(other), p(again), rtol=0, atol=1e-14)
    np.testing.assert_array_equal(p(pickle.loads(pickle.dumps(other))), p(other))
    assert "damping=g*(1 + q**2)" in repr(other)
    constant = ss.model_from_sympy("p**2/2 + q**4/4", damping="2*g", **given)
    assert constant.damping == (1.4,)
    assert constant.with_parameters(g=1.0).damping == (2.0,)
    assert pickle.loads(pickle.dumps(constant)).with_parameters(g=0.5).damping == (1.0,)
    none = constant.with_parameters(g=0.0)
    assert none.damping == () and none.damped(0).with_parameters(g=0.5).damping == ()
    for x in (none, pickle.loads(pickle.dumps(none))):
        assert x.with_parameters(g=0.5).damping == (1.0,)
    assert model.damped(0.3).damping == (0.3,)
    assert model.damped(0).damping == ()
    assert model.damped(0.3).with_parameters(g=9.0).damping == (0.3,)
    braked = model.damped("1 + q**2").with_parameters(s=0.2)
    np.testing.assert_allclose(p(braked), p(model.with_parameters(s=0.2, g=1.0)), rtol=0, atol=1e-14)
    forced = ss.model_from_sympy("p**2/2 + q**4/4", force="-0.3*p", damping="1 + q**2")
    together = ss.model_from_sympy("p**2/2 + q**4/4", damping="1.3 + q**2")
    for x in (forced, ss.model_from_sympy("p**2/2 + q**4/4", force="-0.3*p").damped("1 + q**2"),
              pickle.loads(pickle.dumps(forced))):  # fmt: skip
        assert np.abs(p(x) - p(together)).max() < 1e-3  # the force stands in the tableau, with an error of order two
        assert np.abs(p(x) - p(ss.model_from_sympy("p**2/2 + q**4/4", damping="1 + q**2"))).max() > 1e-2


def _halved(q):
    """A function that pickle finds by its name."""
    return 0.5 * (1 + q[0] ** 2)


def test_functions_for_every_model():
    """Built-in models and models of functions; pickles of functions with names; gain where it is allowed."""
    pendulum = ss.models.pendulum(sigma=0.2)
    how = {"scheme": "midpoint", "q0": 0.5, "p0": 0.3, "step": 0.1, "steps": 20, "seed": 1}
    run = ss.simulate(pendulum.damped(_halved), **how)
    again = ss.simulate(pickle.loads(pickle.dumps(pendulum.damped(_halved))), **how)
    np.testing.assert_array_equal(run.p, again.p)
    assert "gamma(q) p dt, so that dp^dq shrinks by a factor that depends on the path" in run.report.damping
    mine = ss.Model(ndof=1, nnoise=0, gradient=lambda t, w, q, p: (w[0] * np.sin(q), w[0] * p), separable=True,
                    identity_mass=True, damping=lambda q, t: 0.1 + q[0] ** 2 + 0 * t)  # fmt: skip
    assert ss.simulate(mine, scheme="chin4a", q0=0.5, p0=0.3, step=0.1, steps=20).report.status == 0
    # van der Pol's oscillator has a limit cycle of amplitude two
    pol = ss.model_from_sympy("p**2/2 + q**2/2").damped("-0.5*(1 - q**2)", allow_gain=True)
    cycle = ss.simulate(pol, scheme="gauss_dkdkd", q0=0.1, p0=0.0, step=0.05, steps=2000)
    assert np.abs(cycle.q[-200:]).max() == pytest.approx(2.0, abs=0.02)
    assert "dp^dq changes by a factor that depends on the path" in cycle.report.damping


def test_scenes_and_folders(tmp_path):
    """A scene with formulas of damping, whose parameters are those of the model; a folder notices another function."""
    text = """
[model]
H = "p**2/2 + q**4/4"
noise = ["s*q"]
damping = "g*(1 + q**2)"
[model.params]
s = 0.3
g = 0.7
[run]
scheme = "midpoint"
step = 0.1
steps = 10
q0 = 0.5
p0 = 0.3
paths = 4
"""
    file = tmp_path / "scene.toml"
    file.write_text(text)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model = scene.load(file).setup.model if hasattr(scene.load(file), "setup") else scene.load(file).model
    assert model.damping.told() == ["g*(1 + q**2)"]
    file.write_text(text.replace("g*(1 + q**2)", "g*p"))
    with pytest.raises(SceneError, match="holds a momentum"):
        scene.load(file)


def test_refusals():
    """Each refusal has a sentence."""
    well = ss.model_from_sympy("p**2/2 + q**4/4", noise=["0.1*q**2"], params={"g": 0.7}, damping="g + q**2")
    run = {"q0": 0.5, "p0": 0.3, "step": 0.1, "steps": 5}
    with pytest.raises(InvalidArgumentError, match="holds a momentum: rates depend on q and t alone"):
        well.damped("q*p")
    with pytest.raises(WrongShapeError, match="2 formulas for 1 degrees of freedom"):
        well.damped(["1", "q"])
    with pytest.raises(WrongShapeError, match="a matrix holds numbers"):
        well.damped([["q"]])
    with pytest.raises(InvalidArgumentError, match=r"negative rate -1\.25"):
        ss.simulate(well.damped("-1 - q**2"), scheme="midpoint", **run)
    with pytest.raises(InvalidArgumentError, match="a rate of damping is negative"):
        ss.model_from_sympy("p**2/2", params={"g": 0.7}, damping="-g")
    with pytest.raises(WrongTypeError, match="is a text: formulas are for models from formulas"):
        ss.models.pendulum().damped("1 + q**2")
    with pytest.raises(WrongTypeError, match=r"a function of \(x\): give a function of \(q, t\)"):
        ss.models.pendulum().damped(lambda x: x)
    with pytest.raises(WrongShapeError, match="need each=True"):
        ss.simulate(ss.models.pendulum().damped(lambda q: np.ones((3, 1))), scheme="midpoint", **run)
    with pytest.raises(ZeroDivisionError):
        ss.simulate(ss.models.pendulum().damped(lambda q: 1 / 0), scheme="midpoint", **run)
    with pytest.raises(FalseTraitError, match="mixes lanes"):
        ss.simulate(ss.models.pendulum().damped(lambda q: 1 + q[0].mean() + 0 * q[0]), scheme="midpoint", **run)
    with pytest.raises(IncompatibleError, match="adds brackets of H"):
        ss.simulate(well, scheme="gauss2_strong32", **run)
    with pytest.raises(InvalidArgumentError, match="n sites take no formulas of damping"):
        ss.model_from_sympy("Sum(p[i]**2/2 + q[i]**2/2, i)", n=4, damping="q1**2")
    with pytest.raises(IncompatibleError, match="growth in a step is known for numbers"):
        ss.mean_square(ss.model_from_sympy("p**2/2 + q**2/2", damping="1 + sin(t)"), step=0.1)
    with pytest.raises(IncompatibleError, match="the rates of damping of model"):
        ss.thermostat(ss.model_from_sympy("p**2/2 + q**2/2", noise=["q"], damping="1 + q**2"), beta=1.0)
    # a path fails where its rate becomes negative
    falls = ss.model_from_sympy("p**2/2", damping="1 - q")
    status = ss.simulate(falls, scheme="midpoint", q0=0.5, p0=5.0, step=0.1, steps=20).status
    assert status[0] == 3
