# SPDX-License-Identifier: BSD-3-Clause
"""Checks of arguments. Each error is a sentence: the value given, the allowed ones, and what to do."""

from __future__ import annotations

import contextlib
import ctypes
import difflib
import functools
import inspect
import math
import numbers
import operator
import os
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, ParamSpec, TypeVar

import numpy as np

from ..errors import OF_RUNS, InvalidArgumentError, TooLargeError, UnknownNameError, WrongShapeError, WrongTypeError
from .library import library

_P = ParamSpec("_P")
_R = TypeVar("_R")
_address_of, _byte_at = ctypes.addressof, ctypes.c_char.from_buffer

INT32 = (-(2**31), 2**31 - 1)
_LITTLE = 2**24  #: bytes that every machine has
INT64 = (-(2**63), 2**63 - 1)
UINT64 = (0, 2**64 - 1)
_LESS = "save less often (save_every, or save_at with a larger common divisor), fewer paths, or use moments"
_FLOAT64 = np.dtype(np.float64)
_LARGE = 2**28  #: bytes above which free memory is checked
_NAME = 1000  #: most characters of a name; the library takes 4096 bytes


def shown(value: object) -> str:
    """A value as the user wrote it, shortened to fit into a sentence."""
    if isinstance(value, np.ndarray):
        return f"an array of shape {value.shape}"
    try:
        text = repr(value)
    except Exception:  # a foreign object may raise anything; so does an integer of thousands of digits
        return f"an object of type {type(value).__name__}"
    return text if len(text) <= 60 else text[:57] + "..."


def number(name: str, value: object) -> float:
    """A real number; the library decides whether it must be finite."""
    if type(value) is float:
        return value
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value.item()
    if isinstance(value, bool | np.bool_) or not isinstance(value, numbers.Real):
        raise WrongTypeError(f"{name} = {shown(value)} is not a number: give one real number")
    try:
        return float(value)
    except OverflowError:
        raise InvalidArgumentError(f"{name} = {shown(value)} is too large: give a number below 1.8e308") from None


def finite(name: str, value: object) -> float:
    """A finite number."""
    result = number(name, value)
    if not math.isfinite(result):
        raise InvalidArgumentError(f"{name} = {result} is not finite: give a finite number")
    return result


def integer(name: str, value: object, bounds: tuple[int, int] = INT64) -> int:
    """An integer within the bounds; floats with an integer value (1e6) are accepted."""
    whole = value if type(value) is int else _whole(name, value)
    low, high = bounds
    if not low <= whole <= high:
        raise InvalidArgumentError(f"{name} = {shown(whole)} is out of range: give an integer from {low} to {high}")
    return whole


def _whole(name: str, value: object) -> int:
    if isinstance(value, float | np.floating) and float(value).is_integer():
        value = int(value)
    try:
        if isinstance(value, bool | np.bool_):
            raise TypeError
        return operator.index(value)
    except TypeError:
        raise WrongTypeError(f"{name} = {shown(value)} is not a whole number: give an integer") from None


def flag(name: str, value: object) -> bool:
    """True or False."""
    if not isinstance(value, bool | np.bool_):
        raise WrongTypeError(f"{name} = {shown(value)} is not a truth value: give True or False")
    return bool(value)


def name_of(what: str, value: object) -> str:
    """A name."""
    if not isinstance(value, str):
        raise WrongTypeError(f"{what} = {shown(value)} is not a name: give a string")
    if len(value) > _NAME:
        raise InvalidArgumentError(
            f"{what} = {shown(value)} is too long for a name: it has {len(value)} characters, allowed are {_NAME}"
        )
    return value


def items(value: object) -> list | None:
    """The items of a list or a similar object; None for a single object, such as a text or an array without
    dimension."""
    if isinstance(value, str | bytes) or not isinstance(value, Iterable) or getattr(value, "ndim", 1) == 0:
        return None
    return list(value)


def table(name: str, value: object) -> dict[str, Any]:
    """A dict of names and values."""
    if not isinstance(value, Mapping):
        raise WrongTypeError(f"{name} = {shown(value)} is no table: give a dict of names and values")
    return {name_of(f"a name of {name}", key): item for key, item in value.items()}


def counted(number: int, noun: str) -> str:
    """1 path, 2 paths; 1 degree of freedom, 2 degrees of freedom."""
    first, _, rest = noun.partition(" ")
    return f"{number} {first}{'' if number == 1 else 's'}{f' {rest}' if rest else ''}"


#: name in other libraries -> name here
_ELSEWHERE = {
    **dict.fromkeys(("dt", "h", "stepsize", "tau"), "step"),
    **dict.fromkeys(("method", "integrator", "solver", "alg"), "scheme"),
    **dict.fromkeys(("trajectories", "samples", "realizations", "particles"), "paths"),
    **dict.fromkeys(("verlet", "leapfrog", "velocity_verlet", "strang"), "stormer_verlet"),
    **dict.fromkeys(("rng", "random_state"), "seed"),
    **dict.fromkeys(("tol", "atol", "tolerance", "eps"), "abs"),
    "rtol": "rel",
    **dict.fromkeys(("qmc", "sobol", "quasi", "mlqmc"), "multilevel quasi-Monte Carlo"),
    **dict.fromkeys(("mlmc", "multi-level"), "multilevel"),
    **dict.fromkeys(("mc", "monte carlo", "montecarlo"), "plain"),
    **dict.fromkeys(("t", "t_end", "tmax", "t_final", "duration"), "horizon"),
    **dict.fromkeys(("kind", "type", "style"), "what"),
}


