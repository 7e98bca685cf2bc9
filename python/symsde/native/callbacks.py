# SPDX-License-Identifier: BSD-3-Clause
"""Python and compiled functions as callbacks of the library.

An exception never leaves a callback. The callback stores the exception and returns nonzero; when the library has
returned, the exception is raised again with its traceback. Python functions get copies of the state, so a function may
keep its arguments.
"""

from __future__ import annotations

import ctypes
import functools
import re
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import numpy as np

from ..errors import WrongShapeError, WrongTypeError
from . import abi, checks
from .files import optional
from .library import library

Call = tuple[int, int, int, float]  # nlane, ndof, nham, t
_PRECOMPILED = (ctypes._CFuncPtr, ctypes.c_void_p)

# kind -> results of a Python function
RETURNS = {
    "gradient": ("hq", "hp"),
    "value": ("value",),
    "hessian": ("hqq", "hqp", "hpp"),
    "hessian_vector": ("uq", "up"),
    "gradient_hessian": ("hq", "hp", "hqq", "hqp", "hpp"),
    "third_derivative": ("uq", "up"),
    "force": ("f",),
    "force_derivative": ("fq", "fp"),
    "drift": ("qn", "pn"),
    "kick": ("qn", "pn"),
}
# kind -> vectors (dof, lane) among the inputs of a Python function, after t and w
VECTORS = dict.fromkeys(RETURNS, ("q", "p"))
VECTORS |= {"hessian_vector": ("q", "p", "vq", "vp"), "third_derivative": ("q", "p", "aq", "ap", "bq", "bp")}


class WithData(NamedTuple):
    """A compiled function, the address passed to it as user pointer, and an object that must live as long."""

    function: Any
    user_data: Any
    keep_alive: Any = None


_INEXACT = re.compile(r"= f\w+ [\w ]*\b(fast|contract|reassoc|arcp|afn)\b|fmuladd|__svml_|_ZGV|inttoptr")


class Failures:
    """The first exception of the callbacks of a model or a run."""

    def __init__(self) -> None:
        """Start without an exception."""
        self.first: BaseException | None = None

    def store(self, error: BaseException) -> int:
        """Keep the first exception; return the status for the library."""
        if self.first is None:
            self.first = error
        return 1

    def raise_stored(self) -> None:
        """Raise the stored exception, once."""
        error, self.first = self.first, None
        if error is not None:
            raise error


@functools.lru_cache(maxsize=1024)
def view(address: int, shape: tuple[int, ...]) -> np.ndarray:
    """A float64 array at an address, without ownership. Results are cached, since a block uses the same few
    addresses in every step.
    """
    count = 1
    for extent in shape:
        count *= extent
    return np.frombuffer((ctypes.c_double * count).from_address(address)).reshape(shape)


def store_result(where: str, value: object, target: int | None, shape: tuple[int, ...]) -> None:
    """Copy the result of a Python function to an address; NULL means that the library does not need it."""
    if target is None:
        return
    if np.ma.is_masked(value):
        raise WrongTypeError(f"{where} has masked values: return an array of numbers, with NaN where there is none")
    array = np.asarray(value)
    if array.dtype.kind not in "fiu":
        raise WrongTypeError(f"{where} holds {array.dtype} values: return an array of real numbers")
    one_row = len(shape) > 1 and array.shape == shape[-1:] and set(shape[:-1]) == {1}
    if array.ndim and array.shape != shape and not one_row:
        raise WrongShapeError(f"{where} has shape {array.shape}: return shape {shape}, the lanes last, or one number")
    view(target, shape)[...] = array


def _shape(name: str, nlane: int, ndof: int) -> tuple[int, ...]:
    """Shape of a result of a callback."""
    if name in (*RETURNS["hessian"], *RETURNS["force_derivative"]):
        return (ndof, ndof, nlane)
    return (nlane,) if name == "value" else (ndof, nlane)


def from_python(kind: str, function: Callable, failures: Failures) -> ctypes._CFuncPtr:
    """Make a callback of this kind from a Python function f(t, w, q, p, ...)."""
    if kind == "drift":
        return _drift_from_python(function, failures)
    names, nvector = RETURNS[kind], len(VECTORS[kind])

    def callback(nlane, ndof, nham, t, w, *addresses):
        try:
            vectors = [view(a, (ndof, nlane)).copy() for a in addresses[:nvector]]
            result = function(t, view(w, (nham, nlane)).copy(), *vectors)
            results = (result,) if len(names) == 1 else _unpacked(kind, names, result)
            for name, value, target in zip(names, results, addresses[nvector:-1], strict=True):
                store_result(f"{name} of {kind}()", value, target, _shape(name, nlane, ndof))
        except BaseException as error:  # raise_stored raises the exception later
            return failures.store(error)
        return 0

    return abi.CALLBACKS[kind](callback)


