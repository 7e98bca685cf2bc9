# SPDX-License-Identifier: BSD-3-Clause
# ruff: noqa: PLR0912, PLR0917
"""The plain loops that a user of numba would write instead of calling the library: `loop_rows.py` times both.

Every loop goes over paths and steps, draws its normals where it needs them from NumPy's Generator (PCG64 and ziggurat,
as numba compiles them), and keeps nothing but what its name says. Implicit schemes iterate, one unknown by
Newton's method to rounding, several by fixed-point iteration from the explicit guess, which converges at the mild steps
of the rows, until positions change by `ROUNDING` or less. No -ffast-math: results would not be comparable.

A loop is `run(generator, q0, p0, step, steps, paths)`, q0 and p0 arrays of one number for each degree of freedom.
"""

import math

import numba
import numpy as np

ROUNDING = 1e-14
COSINES = np.cos(np.arange(1, 33))
BOUND = 100


def _compiled(function):
    return numba.njit(function)


# ---- H = p.p/2 + U(q), noises in position: force(w, q, f, room) gives f = -d/dq sum_j w_j H_j ------------------------


def verlet(force, n, m):
    """Stormer-Verlet, explicit."""

    @_compiled
    def run(generator, q0, p0, step, steps, paths):
        root, total = math.sqrt(step), 0.0
        q, p, f, w, room = np.empty(n), np.empty(n), np.empty(n), np.empty(m + 1), np.empty(n)
        w[0] = step
        for _ in range(paths):
            q[:], p[:] = q0, p0
            for _ in range(steps):
                for k in range(m):
                    w[k + 1] = root * generator.standard_normal()
                force(w, q, f, room)
                for i in range(n):
                    p[i] += 0.5 * f[i]
                    q[i] += step * p[i]
                force(w, q, f, room)
                for i in range(n):
                    p[i] += 0.5 * f[i]
            total += q[0]
        return total

    return run


def euler(force, n, m):
    """Symplectic Euler, explicit."""

    @_compiled
    def run(generator, q0, p0, step, steps, paths):
        root, total = math.sqrt(step), 0.0
        q, p, f, w, room = np.empty(n), np.empty(n), np.empty(n), np.empty(m + 1), np.empty(n)
        w[0] = step
        for _ in range(paths):
            q[:], p[:] = q0, p0
            for _ in range(steps):
                for k in range(m):
                    w[k + 1] = root * generator.standard_normal()
                force(w, q, f, room)
                for i in range(n):
                    p[i] += f[i]
                    q[i] += step * p[i]
            total += q[0]
        return total

    return run


def collocation(force, n, m, scheme, rounding=ROUNDING):
    """A Runge-Kutta pair with its momenta eliminated: Q_i = q + c_i h p + h sum_j (a abar)_ij F_j.

    It ends where positions change by no more than `rounding`; with 0 where they no longer change, or no longer less.
    """
    a, abar, b = TABLEAUX[scheme]
    s = len(b)
    product, c, weights = a @ abar, a.sum(axis=1), b @ abar

    @_compiled
    def run(generator, q0, p0, step, steps, paths):
        root, total = math.sqrt(step), 0.0
        q, p, w, room = np.empty(n), np.empty(n), np.empty(m + 1), np.empty(n)
        x, f = np.empty((s, n)), np.empty((s, n))
        w[0] = step
        for _ in range(paths):
            q[:], p[:] = q0, p0
            for _ in range(steps):
                for k in range(m):
                    w[k + 1] = root * generator.standard_normal()
                for i in range(s):
                    for j in range(n):
                        x[i, j] = q[j] + c[i] * step * p[j]
                change = math.inf
                for _ in range(BOUND):
                    for i in range(s):
                        force(w, x[i], f[i], room)
                    before, change = change, 0.0
                    for i in range(s):
                        for j in range(n):
                            moved = 0.0
                            for k in range(s):
                                moved += product[i, k] * f[k, j]
                            moved = q[j] + step * (c[i] * p[j] + moved)
                            change = max(change, abs(moved - x[i, j]))
                            x[i, j] = moved
                    if not change > rounding or (rounding <= 0 and change >= before):
                        break
                for j in range(n):
                    dq, dp = p[j], 0.0
                    for k in range(s):
                        dq += weights[k] * f[k, j]
                        dp += b[k] * f[k, j]
                    q[j] += step * dq
                    p[j] += dp
            total += q[0]
        return total

    return run


