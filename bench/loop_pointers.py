# SPDX-License-Identifier: BSD-3-Clause
"""Forces of `loops` that call a compiled callback of the library through its pointer, as the library has to.

What a loop pays for that alone: numba inlines every other force.
"""

import ctypes

import numba

# the gradient of symsde.h, pointers as integers: 0 is NULL
GRADIENT = ctypes.CFUNCTYPE(*(ctypes.c_int,) * 4, ctypes.c_double, *(ctypes.c_size_t,) * 6)


def force(model):
    """One lane, the velocity not asked for."""
    call = GRADIENT(model.functions["gradient"].address)
    n, nham = model.traits.ndof, model.traits.nnoise + 1

    @numba.njit
    def through(w, q, f, room):
        call(1, n, nham, 0.0, w.ctypes.data, q.ctypes.data, q.ctypes.data, f.ctypes.data, 0, 0)
        for i in range(n):
            f[i] = -f[i]

    return through