def _drift_from_python(function: Callable, failures: Failures) -> ctypes._CFuncPtr:
    """Make a callback from a Python function drift(t, tau, q, p), which has a time in the place of weights."""

    def callback(nlane, ndof, t, tau, *addresses):
        try:
            shape, targets = (ndof, nlane), addresses[2:]
            q, p = (view(a, shape).copy() for a in addresses[:2])
            results = _unpacked("drift", RETURNS["drift"], function(t, tau, q, p))
            for name, value, target in zip(RETURNS["drift"], results, targets[:-1], strict=True):
                store_result(f"{name} of drift()", value, target, shape)
        except BaseException as error:  # raise_stored raises the exception later
            return failures.store(error)
        return 0

    return abi.CALLBACKS["drift"](callback)


def _unpacked(kind: str, names: tuple[str, ...], result: object) -> tuple:
    if isinstance(result, tuple | list) and len(result) == len(names):
        return tuple(result)
    given = f"{len(result)} values" if isinstance(result, tuple | list) else type(result).__name__
    raise WrongTypeError(f"{kind}() returned {given}: return the tuple ({', '.join(names)})")


def compiled(kind: str, function: object) -> tuple[ctypes._CFuncPtr, int | None] | None:
    """A compiled function (numba cfunc, ctypes pointer, LowLevelCallable) and its user pointer; None for other
    objects.
    """
    user = None
    if isinstance(function, WithData) or type(function).__name__ == "LowLevelCallable":
        user = _address_of(function.user_data, "user_data of the LowLevelCallable")
        function = function.function
    if not isinstance(function, _PRECOMPILED) and hasattr(function, "address"):
        _check_numba(kind, function)
        function = ctypes.c_void_p(function.address)
    if type(function).__name__ == "PyCapsule":
        function = ctypes.c_void_p(_capsule_pointer(function))
    if isinstance(function, ctypes._CFuncPtr):
        _check_ctypes(kind, function)
    if not isinstance(function, _PRECOMPILED):
        return None
    return ctypes.cast(function, abi.CALLBACKS[kind]), user


def _check_numba(kind: str, function: object) -> None:
    """Check the signature of a numba cfunc: a wrong one would compute nonsense, or end the process."""
    given = getattr(function, "_sig", None)
    if given is None:
        return
    wanted, doing = numba_signature(kind), f"declare it with numba.cfunc(symsde.numba_signature('{kind}'))"
    if len(given.args) != len(wanted.args):
        raise WrongTypeError(
            f"the compiled {kind} takes {len(given.args)} arguments and not {len(wanted.args)}: {doing}"
        )
    if given.return_type != wanted.return_type:
        raise WrongTypeError(f"the compiled {kind} returns {given.return_type} and not {wanted.return_type}: {doing}")
    for i, (mine, theirs) in enumerate(zip(given.args[:-1], wanted.args[:-1], strict=True)):
        if mine != theirs:  # the last argument, user data, may be any pointer
            raise WrongTypeError(f"argument {i + 1} of the compiled {kind} is {mine} and not {theirs}: {doing}")


def _check_ctypes(kind: str, function: object) -> None:
    """Check the types of a ctypes function pointer: integers, numbers and pointers must be in the right places."""
    wanted = abi.CALLBACKS[kind]
    given = function.argtypes or ()
    if given and [_sort(x) for x in given] != [_sort(x) for x in wanted._argtypes_]:
        names = ", ".join(getattr(x, "__name__", str(x)) for x in given)
        raise WrongTypeError(
            f"the compiled {kind} takes ({names}), which is not its C signature in symsde.h: declare it so"
        )
    if function.restype is not ctypes.c_int:
        raise WrongTypeError(
            f"the compiled {kind} returns {function.restype} and not c_int: return 0, or a code to stop"
        )


def _sort(kind: type) -> object:
    """The ctypes type of a number; all pointers count as the same type."""
    texts = (ctypes.c_void_p, ctypes.c_char_p, ctypes.c_wchar_p)
    return kind if issubclass(kind, ctypes._SimpleCData) and kind not in texts else ctypes.c_void_p


