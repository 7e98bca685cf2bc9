# SPDX-License-Identifier: BSD-3-Clause
"""Errors of one scheme at one step, on the Brownian paths that all points of a study share.

    strong (E |x_h - x|^2)^(1/2) over (q, p) at the end,    weak E q_h - E q, E p_h - E p, E H(x_h) - E H(x)

where x is the exact solution on the same path, or a better scheme at a finer step; the error of that reference is
its distance to the same scheme at twice the step.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .. import diagnose
from ..errors import NumericalError
from ..model.definition import Model
from .coupled import end, rms, squares
from .error_plan import BATCHES, Plan, Reference
from .expectation.interval import quantile

CONSERVED = 1e-9  #: relative brackets below this count as zero


class References:
    """Final states of the references, computed on first use."""

    def __init__(self, plan: Plan):
        """Start without computed references."""
        self._plan = plan
        self._known: dict[Reference, tuple[np.ndarray, float]] = {}

    def get(self, reference: Reference) -> tuple[np.ndarray, float]:
        """Final states (2, dof, path) and their own rms error."""
        if reference not in self._known:
            make = self._exact if reference.scheme == "exact" else self._fine
            self._known[reference] = make(reference)
        return self._known[reference]

    def _exact(self, _reference: Reference) -> tuple[np.ndarray, float]:
        run = self._plan.reference_run("midpoint", self._plan.steps[0])
        q, p = diagnose.exact(run)
        return np.stack([q[-1], p[-1]]), 0.0

    def _fine(self, reference: Reference) -> tuple[np.ndarray, float]:
        """Compute a reference; its difference to a run with half as many steps bounds its error, and equals the error
        for a scheme of order one."""
        fine = end(self._plan.reference_run(reference.scheme, reference.steps))
        half = end(self._plan.reference_run(reference.scheme, reference.steps // 2))
        square = squares(fine, half)
        ok = np.isfinite(square)  # paths that are not ok are left out
        if ok.sum() < 2 * BATCHES:
            raise NumericalError(
                f"{(~ok).sum()} of {ok.size} paths fail with the reference ({reference}): give more reference_steps, "
                "or another reference"
            )
        return fine, rms(square[ok])


def measure(plan: Plan, scheme, steps: int, references: References) -> dict:
    """Strong and weak errors with 95 % intervals, and the drift of invariants, of one point."""
    reference, own_error = references.get(plan.references[scheme.name])
    run = plan.run(scheme, steps, shared=True)
    with np.errstate(over="ignore", invalid="ignore"):  # points that diverge may overflow; they are marked below
        return _judge(plan, run, reference, own_error)


def _judge(plan: Plan, run, reference: np.ndarray, own_error: float) -> dict:
    found = end(run)
    square = squares(found, reference)
    ok = (run.status == 0) & np.isfinite(square)
    row = {"failed": int((~ok).sum()), "ref_error": own_error, "stepper": run.report.stepper}
    if ok.sum() < 2 * BATCHES:
        return row
    row |= strong_error(square[ok], reference[:, :, ok])
    row |= weak_errors(plan.model, found[:, :, ok], reference[:, :, ok], times_of(plan)[-1])
    row["drift"] = drift(plan, found[:, :, ok], ok)
    return row


def strong_error(square: np.ndarray, reference: np.ndarray) -> dict:
    """Root mean square of squared errors (path,) with its interval, the size of the solution, and the means of the
    groups.
    """
    error = rms(square)
    spread = square.std(ddof=1) / np.sqrt(square.size)
    half = float(quantile(square.size) * spread / max(2 * error, np.finfo(float).tiny))
    return {
        "err_strong": error,
        "err_strong_low": max(error - half, 0.0),
        "err_strong_high": error + half,
        "size": rms(np.square(reference).sum(axis=(0, 1))),
        "batches": [float(batch.mean()) for batch in np.array_split(square, BATCHES)],
    }


def weak_errors(model: Model, found: np.ndarray, reference: np.ndarray, t: float) -> dict:
    """Differences of E q, E p (mean over degrees of freedom) and E H at t on common paths, with half widths of their
    intervals.
    """
    values = {"q": (found[0] - reference[0]).mean(axis=0), "p": (found[1] - reference[1]).mean(axis=0)}
    if model.traits.has_value:
        values["H"] = model.value(*found, t=t) - model.value(*reference, t=t)
    row = {}
    for name, difference in values.items():
        row[f"weak_{name}"] = float(difference.mean())
        spread = difference.std(ddof=1) / np.sqrt(difference.size)
        row[f"weak_{name}_ci"] = float(quantile(difference.size) * spread)
    return row


def drift(plan: Plan, found: np.ndarray, ok: np.ndarray) -> float | None:
    """Largest rms change of an invariant over the paths, relative unless the invariant is 0; None without
    invariants.
    """
    functions = dict(plan.invariants)
    if not functions and conserves_energy(plan.model, times_of(plan)):
        functions["H"] = plan.model.value
    changes = []
    for function in functions.values():
        first = function(*(start(x, found.shape[1], ok) for x in (plan.q0, plan.p0)))
        last = function(found[0], found[1])
        changes.append(rms(np.square((last - first) / np.where(first == 0, 1, first))))
    return float(np.max(changes)) if changes else None  # max of Python may drop a NaN


def start(state, ndof: int, ok: np.ndarray) -> np.ndarray:
    """Initial state (dof, path) of the paths that are ok."""
    array = np.asarray(state, dtype=float)
    array = array if array.ndim == 2 else np.broadcast_to(array, (ndof,))[:, np.newaxis]
    return np.ascontiguousarray(np.broadcast_to(array, (ndof, ok.size))[:, ok])


def times_of(asked: Any) -> list[float]:
    """Times at which Hamiltonians are examined: beginning, middle and end of a study or problem."""
    return [asked.options.get("t0", 0.0) + part * asked.horizon for part in (0.0, 0.3, 0.7, 1.0)]


def conserves_energy(model: Model, times: list[float]) -> bool:
    """Whether H does not depend on time and {H, H_k} = 0 for every k, at sixteen points: then H is conserved on
    every path of a system without damping and forces. Without gradients nothing tells.
    """
    if not (model.traits.has_value and model.traits.has_gradient) or model.damping or model._forces:
        return False
    points = _points(model)
    if depends_on_time(model, times):
        return False
    return all(_commutes(model, points, t) for t in times)


def depends_on_time(model: Model, times: list[float]) -> bool:
    """Whether H has another value at one of these times than at the first, at one of sixteen points."""
    points = _points(model)
    return any((model.value(*points, t=t) != model.value(*points, t=times[0])).any() for t in times)


def _points(model: Model) -> np.ndarray:
    """Sixteen sample states (2, dof, point)."""
    return np.random.default_rng(1).uniform(-1, 1, (2, model.ndof, 16))


def _commutes(model: Model, points: np.ndarray, t: float) -> bool:
    """Whether every {H, H_k} vanishes at these points at t, up to rounding."""
    weights = np.eye(model.nnoise + 1)
    hq, hp = model.gradient(*points, w=weights[0], t=t)
    for w in weights[1:]:
        kq, kp = model.gradient(*points, w=w, t=t)
        if np.abs(hq * kp - hp * kq).sum(axis=0).max() == 0:
            continue
        bracket = np.abs((hq * kp - hp * kq).sum(axis=0))
        scale = (np.abs(hq * kp) + np.abs(hp * kq)).sum(axis=0)
        if (bracket > CONSERVED * scale).any():
            return False
    return True