_r3, _r15 = math.sqrt(3.0), math.sqrt(15.0)
_gauss2 = np.array([[1 / 4, 1 / 4 - _r3 / 6], [1 / 4 + _r3 / 6, 1 / 4]])
_gauss3 = np.array(
    [
        [5 / 36, 2 / 9 - _r15 / 15, 5 / 36 - _r15 / 30],
        [5 / 36 + _r15 / 24, 2 / 9, 5 / 36 - _r15 / 24],
        [5 / 36 + _r15 / 30, 2 / 9 + _r15 / 15, 5 / 36],
    ]
)
_lobatto3a = np.array([[0, 0, 0], [5 / 24, 1 / 3, -1 / 24], [1 / 6, 2 / 3, 1 / 6]])
_lobatto3b = np.array([[1 / 6, -1 / 6, 0], [1 / 6, 1 / 3, 0], [1 / 6, 5 / 6, 0]])
TABLEAUX = {
    "midpoint": (np.array([[0.5]]), np.array([[0.5]]), np.array([1.0])),
    "gauss2": (_gauss2, _gauss2, np.array([0.5, 0.5])),
    "gauss3": (_gauss3, _gauss3, np.array([5 / 18, 4 / 9, 5 / 18])),
    "lobatto3": (_lobatto3a, _lobatto3b, np.array([1 / 6, 2 / 3, 1 / 6])),
}


@_compiled
def fpu_force(w, q, f, room):
    """The chain with beta = 1, sigma = 1e-3: it stays cool in a long run."""
    n = len(q)
    before = q[0] * (1 + q[0] * q[0])
    for i in range(n):
        r = -q[i] if i == n - 1 else q[i + 1] - q[i]
        after = r * (1 + r * r)
        f[i] = w[0] * (after - before) + 1e-3 * w[i + 1]
        before = after


@_compiled
def henon_heiles_force(w, q, f, room):
    """alpha = 1, sigma1 = sigma2 = 1e-4: no path escapes in a long run."""
    f[0] = -w[0] * (q[0] + 2 * q[0] * q[1]) - 1e-4 * w[1]
    f[1] = -w[0] * (q[1] + q[0] * q[0] - q[1] * q[1]) - 1e-4 * w[2]


@_compiled
def synchrotron_force(w, q, f, room):
    """omega = 2, sigma1 = 0.2, sigma2 = 0.1."""
    f[0] = -(4.0 * w[0] + 0.1 * w[2]) * math.sin(q[0]) - 0.2 * w[1] * math.cos(q[0])


@_compiled
def many_noises_force(w, q, f, room):
    """H_k = -cos(k) q."""
    noise = 0.0
    for k in range(1, len(w)):
        noise += COSINES[k - 1] * w[k]
    f[0] = noise - w[0] * q[0]


@_compiled
def mean_field_force(w, q, f, room):
    """H = sum_i (p_i^2 + q_i^2)/2 + (1/2n) sum_ij (1 - cos(q_i - q_j)), H_1 = -0.03 sum_i cos(i) q_i."""
    n = len(q)
    x, y = 0.0, 0.0
    for i in range(n):
        f[i], room[i] = math.sin(q[i]), math.cos(q[i])
        x, y = x + room[i], y + f[i]
    x, y = x / n, y / n
    for i in range(n):
        f[i] = -w[0] * (q[i] + f[i] * x - room[i] * y) + 0.03 * COSINES[i] * w[1]


# ---- one degree of freedom, scalars -----------------------------------------------------------------------------


def scalar_midpoint(force_slope, m):
    """Newton's method for v = dp: v - f(q + h (p + v/2)/2) = 0; force_slope(w, x) gives f and f'."""

    @_compiled
    def run(generator, q0, p0, step, steps, paths):
        root, total = math.sqrt(step), 0.0
        w = np.empty(m + 1)
        w[0] = step
        for _ in range(paths):
            q, p = q0[0], p0[0]
            for _ in range(steps):
                for k in range(m):
                    w[k + 1] = root * generator.standard_normal()
                v = 0.0
                for _ in range(BOUND):
                    f, slope = force_slope(w, q + 0.5 * step * (p + 0.5 * v))
                    change = (v - f) / (1 - 0.25 * step * slope)
                    v -= change
                    if not abs(change) > 1e-10:  # Newton: the next one would be rounding
                        break
                q += step * (p + 0.5 * v)
                p += v
            total += q
        return total

    return run


@_compiled
def synchrotron_slope(w, x):
    """Force and its derivative."""
    s, c = math.sin(x), math.cos(x)
    a, b = 4.0 * w[0] + 0.1 * w[2], 0.2 * w[1]
    return -a * s - b * c, -a * c + b * s


