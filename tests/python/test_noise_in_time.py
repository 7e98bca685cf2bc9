# SPDX-License-Identifier: BSD-3-Clause
"""Noises that depend on time are noticed; weak order (strong orders: test_axes_orders.py)."""

import numpy as np
import pytest
import symsde as ss

AT_EDGES = {
    "no number at t = 0": ("-sin(4*t)/t*q", 1.0),
    "nothing before its time": ("-(1 + 0.5*sin(0.3*(t - 10))*(1 + tanh(30*(t - 9)))*(1 - tanh(30*(t - 31))))*q", 10.0),
    "in p alone": ("-(1 + 0.8*sin(4*t))*p", 0.0),
}


@pytest.mark.parametrize("kind", AT_EDGES)
def test_change_in_time_is_noticed_at_edges(kind: str):
    """Terms of time are used: paths differ from those with noise constant in each step."""
    noise, t0 = AT_EDGES[kind]
    model = ss.model_from_sympy("p**2/2 - cos(q)", [noise], q="q", p="p")
    end = {}
    for steps, refine in ((64, 4), (128, 3), (256, 2), (1024, 0)):
        run = ss.simulate(model, q0=0.4, p0=0.7, t0=t0, step=1 / steps, steps=steps, save_every=steps, refine=refine,
                          scheme="gauss2_strong32", paths=200, seed=5)  # fmt: skip
        end[steps] = run.q[-1]
    errors = [np.sqrt(np.mean((end[steps] - end[1024]) ** 2)) for steps in (64, 256)]
    assert np.log2(errors[0] / errors[1]) / 2 > 1.4  # 0.98 to 1.0 if the dependence were not noticed


def turning(a: float, b: float) -> tuple[ss.Model, object]:
    """H = (p^2 + q^2)/2, H_1 = (a q^2 cos 5t + b p^2 sin 5t)/2, and the matrix of its field."""

    def strengths(t: float) -> tuple[float, float]:
        return a * np.cos(5 * t), b * np.sin(5 * t)

    def gradient(t, w, q, p):
        x, y = strengths(t)
        return (w[0] + x * w[1]) * q, (w[0] + y * w[1]) * p

    def hessian(t, w, q, p):
        x, y = strengths(t)
        return (w[0] + x * w[1])[None, None], 0 * q[None], (w[0] + y * w[1])[None, None]

    def field(t):
        x, y = strengths(t)
        return np.array([[0, y], [-x, 0]])

    model = ss.Model(ndof=1, nnoise=1, gradient=gradient, hessian=hessian, separable=True, quadratic=True)
    return model, field


def second_moments(field: object, count: int = 1000) -> np.ndarray:
    """Map of the second moments from t = 0 to 1: Runge-Kutta for d/dt E x x^T of the linear model."""

    def rate(t: float) -> np.ndarray:
        noise, unit = field(t), np.eye(2)
        drift = np.array([[0, 1], [-1, 0]]) + noise @ noise / 2
        return np.kron(drift, unit) + np.kron(unit, drift) + np.kron(noise, noise)

    moments, h = np.eye(4), 1 / count
    for t in np.arange(count) * h:
        k1 = rate(t) @ moments
        k2 = rate(t + h / 2) @ (moments + h / 2 * k1)
        k3 = rate(t + h / 2) @ (moments + h / 2 * k2)
        k4 = rate(t + h) @ (moments + h * k3)
        moments = moments + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return moments


def enumerated(model: ss.Model, count: int) -> np.ndarray:
    """The map by gauss2_weak2 in `count` steps, with the mean of each step over its three increments."""
    h = 1 / count
    weights = (1 / 6, 2 / 3, 1 / 6)
    dw = np.repeat(np.sqrt(3 * h) * np.array([-1, 0, 1]), 2)[None, None]
    q, p = np.tile([1.0, 0.0], 3)[None], np.tile([0.0, 1.0], 3)[None]
    moments = np.eye(4)
    for n in range(count):
        run = ss.simulate(model, q0=q, p0=p, scheme="gauss2_weak2", step=h, steps=1, t0=n * h, paths=6, increments=dw)
        ends = np.stack([run.q[-1, 0], run.p[-1, 0]]).reshape(2, 3, 2)
        moments = sum(w * np.kron(ends[:, k], ends[:, k]) for k, w in enumerate(weights)) @ moments
    return moments


@pytest.mark.parametrize(("a", "b"), [(0.8, 0.8), (0.8, 0.0)])
def test_weak_order_where_a_noise_does_not_commute_with_itself(a: float, b: float):
    """Weak orders are measured as 1.98 and 1.99; without {H_1(t_1), H_1(t_0)} the first model has 1.02."""
    model, field = turning(a, b)
    exact = second_moments(field)
    coarse, fine = (np.abs(enumerated(model, count) - exact).max() for count in (32, 64))
    assert np.log2(coarse / fine) == pytest.approx(2, abs=0.06)


@pytest.mark.parametrize("scheme", ["verlet_dz", "averaged_shift_midpoint", "gauss2_strong32"])
def test_one_path_knows_that_noise_changes_in_time(scheme: str):
    """Functions that accept any number of lanes are called with one lane, also at set-up."""
    model = ss.model_from_sympy("p**2/2 - cos(q)", ["-(1 + 0.8*sin(4*t))*q"], q="q", p="p")
    few, many = (
        ss.simulate(model, q0=0.4, p0=0.7, step=0.1, steps=20, scheme=scheme, paths=n, seed=5) for n in (1, 512)
    )
    assert (few.q[..., 0] == many.q[..., 0]).all()
    assert (few.p[..., 0] == many.p[..., 0]).all()
