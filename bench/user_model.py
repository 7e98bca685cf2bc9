# SPDX-License-Identifier: BSD-3-Clause
"""The synchrotron as a user writes it in Python, and the model of user_model.c as the library receives it."""

from __future__ import annotations

import math

import numpy as np
import symsde as ss
from scenes import SCENES

try:
    import numba
except ImportError:
    numba = None

SCENE = SCENES["synchrotron"]
TRAITS = {"ndof": 1, "nnoise": 2, "separable": True, "position_noise": True, "identity_mass": True}


def in_c(programs):
    """The functions of user_model.c."""
    functions = {"gradient": programs.user_gradient, "gradient_hessian": programs.user_gradient_hessian}
    return ss.Model(**functions, **TRAITS, accepts_null=True)


def in_numpy():
    """The functions of the scene by NumPy."""
    s = SCENE.functions("numpy")

    def gradient(t, w, q, p):
        return -s.force(w, t, q), s.mass(w) * p

    def gradient_hessian(t, w, q, p):
        force, derivative = s.slope(w, t, q)
        mass = s.mass(w)
        return -force, mass * p, -derivative[None], np.zeros((1, *q.shape)), mass[None, None]

    return ss.Model(gradient=gradient, gradient_hessian=gradient_hessian, **TRAITS)


def in_numba(plain=False, bare=False):
    """Functions by numba.cfunc with the library's sine and cosine, or if plain with Python's; gradient and Hessian
    jointly, or if bare the gradient alone, and nothing declared.
    """
    if plain:

        @numba.njit
        def sincos(n, x, sine, cosine):
            angles = numba.carray(x, n)
            for i in range(n):
                sine[i], cosine[i] = math.sin(angles[i]), math.cos(angles[i])

    else:
        of_library = ss.numba_sincos()

        @numba.njit
        def sincos(n, x, sine, cosine):
            of_library(n, x, sine.ctypes, cosine.ctypes)

    @numba.cfunc(ss.numba_signature("gradient"))
    def gradient(nlane, ndof, nham, t, w, q, p, hq, hp, user):  # noqa: PLR0917
        if numba.carray(hq, nlane).ctypes.data != 0:
            sine, cosine = np.empty(nlane), np.empty(nlane)
            sincos(nlane, q, sine, cosine)
            for i in range(nlane):
                hq[i] = (4.0 * w[i] + 0.1 * w[2 * nlane + i]) * sine[i] + 0.2 * w[nlane + i] * cosine[i]
        if numba.carray(hp, nlane).ctypes.data != 0:
            for i in range(nlane):
                hp[i] = w[i] * p[i]
        return 0

    if bare:
        return ss.Model(gradient=gradient, ndof=1, nnoise=2)

    @numba.cfunc(ss.numba_signature("gradient_hessian"))
    def gradient_hessian(nlane, ndof, nham, t, w, q, p, hq, hp, hqq, hqp, hpp, user):  # noqa: PLR0917
        sine, cosine = np.empty(nlane), np.empty(nlane)
        sincos(nlane, q, sine, cosine)
        if numba.carray(hq, nlane).ctypes.data != 0:
            for i in range(nlane):
                hq[i] = (4.0 * w[i] + 0.1 * w[2 * nlane + i]) * sine[i] + 0.2 * w[nlane + i] * cosine[i]
        if numba.carray(hqq, nlane).ctypes.data != 0:
            for i in range(nlane):
                hqq[i] = (4.0 * w[i] + 0.1 * w[2 * nlane + i]) * cosine[i] - 0.2 * w[nlane + i] * sine[i]
        for out, mass in ((hp, False), (hpp, True)):
            if numba.carray(out, nlane).ctypes.data != 0:
                for i in range(nlane):
                    out[i] = w[i] if mass else w[i] * p[i]
        if numba.carray(hqp, nlane).ctypes.data != 0:
            for i in range(nlane):
                hqp[i] = 0.0
        return 0

    return ss.Model(gradient=gradient, gradient_hessian=gradient_hessian, accepts_null=True, **TRAITS)


def by_hand(scheme, step, paths, lanes):
    """Runs of a loop in NumPy alone, from (1, 0), in blocks of so many lanes."""
    s, generator = SCENE.functions("numpy"), np.random.default_rng(1)

    def kick(w, q, p):  # change of p in a midpoint step by Newton's iteration
        v = np.zeros_like(p)
        for _ in range(20):
            force, derivative = s.slope(w, 0.0, q + 0.5 * w[0] * (p + 0.5 * v))
            d = (v - force) / (1 - 0.25 * w[0] * derivative)
            v -= d
            if np.abs(d).max() < 1e-12:
                break
        return v

    def run(steps):
        for _ in range(paths // lanes):
            q, p, w = np.ones((1, lanes)), np.zeros((1, lanes)), np.full((3, lanes), step)
            for _ in range(steps):
                w[1:] = step**0.5 * generator.standard_normal((2, lanes))
                if scheme == "midpoint":
                    v = kick(w, q, p)
                    q, p = q + w[0] * (p + 0.5 * v), p + v
                else:
                    p = p + s.force(w, 0.0, q)
                    q = q + w[0] * p

    return run
