# SPDX-License-Identifier: BSD-3-Clause
"""Exact paths and moments of linear equations, damped or closed. Statistical checks allow 4.9 standard errors: a false
alarm in a million.
"""

import numpy as np
import pytest
import symsde as ss
from symsde.errors import IncompatibleError, MissingOperationError, TooLargeError
from test_damping_law import FRICTION, known

CHAIN = "(p1**2 + p2**2)/2 + q1**2/2 + 2*q2**2"
STIFFNESS = np.array([[1.0, 0.0], [0.0, 4.0]])
NOISE = ["-0.7*q1 + 0.2*p2", "0.4*q2"]
PUSH = np.array([[0, 0], [0.2, 0], [0.7, 0], [0, -0.4]])
LOSSES = {"closed": None, "one": 0.8, "each": [0.8, 2.5], "matrix": FRICTION}


def model_of(loss, noise=NOISE):
    model = ss.model_from_sympy(CHAIN, noise=noise)
    return model if LOSSES[loss] is None else model.damped(LOSSES[loss])


def field_of(loss):
    rates = 0.0 if LOSSES[loss] is None else np.array(LOSSES[loss])
    return np.block([[np.zeros((2, 2)), np.eye(2)], [-STIFFNESS, -(rates if loss == "matrix" else rates * np.eye(2))]])


def moments_by_ode(field, push, z, t, steps=4000):
    """m' = A m and C' = A C + C A^T + B B^T by the classical Runge-Kutta method, whose error is below 1e-11 here."""
    h = t / steps
    c, q = np.zeros((4, 4)), push @ push.T

    def slope(x, c):
        return field @ x, field @ c + c @ field.T + q

    for _ in range(steps):
        one = slope(z, c)
        two = slope(z + h / 2 * one[0], c + h / 2 * one[1])
        three = slope(z + h / 2 * two[0], c + h / 2 * two[1])
        four = slope(z + h * three[0], c + h * three[1])
        z, c = (x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4) for x, k1, k2, k3, k4 in
                zip((z, c), one, two, three, four, strict=True))  # fmt: skip
    return z, c


@pytest.mark.parametrize("loss", LOSSES)
def test_moments_are_those_of_their_equation(loss):
    z = np.array([0.3, -0.4, 0.5, 0.2])
    found = ss.diagnose.exact_moments(model_of(loss), q0=z[:2], p0=z[2:], t=[0.0, 0.7, 2.0])
    np.testing.assert_array_equal(found.mean[0], z)
    np.testing.assert_array_equal(found.covariance[0], 0)
    for i in (1, 2):
        mean, covariance = moments_by_ode(field_of(loss), PUSH, z, found.t[i])
        np.testing.assert_allclose(found.mean[i], mean, rtol=0, atol=1e-11)
        np.testing.assert_allclose(found.covariance[i], covariance, rtol=0, atol=1e-11)


@pytest.mark.parametrize("rate", [1e-9, 0.5, 40.0])
def test_moments_of_ornstein_and_uhlenbeck(rate):
    """<p^2> = (1 - e^-2z)/(2 gamma), <q p> = (1 - e^-z)^2/(2 gamma^2), and a start with a spread, in closed forms."""
    model = ss.model_from_sympy("p**2/2", noise=["-q"], damping=rate)
    start = np.array([[0.5, 0.1], [0.1, 0.3]])
    found = ss.diagnose.exact_moments(model, q0=1.0, p0=2.0, t=1.5, covariance=start)
    lost, reach = np.exp(-1.5 * rate), -np.expm1(-1.5 * rate) / rate
    np.testing.assert_allclose(found.mean[0], [1 + 2 * reach, 2 * lost], rtol=1e-13)
    np.testing.assert_allclose(found.covariance[0, 1, 1], -np.expm1(-3 * rate) / (2 * rate) + 0.3 * lost**2, rtol=1e-12)
    np.testing.assert_allclose(found.covariance[0, 0, 1], reach**2 / 2 + lost * (0.1 + 0.3 * reach), rtol=1e-12)


