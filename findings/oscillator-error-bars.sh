#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# pymbar 4.0.3 and emcee 3.1.6 (PyPI), on series of an oscillator with little friction, sampled from its exact law.
# Guess: the statistical inefficiency g, by which the variance of a mean is larger than that of independent values, comes out
#     within 30 % by both.
# Seen: for q at friction 0.02 and omega h = 0.2, where the exact g is 0.2 (values on both sides of the mean cancel), pymbar
#     says 10 and emcee 2.7: error bars of <q> 7 and 3.7 times too large; the true scatter of means agrees with 0.2. Both sum
#     the correlation up to where it first turns negative, or to a window of a few correlation times. At friction 2 both
#     say 20, which is right.
# For users of stochastic integrators: nearly Hamiltonian paths have correlations that change sign; take errors from
#     independent paths, or from means of blocks that are longer than 1/friction.
. "$(dirname "$0")/venv.sh" pymbar==4.0.3 emcee==3.1.6 numpy==2.3.5 scipy==1.17.1 numexpr==2.14.2
python - 2> log <<'END'
from importlib.metadata import version

import emcee
import numpy as np
from pymbar import timeseries
from scipy.linalg import expm

print("pymbar", version("pymbar"), "emcee", emcee.__version__)
n, h, rng = 40000, 0.2, np.random.default_rng(1)


def series(friction, paths):
    """q at n times, step h, of dq = p dt, dp = -(q + friction p) dt + sqrt(2 friction) dW, in equilibrium."""
    move = expm(h * np.array([[0.0, 1.0], [-1.0, -friction]]))
    noise = np.linalg.cholesky(np.eye(2) - move @ move.T)
    state, found = rng.normal(size=(2, paths)), np.empty((n, paths))
    for i in range(n):
        found[i] = state[0]
        state = move @ state + noise @ rng.normal(size=(2, paths))
    exact = ((np.eye(2) + move) @ np.linalg.inv(np.eye(2) - move))[0, 0]
    return found, exact


for friction in (0.02, 0.5, 2.0):
    q, exact = series(friction, 100)
    scatter = n * q.mean(axis=0).var()
    pymbar = np.mean([timeseries.statistical_inefficiency(q[:, i]) for i in range(3)])
    window = np.mean([emcee.autocorr.integrated_time(q[:, i], quiet=True)[0] for i in range(3)])
    print("friction", friction, "g: exact", exact, "by the scatter of 100 means", scatter, "pymbar", pymbar, "emcee", window)
    assert 0.5 * exact < scatter < 2 * exact
    if friction == 0.02:
        assert pymbar > 40 * exact and window > 10 * exact
    if friction == 2.0:
        assert abs(pymbar / exact - 1) < 0.3 and abs(window / exact - 1) < 0.3
END
