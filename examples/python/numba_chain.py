# SPDX-License-Identifier: BSD-3-Clause
"""A chain of one's own by rows, compiled by numba: midpoint in one pass over the chain, as fast as the built-in one.

H = sum p_i^2/2 + sum_i U(q_{i+1} - q_i) between walls, U(r) = r^2/2 + beta r^4/4, H_i = sigma q_i: each mass is pushed.
"""

import sys
import time

import numpy as np
import symsde as ss

try:
    import numba
except ImportError:
    print("skipped: numba is not installed (pip install numba)")
    sys.exit(77)

BETA, SIGMA, N = 1.0, 0.1, 64


@numba.cfunc(ss.numba_signature("gradient"), error_model="numpy")
def gradient(nlane, ndof, nham, t, w, q, p, hq, hp, user):  # noqa: PLR0917 - the C signature
    """Gradient of the weighted sum, for the probes and for schemes that do not ask for rows."""
    weights = numba.carray(w, (nham, nlane))
    x, momentum = numba.carray(q, (ndof, nlane)), numba.carray(p, (ndof, nlane))
    force, velocity = numba.carray(hq, (ndof, nlane)), numba.carray(hp, (ndof, nlane))
    for i in range(ndof):
        for lane in range(nlane):
            left = x[i, lane] - (x[i - 1, lane] if i > 0 else 0.0)
            right = (x[i + 1, lane] if i < ndof - 1 else 0.0) - x[i, lane]
            spring = left * (1 + BETA * left**2) - right * (1 + BETA * right**2)
            force[i, lane] = weights[0, lane] * spring - SIGMA * weights[i + 1, lane]
            velocity[i, lane] = weights[0, lane] * momentum[i, lane]
    return 0


@numba.cfunc(ss.numba_signature("chain_rows"), error_model="numpy")
def rows(nlane, ndof, nham, first, last, t, w, q, hq, hqq, user):  # noqa: PLR0917
    """Force and stiffness of rows first .. last, counted from 0; q begins with the row before, zero beyond the ends."""
    count = last - first + 1
    weights = numba.carray(w, (nham, nlane))
    x = numba.carray(q, (count + 2, nlane))
    force, stiffness = numba.carray(hq, (count, nlane)), numba.carray(hqq, (count, 2, nlane))
    for i in range(count):
        for lane in range(nlane):
            left, right = x[i + 1, lane] - x[i, lane], x[i + 2, lane] - x[i + 1, lane]
            before, behind = BETA * left * left, BETA * right * right
            spring = left * (1 + before) - right * (1 + behind)
            force[i, lane] = weights[0, lane] * spring - SIGMA * weights[first + i + 1, lane]
            stiffness[i, 0, lane] = weights[0, lane] * (2 + 3 * (before + behind))
            stiffness[i, 1, lane] = -weights[0, lane] * (1 + 3 * behind)
    return 0


def seconds(model):
    """Processor time of a run, and its result."""
    start = time.process_time()
    run = ss.simulate(model, q0=0.1, p0=0.0, step=0.1, steps=200, save_every=200, paths=256, seed=1, threads=1)
    return time.process_time() - start, run


own = ss.Model(
    ndof=N,
    nnoise=N,
    gradient=gradient,
    chain_rows=rows,
    bandwidth=1,
    separable=True,
    additive=True,
    identity_mass=True,
)
built_in = ss.models.fpu_chain(n=N, beta=BETA, sigma=SIGMA)
times = {"own": [], "built in": []}
for _ in range(5):
    for name, model in (("own", own), ("built in", built_in)):
        taken, found = seconds(model)
        times[name].append(taken)
        times[name + " q"] = found.q[-1]
for name in ("own", "built in"):
    print(f"{name:9s}{min(times[name]) / (200 * 256) * 1e9:7.0f} ns a path-step")
difference = np.max(np.abs(times["own q"] - times["built in q"]))
print(f"largest difference of their paths: {difference:.1e}")
assert difference < 1e-11
