# SPDX-License-Identifier: BSD-3-Clause
# ruff: noqa: PLR0917
"""The plain loops that a user of numba would write instead of calling the library: `topics/loops.py` times both.

Every loop goes over paths and steps, draws each normal when it is needed from NumPy's Generator (PCG64 and ziggurat, as
numba compiles them), and keeps only results that its name mentions. Implicit schemes iterate, one unknown by Newton's
method to rounding, several by fixed-point iteration from the explicit guess, which converges at the mild steps of the
rows, until positions change by `ROUNDING` or less. No -ffast-math: results would not be comparable.

A loop is `run(generator, q0, p0, step, steps, paths)`, q0 and p0 arrays of one number for each degree of freedom. The
functions of a scene, and the step of a scheme, are inlined as if written in the loop: with one degree of freedom
`step(w, t, q, p)` returns q and p; with several `step(w, t, q, p, x, f)` changes the arrays q and p, and x and f are
room for stages.
"""

import math

import numba
import numpy as np

ROUNDING = 1e-14
BOUND = 100
_inlined = numba.njit(inline="always")  # forced, since LLVM would call large steps


def loop(scene, scheme, keep="nothing"):
    """The loop of a scheme on a scene; keep: "nothing", "states" or "moments"."""
    s = scene.functions(compiled=_inlined)
    if scheme in TABLEAUX and (scene.ndof > 1 or scheme != "midpoint"):
        return _of_arrays(_collocation(s, scene.ndof, TABLEAUX[scheme]), scene, len(TABLEAUX[scheme][2]), keep)
    if scene.ndof > 1:
        return _of_arrays(_kick_drift(s, scene.ndof, half=scheme == "stormer_verlet"), scene, 1, keep)
    midpoint = _linear_midpoint if s.linear else _midpoint
    makers = {"symplectic_euler": _euler, "stormer_verlet": _verlet, "midpoint": midpoint, "taylor": _taylor}
    return _of_numbers(makers[scheme](s), scene.nnoise * (2 if scheme == "taylor" else 1), keep)


def loop_of_increments(scene, scheme):
    """A loop that reads its increments, run(dw, q0, p0, step), dw[path, step, noise]."""
    s = scene.functions(compiled=_inlined)
    if scene.ndof > 1 or scheme == "gauss2":
        return _of_given_arrays(s, scene.ndof, scheme)
    makers = {"stormer_verlet": _verlet, "midpoint": _linear_midpoint if s.linear else _midpoint}
    step_of = makers[scheme](s)

    @numba.njit
    def run(dw, q0, p0, step):
        w, total = np.empty(dw.shape[2] + 1), 0.0
        w[0] = step
        for path in range(dw.shape[0]):
            q, p = q0, p0
            for i in range(dw.shape[1]):
                for k in range(dw.shape[2]):
                    w[k + 1] = dw[path, i, k]
                q, p = step_of(w, i * step, q, p)
            total += q
        return total

    return run


def _of_given_arrays(s, n, scheme):
    a = TABLEAUX.get(scheme)
    step_of, stages = (_collocation(s, n, a), len(a[2])) if a else (_kick_drift(s, n, half=True), 1)

    @numba.njit
    def run(dw, q0, p0, step):
        q, p, w, total = np.empty(n), np.empty(n), np.empty(dw.shape[2] + 1), 0.0
        x, f = np.empty((stages, n)), np.empty((stages, n))
        w[0] = step
        for path in range(dw.shape[0]):
            q[:], p[:] = q0, p0
            for i in range(dw.shape[1]):
                for k in range(dw.shape[2]):
                    w[k + 1] = dw[path, i, k]
                step_of(w, i * step, q, p, x, f)
            total += q[0]
        return total

    return run


# ---- loops over paths and steps ---------------------------------------------------------------------------------


