#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# OpenMM 8.6.1 (PyPI).
# Guess: LangevinIntegrator and LangevinMiddleIntegrator are two schemes, as their descriptions say, and a comparison of the
#     two at a large step shows two errors.
# Seen: with equal seeds their paths are equal bit for bit: there is one scheme under two names.
# For users of stochastic integrators: two names in a comparison are no evidence of two methods; compare one path first.
. "$(dirname "$0")/venv.sh" OpenMM==8.6.1 numpy==2.4.6
python - <<'END'
import numpy as np
import openmm as mm

print("OpenMM", mm.version.short_version)


def path(kind, friction=1.0, seed=7):
    system = mm.System()
    system.addParticle(1.0)
    force = mm.CustomExternalForce("50*x^2 + 30*y^4 + 10*z^2")
    force.addParticle(0)
    system.addForce(force)
    rule = kind(300.0, friction, 0.05)
    rule.setRandomNumberSeed(seed)
    context = mm.Context(system, rule, mm.Platform.getPlatformByName("Reference"))
    context.setPositions([(0.1, 0.2, 0.3)])
    context.setVelocities([(0.0, 0.0, 0.0)])
    found = []
    for _ in range(200):
        rule.step(1)
        found.append(context.getState(getPositions=True).getPositions(asNumpy=True)._value[0])
    return np.array(found)


a, b = path(mm.LangevinIntegrator), path(mm.LangevinMiddleIntegrator)
c = path(mm.LangevinMiddleIntegrator, friction=1.001)
print("largest difference of 200 steps of h = 0.05:", abs(a - b).max(), "and with friction 1.001 for 1:", abs(a - c).max())
assert (a == b).all() and (a != c).any() and np.isfinite(a).all()
END
