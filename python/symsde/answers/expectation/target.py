# SPDX-License-Identifier: BSD-3-Clause
"""The function of the final state whose mean is wanted: a callable f(q, p), or a formula."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ...errors import InvalidArgumentError, WrongShapeError, WrongTypeError
from ...model.definition import Model
from ...model.formulas.formula_observables import FormulaObservables
from ...native import checks

Function = Callable[[np.ndarray, np.ndarray], np.ndarray]
_READ_ONLY = "read-only"  #: as NumPy has it of arrays that are not to be changed
_TRIED = 5  #: points that f is tried at before any work; no other size of a run is likely to be the same


class Target:
    """f as it is called: with q, p of shape (dof, path), it returns (path,) real numbers."""

    def __init__(self, f: Function | str, model: Model, t: float):
        """Take a callable f(q, p), or a formula in the names that observables have, at the time t."""
        self._made = f, model, t
        self.is_truth = False  #: it returns truth values
        self.name = f if isinstance(f, str) else getattr(f, "__name__", "f")
        self._function = _of_formula(f, model, t) if isinstance(f, str) else f
        if not callable(self._function):
            raise WrongTypeError(
                f"f = {checks.shown(f)} is not allowed: give a function f(q, p) of arrays (dof, path), or a formula "
                "as text, such as 'q**2'"
            )

    def __reduce__(self) -> tuple:
        """How pickle makes the target again: from its arguments."""
        return Target, self._made

    def __call__(self, q: np.ndarray, p: np.ndarray) -> np.ndarray:
        """Values of f (path,) at q and p (dof, path); a WrongShapeError says which other shape f returned."""
        values = self._of_states(q, p)
        paths = q.shape[1]
        array = np.asarray(values)
        if array.shape != (paths,):
            raise WrongShapeError(
                f"f returned shape {array.shape} for {paths} paths: q and p have shape {q.shape}, (dof, path), and f "
                f"must return one number a path, shape ({paths},), as in lambda q, p: q[0]**2"
            )
        if array.dtype.kind not in "biuf":
            raise WrongTypeError(f"f returned {array.dtype} values: give real numbers, or truth values")
        self.is_truth = array.dtype.kind == "b"
        return array.astype(np.float64, copy=False)

    def try_at(self, q0: np.ndarray, p0: np.ndarray) -> None:
        """Refuse an f that does not work at the initial state q0, p0 (dof, 1), before any path is computed."""
        self(checks.full(q0, _TRIED), checks.full(p0, _TRIED))

    def _of_states(self, q: np.ndarray, p: np.ndarray) -> Any:
        """What the function returns, of whatever type. The function may not write to q and p (dof, path)."""
        try:
            return self._function(_not_to_write(q), _not_to_write(p))
        except ValueError as refused:
            if _READ_ONLY not in str(refused):
                raise
            raise InvalidArgumentError(
                f"f = {self.name} changes q or p in place, but these are the states of the run: give an f that makes "
                "arrays of its own, as by q = q.copy()"
            ) from refused


def _not_to_write(state: np.ndarray) -> np.ndarray:
    """A view of the state (dof, path) that cannot be written to: an f that tries to raises an error."""
    view = state.view()
    view.flags.writeable = False
    return view


def require_numbers(target: Target, values: np.ndarray, ok: np.ndarray, run) -> None:
    """Refuse values (path,) that are not finite on paths that are ok (path,), and show the state of one of them."""
    bad = ok & ~np.isfinite(values)
    if not bad.any():
        return
    i = int(np.flatnonzero(bad)[0])
    q, p = (np.array2string(x[-1, :, i], precision=6, threshold=6) for x in (run.q, run.p))
    raise InvalidArgumentError(
        f"f = {target.name} is {values[i]} on {int(bad.sum())} of {len(values)} paths, as at q = {q}, p = {p}: "
        "its mean does not exist as a number; give an f that is finite wherever paths go"
    )


def _of_formula(text: str, model: Model, t: float) -> Function:
    """The formula at time t as a function f(q, p) of NumPy arrays; its names are those of observables."""
    read = FormulaObservables(model, {"f": text}, compiles=False)
    return lambda q, p: read(t, q, p)[0]