def _of_numbers(step_of, m, keep):
    place, kept = KEPT[keep]

    @numba.njit
    def run(generator, q0, p0, step, steps, paths):
        root, total = math.sqrt(step), 0.0
        w, saved = np.empty(m + 1), place(paths, steps, 1)
        w[0] = step
        for path in range(paths):
            q, p = q0[0], p0[0]
            kept(saved, path, 0, q, p)
            for i in range(steps):
                for k in range(m):
                    w[k + 1] = root * generator.standard_normal()
                q, p = step_of(w, i * step, q, p)
                kept(saved, path, i + 1, q, p)
            total += q
        return total

    return run


def loop_by_path(scene, scheme):
    """The loop `run(generator, q0, p0, step, steps, strengths)` whose first noise is stronger by a factor by path; it
    keeps the last states.
    """
    s = scene.functions(compiled=_inlined)
    step_of, m = (_linear_midpoint if s.linear else _midpoint)(s) if scheme == "midpoint" else _verlet(s), scene.nnoise

    @numba.njit
    def run(generator, q0, p0, step, steps, strengths):
        root, last = math.sqrt(step), np.empty((2, len(strengths)))
        w = np.empty(m + 1)
        w[0] = step
        for path in range(len(strengths)):
            q, p = q0[0], p0[0]
            for i in range(steps):
                for k in range(m):
                    w[k + 1] = root * generator.standard_normal()
                w[1] *= strengths[path]
                q, p = step_of(w, i * step, q, p)
            last[0, path], last[1, path] = q, p
        return last

    return run


def _of_arrays(step_of, scene, stages, keep):
    n, m, (place, kept) = scene.ndof, scene.nnoise, KEPT[keep + " of arrays"]

    @numba.njit
    def run(generator, q0, p0, step, steps, paths):
        root, total = math.sqrt(step), 0.0
        q, p, w, saved = np.empty(n), np.empty(n), np.empty(m + 1), place(paths, steps, n)
        x, f = np.empty((stages, n)), np.empty((stages, n))
        w[0] = step
        for path in range(paths):
            q[:], p[:] = q0, p0
            kept(saved, path, 0, q, p)
            for i in range(steps):
                for k in range(m):
                    w[k + 1] = root * generator.standard_normal()
                step_of(w, i * step, q, p, x, f)
                kept(saved, path, i + 1, q, p)
            total += q[0]
        return total

    return run


@numba.njit
def _no_place(paths, steps, n):
    return 0


@numba.njit
def _nothing(saved, path, i, q, p):
    pass


@numba.njit
def _place_of_states(paths, steps, n):
    return np.empty((paths, steps + 1, 2 * n))


@numba.njit
def _state(saved, path, i, q, p):
    saved[path, i, 0], saved[path, i, 1] = q, p


@numba.njit
def _state_of_arrays(saved, path, i, q, p):
    n = len(q)
    for j in range(n):
        saved[path, i, j], saved[path, i, n + j] = q[j], p[j]


@numba.njit
def _place_of_moments(paths, steps, n):
    return np.zeros((2, steps + 1, 4))


@numba.njit
def _moments(saved, path, i, q, p):
    """Means and sums of squared deviations of q, p, an oscillator's energy, and q p (Welford)."""
    for j, x in enumerate((q, p, 0.5 * (q * q + p * p), q * p)):
        d = x - saved[0, i, j]
        saved[0, i, j] += d / (path + 1)
        saved[1, i, j] += d * (x - saved[0, i, j])


KEPT = {
    "nothing": (_no_place, _nothing),
    "nothing of arrays": (_no_place, _nothing),
    "states": (_place_of_states, _state),
    "states of arrays": (_place_of_states, _state_of_arrays),
    "moments": (_place_of_moments, _moments),
}


# ---- steps of one degree of freedom -----------------------------------------------------------------------------


def _euler(s):
    force, mass = s.force, s.mass

    @_inlined
    def step(w, t, q, p):
        p += force(w, t, q)
        return q + mass(w) * p, p

    return step


def _verlet(s):
    force, mass = s.force, s.mass

    @_inlined
    def step(w, t, q, p):
        p += 0.5 * force(w, t, q)
        q += mass(w) * p
        return q, p + 0.5 * force(w, t + w[0], q)

    return step