@pytest.mark.parametrize("rate", [0.0, 0.6])
def test_moments_with_noise_that_depends_on_the_state(rate):
    """Kubo's oscillator with damping: (q^2, q p, p^2)' = (a R + sigma^2 R^2/2 + diag(0, -gamma, -2 gamma)) (..)."""
    model = ss.models.kubo(a=1.3, sigma=0.7)
    found = ss.diagnose.exact_moments(model.damped(rate) if rate else model, q0=1.0, p0=0.5, t=[1.1])
    turn = np.array([[0, 2, 0], [-1, 0, 1], [0, -2, 0.0]])
    generator = 1.3 * turn + 0.49 / 2 * turn @ turn + np.diag([0, -rate, -2 * rate])
    value, vector = np.linalg.eig(1.1 * generator)
    squares = (vector * np.exp(value) @ np.linalg.solve(vector, [1.0, 0.5, 0.25])).real
    second = found.covariance[0] + np.outer(found.mean[0], found.mean[0])
    np.testing.assert_allclose([second[0, 0], second[0, 1], second[1, 1]], squares, rtol=0, atol=1e-12)


@pytest.mark.parametrize("loss", LOSSES)
def test_one_long_step_has_its_law(loss):
    """Mean and covariance of 40000 exact paths after two steps of 0.8, from their own equation."""
    z = np.array([0.3, -0.4, 0.5, 0.2])
    run = ss.simulate(model_of(loss), scheme="midpoint", q0=z[:2], p0=z[2:], step=0.8, steps=2, paths=40000, seed=2)
    q, p = ss.diagnose.exact(run)
    mean, covariance = moments_by_ode(field_of(loss), PUSH, z, 1.6)
    x = np.concatenate([q[-1], p[-1]]) - mean[:, None]
    size = np.sqrt(np.diag(covariance))
    assert np.abs(x.mean(axis=1) / size).max() < 4.9 / np.sqrt(40000)
    assert np.abs((x @ x.T / 40000 - covariance) / np.outer(size, size)).max() < 4.9 * np.sqrt(2 / 40000)
    with_one_percent = (x @ x.T / 40000 - 1.05 * covariance) / np.outer(size, size)
    assert np.abs(with_one_percent).max() > 4.9 * np.sqrt(2 / 40000)


@pytest.mark.parametrize("loss", ["one", "each", "matrix"])
def test_runs_approach_the_exact_path(loss):
    """Errors against the exact path on the same draws fall by 8 where chin4a's steps are halved."""
    model = model_of(loss, ["-0.7*q1 + 0.2*q2", "0.4*q2"])
    errors = []
    for k in (3, 4, 5):
        how = {"step": 2.0 / 2**k, "steps": 2**k, "save_every": 2**k, "refine": 8 - k, "paths": 200, "seed": 5}
        run = ss.simulate(model, scheme="chin4a", q0=[0.3, -0.4], p0=[0.5, 0.2], **how)
        q, p = ss.diagnose.exact(run)
        errors.append(np.sqrt((np.concatenate([run.q[-1] - q[-1], run.p[-1] - p[-1]]) ** 2).sum(axis=0).mean()))
    slopes = np.log2(np.array(errors[:-1]) / errors[1:])
    assert (np.abs(slopes - 3) < 0.35).all(), slopes
    assert errors[-1] < 1e-4


def test_levels_and_common_noise():
    """A path is the same at (step, refine) and (step/2, refine - 1); a common noise is the same in all paths."""
    model = model_of("each")
    how = {"scheme": "gauss_dkdkd", "q0": [0.3, -0.4], "p0": [0.5, 0.2], "paths": 6, "seed": 4}
    model = model_of("each", ["-0.7*q1", "0.4*q2"])
    coarse = ss.diagnose.exact(ss.simulate(model, step=0.5, steps=4, refine=3, **how))
    fine = ss.diagnose.exact(ss.simulate(model, step=0.25, steps=8, refine=2, **how))
    np.testing.assert_array_equal(coarse[0], fine[0][::2])
    q, _ = ss.diagnose.exact(ss.simulate(model, step=0.5, steps=4, common_noise=[1, 2], **how))
    np.testing.assert_array_equal(q, np.repeat(q[:, :, :1], 6, axis=2))
    q, _ = ss.diagnose.exact(ss.simulate(model, step=0.5, steps=4, common_noise=[1], **how))
    assert np.ptp(q[-1, 0]) == 0 < np.ptp(q[-1, 1])


