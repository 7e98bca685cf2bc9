#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# ASE 3.29.0 (PyPI), format extxyz.
# Guess: what is written to extended XYZ is read back: positions and momenta of a saved state are those of the run.
# Seen: eight digits behind the point are written, whatever the size: 1/3 comes back as 0.33333333, a momentum of 1e-9 as 0,
#     without a warning. The format traj keeps all bits.
# For users of stochastic integrators: a run that goes on from such a file is another run, and in units in which momenta are
#     small it starts from rest.
. "$(dirname "$0")/venv.sh" ase==3.29.0 numpy==2.4.6 scipy==1.17.1
python - <<'END'
import warnings

import ase
import numpy as np
from ase.io import read, write

warnings.simplefilter("error")
atoms = ase.Atoms("Ar2", positions=[[0, 0, 0], [1 / 3, 0, 0]])
atoms.set_momenta([[1e-9, 1 / 3, 0], [-1e-9, -1 / 3, 0]])
print("ASE", ase.__version__)
back = {}
for name in ("state.extxyz", "state.traj"):
    write(name, atoms)
    back[name] = read(name)
    print(name, "momenta of atom 0:", back[name].get_momenta()[0], "x of atom 1:", back[name].positions[1, 0])
text = back["state.extxyz"]
assert (text.get_momenta()[:, 0] == 0).all() and text.get_momenta()[0, 1] == 0.33333333
assert text.positions[1, 0] == 0.33333333
assert (back["state.traj"].get_momenta() == atoms.get_momenta()).all()
assert (back["state.traj"].positions == atoms.positions).all()
END