def warn(text: str, kind: type[Warning]) -> None:
    """Warn with the line outside of the package that made the call."""
    frame, level = sys._getframe(), 1
    while frame.f_back is not None and frame.f_globals.get("__name__", "").partition(".")[0] == "symsde":
        frame, level = frame.f_back, level + 1
    warnings.warn(text, kind, stacklevel=level)


@contextlib.contextmanager
def unwarned() -> Iterator[None]:
    """Suppress the warnings of runs, whose failures the caller counts, judges or shows."""
    with warnings.catch_warnings():
        for kind in OF_RUNS:
            warnings.simplefilter("ignore", kind)
        yield


def _like(given: str, known: Sequence[str], share: float = 0.5) -> list[str]:
    """The known names that are similar to a given one: the intended or nearest first."""
    close = difflib.get_close_matches(given, known, n=len(known) or 1, cutoff=share)
    meant = _ELSEWHERE.get(given.lower())
    return [meant, *(name for name in close if name != meant)] if meant in known else close


def nearest(given: str, known: Iterable[str]) -> str:
    """The known names, the intended or most similar first, joined by commas."""
    known = list(known)
    close = _like(given, known)
    return ", ".join([*close, *(name for name in known if name not in close)])


def none_such(what: str, given: str, known: Sequence[str]) -> UnknownNameError:
    """The error for a name that is not in the catalogue: it gives the nearest name, and how to see all."""
    close = _like(given, known)
    hint = f"the nearest is {close[0]}; " if close else ""
    return UnknownNameError(f"there is no {what} {shown(given)}: {hint}`symsde list {what}s` shows all")


def no_option(key: str, known: Iterable[str], told: str = "") -> WrongTypeError:
    """The error for an unknown option; told: a sentence to add."""
    known = list(known)
    meant, close = _ELSEWHERE.get(key.lower()), _like(key, known, 0.7)  # if no name is similar, all are listed
    if meant in known:
        hint = f"it is called {meant} here"
    elif "horizon" in (key, meant) and "steps" in known and "horizon" not in known:
        hint = "the time of a run is step times steps"
    else:
        hint = f"the nearest is {close[0]}" if close else f"there are {nearest(key, known)}"
    error = WrongTypeError(f"there is no option {key!r}: {hint}{told}")
    error.option = key
    return error


def hinted(*more: str, told: str = "") -> Callable[[Callable[_P, _R]], Callable[_P, _R]]:
    """Decorate a function that takes options as **: a TypeError at its call gets a hint, such as for dt without
    step.

    told: a sentence added for an unknown option, {key}.
    """

    def wrap(function: Callable[_P, _R]) -> Callable[_P, _R]:
        @functools.wraps(function)
        def call(*args: _P.args, **given: _P.kwargs) -> _R:
            try:
                return function(*args, **given)
            except TypeError as error:
                # raised at the call, or by a function that got the options and knows fewer of them
                if error.__traceback__.tb_next is None or getattr(error, "option", None) in given:
                    known = dict.fromkeys([*inspect.signature(function).parameters, *more])
                    for name in ("options", "self"):
                        known.pop(name, None)
                    for key in given:
                        if key not in known:
                            raise no_option(key, known, told.format(key=key)) from None
                raise

        return call

    return wrap


def takes(what: str, function: Callable, *arguments: str) -> None:
    """Refuse a Python function that cannot be called with this number of positional arguments."""
    try:
        signature = inspect.signature(function)
    except (TypeError, ValueError):  # the function has no signature
        return
    try:
        signature.bind(*arguments)
    except TypeError:
        raise WrongTypeError(
            f"{what} is a function of {signature}: it is called as f({', '.join(arguments)}), in this order"
        ) from None


def not_given(function: str, options: dict, decided: dict[str, str]) -> None:
    """Refuse options that a function sets itself; `decided`: name -> the argument that sets it."""
    for key, by in decided.items():
        if key in options:
            raise WrongTypeError(f"{key!r} is no option of {function}: {by}")


def choice(name: str, value: object, known: Sequence[str]) -> int:
    """The position of a name in a list of allowed names."""
    if name_of(name, value) not in known:
        meant = _ELSEWHERE.get(value.lower())
        hint = f"it is called {meant!r} here" if meant in known else f"there are {nearest(value, known)}"
        raise UnknownNameError(f"{name} = {value!r} does not exist: {hint}")
    return known.index(value)


