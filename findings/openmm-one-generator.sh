#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# OpenMM 8.6.1 (PyPI), Langevin integrators, platform Reference.
# Guess: a Context whose integrator was given a seed has noise of its own, whatever other contexts exist.
# Seen: all contexts of the platform Reference draw from one generator: a context made first and stepped after a second one
#     was made goes the way of the second one's seed, and stepping the two in turn shares one sequence. On the platform CPU
#     each context keeps its own.
# For users of stochastic integrators: an ensemble of contexts in one process is not the ensemble of its seeds; use one
#     context at a time, or the platform CPU.
. "$(dirname "$0")/venv.sh" OpenMM==8.6.1 numpy==2.4.6
python - <<'END'
import numpy as np
import openmm as mm

print("OpenMM", mm.version.short_version)


def context(platform, seed):
    system = mm.System()
    system.addParticle(1.0)
    rule = mm.LangevinMiddleIntegrator(300.0, 1.0, 0.002)
    rule.setRandomNumberSeed(seed)
    made = mm.Context(system, rule, mm.Platform.getPlatformByName(platform))
    made.setPositions(np.zeros((1, 3)))
    made.setVelocities(np.zeros((1, 3)))
    return made, rule


def x(made):
    return made[0].getState(getPositions=True).getPositions(asNumpy=True)._value[0, 0]


for platform in ("Reference", "CPU"):
    alone = {}
    for seed in (1, 2):
        one = context(platform, seed)
        one[1].step(10)
        alone[seed] = x(one)
        del one
    first = context(platform, 1)
    second = context(platform, 2)
    first[1].step(10)
    print(platform, "alone, seeds 1 and 2:", alone, "first context, seed 1, beside one of seed 2:", x(first))
    assert alone[1] != alone[2]
    assert x(first) == alone[2 if platform == "Reference" else 1]
    second[1].step(10)
    print(platform, "second context, seed 2:", x(second))
    assert bool(x(second) == alone[2]) == (platform == "CPU")
END
