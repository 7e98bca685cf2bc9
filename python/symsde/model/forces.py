# SPDX-License-Identifier: BSD-3-Clause
"""Forces beside the Hamiltonians of a model: functions of users as callbacks of the library."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from ..errors import InvalidArgumentError, WrongShapeError, WrongTypeError
from ..native import abi, callbacks, checks, handles


@dataclass(frozen=True)
class Forces:
    """What acts beside the Hamiltonians: functions, compiled or of Python, or None."""

    force: Any = None  #: F
    force_derivative: Any = None  #: of F by q and p
    noise_force: Any = None  #: f_1 .. f_m
    noise_force_derivative: Any = None  #: of the f_k
    force_in_position: bool = False  #: F depends on q and t alone
    noise_force_in_position: bool = False  #: every f_k does
    bandwidth: int | None = None  #: no component i of them depends on q_j or p_j with |i - j| > bandwidth

    def __post_init__(self) -> None:
        """Refuse what is no function, and derivatives of nothing."""
        for kind in ("force", "noise_force"):
            function, derivative = getattr(self, kind), getattr(self, f"{kind}_derivative")
            if derivative is not None and function is None:
                raise InvalidArgumentError(f"there is {kind}_derivative and no {kind}: give both, or the force alone")
            for name, given in ((kind, function), (f"{kind}_derivative", derivative)):
                _check(name, given)

    def __bool__(self) -> bool:
        """Whether any force acts."""
        return self.force is not None or self.noise_force is not None

    @property
    def in_position(self) -> bool:
        """Whether all that act depend on q and t alone."""
        return (self.force is None or self.force_in_position) and (
            self.noise_force is None or self.noise_force_in_position
        )

    @property
    def in_python(self) -> bool:
        """Whether some function is one of Python."""
        return any(x is not None and callbacks.compiled(_kind(n), x) is None for n, x in self.functions().items())

    def functions(self) -> dict[str, Any]:
        """The functions by their names."""
        return {x.name: getattr(self, x.name) for x in fields(self) if not x.name.endswith(("in_position", "width"))}

    def told(self) -> dict[str, str]:
        """The functions that act, by the names of arguments, for files."""
        acting = {name: x for name, x in self.functions().items() if x is not None}
        return {name: getattr(x, "__qualname__", type(x).__name__) for name, x in acting.items()}

    def set(self, handle: Any, noises: int) -> None:
        """Let them act on the model of a handle, which keeps them alive; f_k goes with so many noises, its first."""
        handle.forces = []
        for kind, in_position in (("force", self.force_in_position), ("noise_force", self.noise_force_in_position)):
            function, derivative = getattr(self, kind), getattr(self, f"{kind}_derivative")
            first, user = _ready(kind, function, handle.failures, noises)
            second, other = _ready(f"{kind}_derivative", derivative, handle.failures, noises)
            handle.forces.append((first, second, function, derivative))
            handles.call(f"model_set_{kind}", handle.pointer, first, second, int(in_position), user or other)
        if self and self.bandwidth is not None:
            handles.call("model_set_force_bandwidth", handle.pointer, self.bandwidth)


def given_forces(force, derivative, noise_force, noise_derivative, *declared) -> Forces:
    """Forces from the arguments of `Model.forced`."""
    *in_position, bandwidth = declared
    flags = (checks.flag(x, y) for x, y in zip(("position_force", "position_noise_force"), in_position, strict=True))
    if bandwidth is not None:
        bandwidth = checks.integer("force_bandwidth", bandwidth, checks.INT32)
        if bandwidth < 0:
            raise InvalidArgumentError(
                f"force_bandwidth = {bandwidth}: give the largest |i - j| of q_j or p_j on which a component i of a "
                "force depends, or nothing"
            )
    return Forces(force, derivative, noise_force, noise_derivative, *flags, bandwidth)


@dataclass(frozen=True)
class FrictionOfNoises:
    """A force of a model's own noises, which pickles where the model does."""

    model: Any
    beta: float

    def __call__(self, q: np.ndarray, p: np.ndarray, t: float) -> np.ndarray:
        """-beta/2 sum_k H_k,q (H_k,q . H_p)."""
        weights = np.eye(self.model.nnoise + 1)
        velocity = self.model.gradient(q, p, weights[0], t)[1]
        gradients = (self.model.gradient(q, p, weights[k], t)[0] for k in self.model.traits.acting)
        return -self.beta / 2 * sum(g * (g * velocity).sum(axis=0) for g in gradients)


