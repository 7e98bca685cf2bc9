#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# dynamiqs 0.3.7 with jax 0.10.2 (PyPI): dsmesolve, dssesolve.
# Guess: saved times that are no multiples of dt are refused, as documented; a key is a path, so that saving every second time
#     shows the same path, and its measurement is the mean of two finer ones.
# Seen: they are refused for dt = 0.01, but pass for dt = 1e-8, the same problem in another unit of time: the comparison has an
#     absolute tolerance of 1e-5. For a spacing of 1.5 dt two steps are made: the population at "1.5" is exp(-2). With another
#     spacing of the saved times the same key gives another path.
# For users of stochastic integrators: in seconds, as microwave circuits are written, decay rates come out wrong by a third.
. "$(dirname "$0")/venv.sh" dynamiqs==0.3.7 jax==0.10.2 jaxlib==0.10.2 numpy==2.4.6
python -W ignore - 2> /dev/null <<'END'
from importlib.metadata import version

import dynamiqs as dq
import jax
import numpy as np

dq.set_precision("double")
keys = jax.random.split(jax.random.key(1), 3)
lower, z = dq.sigmam(), dq.sigmaz()
method = dq.method.EulerMaruyama
print("dynamiqs", version("dynamiqs"))
for unit in (1.0, 1e-6):
    times = 0.015 * unit * np.arange(101)
    try:
        run = dq.dsmesolve(0 * z, [np.sqrt(1 / unit) * lower, 1e-9 * z], [0.0, 1.0], dq.basis(2, 0), times, keys,
                           exp_ops=[lower.dag() @ lower], method=method(dt=0.01 * unit))
        end = np.asarray(run.expects)[0, 0, -1].real
        print("dt", 0.01 * unit, "population at the last time:", end, "exp(-1.5) is", np.exp(-1.5))
        assert unit == 1e-6 and abs(end / 0.99**200 - 1) < 1e-6
    except ValueError as refused:
        print("dt", 0.01 * unit, "refused:", refused)
        assert unit == 1.0 and "multiples" in str(refused)
records = {}
for count in (11, 6):
    run = dq.dssesolve(0 * z, [z], dq.basis(2, 0) + dq.basis(2, 1), np.linspace(0, 1, count), keys, method=method(dt=0.01))
    records[count] = np.asarray(run.measurements)[:, 0].reshape(3, 5, -1).mean(2)
print("means over 0.2 saved every 0.1:", *records[11][0], "and every 0.2:", *records[6][0])
assert np.all(abs(records[11] - records[6]).max(1) > 0.1)
END
