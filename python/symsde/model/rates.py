# SPDX-License-Identifier: BSD-3-Clause
"""Damping: rates and matrices that are numbers, and rates gamma_i(q, t), functions of users as callbacks."""

from __future__ import annotations

import ctypes
import inspect
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import IncompatibleError, WrongShapeError, WrongTypeError
from ..native import abi, callbacks, checks, handles


@dataclass(frozen=True)
class Rates:
    """Rates of momenta that depend on position, on time, or on both."""

    function: Any  #: a Python function, or a compiled one
    of: str = "qt"  #: arguments on which the function depends: "q", "t" or "qt"
    each: bool = False  #: whether each momentum has a rate, else one serves all
    allow_gain: bool = False  #: whether rates may be negative
    texts: tuple[str, ...] = ()  #: texts of formulas, if the rates are formulas

    @property
    def in_python(self) -> bool:
        """Whether the function is one of Python."""
        return callbacks.compiled("damping", self.function) is None

    def told(self) -> list[str]:
        """The formulas, or the name of the function, for files."""
        return list(self.texts) or [getattr(self.function, "__qualname__", type(self.function).__name__)]

    def set(self, handle: Any, ndof: int) -> None:
        """Let the rates damp the model of a handle, which keeps them alive."""
        ready = callbacks.compiled("damping", self.function)
        function, user = ready or (self._from_python(handle.failures), None)
        handle.rates = function, self.function
        depends = (1 if "q" in self.of else 0) + (2 if "t" in self.of else 0)
        count = ndof if self.each else 1
        handles.call("model_set_damping_function", handle.pointer, function, count, depends, int(self.allow_gain), user)

    def _from_python(self, failures: callbacks.Failures) -> Any:
        """The callback of a Python function."""

        def callback(nlane, ndof, _nrate, t, q, rate, _user):
            try:
                given = {"q": callbacks.view(q, (ndof, nlane)).copy(), "t": t}
                found = self.function(*(given[name] for name in self.of))
                shape = (ndof, nlane) if self.each else (nlane,)
                callbacks.view(rate, shape)[...] = _like(found, shape)
            except BaseException as error:  # this exception is raised when the library has returned
                return failures.store(error)
            return 0

        return abi.CALLBACKS["damping"](callback)


#: one rate [1/time] for each degree of freedom, rows of a matrix of friction [mass/time], or functions
Damping = tuple[float, ...] | tuple[tuple[float, ...], ...] | Rates


def require_one_mass(model: Any) -> None:
    """Refuse a matrix of friction where masses go by path: the library has one matrix Gamma M^-1 for all paths."""
    origin = np.zeros((model.ndof, model.paths))
    for unit in np.eye(model.ndof):
        velocity = model.gradient(origin, origin + unit[:, np.newaxis])[1]
        if np.any(velocity != velocity[:, :1]):
            raise IncompatibleError(
                f"masses of model {model.name} differ from path to path, and a matrix of friction needs one mass for "
                "all paths: give rates, or a model for each mass"
            )


def rates_of(given: Any, each: bool, allow_gain: bool, ndof: int) -> Rates | None:
    """Rates from what a user gave as damping; None if it is no function."""
    each = checks.flag("each", each) and ndof > 1
    if isinstance(given, Rates):
        return given
    if callbacks.compiled("damping", given) is not None:
        return Rates(given, "qt", each, allow_gain)
    if isinstance(given, str):
        raise WrongTypeError(
            f"damping = {checks.shown(given)} is a text: formulas are for models from formulas; give a number, or a "
            "function of (q, t)"
        )
    if not callable(given):
        return None
    try:
        names = list(inspect.signature(given).parameters)
    except (TypeError, ValueError):
        names = ["q", "t"]
    if names not in (["q"], ["t"], ["q", "t"]):
        raise WrongTypeError(
            f"damping is a function of ({', '.join(names)}): give a function of (q, t), of (q) or of (t), with these "
            "names, or a compiled one"
        )
    return Rates(given, "".join(names), each, allow_gain)


def _like(found: Any, shape: tuple[int, ...]) -> np.ndarray:
    """The result of a function in this shape; a rate that is the same for all lanes is repeated."""
    if np.ma.is_masked(found):
        raise WrongTypeError("damping() has masked values: return an array of numbers, with NaN where there is none")
    array = np.asarray(found)
    if array.dtype.kind not in "fiu":
        raise WrongTypeError(f"damping() holds {array.dtype} values: return an array of real numbers")
    if len(shape) == 1:
        array = array[0] if array.ndim == 2 and len(array) == 1 else array
        if array.shape not in ((), (1,), shape):
            raise WrongShapeError(
                f"damping() has shape {array.shape}: return {shape}, a rate for each lane, or a number; rates of each "
                "momentum need each=True"
            )
        return np.broadcast_to(array, shape)
    array = array[:, np.newaxis] if array.shape == shape[:1] else array
    if array.shape not in (shape, (shape[0], 1)):
        raise WrongShapeError(f"damping() has shape {array.shape}: return {shape}, the lanes last, or {shape[:1]}")
    return np.broadcast_to(array, shape)


def handle_with(make: Any, rates: Rates, ndof: int) -> Any:
    """A handle of a model with damped momenta."""
    handle = make()
    rates.set(handle, ndof)
    return handle


def handle_with_numbers(make: Any, rates: np.ndarray, allow_gain: bool) -> Any:
    """A handle of a model with momenta damped by numbers: rates, or a matrix of friction."""
    handle = make()
    given = (ctypes.c_double * rates.size)(*rates.flat)
    if rates.ndim == 2:
        handles.call("model_set_friction", handle.pointer, given, int(allow_gain))
    else:
        handles.call("model_set_damping", handle.pointer, rates.size, given, int(allow_gain))
    return handle
