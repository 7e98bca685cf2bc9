# SPDX-License-Identifier: BSD-3-Clause
# ruff: noqa: PLR0917
"""Gradients of E q(T)^2 of a noisy pendulum, H = p^2/2 - k cos q and H_1 = sigma sin q, by hand in numba.

The kicks of Stoermer and Verlet's steps, f = (h/2) k sin q + (1/2) sigma dW cos q, keep sine and cosine at all q of a
path. Covectors (u, c) = (df/dq, df/dp) go back by the transposed kicks and drifts,

    u <- u - f' c,   g_k <- g_k - (h/2) sin(q) c,   g_sigma <- g_sigma - (dW/2) cos(q) c;     c <- c + h u
"""

import math

import numba
import numpy as np

_fast = numba.njit(fastmath=True)


@_fast
def swept(dw, sines, cosines, q, p, k, sigma, h):
    """f = q(T)^2, df/dk and df/dsigma of one path with increments dw (step,); sines, cosines: room (step + 1,)."""
    n = dw.size
    sines[0], cosines[0] = math.sin(q), math.cos(q)
    for i in range(n):
        p -= 0.5 * (h * k * sines[i] + dw[i] * sigma * cosines[i])
        q += h * p
        sines[i + 1], cosines[i + 1] = math.sin(q), math.cos(q)
        p -= 0.5 * (h * k * sines[i + 1] + dw[i] * sigma * cosines[i + 1])
    u, c, by_k, by_sigma = 2 * q, 0.0, 0.0, 0.0
    for i in range(n - 1, -1, -1):
        for at in (i + 1, i):
            by_k -= 0.5 * h * sines[at] * c
            by_sigma -= 0.5 * dw[i] * cosines[at] * c
            u -= 0.5 * (h * k * cosines[at] - dw[i] * sigma * sines[at]) * c
            if at > i:
                c += h * u
    return q * q, by_k, by_sigma


@_fast
def run(generator, q0, p0, k, sigma, h, steps, paths):
    """Means of q(T)^2 and of its derivatives by k and sigma, by paths with increments of NumPy's generator."""
    root, total = math.sqrt(h), np.zeros(3)
    dw, sines, cosines = np.empty(steps), np.empty(steps + 1), np.empty(steps + 1)
    for _ in range(paths):
        for i in range(steps):
            dw[i] = root * generator.standard_normal()
        value, by_k, by_sigma = swept(dw, sines, cosines, q0, p0, k, sigma, h)
        total[0] += value
        total[1] += by_k
        total[2] += by_sigma
    return total / paths
