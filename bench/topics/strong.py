# SPDX-License-Identifier: BSD-3-Clause
"""Strong errors: their size, and the number of steps at which they reach a bound."""

import importlib.util
import itertools
import math

import numpy as np


def rms(apart: np.ndarray) -> float:
    """Root mean square distance over paths, of (2 dof, path)."""
    return float(np.sqrt(np.square(apart).sum(axis=0).mean()))


def steps_to(errors: dict[int, float], error: float) -> tuple[float, bool]:
    """The number of steps for an error, by a power law through two measured errors, and whether it is beyond all of
    them.
    """
    points = sorted(errors.items())
    pairs = list(itertools.pairwise(points))
    within = [pair for pair in pairs if pair[0][1] > error >= pair[1][1]]
    (n0, e0), (n1, e1) = within[0] if within else pairs[0] if points[0][1] <= error else pairs[-1]
    return n0 * (n1 / n0) ** (math.log(e0 / error) / math.log(e0 / e1)), not within


def told_steps(steps: float, beyond: bool) -> str:
    """Steps as tables have them; a star if they are beyond measured ones."""
    return (f"{math.ceil(steps):.3g}" if steps > 999 else f"{math.ceil(steps)}") + "*" * beyond


def numba_version() -> list[str]:
    """The version of numba, if it is installed."""
    if importlib.util.find_spec("numba") is None:
        return []
    import numba  # noqa: PLC0415

    return [f"numba {numba.__version__}"]
