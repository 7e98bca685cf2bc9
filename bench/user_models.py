# SPDX-License-Identifier: BSD-3-Clause
"""Time one model written in several ways; prints a line "user NAME NS" for each, ns per path-step.

user_models.py LIBRARY REPEATS: LIBRARY holds the C functions of user_models.c. The model is the linear oscillator,
H = (p^2 + q^2)/2, H_1 = -q, of the catalogue and of a user; one thread, processor time, all in turn.
"""

import ctypes
import statistics
import sys
import time

import numpy as np
import symsde as ss

try:
    import numba
except ImportError:
    numba = None

STEP, PATHS = 0.02, 4096
TRAITS = {
    "ndof": 1,
    "nnoise": 1,
    "separable": True,
    "additive": True,
    "position_noise": True,
    "quadratic": True,
    "identity_mass": True,
}


def gradient(_t, w, q, p):
    """Gradient of w[0] H + w[1] H_1 in NumPy."""
    return w[0] * q - w[1], w[0] * p


def hessian(_t, w, q, _p):
    """Hessian blocks of the same."""
    return w[0][None, None], np.zeros((1, *q.shape)), w[0][None, None]


def compiled_by_numba():
    """The same as numba.cfunc."""

    @numba.cfunc(ss.numba_signature("gradient"))
    def gradient(nlane, ndof, nham, t, w, q, p, hq, hp, user):  # noqa: PLR0917
        w = numba.carray(w, (nham, nlane))
        q = numba.carray(q, (ndof, nlane))
        p = numba.carray(p, (ndof, nlane))
        out = numba.carray(hq, (ndof, nlane))
        if out.ctypes.data != 0:
            for i in range(nlane):
                out[0, i] = w[0, i] * q[0, i] - w[1, i]
        out = numba.carray(hp, (ndof, nlane))
        if out.ctypes.data != 0:
            for i in range(nlane):
                out[0, i] = w[0, i] * p[0, i]
        return 0

    return gradient


def numpy_loop(steps, lanes):
    """Symplectic Euler by hand, in blocks of so many paths as the library has."""
    generator = np.random.default_rng(1)
    for _ in range(PATHS // lanes):
        q, p = np.ones((1, lanes)), np.zeros((1, lanes))
        w = np.empty((2, lanes))
        w[0] = STEP
        for _ in range(steps):
            w[1] = STEP**0.5 * generator.standard_normal(lanes)
            p = p - (w[0] * q - w[1])
            q = q + w[0] * p


def candidates(library):
    """Name, steps and a call that makes so many."""
    c = ctypes.CDLL(library)
    models = {
        "built-in": ss.Model.builtin("linear_oscillator", {"sigma": 1.0}),
        "C": ss.Model(gradient=c.bench_gradient, hessian=c.bench_hessian, **TRAITS),
        "NumPy callable": ss.Model(gradient=gradient, hessian=hessian, **TRAITS),
    }
    if numba:
        models["numba cfunc"] = ss.Model(gradient=compiled_by_numba(), **TRAITS)
    for name, model in models.items():
        for scheme in ("symplectic_euler", "midpoint"):
            steps = 100 if "callable" in name else 10000
            if name == "numba cfunc" and scheme == "midpoint":
                continue

            def run(steps, model=model, scheme=scheme):
                how = {"scheme": scheme, "step": STEP, "steps": steps, "save_every": steps}
                ss.simulate(model, q0=1.0, p0=0.0, paths=PATHS, threads=1, **how)

            yield f"{name}, {scheme}", steps, run
    yield "NumPy loop by hand, symplectic_euler", 100, lambda steps: numpy_loop(steps, 2048)


def main():
    """Print the medians."""
    library, repeats = sys.argv[1], int(sys.argv[2])
    times = {}
    for _ in range(repeats):
        for name, steps, run in candidates(library):
            start = time.process_time()
            run(steps)
            times.setdefault(name, []).append((time.process_time() - start) * 1e9 / (PATHS * steps))
    for name, values in times.items():
        numbers = " ".join(f"{x:.3f}" for x in (statistics.median(values), min(values), max(values)))
        print("user", name.replace(" ", "_"), numbers)


if __name__ == "__main__":
    main()
