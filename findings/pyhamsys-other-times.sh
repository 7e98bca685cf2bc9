#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# pyHamSys 0.90 (PyPI): solve_ivp_symp.
# Guess: values are given at the times of `t_eval`, with the step that was asked for, or the next smaller one that fits.
# Seen: with a step of 0.3 the times 0, 0.25, 0.5, 1 become 0, 0.333, 0.5, 1: `sol.t` says so, and values are those of its times.
#     Without `t_eval` a step of 0.1 on [0, 1] is 1/11, and one of 0.07 is 1/30.
# For users of stochastic integrators: rows set beside rows at the times asked for are 0.08 off in time; an order fitted to the
#     steps asked for is off.
. "$(dirname "$0")/venv.sh" pyhamsys==0.90 numpy==2.4.6 scipy==1.17.1
python - <<'END'
from importlib.metadata import version

import numpy as np
import pyhamsys


def kick_drift(h, t, y):
    p = y[1] - h * y[0]
    return np.array([y[0] + h * p, p])


def drift_kick(h, t, y):
    q = y[0] + h * y[1]
    return np.array([q, y[1] - h * q])


def solve(step, times=None):
    options = pyhamsys.Parameters(step=step, solver="BM4", display=False)
    return pyhamsys.solve_ivp_symp(kick_drift, drift_kick, (0.0, 1.0), np.array([1.0, 0.0]), t_eval=times, params=options)


asked = np.array([0.0, 0.25, 0.5, 1.0])
found = solve(0.3, asked)
steps = [solve(step).step for step in (0.1, 0.07)]
print("pyHamSys", version("pyhamsys"), "asked", asked, "given", found.t, "error of q at these", found.y[0] - np.cos(found.t))
print("steps for 0.1 and 0.07:", *steps)
assert abs(found.t[1] - 1 / 3) < 1e-12 and np.allclose(found.t[[0, 2, 3]], asked[[0, 2, 3]])
assert abs(found.y[0] - np.cos(found.t)).max() < 1e-4
assert abs(steps[0] - 1 / 11) < 1e-12 and abs(steps[1] - 1 / 30) < 1e-12
END
