#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# MDTraj 1.11.1 and MDAnalysis 2.11.0 (PyPI): DCD.
# Guess: frames at 10, 20, 30, 40 ps that MDTraj saves as DCD have these times, or their distance, when they are read.
# Seen: MDTraj reads 0, 1, 2, 3, MDAnalysis 0, 0.0489, 0.0978, 0.1467: the file says 1 of AKMA's unit of time whatever the
#     distance was. As XTC both read 10 to 40.
# For users of stochastic integrators: a diffusion constant from the file is wrong by the factor 10, or 205.
. "$(dirname "$0")/venv.sh" mdtraj==1.11.1.post2 MDAnalysis==2.11.0 numpy==2.4.6 scipy==1.17.1
python -W ignore - 2> /dev/null <<'END'
from importlib.metadata import version

import MDAnalysis
import mdtraj
import numpy as np

top = mdtraj.Topology()
residue = top.add_residue("AR", top.add_chain())
for _ in range(2):
    top.add_atom("AR", mdtraj.element.argon, residue)
times = 10.0 * np.arange(1, 5)
path = mdtraj.Trajectory(np.arange(24.0).reshape(4, 2, 3) / 100, top, time=times)
print("MDTraj", version("mdtraj"), "MDAnalysis", MDAnalysis.__version__, "saved", times)
read = {}
for kind in ("dcd", "xtc"):
    path.save(f"a.{kind}")
    reader = MDAnalysis.Universe.empty(2)
    reader.load_new(f"a.{kind}")
    read[kind] = mdtraj.load(f"a.{kind}", top=top).time, np.array([float(frame.time) for frame in reader.trajectory])
    print(kind, "MDTraj", read[kind][0], "MDAnalysis", read[kind][1])
assert np.array_equal(read["dcd"][0], range(4)) and np.allclose(read["dcd"][1], 0.04888821 * np.arange(4))
assert np.array_equal(read["xtc"][0], times) and np.array_equal(read["xtc"][1], times)
END
