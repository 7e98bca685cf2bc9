#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# h5py 3.16.0, xarray 2026.9.0 with h5netcdf 1.8.2 and netCDF4 1.7.5.1 (PyPI): a virtual dataset over the files of a job array.
# Guess: where the file of a job is missing, reading raises or gives NaN.
# Seen: zeros, in silence, by all readers; NaN if the dataset was made with fillvalue=np.nan. A file that is there with fewer rows
#     than foreseen is an error.
# For users of stochastic integrators: a job that failed becomes paths at rest at the origin: with 1 of 10 files missing a mean
#     square is 10 % too small.
. "$(dirname "$0")/venv.sh" h5py==3.16.0 xarray==2026.9.0 h5netcdf==1.8.2 netCDF4==1.7.5.1 numpy==2.4.6 pandas==3.1.1
python -W ignore - <<'END'
import h5netcdf
import h5py
import netCDF4
import numpy as np
import xarray

for shard in (0, 2):
    with h5py.File(f"shard{shard}.h5", "w") as f:
        f["q"] = np.full(4, 1.0 + shard)
layout = h5py.VirtualLayout((3, 4), "f8")
for shard in range(3):
    layout[shard] = h5py.VirtualSource(f"shard{shard}.h5", "q", shape=(4,))
for name, fill in (("all.h5", None), ("nan.h5", np.nan)):
    with h5py.File(name, "w") as f:
        f.create_virtual_dataset("q", layout, fillvalue=fill)
print("h5py", h5py.__version__, "xarray", xarray.__version__, "netCDF4", netCDF4.__version__)
due = [[1.0] * 4, [0.0] * 4, [3.0] * 4]
with h5py.File("all.h5") as f, netCDF4.Dataset("all.h5") as g:
    found = {"h5py": f["q"][:], "netCDF4": np.asarray(g["q"][:]),
             "xarray": xarray.open_dataset("all.h5", engine="h5netcdf", phony_dims="sort")["q"].values}
for name, q in found.items():
    print(name, *q.tolist())
    assert np.array_equal(q, due)
with h5py.File("nan.h5") as f:
    print("with fillvalue=np.nan", *f["q"][:].tolist())
    assert np.isnan(f["q"][:]).sum() == 4
with h5py.File("shard1.h5", "w") as f:
    f["q"] = np.full(3, 2.0)
try:
    with h5py.File("all.h5") as f:
        print("three rows of four", f["q"][:])
    raise SystemExit("a short file was read")
except OSError as refused:
    print("three rows of four:", refused)
END
