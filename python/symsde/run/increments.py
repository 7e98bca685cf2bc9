# SPDX-License-Identifier: BSD-3-Clause
"""Prescribed increments (row, noise, path), in any order of memory: large ones stay the caller's."""

from __future__ import annotations

import ctypes

import numpy as np

from ..errors import IncompatibleError, WrongShapeError
from ..native import abi, checks

_COPIED = 4096  # most numbers of increments that are copied


class Lent(np.ndarray):
    """Increments in the caller's memory, with some of their numbers, which tell that the caller has written there."""

    seen: np.ndarray | None = None

    def sample(self) -> np.ndarray:
        """Some of the numbers, from all over the array."""
        places = np.linspace(0, self.size - 1, 64).astype(np.int64)
        return np.asarray(self)[np.unravel_index(places, self.shape)]


def unchanged(increments: np.ndarray) -> np.ndarray:
    """The increments of a run, for its analysis; refused if a sampled number is no longer the one that drove it."""
    if isinstance(increments, Lent) and increments.seen is not None and (increments.sample() != increments.seen).any():
        raise IncompatibleError(
            "the increments of this run have been changed since: large arrays are not copied, so leave yours as it is "
            "while runs that it drove are analysed, or give simulate a copy"
        )
    return increments


def put_increments(given: abi.Input, increments: np.ndarray) -> None:
    """Store increments (row, noise, path) in an input; they must live as long as the input."""
    given.increments = increments.ctypes.data
    given.increment_rows, given.increment_noises, given.increment_paths = increments.shape
    given.strides = (ctypes.c_int64 * 3)(*(step // 8 for step in increments.strides))  # lives as long as the input
    given.increment_strides = ctypes.addressof(given.strides)


def increments_array(value: object) -> np.ndarray:
    """Prescribed increments as (row, noise, 1 or path), in any order of memory. Large arrays are not copied."""
    array = checks.real_array("increments", value)
    if array.ndim == 2:
        array = array[:, :, np.newaxis]
    if array.ndim != 3:
        raise WrongShapeError(
            f"increments has shape {array.shape}: give (steps*2**refine, noise, path), or "
            "(steps*2**refine, noise) for all paths"
        )
    if array.size <= _COPIED or not array.flags.aligned or any(step < 0 or step % 8 for step in array.strides):
        return np.array(array, order="C")
    lent = array.view(Lent)
    lent.seen = lent.sample()
    return lent