def real_array(name: str, value: object) -> np.ndarray:
    """Values as an array of float64; copied only if they are not such an array."""
    if type(value) is np.ndarray and value.dtype is _FLOAT64:  # the usual case
        return _fits(value, name)
    if np.ma.is_masked(value):
        raise WrongTypeError(
            f"{name} has masked values, which no array of numbers can hold: fill them or leave them out"
        )
    try:
        array = np.asarray(value)
    except ValueError:
        raise WrongShapeError(
            f"{name} is a nested sequence of unequal lengths: give an array with rows of one length"
        ) from None
    if array.dtype.kind not in "fiu":
        raise WrongTypeError(f"{name} holds {array.dtype} values and not real numbers: give an array of numbers")
    return np.asarray(_fits(array, name), dtype=np.float64)


def _fits(array: Any, name: str) -> Any:
    """The array; a view with repeated numbers is refused if a copy would not fit into memory."""
    if array.nbytes > _LARGE:
        room(array.shape, f"the numbers of {name}", now=False, do="give fewer")
    return array


def own(value: Any) -> Any:
    """A copy that the caller cannot change: arrays, lists and tables are copied to any depth."""
    if isinstance(value, np.ndarray):
        return _fits(value, "an array").copy()
    if isinstance(value, Mapping):
        return {key: own(item) for key, item in value.items()}
    return type(value)(map(own, value)) if type(value) in (list, tuple, set) else value


def fixed(given: Any) -> Any:
    """The value with lists as tuples and arrays as numbers."""
    if isinstance(given, np.ndarray | np.generic):
        given = _fits(given, "an array").tolist()
    return tuple(map(fixed, given)) if isinstance(given, list | tuple | set) else given


def state(name: str, value: object, ndof: int, paths: int, *, kept: bool = True) -> np.ndarray:
    """A state as C-contiguous (dof, 1) or (dof, path) from a scalar, (dof,) or (dof, path); copied if it is
    kept."""
    shaped = np.array if kept else np.asarray
    if type(value) is float:  # the usual case
        array = np.empty((ndof, 1))
        array.fill(value)
        return array
    array = real_array(name, value)
    if array.ndim == 0:
        return np.full((ndof, 1), float(array))
    if array.ndim == 1 and array.shape[0] == ndof:
        return shaped(array[:, np.newaxis], order="C")
    if array.ndim == 2 and array.shape[0] == ndof and array.shape[1] in (1, paths):
        return shaped(array, order="C")
    hint = ""
    if array.shape in ((paths,), (paths, ndof)):
        turned = f"{name}[None, :]" if array.ndim == 1 else f"{name}.T"
        hint = f" (the path is the last axis: {turned})"
    raise WrongShapeError(
        f"{name} has shape {array.shape}: give a number, shape ({ndof},) for all paths, "
        f"or ({ndof}, {paths}), one column for each path{hint}"
    )


def is_one(value: object) -> bool:
    """Whether one state is given for all paths: with a column for each path, each has its own status."""
    return type(value) is float or np.ndim(value) < 2


def points(name: str, value: object, ndof: int, npath: int) -> np.ndarray:
    """A state with one column for each point, which is not kept."""
    return full(state(name, value, ndof, npath, kept=False), npath)


def columns(**given: object) -> int:
    """The number of points of arguments that are each a number, (row,) or (row, path)."""
    arrays = [real_array(name, x) for name, x in given.items()]
    return max([1, *(x.shape[1] for x in arrays if x.ndim == 2)])


def full(array: np.ndarray, npath: int) -> np.ndarray:
    """An array with one column for each path."""
    return np.ascontiguousarray(np.broadcast_to(array, (*array.shape[:-1], npath)))


def room(shape: tuple[int, ...], what: str, *, now: bool = True, do: str = _LESS) -> int:
    """Bytes of float64 arrays. Arrays are refused before allocation if they exceed the memory of the machine or, if
    they are made now, the memory that the control groups of this process leave."""
    size = 8 * math.prod(shape)
    if size <= _LITTLE:
        return size
    most = min(_memory(), _left_by_groups() if now else math.inf)
    if size > most:
        raise TooLargeError(
            f"{what} of shape {shape} need {size / 1e9:.3g} GB, more than the {most / 1e9:.3g} GB "
            f"that this process can have: {do}"
        )
    return size


def _left_by_groups() -> float:
    """Bytes that the control groups of this process leave: a process that uses more is killed."""
    left = ctypes.c_double()
    library.symsde_memory_left(ctypes.byref(left), None)
    return left.value


@functools.cache
def _memory() -> int:
    """Bytes of main memory."""
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, OSError, ValueError):
        return 2**46


def address(array: np.ndarray | None) -> int | None:
    """Address of an array; None (NULL) for None."""
    if array is None:
        return None
    try:
        return _address_of(_byte_at(array))  # array.ctypes.data takes three times as long
    except (TypeError, ValueError):  # the array is read-only, or empty
        return array.ctypes.data


def addresses(arrays: Iterable[np.ndarray]) -> Iterable[int]:
    """Addresses of writable arrays that are not empty, without a Python call for each."""
    return map(_address_of, map(_byte_at, arrays))
