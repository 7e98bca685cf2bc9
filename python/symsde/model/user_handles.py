# SPDX-License-Identifier: BSD-3-Clause
"""Handles of models: built-in ones, and those of users' functions, compiled or of Python."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ..errors import IncompatibleError, WrongTypeError
from ..native import abi, callbacks, checks, handles

#: exact flows of two parts of H
PARTS = ("drift", "kick")

#: schemes whose steps are made of them
STEPPED_BY_PARTS = ("gauss_dkdkd", "verlet_dkd_weak2")


class ModelHandle(handles.Handle):
    """A handle of a model, and the exceptions of the callbacks of its calls."""

    def __init__(self, pointer: ctypes.c_void_p, keep_alive: object, failures: callbacks.Failures):
        """Own the handle `pointer`."""
        super().__init__("model", pointer, keep_alive)
        self.failures = failures


def builtin(name: str, parameters: Mapping[str, float]) -> ModelHandle:
    """A handle of a built-in model."""
    count = len(parameters)
    keys = (ctypes.c_char_p * count)(*(handles.encode(key) for key in parameters))
    values = (ctypes.c_double * count)(*parameters.values())
    pointer = ctypes.c_void_p()
    handles.call("model_get", handles.encode(name), count, keys, values, ctypes.byref(pointer))
    return ModelHandle(pointer, None, callbacks.Failures())


def of_user(name: str, traits: abi.Traits, functions: dict[str, Any], accepts_null: bool) -> ModelHandle:
    """A handle of a user's model, with callbacks that store their exceptions for this handle alone."""
    failures = callbacks.Failures()
    found, user = _all_callbacks(functions, failures)
    (*plain, joint, third, rows, drift, kick), pointer = found, ctypes.c_void_p()
    text, known, made = handles.encode(name), ctypes.byref(traits), ctypes.byref(pointer)
    if functions["gradient"] is None:
        handles.call("model_new_parts", text, known, drift, kick, plain[1], user, made)
    else:
        handles.call("model_new", text, known, *plain, user, made)
    handle = ModelHandle(pointer, (found, tuple(functions.values())), failures)
    if drift and functions["gradient"] is not None:
        handles.call("model_set_parts", pointer, drift, kick)
    if joint:
        handles.call("model_set_gradient_hessian", pointer, joint)
    if third:
        handles.call("model_set_third_derivative", pointer, third)
    if rows:
        handles.call("model_set_chain_rows", pointer, rows)
    if accepts_null:
        handles.call("model_accept_null", pointer)
    return handle


def with_flows(make: Callable[[], ModelHandle], flows: dict[str, Any], any_lanes: bool) -> ModelHandle:
    """A handle of a user's model that defines whole steps, or whose functions take any number of lanes."""
    handle = make()
    handle.flows = []  # must live as long as the handle
    for scheme, function in flows.items():
        callback, _ = callbacks.compiled("flow", function)
        handle.flows.append((callback, function))
        handles.call("model_set_flow", handle.pointer, handles.encode(scheme), callback)
    if any_lanes:
        handles.call("model_accept_any_lanes", handle.pointer)
    return handle


def derived(make: Callable[[], ModelHandle]) -> ModelHandle:
    """A handle of a user's model that remembers which probes it passed."""
    handle = make()
    handles.call("model_set_derived", handle.pointer)
    return handle


def with_kernels(make: Callable[[], ModelHandle], kernels: Mapping[str, Any]) -> ModelHandle:
    """A handle of a user's model that has these compiled functions: "squares", of all noises at one pass, or "pull",
    of covectors over several steps.
    """
    handle = make()
    handle.kernels = kernels  # must live as long as the handle
    for kind, function in kernels.items():
        handles.call(f"model_set_{kind}", handle.pointer, callbacks.compiled(kind, function)[0])
    return handle


def with_probed_traits(make: Callable[[], ModelHandle], ndof: int) -> ModelHandle:
    """A handle of a user's model that declares what its gradient does not refute at three points.

    The state in their middle has different coordinates, since equal ones may lie on each other.
    """
    handle = make()
    places = np.arange(ndof)
    q, p = 1 + places * 0.6180339887498949 % 1, 0.5 + places * 0.41421356237309503 % 1
    try:
        handles.call("model_set_probed_traits", handle.pointer, 0.0, checks.address(q), checks.address(p))
    finally:
        handle.failures.raise_stored()
    return handle


def checked_flows(flows: Mapping[str, Any] | None, by_parts: bool = False) -> dict[str, Any]:
    """Check whole steps by scheme; functions that are not compiled are refused."""
    given = checks.table("flows", {} if flows is None else flows)
    for scheme, function in given.items():
        if by_parts and scheme in STEPPED_BY_PARTS:
            raise IncompatibleError(
                f"flows[{scheme!r}] beside drift and kick, which make these steps: leave one of them out"
            )
        if callbacks.compiled("flow", function) is None:
            raise WrongTypeError(
                f"flows[{scheme!r}] = {checks.shown(function)} is not compiled: give a numba cfunc of "
                "symsde.numba_signature('flow'), a ctypes function pointer or a LowLevelCallable"
            )
    return given


def kinds_of(functions: dict[str, Any]) -> set[str]:
    """The kinds of functions, Python or compiled; refuses anything else."""
    given = {kind for kind, function in functions.items() if function is not None}
    if len(given & set(PARTS)) == 1:
        raise WrongTypeError("drift and kick go together: give both, the exact flows of D and of sum_j w[j] K_j")
    if "gradient" not in given and not given.issuperset(PARTS):
        raise WrongTypeError("gradient is None: give the gradient of the weighted sum of the Hamiltonians")
    if more := sorted(given - {*PARTS, "value"}) if "gradient" not in given else []:
        raise WrongTypeError(f"{more[0]} without gradient: give gradient beside drift and kick, or leave {more[0]} out")
    kinds = set()
    for kind, function in functions.items():
        if function is None:
            continue
        if callbacks.compiled(kind, function) is not None:
            kinds.add("compiled")
        elif callable(function) and kind == "chain_rows":
            raise WrongTypeError(
                "chain_rows is a Python function: it would be called for every few rows of every iteration; "
                "compile it, or leave it out"
            )
        elif callable(function):
            checks.takes(kind, function, "t", "tau" if kind == "drift" else "w", *callbacks.VECTORS[kind])
            kinds.add("Python")
        else:
            raise WrongTypeError(
                f"{kind} = {checks.shown(function)} cannot be called: give a function, a numba cfunc, "
                "a ctypes function pointer or a LowLevelCallable"
            )
    return kinds


def _all_callbacks(functions: dict[str, Any], failures: callbacks.Failures):
    """Callbacks in the order of the C interface, and their user pointer."""
    found, users = [], set()
    for kind, function in functions.items():
        ready = None if function is None else callbacks.compiled(kind, function)
        if function is None:
            found.append(abi.CALLBACKS[kind]())
        elif ready is not None:
            found.append(ready[0])
            users.add(ready[1])
        else:
            found.append(callbacks.from_python(kind, function, failures))
    users.discard(None)
    if len(users) > 1:
        raise IncompatibleError("the compiled functions have different user data: a model has room for one pointer")
    return found, (users.pop() if users else None)
