# SPDX-License-Identifier: BSD-3-Clause
"""How the linear flows between kicks change with parameters that are positions (`wide.py`): derivatives of S of the
quadratic part, and of the squares of the frequencies of a rotation.

Entries of S are computed with complex numbers, so S(theta + ih) = S + ih dS to rounding for h = 1e-30: an exact
derivative. Functions that are computed of real numbers alone, and a choice of S_qq that changes there, differ from
quotients of differences: then nothing is told, and the library refuses such flows.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from ...native import checks, handles
from ..definition import Model
from ..open_system import copied
from ..user_handles import ModelHandle

if TYPE_CHECKING:
    from .formula_model import FormulaModel
    from .wide import Positions

_H = 1e-30
_APART = 1e-5  #: of a value in a quotient of differences, as part of it
_CLOSE = 1e-6  #: part of the largest entry, or of that of S over the value, by which such a quotient may differ


def with_slopes_of_flows(wide: FormulaModel, model: Model, positions: Positions) -> FormulaModel:
    """The wide model that tells them to the library; model: without these positions."""
    from .formula_model import FormulaModel  # noqa: PLC0415

    if not isinstance(model, FormulaModel) or not positions:
        return wide
    values = dict(model.parameters)
    special = {name: values[name] + 0.1357 for name in dict.fromkeys(positions) if _is_special(values[name])}
    code = ((model._closed or model).with_parameters(**special) if special else model)._code
    split = model.traits.split is not None and model.traits.kicks == "positions"
    functions = (
        code.part.of_complex if split and code.part else None,
        code.squares if model.traits.rotation is not None else None,
    )
    found = [function and _slopes(function, values, positions) for function in functions]
    if all(x is None for x in found):
        return wide
    other = copied(wide)
    make = functools.partial(_handle, wide._handles.made, model.ndof, *found)
    other._handles = handles.Pool(make)
    return other


def _is_special(value: object) -> bool:
    """Whether formulas fold this value."""
    return np.ndim(value) == 0 and value in (0, 1, -1)


def _slopes(function: Callable, values: dict, positions: Positions) -> np.ndarray | None:
    """Derivatives of a function of the values by all positions, (position, ..); None where one is not known."""
    rows = []
    for k, key in enumerate(positions):
        site = k - positions.index(key) if key in positions.of_sites else None
        exact = np.imag(function(_moved(values, key, site, 1j * _H))) / _H
        size = np.abs(values[key] if site is None else values[key][site]).max() or 1.0
        both = [np.real(function(_moved(values, key, site, x * _APART * size))) for x in (1, -1)]
        about = (both[0] - both[1]) / (2 * _APART * size)
        largest = max(np.abs(exact).max(), np.abs(both).max() / size)
        if not np.abs(about - exact).max() <= _CLOSE * largest:
            return None
        rows.append(exact)
    return np.array(rows)


def _moved(values: dict, key: str, site: int | None, by: complex) -> list:
    """The values, one of which is moved; those that go by path are not."""
    moved = dict(values)
    if site is None:
        moved[key] = values[key] + by
    else:
        moved[key] = tuple(x + by if i == site else x for i, x in enumerate(values[key]))
    return list(moved.values())


def _handle(make: Callable, ndof: int, second: np.ndarray | None, squares: np.ndarray | None) -> ModelHandle:
    """A handle of the wide model that has them."""
    handle = make()
    arrays = [None if x is None else np.ascontiguousarray(x, dtype=float) for x in (second, squares)]
    handles.call("model_set_flow_slopes", handle.pointer, ndof, *map(checks.address, arrays))
    return handle
