# SPDX-License-Identifier: BSD-3-Clause
"""Time models written in Python; prints a line "model NAME SCHEME KIND" and numbers for each.

user_models.py REPEATS: the linear oscillator, H = (p^2 + q^2)/2, H_1 = -q, and the synchrotron, H = p^2/2 - 4 cos q,
H_1 = 0.2 sin q, H_2 = -0.1 cos q: of the catalogue, as NumPy functions, as numba.cfunc, and as a loop of NumPy by hand
with arrays of the library's size. One thread, processor time, all in turn; the numbers are ns per path-step (median,
least, largest) and the median of the ratios to the built-in model, for NumPy functions to the loop by hand.
"""

import math
import statistics
import sys
import time

import numpy as np
import symsde as ss

try:
    import numba
except ImportError:
    numba = None

STEP, PATHS, LANES = 0.02, 4096, 2048
SCHEMES = ("symplectic_euler", "midpoint")
NOISES = {"linear_oscillator": 1, "synchrotron": 2}


def traits(name):
    """What a user declares."""
    linear = name == "linear_oscillator"
    return {
        "ndof": 1,
        "nnoise": NOISES[name],
        "separable": True,
        "position_noise": True,
        "additive": linear,
        "quadratic": linear,
        "identity_mass": True,
    }


def force(name, w, q):
    """d/dq of sum_j w_j H_j."""
    if name == "linear_oscillator":
        return w[0] * q - w[1]
    return (4.0 * w[0] + 0.1 * w[2]) * np.sin(q) + 0.2 * w[1] * np.cos(q)


def stiffness(name, w, q):
    """d2/dq2 of sum_j w_j H_j."""
    if name == "linear_oscillator":
        return w[0] + 0 * q
    return (4.0 * w[0] + 0.1 * w[2]) * np.cos(q) - 0.2 * w[1] * np.sin(q)


def in_numpy(name):
    """The model as NumPy functions."""

    def gradient(_t, w, q, p):
        return force(name, w, q), w[0] * p

    def hessian(_t, w, q, _p):
        return stiffness(name, w, q)[None], np.zeros((1, *q.shape)), w[0][None, None]

    return ss.Model(gradient=gradient, hessian=hessian, **traits(name))


def in_numba(name):
    """The model as numba.cfunc."""
    if name == "synchrotron":
        return joint_in_numba(name)
    return plain_in_numba(name)


def joint_in_numba(name):
    """The synchrotron by the library's sine and cosine, gradient and Hessian together."""
    sincos = ss.numba_sincos()

    @numba.cfunc(ss.numba_signature("gradient"))
    def gradient(nlane, ndof, nham, t, w, q, p, hq, hp, user):  # noqa: PLR0917
        if numba.carray(hq, nlane).ctypes.data != 0:
            sine, cosine = np.empty(nlane), np.empty(nlane)
            sincos(nlane, q, sine.ctypes, cosine.ctypes)
            for i in range(nlane):
                hq[i] = (4.0 * w[i] + 0.1 * w[2 * nlane + i]) * sine[i] + 0.2 * w[nlane + i] * cosine[i]
        if numba.carray(hp, nlane).ctypes.data != 0:
            for i in range(nlane):
                hp[i] = w[i] * p[i]
        return 0

    @numba.cfunc(ss.numba_signature("gradient_hessian"))
    def gradient_hessian(nlane, ndof, nham, t, w, q, p, hq, hp, hqq, hqp, hpp, user):  # noqa: PLR0917
        sine, cosine = np.empty(nlane), np.empty(nlane)
        sincos(nlane, q, sine.ctypes, cosine.ctypes)
        if numba.carray(hq, nlane).ctypes.data != 0:
            for i in range(nlane):
                hq[i] = (4.0 * w[i] + 0.1 * w[2 * nlane + i]) * sine[i] + 0.2 * w[nlane + i] * cosine[i]
        if numba.carray(hqq, nlane).ctypes.data != 0:
            for i in range(nlane):
                hqq[i] = (4.0 * w[i] + 0.1 * w[2 * nlane + i]) * cosine[i] - 0.2 * w[nlane + i] * sine[i]
        if numba.carray(hp, nlane).ctypes.data != 0:
            for i in range(nlane):
                hp[i] = w[i] * p[i]
        if numba.carray(hqp, nlane).ctypes.data != 0:
            for i in range(nlane):
                hqp[i] = 0.0
        if numba.carray(hpp, nlane).ctypes.data != 0:
            for i in range(nlane):
                hpp[i] = w[i]
        return 0

    return ss.Model(gradient=gradient, gradient_hessian=gradient_hessian, accepts_null=True, **traits(name))


