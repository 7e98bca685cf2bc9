#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# h5py 3.16.0, netCDF4 1.7.5.1.post1, zarr 3.1.6 (PyPI).
# Guess: q[2][3] = 1.0 writes an element of a dataset, as it does of an array or a memory map of NumPy.
# Seen: in all three it writes to a copy of row 2 that was read for it: the file keeps its zero, without a word; q[2, 3] = 1.0
#     writes.
# For users of stochastic integrators: q[step][path] = x fills no file; write q[step, path], or whole rows.
. "$(dirname "$0")/venv.sh" h5py==3.16.0 netCDF4==1.7.5.1.post1 zarr==3.1.6 numpy==2.4.6
python - <<'END'
import h5py
import netCDF4
import numpy as np
import zarr


def tried(q):
    q[2][3] = 1.0
    q[1, 3] = 1.0
    return float(q[2, 3]), float(q[1, 3])


print("h5py", h5py.__version__, "netCDF4", netCDF4.__version__, "zarr", zarr.__version__)
with h5py.File("q.h5", "w") as file:
    found = {"h5py": tried(file.create_dataset("q", data=np.zeros((4, 4))))}
with netCDF4.Dataset("q.nc", "w") as file:
    file.createDimension("t", 4)
    file.createDimension("path", 4)
    file.createVariable("q", "f8", ("t", "path"))[:] = 0
    found["netCDF4"] = tried(file["q"])
found["zarr"] = tried(zarr.create_array("q.zarr", data=np.zeros((4, 4))))
found["memory map"] = tried(np.memmap("q.bin", mode="w+", shape=(4, 4)))
print("q[2][3] = 1 and q[1, 3] = 1 give", found)
assert found.pop("memory map") == (1.0, 1.0) and set(found.values()) == {(0.0, 1.0)}
END
