# SPDX-License-Identifier: BSD-3-Clause
# ruff: noqa: PLR0917
"""The loops of `loops.py` for pendulums, terms(w, t) -> a, c, d, e of

sum_j w_j H_j = e p^2/2 - a cos q + c q^2/2 + d q
"""

import math

import numba
import numpy as np
from loops import BOUND, ROUNDING, TABLEAUX


def pendulum_loop(terms, m, scheme):
    """A loop of the scheme; inlined by LLVM, as if the terms had been written in it."""
    makers = {"midpoint": _pendulum_midpoint, "gauss2": _pendulum_gauss2}
    makers |= {"stormer_verlet": _pendulum_verlet, "symplectic_euler": _pendulum_euler}
    return makers[scheme](terms, m)


def _pendulum_midpoint(terms, m):
    @numba.njit
    def run(generator, q0, p0, step, steps, paths):
        root, total = math.sqrt(step), 0.0
        w = np.empty(m + 1)
        w[0] = step
        for _ in range(paths):
            q, p = q0[0], p0[0]
            for i in range(steps):
                for k in range(m):
                    w[k + 1] = root * generator.standard_normal()
                a, c, d, e = terms(w, (i + 0.5) * step)
                v = 0.0
                for _ in range(BOUND):
                    x = q + 0.5 * e * (p + 0.5 * v)
                    change = (v + a * math.sin(x) + c * x + d) / (1 + 0.25 * e * (a * math.cos(x) + c))
                    v -= change
                    if not abs(change) > 1e-10:  # Newton: the next one would be rounding
                        break
                q += e * (p + 0.5 * v)
                p += v
            total += q
        return total

    return run


def _pendulum_gauss2(terms, m):
    (a11, a12), (a21, a22) = TABLEAUX["gauss2"][0]
    c1, c2 = a11 + a12, a21 + a22

    @numba.njit
    def run(generator, q0, p0, step, steps, paths):
        root, total = math.sqrt(step), 0.0
        w = np.empty(m + 1)
        w[0] = step
        for _ in range(paths):
            q, p = q0[0], p0[0]
            for i in range(steps):
                for k in range(m):
                    w[k + 1] = root * generator.standard_normal()
                pull1, c, torque1, e = terms(w, (i + c1) * step)
                pull2, c, torque2, e = terms(w, (i + c2) * step)
                f1, f2 = e * p, e * p
                g1, g2 = 0.0, 0.0
                for _ in range(BOUND):
                    x1, x2 = q + a11 * f1 + a12 * f2, q + a21 * f1 + a22 * f2
                    new1 = -(pull1 * math.sin(x1) + c * x1 + torque1)
                    new2 = -(pull2 * math.sin(x2) + c * x2 + torque2)
                    change = max(abs(new1 - g1), abs(new2 - g2))
                    g1, g2 = new1, new2
                    f1, f2 = e * (p + a11 * g1 + a12 * g2), e * (p + a21 * g1 + a22 * g2)
                    if not change > ROUNDING:
                        break
                q += 0.5 * (f1 + f2)
                p += 0.5 * (g1 + g2)
            total += q
        return total

    return run


def _pendulum_verlet(terms, m):
    @numba.njit
    def run(generator, q0, p0, step, steps, paths):
        root, total = math.sqrt(step), 0.0
        w = np.empty(m + 1)
        w[0] = step
        for _ in range(paths):
            q, p = q0[0], p0[0]
            for i in range(steps):
                for k in range(m):
                    w[k + 1] = root * generator.standard_normal()
                a, c, d, e = terms(w, i * step)
                p -= 0.5 * (a * math.sin(q) + c * q + d)
                q += e * p
                a, c, d, e = terms(w, (i + 1) * step)
                p -= 0.5 * (a * math.sin(q) + c * q + d)
            total += q
        return total

    return run


def _pendulum_euler(terms, m):
    @numba.njit
    def run(generator, q0, p0, step, steps, paths):
        root, total = math.sqrt(step), 0.0
        w = np.empty(m + 1)
        w[0] = step
        for _ in range(paths):
            q, p = q0[0], p0[0]
            for i in range(steps):
                for k in range(m):
                    w[k + 1] = root * generator.standard_normal()
                a, c, d, e = terms(w, i * step)
                p -= a * math.sin(q) + c * q + d
                q += e * p
            total += q
        return total

    return run


@numba.njit
def pendulum_terms(w, t):
    """sigma = 0.5."""
    s = 0.5 * w[1]
    return w[0], s, 0.0, w[0] + s


@numba.njit
def driven_terms(w, t):
    """omega = 1, epsilon = 0.3, nu = 2, sigma1 = 0.2, sigma2 = 0.1, alpha = 0.5."""
    strength = 1 + 0.5 * math.sin(2 * t)
    return (1 + 0.3 * math.cos(2 * t)) * w[0] + 0.1 * strength * w[2], 0.0, -0.2 * strength * w[1], w[0]