def plain_in_numba(name):
    """The model by the sine and cosine of Python, gradient and Hessian apart."""
    linear = name == "linear_oscillator"

    @numba.cfunc(ss.numba_signature("gradient"))
    def gradient(nlane, ndof, nham, t, w, q, p, hq, hp, user):  # noqa: PLR0917
        w = numba.carray(w, (nham, nlane))
        q = numba.carray(q, (ndof, nlane))
        p = numba.carray(p, (ndof, nlane))
        out = numba.carray(hq, (ndof, nlane))
        if out.ctypes.data != 0:
            for i in range(nlane):
                if linear:
                    out[0, i] = w[0, i] * q[0, i] - w[1, i]
                else:
                    a = 4.0 * w[0, i] + 0.1 * w[2, i]
                    out[0, i] = a * math.sin(q[0, i]) + 0.2 * w[1, i] * math.cos(q[0, i])
        out = numba.carray(hp, (ndof, nlane))
        if out.ctypes.data != 0:
            for i in range(nlane):
                out[0, i] = w[0, i] * p[0, i]
        return 0

    @numba.cfunc(ss.numba_signature("hessian"))
    def hessian(nlane, ndof, nham, t, w, q, p, hqq, hqp, hpp, user):  # noqa: PLR0917
        w = numba.carray(w, (nham, nlane))
        q = numba.carray(q, (ndof, nlane))
        out = numba.carray(hqq, (ndof, nlane))
        if out.ctypes.data != 0:
            for i in range(nlane):
                if linear:
                    out[0, i] = w[0, i]
                else:
                    a = 4.0 * w[0, i] + 0.1 * w[2, i]
                    out[0, i] = a * math.cos(q[0, i]) - 0.2 * w[1, i] * math.sin(q[0, i])
        out = numba.carray(hqp, (ndof, nlane))
        if out.ctypes.data != 0:
            for i in range(nlane):
                out[0, i] = 0.0
        out = numba.carray(hpp, (ndof, nlane))
        if out.ctypes.data != 0:
            for i in range(nlane):
                out[0, i] = w[0, i]
        return 0

    return ss.Model(gradient=gradient, hessian=hessian, accepts_null=True, **traits(name))


def by_hand(name, scheme, steps):
    """A loop of NumPy alone, in blocks of LANES paths."""
    generator, noises = np.random.default_rng(1), NOISES[name]
    for _ in range(PATHS // LANES):
        q, p = np.ones((1, LANES)), np.zeros((1, LANES))
        w = np.empty((1 + noises, LANES))
        w[0] = STEP
        for _ in range(steps):
            w[1:] = STEP**0.5 * generator.standard_normal((noises, LANES))
            if scheme == "midpoint":
                v = kick(name, w, q, p)
                q, p = q + w[0] * (p + 0.5 * v), p + v
            else:
                p = p - force(name, w, q)
                q = q + w[0] * p


def kick(name, w, q, p):
    """Change of p in a midpoint step by Newton's iteration; one iteration is enough for a linear force."""
    v = np.zeros_like(p)
    for _ in range(20):
        x = q + 0.5 * w[0] * (p + 0.5 * v)
        d = (v + force(name, w, x)) / (1 + 0.25 * w[0] * stiffness(name, w, x))
        v -= d
        if name == "linear_oscillator" or np.abs(d).max() < 1e-12:
            break
    return v


def candidates(name, scheme):
    """Kind, steps and a call that makes so many."""
    yield "built-in", 5000, runner(ss.Model.builtin(name, {}), scheme)
    if numba:
        yield "numba", 2000, runner(in_numba(name), scheme)
        if name == "synchrotron":
            yield "numba_plain", 2000, runner(plain_in_numba(name), scheme)
    yield "NumPy", 100, runner(in_numpy(name), scheme)
    yield "hand", 100, lambda steps: by_hand(name, scheme, steps)


def runner(model, scheme):
    """A call of so many steps."""

    def run(steps):
        how = {"scheme": scheme, "step": STEP, "steps": steps, "save_every": steps}
        ss.simulate(model, q0=1.0, p0=0.0, paths=PATHS, threads=1, **how)

    run(2)
    return run


def compare(name, scheme, repeats):
    """Time all kinds in turn and print their lines."""
    runs = list(candidates(name, scheme))
    times = {kind: [] for kind, _, _ in runs}
    for _ in range(repeats):
        for kind, steps, run in runs:
            start = time.process_time()
            run(steps)
            times[kind].append((time.process_time() - start) * 1e9 / (PATHS * steps))
    for kind, values in times.items():
        beside = times["hand" if kind == "NumPy" else "built-in"]
        ratio = statistics.median(a / b for a, b in zip(values, beside, strict=True))
        numbers = (statistics.median(values), min(values), max(values), ratio)
        print("model", name, scheme, kind, *(f"{x:.4f}" for x in numbers))


def main():
    """Compare all."""
    for name in NOISES:
        for scheme in SCHEMES:
            compare(name, scheme, int(sys.argv[1]))


if __name__ == "__main__":
    main()
