#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# xarray 2026.9.0 with netCDF4 1.7.5.1.post1, h5netcdf 1.8.2 and zarr 3.1.6 (PyPI): attributes of a dataset.
# Guess: an attribute that is a list is read back as a list of as many elements.
# Seen: in netCDF a list of one number is read as a number, one text as a text (both engines); lists of two stay lists. zarr keeps
#     both. A sweep over one value, or a chain of one site, so has attributes of another type than one over two.
# For users of stochastic integrators: read parameters that go by site, or seeds of paths, with numpy.atleast_1d.
. "$(dirname "$0")/venv.sh" xarray==2026.9.0 netCDF4==1.7.5.1.post1 h5netcdf==1.8.2 h5py==3.16.0 zarr==3.1.6 numpy==2.4.6
python -W ignore - <<'END'
import numpy as np
import xarray

print("xarray", xarray.__version__)
given = {"one": [0.5], "two": [0.5, 1.0], "name": ["k"], "names": ["k", "m"]}
data = xarray.Dataset({"q": ("t", np.arange(3.0))}, attrs=given)
for engine in ("netcdf4", "h5netcdf"):
    data.to_netcdf(f"{engine}.nc", engine=engine)
    with xarray.open_dataset(f"{engine}.nc", engine=engine) as found:
        print(engine, found.attrs)
        assert np.ndim(found.attrs["one"]) == 0 and np.shape(found.attrs["two"]) == (2,)
        assert found.attrs["name"] == "k" and list(found.attrs["names"]) == ["k", "m"]
data.to_zarr("q.zarr")
found = xarray.open_zarr("q.zarr").attrs
print("zarr", found)
assert found == given
END
