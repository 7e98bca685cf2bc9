#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# ASE 3.29.0, MDAnalysis 2.11.0, ParmEd 4.3.1 with netCDF4 1.7.5.1 (PyPI): AMBER's NetCDF trajectories.
# Guess: 1 A/ps written by one package is 1 A/ps in another: the file says "angstrom/picosecond".
# Seen: MDAnalysis and ParmEd read each other's files; ASE takes the numbers of both for its own unit, A sqrt(u/eV): 98.2 A/ps,
#     9649 times the kinetic energy. What ASE writes has no unit, and ParmEd reads it as 0.0102 A/ps.
# For users of stochastic integrators: start from a frame of a thermal run at 300 K, and ASE's temperature is 2.9 million K.
. "$(dirname "$0")/venv.sh" ase==3.29.0 MDAnalysis==2.11.0 parmed==4.3.1 netCDF4==1.7.5.1.post1 numpy==2.4.6 scipy==1.17.1
python -W ignore - <<'END'
import ase
import ase.units
import MDAnalysis
import numpy as np
import parmed
from ase.io.netcdftrajectory import NetCDFTrajectory
from parmed.amber import NetCDFTraj

ps, ones = 1000 * ase.units.fs, np.ones((2, 3))
file = NetCDFTraj.open_new("parmed.nc", 2, box=True, crds=True, vels=True)
file.add_coordinates(3 * ones)
file.add_velocities(ones)
file.add_box([9.0, 9.0, 9.0, 90.0, 90.0, 90.0])
file.add_time(0.0)
file.close()
source = MDAnalysis.Universe.empty(2, trajectory=True, velocities=True)
source.dimensions, source.atoms.positions, source.atoms.velocities = [9, 9, 9, 90, 90, 90], 3 * ones, ones
with MDAnalysis.Writer("mdanalysis.nc", 2, format="NCDF", velocities=True) as writer:
    writer.write(source.atoms)
atoms = ase.Atoms("Ar2", positions=[[3, 3, 3], [4, 4, 4]], cell=[9, 9, 9], pbc=True)
atoms.set_velocities(ones / ps)
trajectory = NetCDFTrajectory("ase.nc", "w", atoms=atoms)
trajectory.write()
trajectory.close()


def by_mdanalysis(name):
    reader = MDAnalysis.Universe.empty(2)
    reader.load_new(name, format="NCDF")
    return float(reader.atoms.velocities[0, 0])


readers = {"ParmEd": lambda name: float(NetCDFTraj.open_old(name).velocities[0, 0, 0]), "MDAnalysis": by_mdanalysis,
           "ASE": lambda name: float(NetCDFTrajectory(name, "r")[0].get_velocities()[0, 0] * ps)}
print("ASE", ase.__version__, "MDAnalysis", MDAnalysis.__version__, "ParmEd", parmed.__version__)
found = {}
for name in ("parmed.nc", "mdanalysis.nc", "ase.nc"):
    found[name] = {reader: read(name) for reader, read in readers.items() if (name, reader) != ("ase.nc", "MDAnalysis")}
    print(name, "1 A/ps is read as", found[name])
for name in ("parmed.nc", "mdanalysis.nc"):
    assert abs(found[name]["ParmEd"] - 1) < 1e-6 and abs(found[name]["MDAnalysis"] - 1) < 1e-6
    assert abs(found[name]["ASE"] - ps) < 1e-3
assert abs(found["ase.nc"]["ASE"] - 1) < 1e-6 and abs(found["ase.nc"]["ParmEd"] - 1 / ps) < 1e-6
END
