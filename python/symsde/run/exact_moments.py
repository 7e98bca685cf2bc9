# SPDX-License-Identifier: BSD-3-Clause
"""Exact means and covariances of linear equations, dz = (A z + b) dt + sum_k (B_k z + c_k) o dW_k, z = (q, p).

With constant noise, B_k = 0, m' = A m + b and C' = A C + C A^T + sum_k c_k c_k^T: C(t) is a sum of positive matrices,
by doublings of a short time. Otherwise y = (z, 1) has dy = G_0 y dt + sum_k G_k y o dW_k and

    d/dt E y y^T = D E y y^T + E y y^T D^T + sum_k G_k E y y^T G_k^T,    D = G_0 + sum_k G_k^2/2

which is one matrix exponential of (2 dof + 1)^2 rows. Damping is part of A.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import IncompatibleError, InvalidArgumentError, TooLargeError, WrongShapeError
from ..model.definition import Model, require_model, require_unforced
from ..native import checks

MOST = {True: 256, False: 8}  #: degrees of freedom, with constant noise and with other noise
_TERMS = 20  #: of Taylor sums, for matrices of norm 1/4
_LOOKED_AT = (0.0, 0.11, 0.37, 0.5, 0.79, 1.0)  #: parts of the time at which equations are compared


@dataclass(frozen=True)
class ExactMoments:
    """Mean and covariance of z = (q_1 .. q_n, p_1 .. p_n) at the times t."""

    t: np.ndarray  #: (time,)
    mean: np.ndarray  #: (time, 2 dof)
    covariance: np.ndarray  #: (time, 2 dof, 2 dof)


def exact_moments(
    model: Model, *, q0: Any, p0: Any, t: float | Sequence[float], t0: float = 0.0, covariance: Any = None
) -> ExactMoments:
    """The exact mean and covariance of a linear model, closed or damped by numbers or a matrix: see `ExactMoments`.

    - q0, p0: mean of the state at t0, a number or (dof,)
    - t: times of the result [time], at or after t0, ascending
    - covariance: of the state at t0, (2 dof, 2 dof); by default zero

    IncompatibleError: the model is not quadratic, its equations change in time, it has forces or rates of damping that
    are functions. TooLargeError: more than 256 degrees of freedom, or 8 with noise that depends on the state.
    """
    require_model(model)
    require_unforced(model, "exact moments are those")
    if model.paths:
        raise IncompatibleError(
            f"parameters of model {model.name} differ from path to path, and exact moments are those of one model: "
            "give numbers, by model.with_parameters"
        )
    start = checks.finite("t0", t0)
    times = np.atleast_1d(np.asarray(checks.real_array("t", t), dtype=float))
    if times.ndim != 1 or not len(times) or (np.diff([start, *times]) < 0).any():
        raise InvalidArgumentError("t: give times in ascending order, not before t0")
    n = model.ndof
    mean = np.concatenate([checks.full(checks.state(name, x, n, 1), 1)[:, 0] for name, x in (("q0", q0), ("p0", p0))])
    spread = np.zeros((2 * n, 2 * n)) if covariance is None else np.array(checks.real_array("covariance", covariance))
    if spread.shape != (2 * n, 2 * n):
        raise WrongShapeError(f"covariance has shape {spread.shape}: give ({2 * n}, {2 * n}), for q before p")
    fields = _known_fields(model, start, times[-1])
    constant = not np.abs(fields[1:, :-1, :-1]).max(initial=0.0) > 0
    if n > MOST[constant]:
        raise TooLargeError(f"model {model.name} has {n} degrees of freedom: its noise allows {MOST[constant]}")
    advance = _by_covariance if constant else _by_squares
    unit = _units(fields, times[-1] - start)
    fields = fields * unit / unit[:, np.newaxis]
    unit = unit[:-1] / unit[-1]
    mean, spread = mean / unit, spread / np.outer(unit, unit)
    means, spreads, at = [], [], start
    for time in times:
        if time > at:
            mean, spread = advance(fields, time - at, mean, spread)
        at = time
        means.append(mean)
        spreads.append(spread)
    return ExactMoments(times, np.array(means) * unit, np.array(spreads) * np.outer(unit, unit))


def linear_field(model: Model, j: int, t: float) -> np.ndarray:
    """The matrix J H_j'' of the field of H_j; for H with the damping."""
    w = np.zeros(model.nnoise + 1)
    w[j] = 1
    qq, qp, pp = (block[:, :, 0] for block in model.hessian(np.zeros(model.ndof), np.zeros(model.ndof), w, t))
    loss = np.zeros_like(pp)
    if j == 0 and model.damping:
        damping = np.array(model.damping)
        loss = damping @ pp if model.has_friction else np.diag(damping)
    return np.block([[qp, pp], [-qq, -qp.T - loss]])


def _fields(model: Model, t: float) -> np.ndarray:
    """(A, b; 0, 0), and (B_k, c_k; 0, 0) of every noise: (noise + 1, 2 dof + 1, 2 dof + 1)."""
    n = model.ndof
    fields = np.zeros((model.nnoise + 1, 2 * n + 1, 2 * n + 1))
    for j in range(model.nnoise + 1):
        w = np.zeros(model.nnoise + 1)
        w[j] = 1
        hq, hp = model.gradient(np.zeros(n), np.zeros(n), w, t)
        fields[j, :-1, :-1] = linear_field(model, j, t)
        fields[j, :-1, -1] = np.concatenate([hp[:, 0], -hq[:, 0]])
    return fields


def _known_fields(model: Model, start: float, end: float) -> np.ndarray:
    """The fields of a model whose equations are linear and do not change; others are refused."""
    if model._varying:
        raise IncompatibleError(f"the rates of damping of model {model.name} are functions: exact moments need numbers")
    if not model.traits.quadratic:
        raise IncompatibleError(f"model {model.name} is not quadratic: only linear equations have exact moments")
    fields = _fields(model, start)
    room = 1e-10 * _sizes(fields)
    if any((np.abs(_fields(model, start + x * (end - start)) - fields) > room).any() for x in _LOOKED_AT):
        raise IncompatibleError(f"the equations of model {model.name} change in time: exact moments need constant ones")
    return fields


def _sizes(fields: np.ndarray) -> np.ndarray:
    """The largest number beside each entry: of the same field, of velocities or forces, and of the same columns, since
    all these differ in units."""
    sizes, n = np.empty_like(fields), fields.shape[1] // 2
    for rows, columns in itertools.product((slice(n), slice(n, 2 * n), slice(2 * n, None)), repeat=2):
        sizes[:, rows, columns] = np.abs(fields[:, rows, columns]).max(axis=(1, 2), keepdims=True)
    return sizes


def _units(fields: np.ndarray, time: float) -> np.ndarray:
    """Units of z and 1, powers of two in which no entry of the fields is large beside all others: far from one, as
    masses of atoms are, entries would take more doublings than exponentials have digits."""
    sizes = time * np.abs(fields[0]) + math.sqrt(time) * np.abs(fields[1:]).sum(axis=0)
    np.fill_diagonal(sizes, 0)
    unit = np.ones(len(sizes))
    for i in [*range(len(sizes))] * 12:  # each time the square root of what is too large remains
        row, column = (max(1.0, x.sum()) for x in (sizes[i], sizes[:, i]))
        factor = 2.0 ** round(math.log2(row / column) / 2)
        unit[i] *= factor
        sizes[i] /= factor
        sizes[:, i] *= factor
    return unit


def _by_covariance(fields: np.ndarray, time: float, mean: np.ndarray, spread: np.ndarray) -> tuple:
    """Both moments after a time, with constant noise."""
    field, pushes = fields[0], fields[1:, :-1, -1]
    halvings = max(0, math.ceil(math.log2(max(time * np.abs(field).sum(axis=1).max(), 1e-300))) + 2)
    short = time / 2**halvings
    flow, term = np.eye(len(field)), np.eye(len(field))
    for k in range(1, _TERMS):
        term = term @ field * (short / k)
        flow = flow + term
    a, term = field[:-1, :-1], short * pushes.T @ pushes
    grown = np.zeros_like(term)
    for k in range(2, _TERMS + 1):
        grown = grown + term
        term = (a @ term + term @ a.T) * (short / k)
    for _ in range(halvings):
        grown = grown + flow[:-1, :-1] @ grown @ flow[:-1, :-1].T
        flow = flow @ flow
    moved = flow[:-1, :-1]
    return moved @ mean + flow[:-1, -1], moved @ spread @ moved.T + grown


def _by_squares(fields: np.ndarray, time: float, mean: np.ndarray, spread: np.ndarray) -> tuple:
    """Both moments after a time, from E y y^T, y = (z, 1)."""
    size = fields.shape[1]
    drift = fields[0] + sum(b @ b for b in fields[1:]) / 2
    one = np.eye(size)
    generator = np.kron(drift, one) + np.kron(one, drift) + sum(np.kron(b, b) for b in fields[1:])
    y = np.append(mean, 1.0)
    second = np.outer(y, y)
    second[:-1, :-1] += spread
    second = (exponential(time * generator) @ second.ravel()).reshape(size, size)
    mean = second[:-1, -1]
    return mean, second[:-1, :-1] - np.outer(mean, mean)


def exponential(matrix: np.ndarray) -> np.ndarray:
    """Matrix exponential by scaling, Taylor and squaring; the matrices are small."""
    halvings = max(0, math.ceil(math.log2(max(np.abs(matrix).sum(axis=1).max(), 1e-300))) + 4)
    scaled, term = matrix / 2**halvings, np.eye(len(matrix))
    result = term.copy()
    for k in range(1, 14):
        term = term @ scaled / k
        result += term
    for _ in range(halvings):
        result = result @ result
    return result
