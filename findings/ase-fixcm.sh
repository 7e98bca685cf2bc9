#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# ASE 3.29.0 (PyPI), ase.md.Langevin with its default fixcm=True.
# Guess: the centre of mass is held, and the distance of a bound pair has its thermal variance, kT/k for each relative
#     coordinate.
# Seen: the variance is twice that. The noise of all momenta is scaled up by N/(N - 1), here 2, so that the kinetic energy per
#     3 N is kT/2 although three degrees of freedom stand still; the moving ones have twice their temperature.
# For users of stochastic integrators: with few particles compare the relative coordinate, not the temperature; with
#     fixcm=False it is right.
. "$(dirname "$0")/venv.sh" ase==3.29.0 numpy==2.4.6 scipy==1.17.1
python - <<'END'
import ase
import numpy as np
from ase.calculators.calculator import Calculator
from ase.md.langevin import Langevin

kT, k, n = 1.0, 1.0, 4


class Pair(Calculator):
    """k/2 |r1 - r2|^2, without a rest length: every component is an oscillator."""

    implemented_properties = ("energy", "forces")

    def calculate(self, atoms=None, properties=(), changes=()):
        apart = self.atoms_now.positions[0] - self.atoms_now.positions[1]
        self.results = {"energy": k / 2 * apart @ apart, "forces": np.array([-k * apart, k * apart])}


def variance(fixcm):
    atoms = ase.Atoms("H2", positions=np.zeros((2, 3)), masses=[1.0, 1.0])
    atoms.calc = Pair()
    atoms.calc.atoms_now = atoms
    run = Langevin(atoms, timestep=0.2, temperature_K=kT / ase.units.kB, friction=0.5, fixcm=fixcm,
                   rng=np.random.RandomState(4))
    found, kinetic = [], []
    for step in range(12000):
        run.run(1)
        if step > 200:
            found.append(atoms.positions[0] - atoms.positions[1])
            kinetic.append(atoms.get_kinetic_energy() / 3)
    return np.var(found) * k / kT, np.mean(kinetic) / kT


print("ASE", ase.__version__)
for fixcm in (True, False):
    relative, kinetic = variance(fixcm)
    print("fixcm", fixcm, "k <r^2>/kT of a relative coordinate", relative, "kinetic energy of both over 3 kT", kinetic)
    assert abs(relative - (2 if fixcm else 1)) < 0.2 * (2 if fixcm else 1) and abs(kinetic - 1) < 0.1
END
