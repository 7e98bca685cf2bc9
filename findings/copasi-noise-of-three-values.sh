#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# COPASI 4.48 (python-copasi 4.48.311 with copasi-basico 0.92, PyPI): the method "SDE Solver (RI5)".
# Guess: dx = dW has normal increments, and so has a concentration; a seed makes a run repeatable.
# Seen: an internal step adds -sqrt(3 h), 0 or sqrt(3 h), h = 1e-4: x stays as it is in two of three steps, and all values are
#     multiples of 0.01732. A concentration is kept from going below 0: its mean from 0 is that of a reflected path, 0.80 sqrt(t),
#     unless "Force Physical Correctness" is off. The method has no setting for a seed: one given to `run_time_course` is taken
#     without a word, and each run is another. The direct method repeats its runs.
# For users of stochastic integrators: moments are right (the scheme is of weak order), paths are not; a concentration has a wall
#     that is not in the equation.
. "$(dirname "$0")/venv.sh" python-copasi==4.48.311 copasi-basico==0.92 numpy==2.4.6 scipy==1.17.1 pandas==3.1.1
python -W ignore - <<'END'
from importlib.metadata import version

import basico
import numpy as np


def paths(kind, count, t, steps, physical=True):
    model = basico.new_model(name=kind)
    if kind == "quantity":
        basico.add_parameter("x", type="ode", initial_value=0.0, expression="0")
        item = model.getModel().getModelValue(0)
    else:
        basico.add_species("x", type="ode", initial_concentration=0.0, expression="0")
        item = model.getModel().getMetabolite(0)
    item.setNoiseExpression("1")
    item.setHasNoise(True)
    model.getModel().compileIfNecessary()
    basico.set_task_settings("Time-Course", {"method": {"name": "SDE Solver (RI5)", "Force Physical Correctness": physical}})
    return np.array([basico.run_time_course(t, steps, method="sde", use_seed=True, seed=seed, use_initial_values=True)
                     .iloc[:, -1].to_numpy() for seed in range(1, count + 1)])


def decay(seed):
    basico.new_model(name="decay")
    basico.add_reaction("R", "A -> B")
    basico.set_species("A", exact=True, initial_particle_number=100)
    basico.set_species("B", exact=True, initial_particle_number=0)
    return basico.run_time_course(2.0, 4, method="directMethod", use_numbers=True, use_seed=True, seed=seed).iloc[:, 0].tolist()


unit = 3e-4**0.5
once, again = (paths("quantity", 1, 0.02, 200)[0] for _ in range(2))
fine = np.diff(once) / unit
ends = paths("quantity", 300, 0.5, 1)[:, -1]
print("COPASI", version("python-copasi"), "increments over sqrt(3 h):", *sorted({int(value) for value in np.round(fine)}))
print("unchanged:", np.mean(abs(fine) < 1e-6), "variance at t = 0.5:", ends.var())
off = abs(ends / unit - np.round(ends / unit)).max()
floor, free = (paths("species", 200, 0.5, 1, physical)[:, -1] for physical in (True, False))
print("largest distance from multiples of 0.01732:", off, "concentrations, mean:", floor.mean(), "smallest:", floor.min())
print("without a floor: mean", free.mean(), "smallest", free.min())
direct = decay(1), decay(1), decay(2)
print("seed 1 twice gives the same: RI5", np.array_equal(once, again), "direct method", direct[0] == direct[1], *direct)
assert not np.array_equal(once, again) and direct[0] == direct[1] != direct[2]
assert np.allclose(fine, np.round(fine), atol=1e-6) and set(np.round(fine)) == {-1, 0, 1} and off < 1e-3
assert 0.48 < np.mean(abs(fine) < 1e-6) < 0.85 and abs(ends.var() - 0.5) < 0.2
assert abs(floor.mean() - np.pi**-0.5) < 0.15 and floor.min() > -1e-4 and abs(free.mean()) < 0.2 and free.min() < 0
END