def test_studies_take_exact_solutions_of_damped_models():
    found = ss.convergence(model_of("each", ["-0.7*q1", "0.4*q2"]), "gauss_dkdkd", q0=[0.3, -0.4], p0=[0.5, 0.2],
                           steps=[8, 16, 32, 64], paths=200, seed=1)  # fmt: skip
    assert found.reference == "the exact solution"
    assert abs(found.order - 2) < 0.15


def test_refusals():
    how = {"q0": 0.1, "p0": 0.2, "step": 0.1, "steps": 2}
    for model, word in ((ss.models.henon_heiles().damped(0.3), "quadratic"),
                        (ss.models.kubo().damped(0.3), "do not commute, and noise that is not constant"),
                        (ss.models.linear_oscillator().damped(lambda t: 1 + t), "functions")):  # fmt: skip
        with pytest.raises(MissingOperationError, match=word):
            ss.diagnose.exact(ss.simulate(model, **how))
    free = ss.model_from_sympy("p**2/2", noise=["-q"], damping=2.0)
    with pytest.raises(IncompatibleError, match="leave damping_noise out"):
        ss.diagnose.exact(ss.simulate(free, scheme="gauss_dkdkd", damping_noise="path", **how))
    for model, error, word in (
        (ss.models.henon_heiles(), IncompatibleError, "not quadratic"),
        (ss.model_from_sympy("p**2/2 + t*q**2"), IncompatibleError, "change in time"),
        (free.damped(lambda t: 1 + t), IncompatibleError, "functions"),
        (ss.models.kubo().forced(lambda q, p, t: -q), IncompatibleError, "forces"),
        (
            ss.model_from_sympy(" + ".join(f"p{i}**2 + q{i}**2" for i in range(1, 10)), noise=["q1*p1"]),
            TooLargeError,
            "9",
        ),
    ):
        with pytest.raises(error, match=word):
            ss.diagnose.exact_moments(model, q0=0.0, p0=0.0, t=1.0)


def test_law_of_a_run_beside_exact_moments():
    """Rotations that decay give every step the exact covariance, so that moments of runs are exact_moments."""
    model = ss.model_from_sympy(CHAIN, noise=["-0.7*q1", "0.4*q2"]).damped([0.8, 2.5])
    _, exact = known(np.eye(2), np.array([1.0, 2.0]), np.diag([0.8, 2.5]), np.diag([0.7, -0.4]), 1.0)
    found = ss.diagnose.exact_moments(model, q0=0.0, p0=0.0, t=1.0)
    np.testing.assert_allclose(found.covariance[0], exact, rtol=0, atol=1e-13)


def test_a_damped_momentum_is_coloured_noise():
    """docs/is-it-for-me.md: p_2 has the law of an Ornstein-Uhlenbeck process, and is a force on p_1."""
    g, s = 2.0, 0.5
    h = "p1**2/2 + q1**2/2 - q1*p2"
    model = ss.model_from_sympy(h, noise=["-s*q2"], params={"s": s}, damping=[0.0, g])
    found = ss.diagnose.exact_moments(model, q0=0.0, p0=[0.0, 0.3], t=[0.4, 3.0])
    for i, t in enumerate((0.4, 3.0)):
        decay = np.exp(-g * t)
        turned = (g * np.cos(t) + np.sin(t) - g * decay) / (1 + g * g)  # int cos(t - r) exp(-g r) dr, r from 0 to t
        np.testing.assert_allclose(found.mean[i, 2:], [0.3 * turned, 0.3 * decay], rtol=1e-12)
        np.testing.assert_allclose(found.covariance[i, 3, 3], s * s * (1 - decay**2) / (2 * g), rtol=1e-12)
