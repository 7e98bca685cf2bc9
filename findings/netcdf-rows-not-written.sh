#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# netCDF4 1.7.5.1.post1, xarray 2026.9.0 with its engines netcdf4, h5netcdf 1.8.2 and scipy 1.17.1 (PyPI).
# Guess: rows of a file that were never written, as a stopped run leaves them, are missing values in every reader.
# Seen: netCDF4 masks them; xarray shows them, by each engine, as the number 9.97e36, and means over them are of that size.
#     The attribute _FillValue decides: netCDF4 masks the default fill value without it, xarray only with it. The same the
#     other way round: a counter of 32 bits that truly is 4294967295 is masked by netCDF4 and shown by xarray.
# For users of stochastic integrators: a file of paths that is filled as a run goes on needs a _FillValue of its own (NaN),
#     and for integers (seeds, failed steps) fill_value=False.
. "$(dirname "$0")/venv.sh" netCDF4==1.7.5.1.post1 xarray==2026.9.0 h5netcdf==1.8.2 h5py==3.16.0 scipy==1.17.1 numpy==2.4.6
python - <<'END'
import netCDF4
import numpy as np
import xarray

print("netCDF4", netCDF4.__version__, "xarray", xarray.__version__)
FILES = {"new.nc": ("NETCDF4", ("netcdf4", "h5netcdf")), "old.nc": ("NETCDF3_64BIT_OFFSET", ("netcdf4", "scipy"))}
for name, (kind, engines) in FILES.items():
    with netCDF4.Dataset(name, "w", format=kind) as file:
        file.createDimension("time", 4)
        for variable, fill in (("q", None), ("filled", np.nan)):
            file.createVariable(variable, "f8", ("time",), fill_value=fill)[:2] = [1.0, 2.0]
    with netCDF4.Dataset(name) as file:
        masked = np.ma.getmaskarray(file["q"][:])
        print(name, "netCDF4:", file["q"][:], "mean", file["q"][:].mean())
    assert masked.tolist() == [False, False, True, True]
    for engine in engines:
        with xarray.open_dataset(name, engine=engine) as data:
            print(name, "xarray,", engine, ":", data.q.values, "mean", float(data.q.mean()), "with _FillValue NaN",
                  data.filled.values)
            assert np.isfinite(data.q.values).all() and float(data.q.mean()) > 1e36
            assert np.isnan(data.filled.values[2:]).all() and float(data.filled.mean()) == 1.5
with netCDF4.Dataset("counter.nc", "w") as file:
    file.createDimension("path", 2)
    file.createVariable("counter", "u4", ("path",))[:] = [2**32 - 1, 1]
with netCDF4.Dataset("counter.nc") as file, xarray.open_dataset("counter.nc") as data:
    print("2^32 - 1: netCDF4", file["counter"][:], "xarray", data.counter.values)
    assert np.ma.getmaskarray(file["counter"][:]).tolist() == [True, False] and data.counter.values[0] == 2**32 - 1
END
