# SPDX-License-Identifier: BSD-3-Clause
"""Models as a user compiles them by numba.cfunc, plainly: lanes in the inner loop, nothing from the library.

What the loops beside them compute once is computed once here, too: force and slope share their sine and cosine, by
one function for gradient and Hessian, and an angle is read once, since outputs may lie anywhere for all a compiler
knows and a sine that is stored could change the angle of the cosine after it.
"""

import math

import numba
import numpy as np
import symsde as ss
from loops import COSINES


def _model(ndof, nnoise, functions, traits):
    """A model that says which functions it holds: `loop_pointers` calls them, too."""
    model = ss.Model(ndof=ndof, nnoise=nnoise, **functions, **traits, accepts_null=True)
    model.functions = functions
    return model


def synchrotron():
    """H = p^2/2 - 4 cos q, H_1 = 0.2 sin q, H_2 = -0.1 cos q."""

    @numba.cfunc(ss.numba_signature("gradient"))
    def gradient(nlane, ndof, nham, t, w, q, p, hq, hp, user):  # noqa: PLR0917
        w, q, p = numba.carray(w, (nham, nlane)), numba.carray(q, nlane), numba.carray(p, nlane)
        hq, hp = numba.carray(hq, nlane), numba.carray(hp, nlane)
        if hq.ctypes.data != 0:
            for i in range(nlane):
                hq[i] = (4.0 * w[0, i] + 0.1 * w[2, i]) * math.sin(q[i]) + 0.2 * w[1, i] * math.cos(q[i])
        if hp.ctypes.data != 0:
            for i in range(nlane):
                hp[i] = w[0, i] * p[i]
        return 0

    @numba.cfunc(ss.numba_signature("gradient_hessian"))
    def gradient_hessian(nlane, ndof, nham, t, w, q, p, hq, hp, hqq, hqp, hpp, user):  # noqa: PLR0917
        w, q, p = numba.carray(w, (nham, nlane)), numba.carray(q, nlane), numba.carray(p, nlane)
        hq, hp = numba.carray(hq, nlane), numba.carray(hp, nlane)
        hqq, hqp, hpp = numba.carray(hqq, nlane), numba.carray(hqp, nlane), numba.carray(hpp, nlane)
        for i in range(nlane):
            sine, cosine = math.sin(q[i]), math.cos(q[i])
            a, b = 4.0 * w[0, i] + 0.1 * w[2, i], 0.2 * w[1, i]
            if hq.ctypes.data != 0:
                hq[i] = a * sine + b * cosine
            if hqq.ctypes.data != 0:
                hqq[i] = a * cosine - b * sine
            if hp.ctypes.data != 0:
                hp[i] = w[0, i] * p[i]
            if hqp.ctypes.data != 0:
                hqp[i] = 0.0
            if hpp.ctypes.data != 0:
                hpp[i] = w[0, i]
        return 0

    traits = {"separable": True, "position_noise": True, "identity_mass": True}
    functions = {"gradient": gradient, "gradient_hessian": gradient_hessian}
    return _model(1, 2, functions, traits)


def henon_heiles():
    """H = (p.p + q.q)/2 + q_1^2 q_2 - q_2^3/3, H_k = 1e-4 q_k: so little noise that no path escapes in a long run."""

    @numba.cfunc(ss.numba_signature("gradient"))
    def gradient(nlane, ndof, nham, t, w, q, p, hq, hp, user):  # noqa: PLR0917
        w, q, p = numba.carray(w, (nham, nlane)), numba.carray(q, (ndof, nlane)), numba.carray(p, (ndof, nlane))
        hq, hp = numba.carray(hq, (ndof, nlane)), numba.carray(hp, (ndof, nlane))
        if hq.ctypes.data != 0:
            for i in range(nlane):
                x, y = q[0, i], q[1, i]
                hq[0, i] = w[0, i] * (x + 2 * x * y) + 1e-4 * w[1, i]
                hq[1, i] = w[0, i] * (y + x * x - y * y) + 1e-4 * w[2, i]
        if hp.ctypes.data != 0:
            for i in range(nlane):
                hp[0, i], hp[1, i] = w[0, i] * p[0, i], w[0, i] * p[1, i]
        return 0

    @numba.cfunc(ss.numba_signature("gradient_hessian"))
    def gradient_hessian(nlane, ndof, nham, t, w, q, p, hq, hp, hqq, hqp, hpp, user):  # noqa: PLR0917
        w, q, p = numba.carray(w, (nham, nlane)), numba.carray(q, (ndof, nlane)), numba.carray(p, (ndof, nlane))
        hq, hp = numba.carray(hq, (ndof, nlane)), numba.carray(hp, (ndof, nlane))
        hqq, hqp, hpp = numba.carray(hqq, (4, nlane)), numba.carray(hqp, (4, nlane)), numba.carray(hpp, (4, nlane))
        if hq.ctypes.data != 0:
            for i in range(nlane):
                x, y = q[0, i], q[1, i]
                hq[0, i] = w[0, i] * (x + 2 * x * y) + 1e-4 * w[1, i]
                hq[1, i] = w[0, i] * (y + x * x - y * y) + 1e-4 * w[2, i]
        if hqq.ctypes.data != 0:
            for i in range(nlane):
                x, y, h = q[0, i], q[1, i], w[0, i]
                hqq[0, i], hqq[1, i] = h * (1 + 2 * y), h * (2 * x)
                hqq[2, i], hqq[3, i] = h * (2 * x), h * (1 - 2 * y)
        if hp.ctypes.data != 0:
            for i in range(nlane):
                hp[0, i], hp[1, i] = w[0, i] * p[0, i], w[0, i] * p[1, i]
        if hqp.ctypes.data != 0:
            hqp[:] = 0.0
        if hpp.ctypes.data != 0:
            for i in range(nlane):
                hpp[0, i], hpp[1, i], hpp[2, i], hpp[3, i] = w[0, i], 0.0, 0.0, w[0, i]
        return 0

    traits = {"separable": True, "additive": True, "position_noise": True, "identity_mass": True}
    functions = {"gradient": gradient, "gradient_hessian": gradient_hessian}
    return _model(2, 2, functions, traits)


