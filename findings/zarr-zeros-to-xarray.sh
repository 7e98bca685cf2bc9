#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# zarr 3.1.6 and xarray 2026.9.0 (PyPI).
# Guess: an array of doubles has the same numbers in xarray; rows that were never written are either NaN or 0.
# Seen: an array of format 2 that zarr made without a `fill_value` has 0 as such, and xarray takes it for the sign of missing
#     values: zeros that were written become NaN. In format 3 zeros stay, and rows that were never written are 0, too.
#     `mask_and_scale=False`, or `fill_value=None` when the array is made, leave the zeros of format 2.
# For users of stochastic integrators: starts at 0 and particles at rest go missing; `mean(skipna)` is then one of the others.
. "$(dirname "$0")/venv.sh" zarr==3.1.6 xarray==2026.9.0 numpy==2.4.6 pandas==3.1.1
python - <<'END'
from importlib.metadata import version

import numpy as np
import xarray as xr
import zarr

print("zarr", version("zarr"), "xarray", version("xarray"))
rows = np.array([[0.0, 1.0, 2.0, 0.0], [0.0, -1.0, -2.0, 3.0]])


def read(kind, name, **options):
    group = zarr.open_group(name, mode="w", zarr_format=kind)
    if kind == 2:
        group.create_array("x", shape=(3, 4), chunks=(1, 4), dtype="f8", **options)
        group["x"].attrs["_ARRAY_DIMENSIONS"] = ["path", "time"]
    else:
        group.create_array("x", shape=(3, 4), chunks=(1, 4), dtype="f8", dimension_names=["path", "time"], **options)
    group["x"][:2] = rows
    return [xr.open_zarr(name, consolidated=False, mask_and_scale=masked).x.values for masked in (True, False)]


two, plain = read(2, "two")
three, _ = read(3, "three")
without, _ = read(2, "without", fill_value=None)
print("format 2:", *two, "format 2, not masked:", *plain, "format 3:", *three, sep="\n")
assert np.array_equal(two[:2], np.where(rows == 0, np.nan, rows), equal_nan=True) and np.isnan(two[2]).all()
assert np.array_equal(plain[:2], rows) and np.array_equal(three[:2], rows) and np.all(three[2] == 0)
assert np.array_equal(without[:2], rows)
END
