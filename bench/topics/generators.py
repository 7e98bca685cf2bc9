# SPDX-License-Identifier: BSD-3-Clause
"""Normals of this library beside those of NumPy and Intel MKL."""

import ctypes
import glob
import sys
import time

from .tools import ABSENT, Setting, lines_of, spread, summary, table

try:
    import numpy as np
except ImportError:
    np = None

COUNT, BLOCKS = 10**6, (10**4, 10**6)
_UNIT = 1 << 20  # mkl_vsl_defines.h: generators are multiples of it
MKL_GENERATORS = {"Philox": 16 * _UNIT, "MT19937": 8 * _UNIT, "SFMT19937": 13 * _UNIT}
MKL_METHODS = {"Box-Muller 2": 1, "ICDF": 2}


def measure(setting: Setting) -> list[dict]:
    """Time all generators in turn: ns per normal, one thread."""
    draws = [*numpy_draws(), *mkl_draws()]
    for *_, draw in draws:
        draw()
    own, times = [], [[] for _ in draws]
    for _ in range(max(5, setting.repeats)):
        lines = lines_of(setting.bench / "bench_blocks", 1)
        own += [float(words[2]) for words in lines if words[:2] == ["block", "normal"]]
        for (*_, draw), found in zip(draws, times, strict=True):
            start = time.process_time()
            draw()
            found.append((time.process_time() - start) * 1e9 / COUNT)
    rows = [{"name": "symsde", "block": 256, "ns": summary(own)}]
    rows += [{"name": d[0], "block": d[1], "ns": summary(t)} for d, t in zip(draws, times, strict=True)]
    rows += [{"name": name, "block": None, "ns": None} for name in absent(draws)]
    return rows


def absent(draws: list[tuple]) -> list[str]:
    """The libraries of which there is no generator."""
    return [name for name in ("NumPy", "MKL") if not any(d[0].startswith(name) for d in draws)]


def numpy_draws() -> list[tuple]:
    """Name, block and a call that makes COUNT normals, for the generators of NumPy."""
    if np is None:
        return []

    def draws_of(bits: str, block: int):
        generator, out = np.random.Generator(getattr(np.random, bits)(1)), np.empty(block)

        def draw() -> None:
            for _ in range(COUNT // block):
                generator.standard_normal(out=out)

        return draw

    names = ("PCG64", "SFC64", "Philox")
    version = np.__version__
    return [(f"NumPy {version} {bits}, ziggurat", block, draws_of(bits, block)) for bits in names for block in BLOCKS]


def mkl_draws() -> list[tuple]:
    """The same for Intel MKL, where `pip install mkl` has put it."""
    names = glob.glob(f"{sys.prefix}/lib/libmkl_rt.so*")
    if not names:
        return []
    mkl = ctypes.CDLL(names[0])
    mkl.MKL_Set_Threading_Layer(1)  # sequential
    text = ctypes.create_string_buffer(200)
    mkl.MKL_Get_Version_String(text, len(text))
    version = text.value.decode().partition("Version ")[2].split("-")[0]
    zero, one = ctypes.c_double(0), ctypes.c_double(1)

    def draws_of(generator: int, method: int, block: int):
        stream, out = ctypes.c_void_p(), (ctypes.c_double * block)()
        if mkl.vslNewStream(ctypes.byref(stream), generator, 1) != 0:
            sys.exit("MKL has no such generator")

        def draw() -> None:
            for _ in range(COUNT // block):
                if mkl.vdRngGaussian(method, stream, block, out, zero, one) != 0:
                    sys.exit("MKL made no normals")

        return draw

    return [
        (f"MKL {version} {generator}, {method}", block, draws_of(number, rule, block))
        for generator, number in MKL_GENERATORS.items()
        for method, rule in MKL_METHODS.items()
        for block in BLOCKS
    ]


def section(found: list[dict]) -> str:
    """Write the section."""
    rows = [[g["name"], str(g["block"] or ""), spread(g["ns"])] for g in found]
    note = f"\n\nMKL (`pip install mkl`): {ABSENT}." if any(g["name"] == "MKL" for g in found) else ""
    return (
        "## Normals beside other libraries\n\n"
        "The table gives ns of processor time for one normal number, on one thread. "
        "All generators alternate. One call fills a block.\n\n" + table(["generator", "block", "ns"], rows) + note
    )