@_compiled
def synchrotron_taylor(generator, q0, p0, step, steps, paths):
    """Stochastic Taylor scheme of strong order 3/2 (Kloeden, Platen 1992): what a user would write; not symplectic."""
    root, total = math.sqrt(step), 0.0
    shape = step * math.sqrt(step / 12)
    for _ in range(paths):
        q, p = q0[0], p0[0]
        for _ in range(steps):
            w1, w2 = root * generator.standard_normal(), root * generator.standard_normal()
            z1 = 0.5 * step * w1 + shape * generator.standard_normal()
            z2 = 0.5 * step * w2 + shape * generator.standard_normal()
            s, c = math.sin(q), math.cos(q)
            f, slope = -4.0 * s, -4.0 * c
            change = step * p + 0.5 * step * step * f - 0.2 * c * z1 - 0.1 * s * z2
            bent = 0.5 * step * step * slope + 0.2 * s * (step * w1 - z1) - 0.1 * c * (step * w2 - z2)
            p += step * f - 0.2 * c * w1 - 0.1 * s * w2 + p * bent
            q += change
        total += q
    return total


def linear_midpoint(m):
    """H = p^2/2 + q^2/2, H_k = -cos(k) q; one noise of strength one instead where m = 1. The linear equation solved."""
    strength = np.ones(1) if m == 1 else COSINES[:m].copy()

    @_compiled
    def run(generator, q0, p0, step, steps, paths):
        root, total = math.sqrt(step), 0.0
        inverse = 1 / (1 + 0.25 * step * step)
        for _ in range(paths):
            q, p = q0[0], p0[0]
            for _ in range(steps):
                noise = 0.0
                for k in range(m):
                    noise += strength[k] * generator.standard_normal()
                dp = (root * noise - step * (q + 0.5 * step * p)) * inverse
                q += step * (p + 0.5 * dp)
                p += dp
            total += q
        return total

    return run


@_compiled
def kubo_midpoint(generator, q0, p0, step, steps, paths):
    """a = 1, sigma = 0.3: a Cayley rotation."""
    root, total = math.sqrt(step), 0.0
    for _ in range(paths):
        q, p = q0[0], p0[0]
        for _ in range(steps):
            half = 0.5 * (step + 0.3 * root * generator.standard_normal())
            factor = 2 * half / (1 + half * half)
            dq, dp = factor * (p - half * q), -factor * (q + half * p)
            q, p = q + dq, p + dp
        total += q
    return total


@_compiled
def kubo_midpoint_saved(generator, q0, p0, step, steps, paths):
    """The same; every step is kept."""
    root = math.sqrt(step)
    saved = np.empty((paths, steps + 1, 2))
    for path in range(paths):
        q, p = q0[0], p0[0]
        saved[path, 0, 0], saved[path, 0, 1] = q, p
        for i in range(steps):
            half = 0.5 * (step + 0.3 * root * generator.standard_normal())
            factor = 2 * half / (1 + half * half)
            dq, dp = factor * (p - half * q), -factor * (q + half * p)
            q, p = q + dq, p + dp
            saved[path, i + 1, 0], saved[path, i + 1, 1] = q, p
    return saved[-1, -1, 0]


@_compiled
def linear_midpoint_saved(generator, q0, p0, step, steps, paths):
    """Of one noise; every step is kept."""
    root = math.sqrt(step)
    inverse = 1 / (1 + 0.25 * step * step)
    saved = np.empty((paths, steps + 1, 2))
    for path in range(paths):
        q, p = q0[0], p0[0]
        saved[path, 0, 0], saved[path, 0, 1] = q, p
        for i in range(steps):
            dp = (root * generator.standard_normal() - step * (q + 0.5 * step * p)) * inverse
            q += step * (p + 0.5 * dp)
            p += dp
            saved[path, i + 1, 0], saved[path, i + 1, 1] = q, p
    return saved[-1, -1, 0]


@_compiled
def henon_heiles_verlet_saved(generator, q0, p0, step, steps, paths):
    """alpha = 1, sigma1 = sigma2 = 1e-4; every step is kept."""
    root = math.sqrt(step)
    q, p, f, w = np.empty(2), np.empty(2), np.empty(2), np.empty(3)
    saved = np.empty((paths, steps + 1, 4))
    w[0] = step
    for path in range(paths):
        q[:], p[:] = q0, p0
        saved[path, 0, :2], saved[path, 0, 2:] = q, p
        for i in range(steps):
            w[1], w[2] = root * generator.standard_normal(), root * generator.standard_normal()
            henon_heiles_force(w, q, f, f)
            p[0], p[1] = p[0] + 0.5 * f[0], p[1] + 0.5 * f[1]
            q[0], q[1] = q[0] + step * p[0], q[1] + step * p[1]
            henon_heiles_force(w, q, f, f)
            p[0], p[1] = p[0] + 0.5 * f[0], p[1] + 0.5 * f[1]
            saved[path, i + 1, 0], saved[path, i + 1, 1] = q[0], q[1]
            saved[path, i + 1, 2], saved[path, i + 1, 3] = p[0], p[1]
    return saved[-1, -1, 0]


