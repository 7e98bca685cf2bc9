#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# SciPy 1.17.1 (PyPI): stats.qmc.MultivariateNormalQMC on a Sobol sequence without scrambling.
# Guess: 64 points in 8 dimensions have variance 1 within some per cent, and nothing beyond 3: the points are evenly spread.
# Seen: the first point is -6.467 in every coordinate: the sequence begins at the origin, which is pulled in by 5e-11 before the
#     inverse of the normal law. The variance of 64 points is 1.52, of 1024 1.03; without the first point it is 0.89 and 0.99.
#     With `scramble=True` it is right.
# For users of stochastic integrators: one path of 64 has increments of -6.5 standard deviations in all steps.
. "$(dirname "$0")/venv.sh" scipy==1.17.1 numpy==2.4.6
python - <<'END'
import numpy as np
import scipy
from scipy.stats import qmc


def normals(count, scramble):
    engine = qmc.Sobol(8, scramble=scramble, rng=np.random.default_rng(1))
    return qmc.MultivariateNormalQMC(np.zeros(8), engine=engine).random(count)


plain, scrambled = normals(64, False), normals(64, True)
print("SciPy", scipy.__version__, "first point", plain[0])
print("variances of 64 points:", plain.var(), "without the first:", plain[1:].var(), "scrambled:", scrambled.var())
long = normals(1024, False)
print("variances of 1024 points:", long.var(), "without the first:", long[1:].var())
assert np.all(plain[0] < -6.4) and abs(plain[1:]).max() < 3
assert abs(plain.var() - 1.52) < 0.02 and abs(scrambled.var() - 1) < 0.1 and abs(scrambled).max() < 5
END
