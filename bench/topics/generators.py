# SPDX-License-Identifier: BSD-3-Clause
"""Normals of this library beside those of NumPy."""

import ctypes
from functools import partial

import numpy as np
from timing import in_turn

from .tools import Setting, spread, summary, table

COUNT, BLOCKS = 10**6, (10**4, 10**6)
LANES, STEPS = 256, 8  #: lanes of a block of the library, and steps


def measure(setting: Setting) -> list[dict]:
    """Time all generators in turn: ns per normal, one thread."""
    calls, block = COUNT // (LANES * STEPS), np.empty((STEPS, 2, LANES))
    address = ctypes.c_void_p(block.ctypes.data)
    draws = [
        ("symsde", LANES, calls * LANES * STEPS, partial(setting.programs.draw_normals, ctypes.c_int64(calls), address))
    ]
    draws += [
        (f"NumPy {np.__version__} {bits}, ziggurat", size, COUNT, numpy_draw(bits, size))
        for bits in ("PCG64", "SFC64", "Philox")
        for size in BLOCKS
    ]
    for *_, draw in draws:
        draw()
    times = in_turn([draw for *_, draw in draws], max(5, setting.repeats))
    return [
        {"name": name, "block": size, "ns": summary([1e9 * x / count for x in seconds])}
        for (name, size, count, _), seconds in zip(draws, times, strict=True)
    ]


def numpy_draw(bits: str, size: int):
    """A call that makes COUNT normals in blocks of this size."""
    generator, out = np.random.Generator(getattr(np.random, bits)(1)), np.empty(size)

    def draw() -> None:
        for _ in range(COUNT // size):
            generator.standard_normal(out=out)

    return draw


def section(found: list[dict]) -> str:
    """Write the section."""
    rows = [[g["name"], str(g["block"]), spread(g["ns"])] for g in found]
    return (
        "## Normals beside other libraries\n\n"
        "The table gives ns of processor time for one normal number, on one thread. "
        "All generators alternate. One call fills a block.\n\n" + table(["generator", "block", "ns"], rows)
    )
