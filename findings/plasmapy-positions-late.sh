#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# PlasmaPy 2025.8.0 (PyPI, the last one for Python 3.11), ParticleTracker with Boris' algorithm.
# Guess: positions and velocities of a gyration are of second order in dt at the times that are told; frames saved every 0.1 and
#     a run until 1 give 0.1, 0.2, .. 1.
# Seen: velocities are of second order, positions of first: they are those of a start half a step off, 2.1 % of the gyroradius
#     at omega dt = 0.05. With dt = 0.0125 frames stand at 0.1, 0.2125, 0.325, 0.425, .. 1.0125, with dt = 0.1 none stands at 0.4:
#     an interval may last a step longer, the next begins there, and one step is made beyond the end.
# For users of stochastic integrators: a reference path from there ends one order below the scheme that it is to judge, and is
#     compared at other times than asked for; start it with the velocity at -dt/2.
. "$(dirname "$0")/venv.sh" plasmapy==2025.8.0 numpy==2.4.6 scipy==1.17.1 astropy==8.0.2
python -W ignore - 2> /dev/null <<'END'
from importlib.metadata import version

import astropy.constants as const
import astropy.units as u
import numpy as np
from plasmapy.particles import Particle
from plasmapy.plasma.grids import CartesianGrid
from plasmapy.simulation.particle_tracker.particle_tracker import ParticleTracker
from plasmapy.simulation.particle_tracker.save_routines import IntervalSaveRoutine
from plasmapy.simulation.particle_tracker.termination_conditions import TimeElapsedTerminationCondition

field, radius = 1e-4, 0.1
omega = const.e.si.value * field / const.m_p.si.value
grid = CartesianGrid(-1 * u.m, 1 * u.m, num=20)
zero = np.zeros(grid.shape) * u.T
grid.add_quantities(B_x=zero, B_y=zero, B_z=zero + field * u.T)


def gyration(steps, late=0.0):
    """Errors of x and v at the end of omega t = 1, and the saved times; late: phase of the start velocity, in steps."""
    dt = 1 / steps
    save = IntervalSaveRoutine(0.1 / omega * u.s)
    tracker = ParticleTracker(grid, TimeElapsedTerminationCondition((1 - 1e-9) / omega * u.s), save, dt=dt / omega * u.s,
                              verbose=False, field_weighting="nearest neighbor")
    start = radius * omega * np.array([[np.cos(late * dt), -np.sin(late * dt), 0]])
    tracker.load_particles(np.zeros((1, 3)) * u.m, start * u.m / u.s, Particle("p+"))
    tracker.run()
    t = float(np.ravel(tracker.time)[0]) * omega
    x = radius * np.array([np.sin(t), np.cos(t) - 1, 0])
    v = radius * omega * np.array([np.cos(t), -np.sin(t), 0])
    times = np.ravel(u.Quantity(save.results["time"]).value) * omega
    return abs(tracker.x[0] - x).max() / radius, abs(tracker.v[0] - v).max() / (radius * omega), times


print("PlasmaPy", version("plasmapy"))
found = {steps: gyration(steps) for steps in (10, 20, 40, 80)}
for steps, (x, v, times) in found.items():
    print("omega dt", 1 / steps, "error of x", x, "of v", v, "x with the velocity of -dt/2", gyration(steps, -0.5)[0])
    print("   saved at", *times.round(6))
for coarse, fine in ((10, 20), (20, 40), (40, 80)):
    (x, v, _), (finer_x, finer_v, _) = found[coarse], found[fine]
    assert 1.8 < x / finer_x < 2.2 and 3.5 < v / finer_v < 4.6
assert gyration(80, -0.5)[0] < 0.02 * found[80][0]
assert np.allclose(found[80][2][[0, 1, 2, 3, -1]], [0.1, 0.2125, 0.325, 0.425, 1.0125])
assert abs(found[10][2] - 0.4).min() > 0.09
END
