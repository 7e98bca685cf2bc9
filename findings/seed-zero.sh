#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# OpenMM 8.6.1 and QuantLib 1.44 (PyPI).
# Guess: seed 0 is a seed as any other: two runs of it are equal. A job array counts from 0.
# Seen: in both seed 0 asks for a seed by chance: two runs of seed 0 in one program differ, two of seed 1 are equal.
# For users of stochastic integrators: the first task of an array whose index is the seed cannot be repeated; give index + 1.
. "$(dirname "$0")/venv.sh" OpenMM==8.6.1 QuantLib==1.44 numpy==2.4.6
python - <<'END'
import numpy as np
import openmm as mm
import QuantLib as ql

print("OpenMM", mm.version.short_version, "QuantLib", ql.__version__)


def langevin(seed):
    system = mm.System()
    system.addParticle(1.0)
    rule = mm.LangevinMiddleIntegrator(300.0, 1.0, 0.002)
    rule.setRandomNumberSeed(seed)
    context = mm.Context(system, rule, mm.Platform.getPlatformByName("Reference"))
    context.setPositions(np.zeros((1, 3)))
    rule.step(5)
    return context.getState(getPositions=True).getPositions(asNumpy=True)._value[0, 0]


def quantlib(seed):
    process = ql.OrnsteinUhlenbeckProcess(1.0, 1.0)
    normal = ql.GaussianRandomSequenceGenerator(ql.UniformRandomSequenceGenerator(5, ql.UniformRandomGenerator(seed)))
    return ql.GaussianPathGenerator(process, 1.0, 5, normal, False).next().value()[5]


for name, run in (("OpenMM", langevin), ("QuantLib", quantlib)):
    zeros, ones = [run(0) for _ in range(3)], [run(1) for _ in range(3)]
    print(name, "seed 0:", zeros, "seed 1:", ones)
    assert len(set(zeros)) == 3 and len(set(ones)) == 1
END