def _address_of(value: object, what: str) -> int | None:
    """The address in a pointer of any kind."""
    if value is None:
        return None
    if type(value).__name__ == "PyCapsule":
        return _capsule_pointer(value)
    try:
        return ctypes.cast(value, ctypes.c_void_p).value
    except (TypeError, ctypes.ArgumentError):
        raise WrongTypeError(f"{what} is no pointer: give a ctypes pointer or None") from None


def _capsule_pointer(capsule: object) -> int | None:
    api = ctypes.pythonapi
    api.PyCapsule_GetName.restype = ctypes.c_char_p
    api.PyCapsule_GetName.argtypes = (ctypes.py_object,)
    api.PyCapsule_GetPointer.restype = ctypes.c_void_p
    api.PyCapsule_GetPointer.argtypes = (ctypes.py_object, ctypes.c_char_p)
    return api.PyCapsule_GetPointer(capsule, api.PyCapsule_GetName(capsule))


def takes_any_lanes(functions: Iterable[object]) -> bool:
    """Whether compiled functions are known to give a lane the same bits whatever the number of lanes.

    LLVM uses IEEE arithmetic both in vectors and in remainder loops, unless instructions are marked as fast, a vector
    library computes sine and similar functions, or a function is called by its address; among functions called by
    address, only the library's sine and cosine are known to be safe. Only numba functions can be examined.
    """
    texts = [getattr(function, "inspect_llvm", None) for function in functions if function is not None]
    own = f"inttoptr (i64 {ctypes.cast(library.symsde_sincos, ctypes.c_void_p).value} to"
    return bool(texts) and all(text and not _INEXACT.search(text().replace(own, "")) for text in texts)


def numba_signature(kind: str):
    """Signature of a function of a model (gradient, value, hessian, .., drift, kick, flow, chain_rows) for numba.cfunc.

    Inside the function, with the shapes of `Model`:

        x, out = numba.carray(q, (ndof, nlane)), numba.carray(hq, (ndof, nlane))
        out[0] = ...

    Write every output: it is NaN before the call, and a lane that is not written fails. numba leaves a function at a
    division by zero, unless `numba.cfunc` is given `error_model="numpy"`. If the model is made with accepts_null=True,
    the pointers of unwanted outputs are NULL. Then test `if out.ctypes.data != 0` before you write; writing to NULL
    ends the process.
    """
    checks.choice("kind", kind, list(abi.CALLBACKS))
    types = optional("numba", "fast").types
    if kind == "flow":
        array = types.CPointer(types.double)
        pointers = (array, types.CPointer(array), *(array,) * 4, types.CPointer(types.int64))
        return types.intc(*(types.intc,) * 6, types.double, types.double, *pointers, types.voidptr)
    of = {ctypes.c_int: types.intc, ctypes.c_double: types.double, ctypes.c_void_p: types.CPointer(types.double)}
    return types.intc(*(of[kind] for kind in abi.CALLBACKS[kind]._argtypes_[:-1]), types.voidptr)


def numba_sincos():
    """The library's sine and cosine as a function for numba.cfunc, several times as fast as math.sin.

    Make it outside of the cfunc, and call it inside, with n real numbers each:

        sincos = symsde.numba_sincos()
        sincos(n, x, sine, cosine)           # pointers, or array.ctypes; an int, 0 = ok
    """
    array = ctypes.POINTER(ctypes.c_double)
    return ctypes.cast(library.symsde_sincos, ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_int, array, array, array))


def observables(rows: Callable, failures: Failures) -> ctypes._CFuncPtr:
    """A callback from a function of (t, q, p) that yields names and values, (lane,) each."""

    def callback(nlane, ndof, t, *addresses):
        q, p, values, _user = addresses
        try:
            for i, (name, result) in enumerate(rows(t, view(q, (ndof, nlane)), view(p, (ndof, nlane)))):
                if np.ndim(result) == 0:  # a sum over the paths of a block is often meant as one over coordinates
                    raise WrongShapeError(
                        f"observable {name!r} is one number for all paths: return one for each, shape ({nlane},), the "
                        "paths last, as q[0]**2 or np.sum(q**2, axis=0)"
                    )
                store_result(f"observable {name!r}", result, values + 8 * nlane * i, (nlane,))
        except BaseException as error:  # raise_stored raises the exception later
            return failures.store(error)
        return 0

    return abi.Observables(callback)