def many_noises(m):
    """H = p^2/2 + q^2/2, H_k = -cos(k) q, k = 1 .. m."""

    @numba.cfunc(ss.numba_signature("gradient"))
    def gradient(nlane, ndof, nham, t, w, q, p, hq, hp, user):  # noqa: PLR0917
        w, q, p = numba.carray(w, (nham, nlane)), numba.carray(q, nlane), numba.carray(p, nlane)
        hq, hp = numba.carray(hq, nlane), numba.carray(hp, nlane)
        if hq.ctypes.data != 0:
            for i in range(nlane):
                force = w[0, i] * q[i]
                for k in range(1, nham):
                    force -= COSINES[k - 1] * w[k, i]
                hq[i] = force
        if hp.ctypes.data != 0:
            for i in range(nlane):
                hp[i] = w[0, i] * p[i]
        return 0

    @numba.cfunc(ss.numba_signature("gradient_hessian"))
    def gradient_hessian(nlane, ndof, nham, t, w, q, p, hq, hp, hqq, hqp, hpp, user):  # noqa: PLR0917
        w, q, p = numba.carray(w, (nham, nlane)), numba.carray(q, nlane), numba.carray(p, nlane)
        hq, hp = numba.carray(hq, nlane), numba.carray(hp, nlane)
        hqq, hqp, hpp = numba.carray(hqq, nlane), numba.carray(hqp, nlane), numba.carray(hpp, nlane)
        if hq.ctypes.data != 0:
            for i in range(nlane):
                force = w[0, i] * q[i]
                for k in range(1, nham):
                    force -= COSINES[k - 1] * w[k, i]
                hq[i] = force
        for i in range(nlane):
            if hp.ctypes.data != 0:
                hp[i] = w[0, i] * p[i]
            if hqq.ctypes.data != 0:
                hqq[i] = w[0, i]
            if hqp.ctypes.data != 0:
                hqp[i] = 0.0
            if hpp.ctypes.data != 0:
                hpp[i] = w[0, i]
        return 0

    traits = {"separable": True, "additive": True, "position_noise": True, "quadratic": True, "identity_mass": True}
    functions = {"gradient": gradient, "gradient_hessian": gradient_hessian}
    return _model(1, m, functions, traits)


def mean_field(n):
    """H = sum_i (p_i^2 + q_i^2)/2 + (1/2n) sum_ij (1 - cos(q_i - q_j)), H_1 = -0.03 sum_i cos(i) q_i."""

    @numba.cfunc(ss.numba_signature("gradient"))
    def gradient(nlane, ndof, nham, t, w, q, p, hq, hp, user):  # noqa: PLR0917
        shape = (ndof, nlane)
        w, q, p = numba.carray(w, (nham, nlane)), numba.carray(q, shape), numba.carray(p, shape)
        hq, hp = numba.carray(hq, shape), numba.carray(hp, shape)
        sines, cosines, moves = np.empty(ndof), np.empty(ndof), hp.ctypes.data != 0
        for lane in range(nlane):
            x, y = 0.0, 0.0
            for i in range(ndof):
                angle = q[i, lane]
                sine, cosine = math.sin(angle), math.cos(angle)
                sines[i], cosines[i] = sine, cosine
                y += sine
                x += cosine
            x, y = x / ndof, y / ndof
            for i in range(ndof):
                pull = sines[i] * x - cosines[i] * y
                hq[i, lane] = w[0, lane] * (q[i, lane] + pull) - 0.03 * COSINES[i] * w[1, lane]
                if moves:  # what is not asked for need not be computed
                    hp[i, lane] = w[0, lane] * p[i, lane]
        return 0

    @numba.cfunc(ss.numba_signature("hessian"))
    def hessian(nlane, ndof, nham, t, w, q, p, hqq, hqp, hpp, user):  # noqa: PLR0917
        w, q = numba.carray(w, (nham, nlane)), numba.carray(q, (ndof, nlane))
        shape = (ndof, ndof, nlane)
        hqq, hqp, hpp = numba.carray(hqq, shape), numba.carray(hqp, shape), numba.carray(hpp, shape)
        sines, cosines = np.empty(ndof), np.empty(ndof)
        mixed, moves = hqp.ctypes.data != 0, hpp.ctypes.data != 0
        for lane in range(nlane):
            x, y = 0.0, 0.0
            for i in range(ndof):
                angle = q[i, lane]
                sine, cosine = math.sin(angle), math.cos(angle)
                sines[i], cosines[i] = sine, cosine
                y += sine
                x += cosine
            x, y = x / ndof, y / ndof
            for i in range(ndof):
                for j in range(ndof):
                    if hqq.ctypes.data != 0:
                        hqq[j, i, lane] = -w[0, lane] * (sines[i] * sines[j] + cosines[i] * cosines[j]) / ndof
                    if mixed:
                        hqp[j, i, lane] = 0.0
                    if moves:
                        hpp[j, i, lane] = 0.0
                if hqq.ctypes.data != 0:
                    hqq[i, i, lane] += w[0, lane] * (1 + cosines[i] * x + sines[i] * y)
                if moves:
                    hpp[i, i, lane] = w[0, lane]
        return 0

    traits = {"separable": True, "additive": True, "position_noise": True, "identity_mass": True}
    return _model(n, 1, {"gradient": gradient, "hessian": hessian}, traits)
