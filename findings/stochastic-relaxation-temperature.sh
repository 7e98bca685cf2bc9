#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# stochastic-relaxation 0.1.1 with pint 0.25.3 (PyPI): its integrator, OVRVO.
# Guess: at equilibrium m v^2 and k x^2 have the mean kT.
# Seen: twice that for small friction times step, at the start (which is to be Maxwell and Boltzmann's) and later; m v^2 falls to
#     1.6 kT at gamma h = 0.5, and k x^2 rises to 7 kT at 2. The half step of noise that ends a step and the one that begins the
#     next use the same normal numbers.
# For users of stochastic integrators: two half steps of noise need two draws, or one draw of the whole step's size.
. "$(dirname "$0")/venv.sh" stochastic-relaxation==0.1.1 pint==0.25.3 numpy==2.4.6
python -W ignore - <<'END'
from importlib.metadata import version

import numpy as np
from stochastic_relaxation.ovrvo import OVRVO
from stochastic_relaxation.util.constants import kB
from stochastic_relaxation.util.options import Option

np.random.seed(1)
mass = 300 * kB
print("stochastic-relaxation", version("stochastic-relaxation"), "over kT, in a well of frequency 1/s at friction 1/s")
for h, frames, due in ((0.01, 1500, (2.0, 2.0)), (0.1, 600, (1.9, 2.0)), (0.5, 600, (1.59, 2.1)), (2.0, 600, (1.09, 6.9))):
    options = Option(NP=4000, ND=1, NA=0, dt=f"{h} s", tfinal=f"{h * frames} s", Te="300 K", m=f"{mass} kg", gamma="1 1/s",
                     initial_position=[])
    run = OVRVO(options)
    run.set_force(lambda x: -mass * x)
    for _ in range(run.Nt):
        run.step()
    later = run.Nt // 2
    found = [mass * (a**2).mean() / (300 * kB) for a in (run.velocities[0], run.velocities[later:], run.positions[later:])]
    print("gamma h", h, "m v^2 at the start", found[0], "later", found[1], "k x^2", found[2])
    assert abs(found[0] - 2) < 0.25 and abs(found[1] / due[0] - 1) < 0.05 and abs(found[2] / due[1] - 1) < 0.08
END
