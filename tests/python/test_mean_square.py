# SPDX-License-Identifier: BSD-3-Clause
"""Mean-square stability: the matrix of second moments against hand calculations and against paths."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
import symsde as ss
from symsde.studies.stability.systems import bilinear, noisy_spring, soft


def spring(sigma: float = 0.4) -> ss.Model:
    """H = (p^2 + q^2)/2, H_1 = sigma q^2/2."""
    return noisy_spring(1.0, sigma)


def two_springs():
    """H = (p^2 + q^2)/2 with two noises in the stiffness."""
    flags = dict.fromkeys(("separable", "position_noise", "identity_mass"), True)
    return bilinear(lambda w: (w[0] + 0.1 * w[1] + 0.2 * w[2], 0, w[0]), nnoise=2, **flags)


@pytest.mark.parametrize(("a", "sigma", "h"), [(1.0, 0.3, 0.2), (2.0, 0.5, 0.5)])
def test_kubo_by_hand(a, sigma, h):
    """x = a h + sigma dW: midpoint rotates; Heun multiplies |z|^2 by 1 + x^4/4; Euler-Maruyama in Ito's form by
    (1 - sigma^2 h/2)^2 + E x^2."""
    model = ss.models.kubo(a=a, sigma=sigma)
    mu, s2 = a * h, sigma**2 * h
    fourth = mu**4 + 6 * mu**2 * s2 + 3 * s2**2
    found = {name: ss.mean_square(model, name, step=h) for name in ("midpoint", "gauss2", "heun", "euler_maruyama")}
    assert found["midpoint"].growth == pytest.approx(1.0, abs=1e-12)
    assert found["gauss2"].growth == pytest.approx(1.0, abs=1e-12)
    assert found["heun"].growth == pytest.approx(1 + fourth / 4, rel=1e-12)
    assert found["euler_maruyama"].growth == pytest.approx((1 - s2 / 2) ** 2 + mu**2 + s2, rel=1e-12)
    for one in found.values():
        assert one.exact == pytest.approx(1.0, abs=1e-12)
    assert found["midpoint"].mean < 1  # E z decays, E |z|^2 does not


def test_exact_growth_of_noise_on_the_stiffness():
    """The largest eigenvalue of d/dt E(q^2, q p, p^2), whose matrix is ((0, 2, 0), (-1, 0, 1), (s^2, -2, 0))."""
    rates = np.linalg.eigvals([[0, 2, 0], [-1, 0, 1], [0.16, -2, 0]]).real.max()
    found = ss.mean_square(spring(), "stormer_verlet", step=0.3)
    assert found.exact == pytest.approx(math.exp(0.3 * rates), rel=1e-10)
    assert found.growth == pytest.approx(found.exact, rel=2e-2) and found.excess == pytest.approx(0, abs=2e-2)


def test_verlet_ends_at_two():
    """Without noise |M| = 1 up to omega h = 2, and more beyond."""
    model = ss.models.linear_oscillator()
    assert ss.mean_square(model, "stormer_verlet", step=1.99).growth == pytest.approx(1.0, abs=1e-9)
    assert ss.mean_square(model, "stormer_verlet", step=2.05).growth > 1.2
    assert ss.mean_square(model, "midpoint", step=30.0).growth == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize("noise", [[], ["0.3*q"]])
@pytest.mark.parametrize("h", [0.2, -0.2])
def test_exact_growth_on_a_hill(noise, h):
    """If H = (p^2 - q^2)/2, the sum p + q grows as e^t and its square as e^(2t); back in time p - q does. Additive
    noise does not change these rates."""
    found = ss.mean_square(ss.model_from_sympy("p**2/2 - q**2/2", noise), "midpoint", step=h)
    assert found.exact == pytest.approx(math.exp(0.4), rel=1e-12)
    assert found.growth == pytest.approx((1.1 / 0.9) ** 2, rel=1e-12)


DRIVEN = {"stiffness": spring(), "mass": soft(0.4), "Kubo": ss.models.kubo(a=1.0, sigma=0.4)}


@pytest.mark.parametrize(
    ("scheme", "equation"),
    [
        ("stormer_verlet", "stiffness"), ("stormer_verlet", "mass"), ("stormer_verlet", "Kubo"),
        ("symplectic_euler", "stiffness"), ("symplectic_euler", "Kubo"), ("heun", "stiffness"), ("heun", "mass"),
        ("gauss2_strong32", "stiffness"), ("gauss2_strong32", "mass"), ("gauss_dkdkd", "stiffness"),
        ("chin4a", "stiffness"), ("gauss2_weak2", "mass"), ("midpoint_weak1", "stiffness"),
    ],
)  # fmt: skip
def test_paths_grow_as_the_matrix_says(scheme, equation):
    """E q^2, q p, p^2 after 12 steps over 4e4 paths, each within 4.5 standard errors (9e-5 for thirteen schemes and
    four equations).
    """
    model, h, steps = DRIVEN[equation], 0.4, 12
    matrix = ss.mean_square(model, scheme, step=h).matrix
    start = np.array([1.0, 0.5])
    expected = np.linalg.matrix_power(matrix, steps) @ np.kron(start, start)
    run = ss.simulate(
        model, q0=1.0, p0=0.5, step=h, steps=steps, save_every=steps, scheme=scheme, paths=40_000, seed=8, threads=1
    )
    z = np.concatenate([run.q[-1], run.p[-1]])
    pairs = np.einsum("in,jn->ijn", z, z).reshape(4, -1)
    mean, error = pairs.mean(axis=1), pairs.std(axis=1) / math.sqrt(z.shape[1])
    assert (np.abs(mean - expected) < 4.5 * error).all()
    wrong = ss.mean_square(model, scheme, step=1.05 * h).matrix  # the planted twin
    assert (np.abs(mean - np.linalg.matrix_power(wrong, steps) @ np.kron(start, start)) > 4.5 * error).any()


@pytest.mark.parametrize(("scheme", "equation"), [("midpoint", "Kubo"), ("stormer_verlet", "stiffness")])
def test_symplectic_steps_keep_areas(scheme, equation):
    """M x M multiplies (1, 0) x (0, 1) - (0, 1) x (1, 0) by det M: symmetric second moments would not show this."""
    area = np.array([0.0, 1.0, -1.0, 0.0])
    matrix = ss.mean_square(DRIVEN[equation], scheme, step=0.4).matrix
    np.testing.assert_allclose(matrix @ area, area, atol=1e-12)


def test_a_step_that_may_be_singular_has_no_second_moments():
    """Midpoint divides by 1 + h^2/4 + sigma h dW/4, which vanishes at three standard deviations of dW here."""
    assert ss.mean_square(spring(4.0), "midpoint", step=0.5).growth == math.inf


def test_misuse_gets_a_sentence():
    for model, scheme, words in (
        (ss.models.pendulum(), "midpoint", "not quadratic"),
        (spring(), "chin4a_strong2", "takes J or areas"),
        (ss.models.noncommutative_oscillator(), "midpoint_areas", "takes J or areas"),
        (two_springs(), "chin4a", "ways to drive a step"),
    ):
        with pytest.raises(ss.errors.IncompatibleError, match=words):
            ss.mean_square(model, scheme, step=0.1)


@pytest.mark.parametrize("n", [20, 100])
def test_a_chain_under_additive_noise(n):
    """Fixed ends: omega_k = 2 sin(k pi/(2n + 2)). Verlet's largest multiplier at x = h omega_n > 2 solves l^2 + (x^2
    - 2) l + 1 = 0; midpoint's are on the unit circle.
    """
    model = ss.models.fpu_chain(n=n, beta=0.0, sigma=0.3)
    fastest = 2 * math.sin(n * math.pi / (2 * n + 2))
    for h in (0.5, 1.9 / fastest, 2.2 / fastest):
        s = max((h * fastest) ** 2 / 2 - 1, 1.0)
        found = ss.mean_square(model, "stormer_verlet", step=h)
        assert found.growth == pytest.approx((s + math.sqrt(s**2 - 1)) ** 2, rel=1e-9)
        assert found.exact == pytest.approx(1.0, abs=1e-10) and found.mean == pytest.approx(math.sqrt(found.growth))
        assert (found.matrix is None) == (n > 32)
    assert ss.mean_square(model, "midpoint", step=3.0).growth == pytest.approx(1.0, abs=1e-10)


def test_one_matrix_is_the_matrix_of_pairs():
    """With additive noise M is one matrix, and E M x M, by its definition, is the Kronecker product of M with itself;
    heun grows."""
    found = ss.mean_square(ss.models.linear_oscillator(), "heun", step=0.5)
    x = 0.5
    one = np.array([[1 - x**2 / 2, x], [-x, 1 - x**2 / 2]])
    np.testing.assert_allclose(found.matrix, np.kron(one, one), atol=1e-14)
    assert found.growth == pytest.approx(1 + x**4 / 4, rel=1e-12)


def test_many_degrees_of_freedom_get_a_sentence_before_memory():
    """A matrix of (2 x 400)^4 entries would take 3 TB, and is refused."""

    def hessian(t, w, q, p):
        unit = np.eye(400)[:, :, None] * np.ones(q.shape[1])
        return (w[0] + 0.1 * w[1]) * unit, 0 * unit, w[0] * unit

    def gradient(t, w, q, p):
        return (w[0] + 0.1 * w[1]) * q, w[0] * p

    model = ss.Model(ndof=400, nnoise=1, gradient=gradient, hessian=hessian, quadratic=True, separable=True)
    with pytest.raises(ss.errors.TooLargeError, match="at most 32 degrees of freedom"):
        ss.mean_square(model, "midpoint", step=0.1)


@pytest.mark.parametrize("h", [0.3, -0.3])
def test_exact_growth_of_steps_back_in_time(h):
    """Kubo's oscillator rotates either way; noise in the stiffness acts with |h|: ((0, 2, 0), (-1, 0, 1), (0, -2,
    0)) changes its sign with h, and s^2 in the row of E p^2 does not.
    """
    assert ss.mean_square(ss.models.kubo(sigma=0.9), "midpoint", step=h).exact == pytest.approx(1.0, abs=1e-12)
    sign = math.copysign(1, h)
    rates = np.array([[0, 2, 0], [-1, 0, 1], [0, -2, 0]]) * sign + np.array([[0, 0, 0], [0, 0, 0], [0.16, 0, 0]])
    found = ss.mean_square(spring(), "stormer_verlet", step=h)
    assert found.exact == pytest.approx(math.exp(0.3 * np.linalg.eigvals(rates).real.max()), rel=1e-10)
    assert found.excess == pytest.approx(0, abs=2e-2)


@pytest.mark.parametrize(("sigma", "h"), [(3.0, 1.0), (0.2, 6.0)])
def test_exact_growth_of_large_steps(sigma, h):
    """The largest eigenvalue of ((0, 2, 0), (-1, 0, 1), (s^2, -2, 0)) times h, where growth is far from one."""
    rates = np.linalg.eigvals([[0, 2, 0], [-1, 0, 1], [sigma**2, -2, 0]]).real.max()
    found = ss.mean_square(spring(sigma), "heun", step=h)
    assert found.exact == pytest.approx(math.exp(h * rates), rel=1e-11)
    assert found.excess == math.log(found.growth / found.exact) and abs(found.excess) > 0.1


def test_the_map_of_the_pages_tells_of_every_scheme():
    """The page has limits for every scheme. With additive noise, where the step is one matrix, Verlet's is just
    below 2, and midpoint has none.
    """
    path = Path(__file__).resolve().parents[2] / "docs/figures/mean-square.json"
    data = json.loads(path.read_text(encoding="utf-8"))
    assert list(data["limits"]) == ss.schemes.names()
    still = {name: found["additive noise, H_1 = -sigma q"] for name, found in data["limits"].items()}
    assert set(still["midpoint"]) == {data["omega_h"][-1]} and 1.8 < min(still["stormer_verlet"]) < 2
