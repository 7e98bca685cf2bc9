#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# OpenMM 8.6.1 (PyPI), CustomIntegrator, platforms Reference and CPU.
# Guess: every `gaussian` in an expression of addComputePerDof is a new number, so `gaussian-gaussian` has variance 2 and
#     `gaussian*gaussian` has mean 0.
# Seen: all of them in one expression are one number for a degree of freedom: the difference is 0 for every particle, the
#     product has mean 1, the sum variance 4. Two expressions, one after the other, have independent numbers (variance 2).
#     `uniform` and addComputeGlobal do the same.
# For users of stochastic integrators: a step that needs two increments, dW and the integral of W, cannot draw them in one
#     expression: a variable of its own takes the first.
. "$(dirname "$0")/venv.sh" OpenMM==8.6.1 numpy==2.4.6
python - <<'END'
import numpy as np
import openmm as mm

print("OpenMM", mm.version.short_version)
assert mm.version.short_version.startswith("8.6.1")
N = 3000


def sample(platform, *expressions):
    """x of 3 N degrees of freedom after one step: of the last expression, which may use a, the first one."""
    system = mm.System()
    for _ in range(N):
        system.addParticle(1.0)
    rule = mm.CustomIntegrator(0.001)
    rule.setRandomNumberSeed(3)
    rule.addPerDofVariable("a", 0.0)
    for name, expression in zip(("x", "a x")[len(expressions) - 1].split(), expressions, strict=True):
        rule.addComputePerDof(name, expression)
    context = mm.Context(system, rule, mm.Platform.getPlatformByName(platform))
    context.setPositions(np.zeros((N, 3)))
    rule.step(1)
    return context.getState(getPositions=True).getPositions(asNumpy=True)._value.ravel()


for platform in ("Reference", "CPU"):
    difference, product = sample(platform, "gaussian-gaussian"), sample(platform, "gaussian*gaussian")
    total, two = sample(platform, "gaussian+gaussian"), sample(platform, "gaussian", "a-gaussian")
    print(platform, "largest |g - g|", abs(difference).max(), "mean of g g", product.mean(),
          "variance of g + g", total.var(), "variance of two expressions", two.var())
    assert (difference == 0).all() and (sample(platform, "uniform-uniform") == 0).all()
    assert abs(product.mean() - 1) < 0.1 and abs(total.var() - 4) < 0.3 and abs(two.var() - 2) < 0.15
END
