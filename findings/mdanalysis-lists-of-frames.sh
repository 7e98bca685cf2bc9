#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# MDAnalysis 2.11.0 (PyPI): XTC, TRR, AMBER NetCDF, DCD, and a trajectory in memory.
# Guess: [frame.positions for frame in trajectory] holds the positions of each frame, in every format.
# Seen: of XTC, TRR and AMBER all five are those of the first frame, since readers fill one array and end where they began. DCD
#     copies, with a warning that it will not for ever; in memory positions are right, and a list of the frames themselves is not.
# For users of stochastic integrators: a variance over frames collected so is exactly zero, in some formats; copy each frame, or
#     use trajectory.timeseries().
. "$(dirname "$0")/venv.sh" MDAnalysis==2.11.0 numpy==2.4.6
python -W ignore - <<'END'
import MDAnalysis
import numpy as np

print("MDAnalysis", MDAnalysis.__version__)
x = np.arange(30, dtype=np.float32).reshape(5, 2, 3)
first, right = [0.0] * 5, [0.0, 6.0, 12.0, 18.0, 24.0]
universe = MDAnalysis.Universe.empty(2, trajectory=True)
for name in ("a.xtc", "a.trr", "a.ncdf", "a.dcd", "memory"):
    read = MDAnalysis.Universe.empty(2)
    if name == "memory":
        read.load_new(x, order="fac")
    else:
        with MDAnalysis.Writer(name, 2) as writer:
            for positions in x:
                universe.atoms.positions = positions
                writer.write(universe.atoms)
        read.load_new(name)
    arrays = [float(a[0, 0]) for a in [frame.positions for frame in read.trajectory]]
    frames = [float(frame.positions[0, 0]) for frame in list(read.trajectory)]
    copies = [float(a[0, 0]) for a in [frame.positions.copy() for frame in read.trajectory]]
    print(name, "list of positions", arrays, "list of frames", frames, "copies", copies)
    assert copies == right
    assert arrays == (right if name in ("a.dcd", "memory") else first)
    assert frames == (right if name == "a.dcd" else first)
END
