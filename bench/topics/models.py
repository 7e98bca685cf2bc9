# SPDX-License-Identifier: BSD-3-Clause
"""Models of a user beside built-in ones."""

import importlib.util

from .tools import ABSENT, Setting, lines_of_python, spread, table


def measure(setting: Setting) -> list[dict]:
    """One model written in several ways, by the Python package; nothing where NumPy is missing."""
    functions = setting.bench / "libbench_user_models.so"
    if importlib.util.find_spec("numpy") is None or not functions.exists():
        return []
    lines = lines_of_python("user_models.py", setting.build, functions.resolve(), min(setting.repeats, 5))
    return [{"name": w[1].replace("_", " "), "ns": [float(x) for x in w[2:]]} for w in lines]


def section(found: list[dict]) -> str:
    """Write the section."""
    rows = [[u["name"], spread(u["ns"])] for u in found]
    return (
        "## Models of one's own\n\nThe linear oscillator of the catalogue and the same model written by a user, 4096 "
        "paths, one thread: ns of\nprocessor time per path-step. The loop by hand has NumPy's own generator and "
        "arrays of the library's size.\n`numba cfunc` is absent where numba is not installed.\n\n"
        + table(["model, scheme", "ns"], rows or [["NumPy is not installed", ABSENT]])
    )
