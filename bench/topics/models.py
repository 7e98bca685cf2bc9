# SPDX-License-Identifier: BSD-3-Clause
"""Models of a user beside built-in ones."""

import importlib.util

from .tools import ABSENT, Setting, at_most, lines_of, lines_of_python, spread, table

NAMES = {
    "built-in": "built-in",
    "Fortran": "Fortran type",
    "Fortran_plain": "Fortran type, plain",
    "C": "C functions",
    "C_plain": "C functions, plain",
    "numba": "numba cfunc",
    "numba_plain": "numba cfunc, plain",
    "NumPy": "NumPy functions",
    "hand": "NumPy loop by hand",
}
# Largest ratio to the built-in model; for NumPy functions to the loop by hand.
TARGETS = {"Fortran": 1.2, "C": 1.2, "numba": 1.5, "NumPy": 1.5}


def measure(setting: Setting) -> dict:
    """Models in Fortran and C, then those in Python; nothing of these where NumPy is missing."""
    repeats = max(5, setting.repeats)
    found = {"Fortran": rows_of(lines_of(setting.bench / "bench_models", repeats)), "Python": []}
    if importlib.util.find_spec("numpy"):
        found["Python"] = rows_of(lines_of_python("user_models.py", setting.build, repeats))
        found["numba"] = importlib.util.find_spec("numba") is not None
    return found


def rows_of(lines: list[list[str]]) -> list[dict]:
    """Numbers of the printed lines."""
    return [
        {
            "model": words[1].replace("_", " "),
            "scheme": words[2].replace("_", " "),
            "kind": words[3],
            "ns": [float(x) for x in words[4:7]],
            "ratio": float(words[7]),
        }
        for words in lines
    ]


def section(found: dict) -> str:
    """Write the section."""
    return (
        "## Models of one's own\n\n"
        "The tables compare built-in models with the same models written by a user: ns of processor time for a step\n"
        "of a path, with 4096 paths on one thread. All variants of a model alternate. The ratio is to the built-in\n"
        "model in the same program; for NumPy functions it is to the same NumPy loop written by hand, with arrays of\n"
        "the library's size.\n\n" + table_of(found["Fortran"]) + "\n\n"
        "`bench/user_models.f90` and `bench/user_models.c` are compiled with -O3 -march=native, without -ffast-math.\n"
        "The synchrotron takes sine and cosine from the library (`sincos_lanes`, `symsde_sincos`, `numba_sincos`) and\n"
        "gives gradient and Hessian in one function, which an implicit scheme calls in every iteration. The plain\n"
        "variant has two functions, and takes sine and cosine from its compiler. If sine and cosine are in one\n"
        "statement, compilers call a scalar `sincos` for each lane. In separate statements, as here, gfortran calls\n"
        "the vector versions of the C library. gcc does so with -ffast-math, or after `double sin(double)\n"
        '__attribute__((simd("notinbranch")));` and the same for `cos`. numba calls the scalar ones.\n\n'
        + (table_of(found["Python"]) if found["Python"] else f"NumPy: {ABSENT}.")
        + ("" if found.get("numba") else f"\n\nnumba: {ABSENT}.")
    )


def table_of(rows: list[dict]) -> str:
    """All kinds of all models."""
    heads = ["model", "scheme", "written as", "ns", "ratio", "target", ""]
    return table(
        heads,
        [
            [
                r["model"],
                r["scheme"],
                NAMES[r["kind"]],
                spread(r["ns"]),
                f"{r['ratio']:.2f}",
                *at_most(r["ratio"], TARGETS.get(r["kind"])),
            ]
            for r in rows
        ],
    )
