# SPDX-License-Identifier: BSD-3-Clause
"""The law of the noise of linear damped drifts: unequal rates, matrices of friction, and rotations that decay."""

import mpmath
import numpy as np
import pytest
import symsde as ss
from symsde.errors import IncompatibleError

pytestmark = pytest.mark.filterwarnings("ignore::symsde.errors.DoubtfulRunWarning")

EYE, ZERO = np.eye(2), np.zeros((2, 2))
FRICTION = np.array([[0.9, -0.5], [-0.5, 1.6]])
INVERSE = np.array([[1.0, 0.4], [0.4, 0.5]])
APART = ["-q1", "-0.5*q2"]
SHARED = ["-q1 - 0.3*q2", "-0.5*q2"]
PUSH = {"apart": np.array([[1.0, 0.0], [0.0, 0.5]]), "shared": np.array([[1.0, 0.0], [0.3, 0.5]])}
NOISE = {"apart": APART, "shared": SHARED}
RATES = np.array([0.8, 0.3])
OMEGA = np.array([1.0, 2.0])
#: H, its M^-1 and frequencies, the damping, and p' = .. - loss p
DRIFTS = {
    "rates": ("(p1**2 + p2**2)/2", EYE, 0 * OMEGA, RATES, np.diag(RATES)),
    "masses": ("p1**2/2 + p2**2/6", np.diag([1, 1 / 3]), 0 * OMEGA, RATES, np.diag(RATES)),
    "matrix": ("p1**2/2 + 0.4*p1*p2 + 0.25*p2**2", INVERSE, 0 * OMEGA, FRICTION, FRICTION @ INVERSE),
    "springs": ("(p1**2 + p2**2)/2 + q1**2/2 + 2*q2**2", EYE, OMEGA, RATES, np.diag(RATES)),
    "springs, one rate": ("(p1**2 + p2**2)/2 + q1**2/2 + 2*q2**2", EYE, OMEGA, 0.8, 0.8 * EYE),
    "coupled springs": ("(p1**2 + p2**2)/2 + q1**2/2 + 2*q2**2", EYE, OMEGA, FRICTION, FRICTION),
}
KICKS = ("gauss_dkdkd", "verlet_kdk", "chin4a", "chin4a_strong2")
CASES = [(drift, x) for drift in DRIFTS for x in (("gauss_dkdkd_rotation",) if "springs" in drift else KICKS)]
CASES += [("rates", "verlet_dz")]


def known(mass, omega, loss, push, step):
    """exp(h M) and the covariance of int exp(u M) b dW of a damped drift without products of q and p."""
    return law_of(np.block([[ZERO, mass], [-np.diag(omega**2), -loss]]), push, step)


def law_of(drift, push, step):
    """exp(h M) and the covariance of int exp(u M) b dW, by the exponential of a block matrix in 80 digits."""
    noise = np.vstack([ZERO, push])
    blocks = mpmath.matrix(np.block([[-drift, noise @ noise.T], [np.zeros((4, 4)), drift.T]]).tolist())
    with mpmath.workdps(80):
        found = mpmath.expm(blocks * mpmath.mpf(step), method="pade")
        flow = found[4:, 4:].T
        covariance = flow * found[:4, 4:]
    return np.array(flow.tolist(), float), np.array(covariance.tolist(), float) * np.sign(step)


def step_of(model, scheme, step, functionals, **options):
    """A step as a linear map: x <- flow x + noise (dW, a, K); noise (4, noise, functional)."""
    unit = np.eye(2 * functionals).reshape(functionals, 2, 2 * functionals)  # (functional, noise, path)
    rows = unit.copy()
    rows[1] = step * (unit[0] / 2 + unit[1])  # dZ
    rows = np.concatenate([rows.reshape(2 * functionals, -1), np.zeros((2 * functionals, 4))], axis=1)
    x = np.concatenate([np.zeros((4, 2 * functionals)), np.eye(4)], axis=1)
    run = ss.simulate(model, scheme=scheme, q0=x[:2], p0=x[2:], step=step, steps=1, paths=x.shape[1],
                      increments=rows[np.newaxis], **options)  # fmt: skip
    found = np.concatenate([run.q[-1], run.p[-1]])
    return found[:, 2 * functionals :], found[:, : 2 * functionals].reshape(4, functionals, 2).transpose(0, 2, 1)


def covariance_of(noise, step):
    variance = abs(step) / np.array([1, 12, 720])[: noise.shape[2]]
    return np.einsum("ikr,r,jkr->ij", noise, variance, noise)


