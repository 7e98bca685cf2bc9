#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# gsd 5.0.1 (PyPI), HOOMD's schema.
# Guess: a frame that is saved without velocities has none, or zeros.
# Seen: it has those of frame 0, as long as the number of particles is the same; with another number it has zeros. (The schema
#     says so: what a frame lacks is that of frame 0.)
# For users of stochastic integrators: kinetic energies and velocity correlations of a file with positions alone behind its first
#     frame are those of a frozen start, correlation 1 at all lags.
. "$(dirname "$0")/venv.sh" gsd==5.0.1 numpy==2.4.6
python - <<'END'
from importlib.metadata import version

import gsd.hoomd
import numpy as np

with gsd.hoomd.open("a.gsd", "w") as file:
    for step, count in enumerate((2, 2, 3)):
        frame = gsd.hoomd.Frame()
        frame.configuration.step, frame.particles.N = step, count
        frame.particles.position = np.full((count, 3), float(step))
        if step == 0:
            frame.particles.velocity = [[1, 2, 3], [4, 5, 6]]
        file.append(frame)
with gsd.hoomd.open("a.gsd", "r") as file:
    found = [frame.particles.velocity for frame in file]
print("gsd", version("gsd"), "velocities read:", *[v.tolist() for v in found])
assert np.array_equal(found[1], found[0]) and found[0].any() and not found[2].any()
END
