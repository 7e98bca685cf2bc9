# SPDX-License-Identifier: BSD-3-Clause
"""What acts beside the Hamiltonians of a wide model (`wide.py`), where that is no formula: forces that are functions,
which hold no parameters, and the friction that belongs to noises, which holds theirs and the masses.

A force of the path's rows has zeros in the rows of parameters, and derivatives of zero by them. With g_k = H_k,q and
v = H_p, the friction of noises in position and its derivatives are

    F = -beta/2 sum_k g_k (g_k.v)      F_q = -beta/2 sum_k (H_k,qq (g_k.v) + g_k (H_k,qq v + H_qp g_k))
                                       F_p = -beta/2 sum_k g_k H_pp g_k

where q holds the parameters. Of noises with constant g_k and diagonal masses it is damping by gamma_i =
beta/2 sum_k g_ki^2 v_i(p = 1), whose derivatives by parameters are those of g_k and v.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

from ...native import callbacks, checks
from ..definition import Model
from ..forces import Forces, FrictionOfNoises


def with_acting(wide: Model, model: Model) -> Model:
    """The wide model with the forces of a model, which are functions."""
    forces = model._forces
    if not forces:
        return wide
    if isinstance(forces.force, FrictionOfNoises):
        rubbed = _Friction(wide, forces.force.beta, model.ndof)
        return wide._with_forces(Forces(force=rubbed.force, force_derivative=rubbed.derivative))
    padded = {
        name: _Padded(_called(name, x, model.nnoise), model.ndof, 2 if name.endswith("derivative") else 1)
        for name, x in forces.functions().items()
        if x is not None
    }
    return wide._with_forces(dataclasses.replace(forces, **padded, bandwidth=None))


def with_slopes(model: Model) -> Model:
    """A model whose force has derivatives if it is the friction of noises, with which steps are not solved."""
    known = isinstance(model._forces.force, FrictionOfNoises) and model.traits.has_hessian
    return with_acting(model._unforced, model) if known else model


def bath_slopes(wide: Model, theta: np.ndarray, ndof: int, beta: float) -> np.ndarray:
    """Derivatives of the rates gamma_i of a bath by the parameters that are positions, (position, dof)."""
    place = np.concatenate((np.cos(1.0 + np.arange(ndof)), theta))
    momenta = np.concatenate((np.ones(ndof), np.zeros(len(theta))))
    weights = np.eye(wide.nnoise + 1)
    velocity = wide.gradient(place, momenta, weights[0])[1][:ndof, 0]
    of_velocity = wide.hessian(place, momenta, weights[0])[1][:ndof, ndof:, 0].T
    found = np.zeros((len(theta), ndof))
    for w in weights[1:]:
        force = wide.gradient(place, momenta, w)[0][:ndof, 0]
        of_force = wide.hessian(place, momenta, w)[0][ndof:, :ndof, 0]
        found += beta / 2 * (2 * force * of_force * velocity + force**2 * of_velocity)
    return found


@dataclasses.dataclass(frozen=True)
class _Padded:
    """A force, or its derivatives, of the first n rows."""

    function: Callable
    n: int
    axes: int  #: of a force 1, of a derivative 2

    def __call__(self, q: np.ndarray, p: np.ndarray, t: float) -> Any:
        """Of all rows."""
        found, n = self.function(q[: self.n], p[: self.n], t), self.n
        if self.axes == 1:
            return self._wide(found, q.shape)
        return tuple(self._wide(x, q.shape) for x in found) if len(found) == 2 and n else found

    def _wide(self, x: Any, shape: tuple[int, ...]) -> np.ndarray:
        """Rows of zeros behind those of each axis."""
        x = np.asarray(x)
        rows, lanes = shape
        if x.ndim < self.axes + 1:  # the same for all lanes
            x = x[..., np.newaxis]
        out = np.zeros((*x.shape[: x.ndim - self.axes - 1], *(rows,) * self.axes, lanes))
        out[(..., *(slice(self.n),) * self.axes, slice(None))] = x
        return out


@dataclasses.dataclass(frozen=True)
class _Friction:
    """The friction of the noises of a wide model, in the rows of n degrees of freedom."""

    model: Model
    beta: float
    n: int

    def force(self, q: np.ndarray, p: np.ndarray, t: float) -> np.ndarray:
        """F; zero in the rows of parameters."""
        found = FrictionOfNoises(self.model, self.beta)(q, p, t)
        found[self.n :] = 0
        return found

    def derivative(self, q: np.ndarray, p: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
        """F_q and F_p, (by, of, lane)."""
        n, weights = self.n, np.eye(self.model.nnoise + 1)
        velocity = self.model.gradient(q, p, weights[0], t)[1][:n]
        _, hqp, hpp = self.model.hessian(q, p, weights[0], t)
        fq, fp = np.zeros_like(hpp), np.zeros_like(hpp)
        for k in self.model.traits.acting:
            g = self.model.gradient(q, p, weights[k], t)[0][:n]
            hqq = self.model.hessian(q, p, weights[k], t)[0][:, :n]
            work = (g * velocity).sum(axis=0)
            of_work = (hqq * velocity).sum(axis=1) + (hqp[:n] * g[:, np.newaxis]).sum(axis=0)
            fq[:, :n] += hqq * work + of_work[:, np.newaxis] * g
            fp[:n, :n] += (hpp[:n, :n] * g).sum(axis=1)[:, np.newaxis] * g
        return -self.beta / 2 * fq, -self.beta / 2 * fp


def _called(name: str, function: Any, noises: int) -> Callable:
    """A force, or its derivatives, as a function of (q, p, t), where it is compiled."""
    kind = name.removeprefix("noise_")
    ready = callbacks.compiled(kind, function)
    if ready is None:
        return function
    of_noises, count = name.startswith("noise"), 2 if name.endswith("derivative") else 1

    def called(q, p, t):
        n, lanes = q.shape
        state = [np.ascontiguousarray(x, dtype=float) for x in (q, p)]
        rows = []
        for k in range(1, noises + 1) if of_noises else (0,):
            w = np.zeros((noises + 1, lanes))
            w[k] = 1
            out = [np.empty((*(n,) * count, lanes)) for _ in range(count)]
            ready[0](lanes, n, noises + 1, t, *map(checks.address, (w, *state, *out)), ready[1])
            rows.append(out)
        found = [np.array(x) if of_noises else x[0] for x in zip(*rows, strict=True)]
        return found[0] if count == 1 else tuple(found)

    return called