@pytest.mark.parametrize("push", PUSH)
@pytest.mark.parametrize("factor", [1e-11, 1.0, 25.0])
@pytest.mark.parametrize(("drift", "scheme"), CASES)
def test_noise_of_a_step_has_its_law(drift, scheme, factor, push):
    """Covariances of the noise of a step, from gamma h = 3e-13 to 40, relative to the standard deviations; also back in
    time. A strength or a rate that is 1 % off is seen, and so are the weights of the closed system.
    """
    h_text, mass, omega, damping, loss = DRIFTS[drift]
    model = ss.model_from_sympy(h_text, noise=NOISE[push])
    functionals = 3 if "chin" in scheme else 2
    for step in (0.1, 1.0, -0.1):
        if step * factor > 25:
            continue
        damped = model.damped(factor * np.array(damping))
        flow, exact = known(mass, omega, factor * loss, PUSH[push], step)
        found, noise = step_of(damped, scheme, step, functionals)
        size = np.sqrt(np.diag(exact))
        errors = (covariance_of(noise, step) - exact) / np.outer(size, size)
        assert np.abs(errors).max() < 1e-13, step
        if drift.startswith("springs"):
            np.testing.assert_allclose(found, flow, rtol=0, atol=1e-13 * np.abs(flow).max())
        if factor == 1.0:
            _, other = known(mass, omega, 1.01 * loss, PUSH[push], step)
            assert np.abs((covariance_of(noise, step) - other) / np.outer(size, size)).max() > 1e-5
            _, plain = step_of(damped, scheme, step, functionals, damping_noise="polynomial")
            assert np.abs((covariance_of(plain, step) - exact) / np.outer(size, size)).max() > 1e-6


@pytest.mark.parametrize("push", PUSH)
@pytest.mark.parametrize("scheme", ["gauss_dkdkd", "verlet_kdk", "chin4a"])
@pytest.mark.parametrize("step", [0.1, 0.5, -0.1])
def test_noise_between_flows_of_a_quadratic_part_has_its_law(scheme, step, push):
    """A charge in a field and a spring, split=: the flow and the covariances of the noise of a damped step; rates or a
    strength that are 1 % off are seen, and so are the weights of the closed system.
    """
    text = "((p1 + q2)**2 + (p2 - q1)**2)/2 + q1**2/2 + 0.3*q1*q2 + 0.4*q2**2"
    second = np.array([[2.0, 0.3, 0, -1], [0.3, 1.8, 1, 0], [0, 1, 1, 0], [-1, 0, 0, 1]])
    model = ss.model_from_sympy(text, noise=NOISE[push], split=text).damped(RATES)
    loss = np.diag([0, 0, *RATES])
    field = np.vstack([second[2:], -second[:2]])
    flow, exact = law_of(field - loss, PUSH[push], step)
    functionals = 3 if scheme == "chin4a" else 2
    found, noise = step_of(model, scheme, step, functionals)
    np.testing.assert_allclose(found, flow, rtol=0, atol=1e-13)
    scale = np.outer(*2 * [np.sqrt(np.diag(exact))])
    assert np.abs((covariance_of(noise, step) - exact) / scale).max() < 1e-13
    _, other = law_of(field - 1.01 * loss, PUSH[push], step)
    assert np.abs((covariance_of(noise, step) - other) / scale).max() > 1e-5
    assert np.abs((covariance_of(1.01 * noise, step) - exact) / scale).max() > 1e-2
    _, plain = step_of(model, scheme, step, functionals, damping_noise="polynomial")
    assert np.abs((covariance_of(plain, step) - exact) / scale).max() > 1e-7


@pytest.mark.parametrize("scheme", ["gauss_dkdkd", "verlet_kdk", "chin4a"])
def test_momentum_that_friction_takes_is_that_of_the_path(scheme):
    """p + gamma q receives dW itself, as with one rate; equal rates beside a third have the law of one rate."""
    model = ss.model_from_sympy("(p1**2 + p2**2)/2", noise=APART)
    functionals = 3 if scheme == "chin4a" else 2
    for rates in ([0.8, 0.3], [1e-9, 5.0], [30.0, 2.0]):
        _, noise = step_of(model.damped(rates), scheme, 1.0, functionals)
        received = noise[2:] + np.array(rates)[:, None, None] * noise[:2]
        dw = np.concatenate([PUSH["apart"][:, :, None], np.zeros((2, 2, functionals - 1))], axis=2)
        np.testing.assert_allclose(received, dw, rtol=0, atol=1e-13)
        if scheme != "chin4a":
            _, alone = step_of(model.damped(rates[0]), scheme, 1.0, functionals)
            np.testing.assert_allclose(noise[::2, 0], alone[::2, 0], rtol=0, atol=1e-12)


def test_what_comes_to_rest_has_the_law_of_the_bath():
    """sigma sigma^T = 2 Gamma/beta and H = |p|^2/2 + (q1^2 + 4 q2^2)/2: rotations come to <q_i^2> = 1/omega_i^2 and
    <p_i^2> = 1 for every step, by the equation S = F S F^T + C of the steps' own F and C.
    """
    root = np.linalg.cholesky(2 * FRICTION)
    noise = [f"-({root[0, k]!r}*q1 + {root[1, k]!r}*q2)".replace("np.float64", "") for k in range(2)]
    model = ss.model_from_sympy(DRIFTS["coupled springs"][0], noise=noise)
    for factor, step in ((1.0, 0.5), (1.0, 4.0), (1e-3, 0.5)):
        matrix = factor * FRICTION
        scaled = ss.model_from_sympy(
            DRIFTS["coupled springs"][0], noise=[f"{np.sqrt(factor)!r}*({x})".replace("np.float64", "") for x in noise]
        )
        flow, found = step_of((model if factor == 1.0 else scaled).damped(matrix), "gauss_dkdkd_rotation", step, 2)
        left = np.eye(16) - np.kron(flow, flow)
        rest = np.linalg.solve(left, covariance_of(found, step).ravel()).reshape(4, 4)
        np.testing.assert_allclose(rest, np.diag([1, 1 / 4, 1, 1]), rtol=0, atol=1e-12)