def _kind(name: str) -> str:
    """The kind of callback of an argument."""
    return name.removeprefix("noise_")


def _check(name: str, function: Any) -> None:
    """Refuse what is no function of (q, p, t)."""
    if function is None or callbacks.compiled(_kind(name), function) is not None:
        return
    if not callable(function):
        raise WrongTypeError(
            f"{name} = {checks.shown(function)} cannot be called: give a function of (q, p, t), a numba cfunc, "
            "a ctypes function pointer or a LowLevelCallable"
        )
    checks.takes(name, function, "q", "p", "t")


def _ready(name: str, function: Any, failures: callbacks.Failures, noises: int) -> tuple[Any, int | None]:
    """The callback of a function, and its user pointer; that of None is NULL."""
    kind = _kind(name)
    if function is None:
        return abi.CALLBACKS[kind](), None
    ready = callbacks.compiled(kind, function)
    if ready is not None:
        return ready
    weigh = _weigh_derivative if kind == "force_derivative" else _weigh
    return callbacks.from_python(kind, weigh(name, function, noises), failures), None


def _weigh(name: str, function: Callable, noises: int) -> Callable:
    """w[0] F, or the sum of w[k] f_k, as the library asks for it."""

    def weighted(t, w, q, p):
        found = function(q, p, t)
        if name == "force":
            return w[0] * _like(name, found, q.shape)
        return _summed(w[1:], _like(name, found, (noises, *q.shape)))

    return weighted


def _weigh_derivative(name: str, function: Callable, noises: int) -> Callable:
    """Derivatives by q and by p of what `_weigh` gives."""

    def weighted(t, w, q, p):
        found = function(q, p, t)
        if not isinstance(found, tuple | list) or len(found) != 2:
            raise WrongTypeError(f"{name}() returned {type(found).__name__}: return the tuple (fq, fp)")
        square = (len(q), *q.shape)
        if name == "force_derivative":
            return tuple(w[0] * _like(name, x, square) for x in found)
        return tuple(_summed(w[1:], _like(name, x, (noises, *square))) for x in found)

    return weighted


def _summed(w: np.ndarray, forces: np.ndarray) -> np.ndarray:
    """Sum of w[k] f[k], in the order of the noises: a lane has the same bits whatever their number."""
    total = np.zeros(forces.shape[1:])
    for weight, force in zip(w, forces, strict=False):  # a bath adds noises behind these
        total = total + weight * force
    return total


def _like(name: str, found: Any, shape: tuple[int, ...]) -> np.ndarray:
    """What a function returned, in its shape; rows that are the same for all lanes are repeated."""
    if np.ma.is_masked(found):
        raise WrongTypeError(f"{name}() has masked values: return an array of numbers, with NaN where there is none")
    array = np.asarray(found)
    if array.dtype.kind not in "fiu":
        raise WrongTypeError(f"{name}() holds {array.dtype} values: return an array of real numbers")
    if array.shape == shape[:-1]:
        array = array[..., np.newaxis]
    if array.shape not in (shape, (*shape[:-1], 1)):
        raise WrongShapeError(f"{name}() has shape {array.shape}: return shape {shape}, the lanes last")
    return np.broadcast_to(array, shape)


def handle_with(make: Callable[[], Any], forces: Forces, noises: int) -> Any:
    """A handle of a model on which forces act."""
    handle = make()
    forces.set(handle, noises)
    return handle
