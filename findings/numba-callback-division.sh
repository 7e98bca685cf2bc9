#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# numba 0.68.1 (PyPI): a callback in C by numba.cfunc that returns a status.
# Guess: a division by zero in a loop over paths gives inf in its place, as in C, or a status that is not 0.
# Seen: the function ends at the division and returns 0, the status of success; the outputs behind it are left as they were,
#     and only a line on standard error tells. With error_model="numpy" the value is inf and all others are there.
# For users of stochastic integrators: one path at a pole spoils paths that have nothing to do with it; give error_model="numpy"
#     to every callback, and NaN to outputs before a call.
. "$(dirname "$0")/venv.sh" numba==0.68.1 llvmlite==0.50.0 numpy==2.4.6
python - <<'END'
import ctypes

import numba
import numpy as np
from numba import types

array = types.CPointer(types.double)
C_TYPE = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int64)


def gradient(q, out, n):
    for i in range(n):
        out[i] = 1.0 / (q[i] - 2.0)
    return 0


print("numba", numba.__version__)
q = np.array([1.0, 2.0, 3.0, 4.0])
for options, wanted in ({}, [-1, 7, 7, 7]), ({"error_model": "numpy"}, [-1, np.inf, 1, 0.5]):
    compiled = numba.cfunc(types.int32(array, array, types.int64), **options)(gradient)
    out = np.full(4, 7.0)
    status = C_TYPE(compiled.address)(q.ctypes.data, out.ctypes.data, 4)
    print(options, "status", status, "outputs, 7 before the call:", out)
    assert status == 0 and (out == wanted).all()
END
