#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# jitcsde 1.6.2 (PyPI), in Python without compiling, dX = -X dt + dW.
# Guess: with one seed, integrate(2) gives the same value whether or not integrate(1) was called before: the step is fixed.
# Seen: the stop at 1 changes the rest of the path by a number of order one, although steps (first_step = max_step = 0.01) are
#     of one size; without a stop two runs are equal, and so are two with the same stops.
# For users of stochastic integrators: the set of saved times belongs to the seed; paths that are saved at other times are
#     other paths.
. "$(dirname "$0")/venv.sh" jitcsde==1.6.2 jitcxde_common==1.5.6 symengine==0.15.0 sympy==1.14.0 numpy==2.4.6 Jinja2==3.1.6 \
   setuptools==80.9.0
python -W ignore - <<'END'
from importlib.metadata import version

import numpy as np
from jitcsde import jitcsde, y
from symengine import Float


def path(*stops):
    run = jitcsde([-y(0)], [Float(1.0)], verbose=False)
    run.set_seed(5)
    run.set_initial_value(np.array([0.0]), 0.0)
    run.set_integration_parameters(atol=1e-6, rtol=1e-6, first_step=0.01, max_step=0.01)
    return [float(run.integrate(t)[0]) for t in stops]


print("jitcsde", version("jitcsde"))
whole, stopped = path(2.0), path(1.0, 2.0)
print("X(2) without a stop", whole[-1], "again", path(2.0)[-1], "with a stop at 1", stopped[-1], "again", path(1.0, 2.0)[-1])
assert whole == path(2.0) and stopped == path(1.0, 2.0)
assert abs(whole[-1] - stopped[-1]) > 0.05
END
