#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# sdepack 0.2.0 (PyPI).
# Guess: seeds 1, 2, 3, .. give independent paths, and a solve prints nothing.
# Seen: over seeds 1 to 1000 the first increments of neighbours have correlation 0.68, the Wiener paths at the end (20 steps)
#     0.29, and the variance at the end, t = 1, is 1.52. Seeds that are drawn have no such correlation. Every call writes the
#     whole path as a table to standard output, past sys.stdout.
# For users of stochastic integrators: with a seed a task, counted up, neither means nor variances over tasks are those of
#     independent paths.
. "$(dirname "$0")/venv.sh" sdepack==0.2.0 numpy==2.4.6
python - > table 4> result <<'END'
import os
from importlib.metadata import version

import numpy as np
import sdepack

result = os.fdopen(4, "w")


def paths(seeds):
    found = []
    for seed in seeds:
        x = np.zeros(21)
        sdepack.rk1_ti_solve(lambda x: 0.0, lambda x: 1.0, x, 0.0, 1.0, 0.0, 20, 1.0, int(seed))
        found.append(x)
    return np.array(found)


def neighbours(found, column):
    return np.corrcoef(found[:-1, column], found[1:, column])[0, 1]


counted, drawn = paths(range(1, 1001)), paths(np.random.default_rng(1).integers(1, 2**31 - 2, 1000))
print("sdepack", version("sdepack"), file=result)
print("seeds 1 to 1000, correlation of neighbours: first increment", neighbours(counted, 1), "end", neighbours(counted, 20),
      "variance at the end", counted[:, 20].var(), file=result)
print("drawn seeds: first increment", neighbours(drawn, 1), "end", neighbours(drawn, 20),
      "variance", drawn[:, 20].var(), file=result)
result.flush()
assert neighbours(counted, 1) > 0.5 and neighbours(counted, 20) > 0.2 and counted[:, 20].var() > 1.3
assert abs(neighbours(drawn, 1)) < 0.15 and abs(neighbours(drawn, 20)) < 0.15
END
cat result
echo "lines on standard output: $(wc -l < table)"
[ "$(wc -l < table)" -gt 20000 ]