@_compiled
def pendulum_verlet_saved(generator, q0, p0, step, steps, paths):
    """H = p^2/2 - cos q, H_1 = 0.5 (p^2 + q^2)/2; every step is kept."""
    root = math.sqrt(step)
    saved = np.empty((paths, steps + 1, 2))
    for path in range(paths):
        q, p = q0[0], p0[0]
        saved[path, 0, 0], saved[path, 0, 1] = q, p
        for i in range(steps):
            s = 0.5 * root * generator.standard_normal()
            p -= 0.5 * (step * math.sin(q) + s * q)
            q += (step + s) * p
            p -= 0.5 * (step * math.sin(q) + s * q)
            saved[path, i + 1, 0], saved[path, i + 1, 1] = q, p
    return saved[-1, -1, 0]


@_compiled
def kubo_midpoint_moments(generator, q0, p0, step, steps, paths):
    """The same; mean and square sum of q, p, energy and q p at every step (Welford)."""
    root = math.sqrt(step)
    mean, square, x = np.zeros((steps + 1, 4)), np.zeros((steps + 1, 4)), np.empty(4)
    for path in range(paths):
        q, p = q0[0], p0[0]
        for i in range(steps + 1):
            if i > 0:
                half = 0.5 * (step + 0.3 * root * generator.standard_normal())
                factor = 2 * half / (1 + half * half)
                dq, dp = factor * (p - half * q), -factor * (q + half * p)
                q, p = q + dq, p + dp
            x[0], x[1], x[2], x[3] = q, p, 0.5 * (q * q + p * p), q * p
            for j in range(4):
                d = x[j] - mean[i, j]
                mean[i, j] += d / (path + 1)
                square[i, j] += d * (x[j] - mean[i, j])
    return mean[-1, 0]


@_compiled
def noncommutative_midpoint(generator, q0, p0, step, steps, paths):
    """sigma1 = sigma2 = 0.5: the linear equations solved."""
    root, total = math.sqrt(step), 0.0
    for _ in range(paths):
        q, p = q0[0], p0[0]
        for _ in range(steps):
            c = 0.5 * (step + 0.5 * root * generator.standard_normal())
            a = 0.5 * (step + 0.5 * root * generator.standard_normal())
            inverse = 2 / (1 + a * c)
            dq, dp = c * (p - a * q) * inverse, -a * (q + c * p) * inverse
            q, p = q + dq, p + dp
        total += q
    return total


@_compiled
def additive_euler(generator, q0, p0, step, steps, paths):
    """sigma = 0, gamma = 1, as drawn by the library: the noise of strength zero is not."""
    root, total = math.sqrt(step), 0.0
    for _ in range(paths):
        q, p = q0[0], p0[0]
        for _ in range(steps):
            p -= step * q - root * generator.standard_normal()
            q += step * p
        total += q
    return total


@_compiled
def pendulum_verlet(generator, q0, p0, step, steps, paths):
    """H = p^2/2 - cos q, H_1 = 0.5 (p^2 + q^2)/2."""
    root, total = math.sqrt(step), 0.0
    for _ in range(paths):
        q, p = q0[0], p0[0]
        for _ in range(steps):
            s = 0.5 * root * generator.standard_normal()
            p -= 0.5 * (step * math.sin(q) + s * q)
            q += (step + s) * p
            p -= 0.5 * (step * math.sin(q) + s * q)
        total += q
    return total


@_compiled
def synchrotron_euler(generator, q0, p0, step, steps, paths):
    """omega = 2, sigma1 = 0.2, sigma2 = 0.1."""
    root, total = math.sqrt(step), 0.0
    for _ in range(paths):
        q, p = q0[0], p0[0]
        for _ in range(steps):
            a = 4.0 * step + 0.1 * root * generator.standard_normal()
            b = 0.2 * root * generator.standard_normal()
            p -= a * math.sin(q) + b * math.cos(q)
            q += step * p
        total += q
    return total
