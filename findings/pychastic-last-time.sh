#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# pychastic 0.2.2 with jax 0.10.2 (PyPI).
# Guess: a problem with tmax = 1 is solved up to 1, and the first row of the result is the start.
# Seen: with dt = 0.03 the last time is 0.99, with rows every 7 steps of 0.01 it is 1.05, beyond tmax, without a word; the
#     first row is one step (or 7) after the start.
# For users of stochastic integrators: `solution_values[:, -1]` at several steps are values at several times, so that an order
#     of convergence taken from them measures time. Look at time_values.
. "$(dirname "$0")/venv.sh" pychastic==0.2.2 jax==0.10.2 jaxlib==0.10.2 numpy==2.4.6 scipy==1.17.1
python - <<'END'
import warnings
from importlib.metadata import version

import jax.numpy as jnp
import numpy as np

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    import pychastic

problem = pychastic.sde_problem.SDEProblem(lambda x: 0 * x, lambda x: jnp.array([[x[0]]]), x0=jnp.array([1.0]), tmax=1.0)


def times(dt, chunk):
    solver = pychastic.sde_solver.SDESolver(scheme="milstein", dt=dt)
    found = solver.solve_many(problem, n_trajectories=2, seed=1, chunk_size=chunk, progress_bar=False)
    return np.array(found["time_values"])[0]


print("pychastic", version("pychastic"))
for dt, chunk, first, last in ((0.1, 1, 0.1, 1.0), (0.03, 1, 0.03, 0.99), (0.01, 7, 0.07, 1.05)):
    found = times(dt, chunk)
    print("dt", dt, "a row every", chunk, "steps: first time", found[0], "last time", found[-1])
    assert abs(found[0] - first) < 1e-5 and abs(found[-1] - last) < 1e-5
END
