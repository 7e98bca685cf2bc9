#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# zfpy 1.0.1.post0 (PyPI): fixed-accuracy compression of an ensemble.
# Guess: with tolerance=1e-6 each number comes back within 1e-6; NaN of a failed path is NaN, or refused.
# Seen: beside a path that has grown to 1e30 the 15 other numbers of its block of 4 paths and 4 times come back as 0. NaN
#     comes back as a finite number, infinity too. Nothing is refused.
# For users of stochastic integrators: one path that diverges erases its neighbours in the file, and a failed path looks like a good
#     one; mask failed paths before, or compress each path alone.
. "$(dirname "$0")/venv.sh" zfpy==1.0.1.post0 numpy==2.4.6
python - <<'END'
from importlib.metadata import version

import numpy as np
import zfpy

paths = np.random.default_rng(1).normal(size=(8, 16)).cumsum(1)
print("zfpy", version("zfpy"))


def back(value):
    """The array after a round trip with `value` at one place, and which other numbers are off by more than the tolerance."""
    given = paths.copy()
    given[5, 7] = value
    got = zfpy.decompress_numpy(zfpy.compress_numpy(given, tolerance=1e-6))
    off = ~(abs(got - given) <= 1e-6)
    off[5, 7] = False
    return got, off


got, off = back(1.0)
assert not off.any()
got, off = back(1e30)
print("beside 1e30:", off.sum(), "others are off;", got[4:8, 4:8])
assert off.sum() == 15 and np.array_equal(np.argwhere(off)[[0, -1]], [[4, 4], [7, 7]]) and not got[off].any()
for value in (np.nan, np.inf):
    got, off = back(value)
    print(value, "is read as", got[5, 7], "others off:", off.sum())
    assert np.isfinite(got[5, 7])
END
