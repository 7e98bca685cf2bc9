#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# chaospy 4.3.21 (PyPI): samples with `antithetic=True`.
# Guess: n antithetic samples are n/2 independent ones and their opposites; `antithetic=False` is the default.
# Seen: each independent sample comes with all 2^d choices of signs of its d coordinates: 64 samples of a Wiener path of 6 steps
#     hold one size of each increment, 100 hold two, and 100 of 8 steps one. Where 2^d does not divide n the mean is not 0.
#     With `antithetic=False` (the default is None) 4 samples come back where 64 of 6 coordinates were asked for.
# For users of stochastic integrators: the mean square of an increment over 64 paths of 6 steps scatters 6.5 times as much as
#     over 64 independent paths.
. "$(dirname "$0")/venv.sh" chaospy==4.3.21 numpoly==1.3.9 numpy==2.4.6 scipy==1.17.1
python - <<'END'
from importlib.metadata import version

import chaospy
import numpy as np


def draw(steps, count, seed, antithetic):
    np.random.seed(seed)
    return chaospy.Iid(chaospy.Normal(0, 1), steps).sample(count, antithetic=antithetic)


print("chaospy", version("chaospy"))
for steps, count, sizes in ((6, 64, 1), (6, 100, 2), (8, 100, 1)):
    found = draw(steps, count, 1, True)
    distinct = [len(np.unique(np.round(abs(row), 12))) for row in found]
    print(steps, "steps", count, "samples: sizes of each increment", distinct, "largest mean", abs(found.mean(axis=1)).max())
    assert found.shape == (steps, count) and distinct == [sizes] * steps
    assert (abs(found.mean(axis=1)).max() < 1e-12) == (count % 2**steps == 0)
spread = [np.std([(draw(6, 64, seed, kind)[0] ** 2).mean() for seed in range(300)]) for kind in (None, True)]
print("standard deviation of the mean of an increment's square over 64 samples:", *spread, "ratio", spread[1] / spread[0])
print("antithetic=False:", draw(6, 64, 1, False).shape, "default:", draw(6, 64, 1, None).shape)
assert draw(6, 64, 1, False).shape == (6, 4) and draw(6, 64, 1, None).shape == (6, 64)
assert 5 < spread[1] / spread[0] < 10
END
