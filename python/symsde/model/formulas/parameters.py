# SPDX-License-Identifier: BSD-3-Clause
"""Values of parameters: numbers, or arrays with a value for each path of a run.

Compiled functions get values as data. If all are numbers, functions read the numbers in the order of the formulas. If
one is an array, the functions are compiled in another form, which reads constants of each lane: the parts of formulas
that depend on parameters alone, computed once for each path.
"""

from __future__ import annotations

import ctypes
import dataclasses
import functools
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ...errors import IncompatibleError, InvalidArgumentError, WrongShapeError
from ...native import callbacks, checks, handles
from ..built_in import is_array
from ..open_system import copied
from ..split import KICKS, handle_with_split
from ..user_handles import ModelHandle

if TYPE_CHECKING:
    from .formula_code import Code
    from .formula_model import FormulaModel


def value_of(name: str, given: object, each: str = "path") -> float | np.ndarray:
    """The value of a parameter: a finite number, or a copy of an array with a finite number for each path or site."""
    if not is_array(given):
        return checks.finite(f"the parameter {name}", given)
    values = np.array(checks.real_array(f"the parameter {name}", given))
    if values.ndim != 1 or not values.size:
        raise WrongShapeError(
            f"the parameter {name} has shape {values.shape}: give a number, or ({each},), a number for each {each}"
        )
    if not np.isfinite(values).all():
        first = int(np.flatnonzero(~np.isfinite(values))[0])
        raise InvalidArgumentError(f"the parameter {name} is {values[first]} at {each} {first}: give finite numbers")
    values.flags.writeable = False
    return values


def count_of(values: dict[str, Any]) -> int:
    """Number of paths that the values are for; 0 = any number, if all values are numbers or arrays of one number."""
    sizes = {name: x.size for name, x in values.items() if isinstance(x, np.ndarray) and x.size > 1}
    if len(set(sizes.values())) > 1:
        told = ", ".join(f"{name} for {size}" for name, size in sizes.items())
        raise WrongShapeError(
            f"the parameters have values for different numbers of paths, {told}: give as many of each"
        )
    return next(iter(sizes.values()), 0)


def require_numbers(values: Mapping[str, Any], where: str) -> None:
    """Refuse arrays; only compiled functions of formulas without sums over sites accept them."""
    for name, value in values.items():
        if np.ndim(value):
            raise IncompatibleError(
                f"the parameter {name} is an array, and parameters {where} are the same for all paths: give a number, "
                "and a run for each value, as ss.sweep does"
            )


def kind_of(values: dict[str, Any]) -> tuple:
    """The kind of values for which code is made: whether parameters differ by path, and which numbers are 0, 1 or
    -1, since formulas are simplified with these numbers.
    """
    arrays = any(isinstance(x, np.ndarray) for x in values.values())
    return arrays, *(
        float(x) if not isinstance(x, np.ndarray) and x in (0.0, 1.0, -1.0) else None for x in values.values()
    )


def packed(values: Mapping[str, Any]) -> np.ndarray:
    """Values as compiled functions read them: a number for each parameter, and behind these the numbers of those that
    have one for each site (a tuple)."""
    alone = [0.0 if isinstance(x, tuple) else x for x in values.values()]
    for x in values.values():
        if isinstance(x, tuple):
            alone += x
    return np.array(alone or [0.0], float)


def valued(root: FormulaModel, code: Code, values: dict[str, Any]) -> FormulaModel:
    """The model of compiled functions with these values of its parameters, in the order of the formulas."""
    model = copied(root)
    rotation = code.rotation(list(values.values()))
    split = code.part and code.part.at(list(values.values()))
    own = {"rotation": rotation, "split": split, "kicks": code.part.kicks if split else KICKS[0]}
    if any(getattr(root.traits, x) != y for x, y in own.items()):
        model.traits = dataclasses.replace(root.traits, **own)
        if root.formula.structure is not None:
            structure = dataclasses.replace(root.formula.structure, **own)
            model.formula = dataclasses.replace(root.formula, structure=structure)
        model._split, model._kicks = split, own["kicks"]
    if code.kind[0]:
        table, numbers = _constants(code, values), None
    else:
        table, numbers = None, packed(values)
        gradient, value, w = code.direct
        model._direct = gradient, value, checks.address(numbers), w
    frequencies = None if rotation is None else np.array(rotation)
    make = functools.partial(_handle, root._handles, numbers, table, frequencies)
    if split != root._split:
        make = functools.partial(handle_with_split, make, split, own["kicks"])
    model._handles = handles.Pool(make)
    return model


def _handle(roots: handles.Pool, numbers: Any, table: Any, frequencies: Any) -> ModelHandle:
    """Make a handle of a model with these values from a handle of the root."""
    pointer, root = ctypes.c_void_p(), roots.take()
    try:
        user, rotation = checks.address(numbers), checks.address(frequencies)
        handles.call("model_with_user", root.pointer, user, rotation, ctypes.byref(pointer))
    finally:
        roots.give(root)
    made = ModelHandle(pointer, (numbers, root), callbacks.Failures())
    if table is not None:
        handles.call("model_set_parameters", pointer, *table.shape, checks.address(table))
    return made


def _constants(code: Code, values: dict[str, Any]) -> np.ndarray:
    """Values (constant, path) of the parts of formulas that depend on parameters alone."""
    paths = count_of(values) or 1
    given = np.array([np.broadcast_to(x, paths) for x in values.values()])
    found = np.empty((len(code.derivatives.constants()), paths))
    function = code.compiled.library.formula_constants
    function.argtypes = (ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p)
    function(paths, checks.address(given), checks.address(found))
    return found
