# SPDX-License-Identifier: BSD-3-Clause
"""Models of the scenarios that are not built in, as NumPy functions.

With `clocked` the Hamiltonian is H_1 and H_0 = 0: prescribed increments are then the steps in time, and each path of
a run has its own step.
"""

from __future__ import annotations

import numpy as np

import symsde as ss


def _quiet(function):
    """Suppress warnings about overflow, which the scenarios examine."""

    def quiet(*arguments):
        with np.errstate(over="ignore", invalid="ignore"):
            return function(*arguments)

    return quiet


def in_potential(force, stiffness, potential, *, clocked: bool = False, **traits) -> ss.Model:
    """H = p^2/2 + U(q) with U, U' (force) and U'' (stiffness) given; one degree of freedom."""
    k = int(clocked)

    @_quiet
    def gradient(t, w, q, p):
        return w[k] * force(q), w[k] * p

    @_quiet
    def hessian(t, w, q, p):
        zero = np.zeros((1, 1, q.shape[1]))
        return (w[k] * stiffness(q))[None], zero, zero + w[k]

    @_quiet
    def value(t, w, q, p):
        return w[k] * (p[0] ** 2 / 2 + potential(q)[0])

    more = {"separable": True, **traits}
    if not clocked:
        more |= {"identity_mass": True, "additive": True, "position_noise": True}
    return ss.Model(ndof=1, nnoise=k, gradient=gradient, hessian=hessian, value=value, **more)


def quartic(clocked: bool = False) -> ss.Model:
    """U = q^4/4."""
    return in_potential(lambda q: q**3, lambda q: 3 * q**2, lambda q: q**4 / 4, clocked=clocked)


def double_well() -> ss.Model:
    """U = q^4/4 - q^2/2: U'' = -1 at the top."""
    return in_potential(lambda q: q**3 - q, lambda q: 3 * q**2 - 1, lambda q: q**4 / 4 - q**2 / 2)


def spring(omega: float) -> ss.Model:
    """U = omega^2 q^2/2: one fast mode."""
    k = omega**2
    return in_potential(lambda q: k * q, lambda q: k + 0 * q, lambda q: k * q**2 / 2, quadratic=True)


def bilinear(rates, ndof: int = 1, nnoise: int = 1, **traits) -> ss.Model:
    """S = (a q.q + 2 b q.p + c p.p)/2 with (a, b, c) = rates(w)."""

    def gradient(t, w, q, p):
        a, b, c = rates(w)
        return a * q + b * p, b * q + c * p

    def hessian(t, w, q, p):
        unit = np.eye(ndof)[:, :, None] * np.ones(q.shape[1])
        return tuple(rate * unit for rate in rates(w))

    return ss.Model(ndof=ndof, nnoise=nnoise, gradient=gradient, hessian=hessian, quadratic=True, **traits)


def squeeze(sigma: float) -> ss.Model:
    """H = 0, H_1 = sigma q p: a step multiplies q by (1 + a)/(1 - a), a = sigma dW/2, while the exact q never
    changes sign.
    """
    return bilinear(lambda w: (0, sigma * w[1], 0), noise_lipschitz=sigma)


def noisy_spring(stiffness: float, sigma: float) -> ss.Model:
    """H = p^2/2 + stiffness q^2/2, H_1 = sigma q^2/2."""
    flags = dict.fromkeys(("separable", "position_noise", "identity_mass"), True)
    return bilinear(lambda w: (w[0] * stiffness + w[1] * sigma, 0, w[0]), noise_lipschitz=sigma, **flags)


def soft(sigma: float) -> ss.Model:
    """H = (p^2 + q^2)/2 with noise on the mass, H_1 = sigma p^2/2."""
    return bilinear(lambda w: (w[0], 0, w[0] + sigma * w[1]), separable=True)


def inverted(n: int, h: float) -> ss.Model:
    """n equal hills, U'' = -4/h^2: the matrix of the midpoint rule is zero."""
    return bilinear(lambda w: (-4 / h**2 * w[0], 0, w[0]), n, 0, separable=True, identity_mass=True)


def two_springs(omega: float, coupling: float) -> ss.Model:
    """H = p.p/2 + omega^2 q_1^2/2 + q_2^4/4 + coupling q_1 q_2, clocked."""

    @_quiet
    def gradient(t, w, q, p):
        force = np.stack([omega**2 * q[0] + coupling * q[1], q[1] ** 3 + coupling * q[0]])
        return w[1] * force, w[1] * p

    def hessian(t, w, q, p):
        one = np.ones(q.shape[1])
        cross = coupling * one
        qq = w[1] * np.array([[omega**2 * one, cross], [cross, 3 * q[1] ** 2]])
        return qq, 0 * qq, w[1] * np.array([[one, 0 * one], [0 * one, one]])

    def value(t, w, q, p):
        potential = omega**2 * q[0] ** 2 / 2 + q[1] ** 4 / 4 + coupling * q[0] * q[1]
        return w[1] * ((p**2).sum(axis=0) / 2 + potential)

    return ss.Model(ndof=2, nnoise=1, gradient=gradient, hessian=hessian, value=value, separable=True)


def turning(sigma: float = 0.5) -> ss.Model:
    """H = I + I^2/2, H_1 = sigma I with I = (p^2 + q^2)/2, the invariant: a rotation whose speed depends on I."""

    def rates(w, q, p):
        action = (q[0] ** 2 + p[0] ** 2) / 2
        return w[0] * (1 + action) + sigma * w[1]

    def gradient(t, w, q, p):
        rate = rates(w, q, p)
        return rate * q, rate * p

    def hessian(t, w, q, p):
        rate = rates(w, q, p)
        return (rate + w[0] * q * q)[None], (w[0] * q * p)[None], (rate + w[0] * p * p)[None]

    return ss.Model(ndof=1, nnoise=1, gradient=gradient, hessian=hessian)
