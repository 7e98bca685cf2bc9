#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# tvb-library 2.10.0 (PyPI): HeunStochastic with Multiplicative noise; default noise.
# Guess: Heun's scheme solves Stratonovich's equation, EulerStochastic Ito's; two simulators have different noise.
# Seen: for dx = sqrt(2 D) x dW both give the same bits, and Ito's law: the mean of ln x is -D t, Stratonovich's is 0. The
#     predictor enters the drift, not the factor of the noise. Two simulators without a seed have one noise.
# For users of stochastic integrators: a change of the integrator there does not change the calculus, and a sweep of simulators
#     has the same noise in each.
. "$(dirname "$0")/venv.sh" tvb-library==2.10.0 numpy==2.4.6 scipy==1.17.1 numba==0.68.1
python -W ignore - 2> /dev/null <<'END'
from importlib.metadata import version

import numpy as np
from tvb.datatypes.connectivity import Connectivity
from tvb.simulator import coupling, integrators, models, monitors, noise, simulator

count, D, t = 1000, 0.05, 4.0


def run(integrator, dt, kind):
    nodes = np.zeros((count, count))
    net = Connectivity(weights=nodes, tract_lengths=nodes, region_labels=np.arange(count).astype(str),
                       centres=np.zeros((count, 3)), speed=np.array([4.0]))
    sim = simulator.Simulator(
        model=models.Linear(gamma=np.zeros(1)), connectivity=net, coupling=coupling.Linear(a=np.zeros(1)),
        integrator=integrator(dt=dt, noise=kind(nsig=np.array([D]))), monitors=(monitors.Raw(),),
        initial_conditions=np.ones((1, 1, count, 1)), simulation_length=t)
    sim.configure()
    return sim.run()[0][1][-1, 0, :, 0]


print("tvb-library", version("tvb-library"))
for dt in (0.1, 0.02):
    heun, euler = (run(which, dt, noise.Multiplicative) for which in (integrators.HeunStochastic, integrators.EulerStochastic))
    logs = np.log(heun)
    error = logs.std() / count**0.5
    print("dt", dt, "mean of ln x over -D t:", logs.mean() / (-D * t), "+-", error / (D * t))
    print("    same bits:", np.array_equal(heun, euler))
    assert np.array_equal(heun, euler) and abs(logs.mean() + D * t) < 4 * error < 0.1
first, second = (run(integrators.HeunStochastic, 0.1, noise.Additive) for _ in range(2))
print("two simulators, same noise:", np.array_equal(first, second), "variance over 2 D t:", first.var() / (2 * D * t))
assert np.array_equal(first, second) and first.std() > 0
END
