#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# freud-analysis 3.4.0 (PyPI, the last one for Python 3.11), msd.MSD; tidynamics 1.1.2 beside it.
# Guess: the mean squared displacement of Brownian paths does not depend on where they begin, but for the digits of single
#     precision, 1e-6 of it at a distance of 1e4 steps.
# Seen: mode "window" has 1.08 times the first value at 1e3 steps from the origin, ten times at 1e4, and -2500 times
#     that at lag 10 at 1e6: Fourier sums of squares of positions in single precision cancel. Mode "direct" is right to 1e-3 at
#     1e4, tidynamics everywhere.
# For users of stochastic integrators: unwrapped, driven or drifting paths are far from the origin; subtract each path's first
#     position before.
. "$(dirname "$0")/venv.sh" freud-analysis==3.4.0 tidynamics==1.1.2 numpy==2.4.6 scipy==1.17.1 rowan==1.3.2
python -W ignore - <<'END'
import freud
import numpy as np
import tidynamics

steps, paths, lags = 400, 200, [1, 10, 100]
rng = np.random.default_rng(1)
walk = np.concatenate([np.zeros((1, paths, 3)), np.cumsum(rng.normal(size=(steps, paths, 3)), axis=0)])
print("freud", freud.__version__, "mean squared displacement over 3 n of n =", *lags, "steps of variance 1")
found = {}
for away in (0.0, 1e3, 1e4, 1e6):
    for mode in ("window", "direct"):
        found[mode, away] = freud.msd.MSD(mode=mode).compute(walk + away).msd[lags] / (3 * np.array(lags))
    found["tidynamics", away] = np.mean([tidynamics.msd(walk[:, i] + away) for i in range(paths)], axis=0)[lags] / (3 * np.array(lags))
    for name in ("window", "direct", "tidynamics"):
        print("begin at", away, name, *found[name, away])
near = {name: found[name, 0.0] for name in ("window", "direct", "tidynamics")}
assert np.allclose(near["window"], near["tidynamics"], rtol=1e-3) and np.all(abs(near["window"] - 1) < 0.1)
assert found["window", 1e3][0] > 1.05 and found["window", 1e4][0] > 5 and found["window", 1e6].min() < -100
assert np.allclose(found["direct", 1e4], near["direct"], rtol=2e-3)
assert np.allclose(found["tidynamics", 1e6], near["tidynamics"], rtol=1e-2)
END
