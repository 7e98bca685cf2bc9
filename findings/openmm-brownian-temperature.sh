#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# OpenMM 8.6.1 (PyPI): BrownianIntegrator.
# Guess: kinetic energy, and with it the temperature that StateDataReporter writes, is that of the bath, or zero.
# Seen: it is 2/(gamma h) times the bath's: 6000 K for a bath of 300 K at gamma h = 0.1, 1200 K at 0.5. Velocities are the
#     displacement of the last step over h. Positions have the bath's variance.
# For users of stochastic integrators: overdamped runs show a temperature that depends on the step; nothing is wrong with them, nor
#     does the number say that anything is right.
. "$(dirname "$0")/venv.sh" openmm==8.6.1 numpy==2.4.6
python - <<'END'
import io

import numpy as np
import openmm as mm
from openmm import app

count, mass, temperature, friction = 300, 10.0, 300.0, 10.0
kT = 0.00831446261815324 * temperature
system, well, topology = mm.System(), mm.CustomExternalForce("5*(x*x+y*y+z*z)"), app.Topology()
chain = topology.addChain()
for i in range(count):
    system.addParticle(mass)
    well.addParticle(i)
    topology.addAtom("AR", app.element.argon, topology.addResidue("AR", chain))
system.addForce(well)
print("OpenMM", mm.version.version)
for h in (0.01, 0.05):
    integrator = mm.BrownianIntegrator(temperature, friction, h)
    integrator.setRandomNumberSeed(1)
    run = app.Simulation(topology, system, integrator, mm.Platform.getPlatformByName("Reference"))
    run.context.setPositions(np.zeros((count, 3)))
    run.step(round(40 / h))
    text, squares = io.StringIO(), []
    run.reporters.append(app.StateDataReporter(text, 10, temperature=True))
    for _ in range(100):
        run.step(20)
        squares.append((run.context.getState(positions=True).getPositions(asNumpy=True)._value ** 2).mean())
    shown = np.mean([float(line) for line in text.getvalue().splitlines()[1:]])
    positions = 10 * np.mean(squares) / kT
    print("gamma h", friction * h, "temperature", shown, "over the bath's", shown / temperature, "from positions", positions)
    assert abs(shown / temperature * friction * h / 2 - 1) < 0.05 and abs(positions - 1) < 0.1
END
