# SPDX-License-Identifier: BSD-3-Clause
"""Quadratic parts of H, by their second derivatives, whose flows are exact drifts between kicks."""

from __future__ import annotations

import ctypes
import itertools
from collections.abc import Callable
from typing import Any

from ..errors import InvalidArgumentError, WrongShapeError
from ..native import checks, handles

Split = tuple[tuple[float, ...], ...]  #: rows of second derivatives by q and then by p, (2 dof, 2 dof)

#: what kicks beside a quadratic part depend on: on phases means on actions, with noises that are linear in these
KICKS = ("positions", "actions", "phases")


def second_derivatives(split: Any, ndof: int) -> Split | None:
    """A matrix (2 dof, 2 dof) as rows of numbers; None without one."""
    if split is None:
        return None
    values = checks.real_array("split", split)
    if values.shape != (2 * ndof, 2 * ndof):
        raise WrongShapeError(
            f"split has shape {values.shape}: give ({2 * ndof}, {2 * ndof}), second derivatives of a quadratic part of "
            "H by q and then by p"
        )
    return tuple(tuple(float(x) for x in row) for row in values)


def kicks_of(kicks: Any, split: Split | None) -> str:
    """What kicks depend on, one of KICKS."""
    chosen = KICKS[checks.choice("kicks", kicks, KICKS)]
    if chosen != KICKS[0] and split is None:
        raise InvalidArgumentError(
            f"kicks = {chosen!r} without split: give split, second derivatives of a quadratic part of H, which may be "
            "zero"
        )
    return chosen


def handle_with_split(make: Callable[[], Any], split: Split | None, kicks: str = KICKS[0]) -> Any:
    """A handle of a user's model that declares a quadratic part of H and what kicks depend on, or none."""
    handle = make()
    declare(handle.pointer, split, kicks)
    return handle


def declare(pointer: ctypes.c_void_p, split: Split | None, kicks: str) -> None:
    """Declare a quadratic part of H, and what kicks depend on, to the library; or none."""
    handles.call("model_set_action_kicks", pointer, 0)
    rows = None if split is None else (ctypes.c_double * len(split) ** 2)(*itertools.chain(*split))
    handles.call("model_set_quadratic_part", pointer, rows)
    if split is not None and kicks != KICKS[0]:
        handles.call("model_set_action_kicks", pointer, KICKS.index(kicks))