def test_laws_of_more_dimensions_than_normals():
    """One noise that pushes two momenta of unequal rates has three dimensions: dW and dZ are not enough, and the
    weights of the closed system stay; with K, too (law3), the law is exact.
    """
    model = ss.model_from_sympy("(p1**2 + p2**2)/2", noise=["-q1 - 0.5*q2", "0*q1"]).damped([2.0, 0.3])
    _, exact = known(EYE, 0 * OMEGA, np.diag([2.0, 0.3]), np.array([[1.0, 0.0], [0.5, 0.0]]), 1.0)
    _, plain = step_of(model, "gauss_dkdkd", 1.0, 2)
    _, polynomial = step_of(model, "gauss_dkdkd", 1.0, 2, damping_noise="polynomial")
    np.testing.assert_array_equal(plain, polynomial)
    _, noise = step_of(model, "gauss_dkdkd", 1.0, 3, damping_noise="law3")
    np.testing.assert_allclose(covariance_of(noise, 1.0), exact, rtol=0, atol=1e-13)


def test_the_law_of_two_functionals_takes_no_third():
    """law2 leaves nothing of K, which kicks of chin4a follow."""
    model = ss.model_from_sympy("(p1**2 + p2**2)/2", noise=["-q1", "-0.5*q2"]).damped([2.0, 0.3])
    _, exact = known(EYE, 0 * OMEGA, np.diag([2.0, 0.3]), np.diag([1.0, 0.5]), 1.0)
    _, noise = step_of(model, "chin4a", 1.0, 3, damping_noise="law2")
    np.testing.assert_allclose(covariance_of(noise, 1.0), exact, rtol=0, atol=1e-13)
    np.testing.assert_allclose(noise[..., 2], 0, rtol=0, atol=1e-14)


@pytest.mark.parametrize("ratio", [0.3, 1 / 3, 1.1])
@pytest.mark.filterwarnings("ignore:gamma")
def test_noises_that_push_alike_are_one(ratio):
    """Two noises have as many normals as one where one is a multiple of the other: what cancels in them moves nothing,
    and rounding is not taken for the direction of a further normal."""
    push = {"a": 0.7, "b": 0.37, "c": 0.7 * ratio, "d": 0.37 * ratio}
    model = ss.model_from_sympy("(p1**2 + p2**2)/2", ["-a*q1 - b*q2", "-c*q1 - d*q2"], params=push).damped([2.0, 0.5])
    opposite = np.array([[ratio, -1.0, ratio / 2, -0.5]])
    run = ss.simulate(model, scheme="gauss_dkdkd", q0=0.0, p0=0.0, step=1.0, steps=1, increments=opposite)
    np.testing.assert_allclose([run.q[-1], run.p[-1]], 0, rtol=0, atol=1e-14)


def test_paths_are_those_of_blocks():
    """One path has the bits of a path among many; law3 asks for K. Refused: the path's own noise, for which there is no
    rule of merging.
    """
    model = ss.model_from_sympy("(p1**2 + p2**2)/2 + q1**4/4 + cos(q1 - q2)", noise=SHARED).damped([2.0, 0.3])
    how = {"scheme": "gauss_dkdkd", "q0": 0.3, "p0": 0.1, "step": 0.25, "steps": 4, "seed": 3}
    many = ss.simulate(model, paths=40, refine=3, **how)
    one = ss.simulate(model, paths=1, first_path=7, refine=3, **how)
    np.testing.assert_array_equal(one.q[:, :, 0], many.q[:, :, 7])
    assert "K" in ss.simulate(model, damping_noise="law3", **how).report.functionals
    with pytest.raises(IncompatibleError, match="merges for kicks between free drifts with one rate alone"):
        ss.simulate(model, damping_noise="path", **how)


def test_noise_that_changes_keeps_the_weights_of_the_closed_system():
    """A strength that depends on time has no law for all steps."""
    model = ss.model_from_sympy("(p1**2 + p2**2)/2", noise=["-(1 + t)*q1", "-q2"]).damped([2.0, 0.3])
    how = {"scheme": "gauss_dkdkd", "q0": 0.1, "p0": 0.1, "step": 0.1, "steps": 2, "paths": 3}
    np.testing.assert_array_equal(*(ss.simulate(model, damping_noise=x, **how).q for x in ("law", "polynomial")))
