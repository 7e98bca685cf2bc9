#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# tfs-pandas 4.0.2 (PyPI), tables and headers of MAD-X's format.
# Guess: doubles written and read again are the same, as in pandas' own tables.
# Seen: none of 1000 is: twelve significant digits are written, the error is up to 5e-12 of a value; a header likewise.
# For users of stochastic integrators: a run that starts from a saved table is another path, and energy errors of symplectic
#     steps below 1e-12 cannot be seen in a table.
. "$(dirname "$0")/venv.sh" tfs-pandas==4.0.2 numpy==2.4.6 pandas==3.1.1
python - <<'END'
from importlib.metadata import version

import numpy as np
import tfs

rng = np.random.default_rng(1)
x = rng.standard_normal(1000) * 10.0 ** rng.integers(-12, 12, 1000)
tfs.write("a.tfs", tfs.TfsDataFrame({"X": x}, headers={"ENERGY": x[0]}))
back = tfs.read("a.tfs")
error = abs(back.X.to_numpy() / x - 1).max()
print("tfs-pandas", version("tfs-pandas"), "values with their bits:", int((back.X.to_numpy() == x).sum()), "largest error", error)
print("header", x[0], "read", back.headers["ENERGY"])
assert (back.X.to_numpy() == x).sum() < 20 and 1e-12 < error < 1e-11 and back.headers["ENERGY"] != x[0]
END