def _linear_midpoint(s):
    """The midpoint step of a linear force in closed form."""
    slope, mass = s.slope, s.mass

    @_inlined
    def step(w, t, q, p):
        e, (f, derivative) = mass(w), slope(w, t + 0.5 * w[0], q)
        part = 1 / (1 - 0.25 * e * derivative)  # computed before q and p are ready
        return q + (e * part) * (p + 0.5 * f), p + part * (f + 0.5 * e * derivative * p)

    return step


def _midpoint(s):
    """Newton's method for v = dp: v - f(q + mass (p + v/2)/2) = 0."""
    slope, mass = s.slope, s.mass

    @_inlined
    def step(w, t, q, p):
        e, v = mass(w), 0.0
        for _ in range(BOUND):
            f, derivative = slope(w, t + 0.5 * w[0], q + 0.5 * e * (p + 0.5 * v))
            change = (v - f) / (1 - 0.25 * e * derivative)
            v -= change
            if not abs(change) > 1e-10:  # the next correction would be rounding
                break
        return q + e * (p + 0.5 * v), p + v

    return step


def _taylor(s):
    """Stochastic Taylor scheme of strong order 3/2 for H = p^2/2 + U(q), two noises in position (Kloeden, Platen 1992):
    as a user would write it; not symplectic. Its last two normals give dZ of the two noises."""
    force, slope, part = s.force, s.slope, math.sqrt(1 / 12)

    @_inlined
    def step(w, t, q, p):
        h = w[0]
        z1, z2 = h * (0.5 * w[1] + part * w[3]), h * (0.5 * w[2] + part * w[4])
        kick = force(w, t, q)
        bent = slope((0.5 * h * h, h * w[1] - z1, h * w[2] - z2), t, q)[1]
        return q + h * p + force((0.5 * h * h, z1, z2), t, q), p + kick + p * bent

    return step


# ---- steps of several -------------------------------------------------------------------------------------------


def _kick_drift(s, n, half):
    """Stormer-Verlet with two half kicks, or symplectic Euler with one whole kick."""
    force, part = s.force, 0.5 if half else 1.0

    @_inlined
    def step(w, t, q, p, x, f):
        force(w, t, q, f[0])
        for i in range(n):
            p[i] += part * f[0, i]
            q[i] += w[0] * p[i]
        if half:
            force(w, t + w[0], q, f[0])
            for i in range(n):
                p[i] += 0.5 * f[0, i]

    return step


def _collocation(s, n, tableau):
    """A Runge-Kutta pair with its momenta eliminated: Q_i = q + mass (c_i p + sum_j (a abar)_ij F_j)."""
    a, abar, b = tableau
    stages, product, c, weights = len(b), a @ abar, a.sum(axis=1), b @ abar
    number, mass = s.force, s.mass
    force = number if n > 1 else numba.njit(lambda w, t, q, f: _set(f, number(w, t, q[0])))

    @_inlined
    def step(w, t, q, p, x, f):
        e = mass(w)
        for i in range(stages):
            for j in range(n):
                x[i, j] = q[j] + c[i] * e * p[j]
        for _ in range(BOUND):
            for i in range(stages):
                force(w, t + c[i] * w[0], x[i], f[i])
            change = 0.0
            for i in range(stages):
                for j in range(n):
                    moved = 0.0
                    for k in range(stages):
                        moved += product[i, k] * f[k, j]
                    moved = q[j] + e * (c[i] * p[j] + moved)
                    change = max(change, abs(moved - x[i, j]))
                    x[i, j] = moved
            if not change > ROUNDING:
                break
        for j in range(n):
            dq, dp = p[j], 0.0
            for k in range(stages):
                dq += weights[k] * f[k, j]
                dp += b[k] * f[k, j]
            q[j] += e * dq
            p[j] += dp

    return step


@numba.njit
def _set(f, value):
    f[0] = value


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
