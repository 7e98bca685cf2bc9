#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# MDAnalysis 2.11.0 (PyPI), H5MD; h5py 3.16.0.
# Guess: velocities that were saved every 5 steps beside positions every 10, each with its own `step` and `time` as the format
#     has it, are matched by step, or the file is refused.
# Seen: row i of the one stands beside row i of the other: positions of step 40 have the velocities of step 20, in silence.
# For users of stochastic integrators: correlations of velocity and position, energies and work come from two times; a file of
#     equal steps is the only one to write.
. "$(dirname "$0")/venv.sh" MDAnalysis==2.11.0 h5py==3.16.0 numpy==2.4.6 scipy==1.17.1
python -W ignore - <<'END'
import h5py
import MDAnalysis
import numpy as np

atoms, every = 3, {"position": ("Angstrom", 10), "velocity": ("Angstrom ps-1", 5)}
with h5py.File("path.h5md", "w") as file:
    head = file.create_group("h5md")
    head.attrs["version"] = [1, 1]
    head.create_group("author").attrs["name"] = "none"
    creator = head.create_group("creator")
    creator.attrs["name"], creator.attrs["version"] = "none", "1"
    particles = file.create_group("particles/all")
    box = particles.create_group("box")
    box.attrs["dimension"], box.attrs["boundary"] = 3, np.array(["none"] * 3, dtype="S")
    for name, (unit, stride) in every.items():
        steps = np.arange(0, 50, stride)
        group = particles.create_group(name)
        group["step"], group["time"] = steps, 0.01 * steps
        group["value"] = np.broadcast_to(steps[:, None, None], (len(steps), atoms, 3)).astype(float)
        group["time"].attrs["unit"], group["value"].attrs["unit"] = "ps", unit
path = MDAnalysis.Universe.empty(atoms, trajectory=False)
path.load_new("path.h5md", convert_units=False)
found = [(frame.data["step"], frame.positions[0, 0], frame.velocities[0, 0]) for frame in path.trajectory]
print("MDAnalysis", MDAnalysis.__version__, "step, step of the positions, step of the velocities:\n", np.array(found))
assert [row[1] for row in found] == [0, 10, 20, 30, 40] and [row[2] for row in found] == [0, 5, 10, 15, 20]
END
