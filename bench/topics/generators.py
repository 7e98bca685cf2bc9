# SPDX-License-Identifier: BSD-3-Clause
"""Normals of other libraries."""

import ctypes
import glob
import sys
import time

from .tools import Setting, spread, summary, table

try:
    import numpy as np
except ImportError:
    np = None

COUNT = 10**6


def measure(setting: Setting) -> list[dict]:
    """Time NumPy's and MKL's generators, where they are: ns per normal."""
    return numpy_normals(setting.repeats) + mkl_normals(setting.repeats)


def numpy_normals(repeats: int) -> list[dict]:
    """Generators of NumPy."""
    if np is None:
        return [{"name": "NumPy", "ns": None}]
    out, rows = np.empty(COUNT), []
    for bits in ("PCG64", "SFC64", "Philox"):
        generator = np.random.Generator(getattr(np.random, bits)(1))
        times = time_calls(lambda g=generator: g.standard_normal(out=out), repeats)
        rows.append({"name": f"NumPy {bits} ziggurat", "ns": times})
    return rows


def mkl_normals(repeats: int) -> list[dict]:
    """Generators of Intel MKL."""
    names = glob.glob(f"{sys.prefix}/lib/libmkl_rt.so*")
    if not names:
        return [{"name": "MKL (pip install mkl)", "ns": None}]
    mkl = ctypes.CDLL(names[0])
    stream, numbers = ctypes.c_void_p(), (ctypes.c_double * 4096)()
    philox, box_muller2 = 0x100000 * 16, 1
    mkl.vslNewStream(ctypes.byref(stream), philox, 1)
    zero, one = ctypes.c_double(0), ctypes.c_double(1)

    def draw() -> None:
        for _ in range(COUNT // 4096):
            mkl.vdRngGaussian(box_muller2, stream, 4096, numbers, zero, one)

    return [{"name": "MKL Philox Box-Muller", "ns": time_calls(draw, repeats)}]


def time_calls(call, repeats: int) -> list[float]:
    """Times of a call that makes COUNT normals, ns each."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        call()
        times.append((time.perf_counter() - start) * 1e9 / COUNT)
    return summary(times)


def section(found: list[dict]) -> str:
    """Write the section."""
    rows = [[g["name"], spread(g["ns"])] for g in found]
    return "## Normals of other libraries\n\nns each, one thread.\n\n" + table(["generator", "ns"], rows)
