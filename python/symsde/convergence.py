# SPDX-License-Identifier: BSD-3-Clause
"""Strong errors over step sizes on shared Brownian paths, with confidence intervals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from . import _checks, _files
from ._setup import make_setup
from .diagnose import exact_of
from .errors import InvalidArgumentError, MissingOperationError, NumericalError
from .model import Model
from .schemes import Scheme, as_scheme
from .simulate import simulate

_BATCHES = 20
_QUANTILE = 2.093  # of Student's t with 19 degrees of freedom, 95 %


@dataclass(frozen=True)
class Convergence:
    """Root-mean-square errors of (q, p) at the final time, with 95 % confidence intervals."""

    scheme: str
    model: str
    reference: str  #: what the paths are compared with
    steps: np.ndarray  #: (level,), number of steps
    step: np.ndarray  #: (level,), h
    error: np.ndarray  #: (level,)
    low: np.ndarray  #: (level,), ends of the intervals
    high: np.ndarray
    order: float  #: fitted slope of log error over log h
    order_low: float
    order_high: float
    paths: int  #: paths that count

    def __str__(self) -> str:
        """Table of the errors."""
        rows = zip(self.steps, self.step, self.error, self.low, self.high, strict=True)
        return "\n".join(
            [
                f"{self.scheme} on {self.model}, {self.paths} paths, against {self.reference}",
                f"{'steps':>8s} {'h':>12s} {'error':>11s}   95 % interval",
                *(f"{n:8d} {h:12.5g} {e:11.4e}   {lo:.3e} .. {up:.3e}" for n, h, e, lo, up in rows),
                f"order {self.order:.3f}, {self.order_low:.3f} .. {self.order_high:.3f}",
            ]
        )

    def plot(self, axes=None):
        """Draw errors over h with matplotlib; returns the axes."""
        if axes is None:
            axes = _files.optional("matplotlib.pyplot", "plot").subplots(layout="constrained")[1]
        bars = np.abs(np.stack([self.low, self.high]) - self.error)
        axes.errorbar(self.step, self.error, yerr=bars, fmt="o-", label=f"{self.scheme}: order {self.order:.2f}")
        axes.set(xscale="log", yscale="log", xlabel="step $h$", ylabel="strong error (rms)")
        axes.legend()
        return axes


def convergence(
    model: Model,
    scheme: str | Scheme = "midpoint",
    *,
    q0: Any,
    p0: Any,
    time: float = 1.0,
    steps: Sequence[int] = (16, 32, 64, 128, 256),
    paths: int = 1000,
    halvings: int = 5,
    **options: Any,
) -> Convergence:
    """Strong errors at `time` for several numbers of steps, all on the same Brownian paths.

    steps: each is the largest one divided by a power of two. The reference is the exact solution where the
    model has one, else gauss2 with steps `halvings` times halved from the finest. Further options are those
    of `simulate` (seed, correction, threads, ...). Paths that fail anywhere are left out and not counted.
    """
    steps = _check_steps(steps)
    paths = _checks.integer("paths", paths, (2 * _BATCHES, 2**47))
    scheme = as_scheme(scheme)
    common = {"q0": q0, "p0": p0, "paths": paths, **options}
    end, extra, reference = _reference(model, time, steps[-1], halvings, common)
    squares = np.empty((len(steps), paths))
    for i, n in enumerate(steps):
        refine = _halvings(steps[-1], n) + extra
        found = _end(simulate(model, scheme=scheme, step=time / n, steps=n, save_every=n, refine=refine, **common))
        squares[i] = np.square(found - end).sum(axis=(0, 1))
    ok = np.isfinite(squares).all(axis=0)
    if ok.sum() < 2 * _BATCHES:
        raise NumericalError(f"only {ok.sum()} of {paths} paths are ok at every step size: use smaller steps")
    return _table(model=model, scheme=scheme, time=time, steps=steps, squares=squares[:, ok], reference=reference)


def _check_steps(steps: Sequence[int]) -> list[int]:
    counts = sorted(_checks.integer("steps", n, (1, 2**40)) for n in steps)
    if len(set(counts)) < 2:
        raise InvalidArgumentError(f"steps = {_checks.shown(steps)} has one level: give at least two")
    for n in counts:
        if counts[-1] % n or (counts[-1] // n).bit_count() != 1:
            raise InvalidArgumentError(
                f"steps: {n} is not {counts[-1]} divided by a power of two, so the paths cannot be shared: "
                "give numbers such as 16, 32, 64"
            )
    return counts


def _halvings(fine: int, coarse: int) -> int:
    return (fine // coarse).bit_length() - 1


def _end(run) -> np.ndarray:
    """Final state (2, dof, path)."""
    return np.stack([run.q[-1], run.p[-1]])


def _reference(model, time, finest, halvings, common) -> tuple[np.ndarray, int, str]:
    """Final state, further halvings it needs, and what it is."""
    grid = {"step": time / finest, "steps": finest, "save_every": finest}
    physical = {key: value for key, value in common.items() if key not in ("correction", "progress")}
    try:
        q, p = exact_of(make_setup(model, **grid, **physical))
        return np.stack([q[-1], p[-1]]), 0, "the exact solution"
    except MissingOperationError:
        extra = _checks.integer("halvings", halvings, (1, 20))
    n = finest << extra
    run = simulate(model, scheme="gauss2", step=time / n, steps=n, save_every=n, **physical)
    return _end(run), extra, f"gauss2 with {n} steps"


def _table(*, model, scheme, time, steps, squares, reference) -> Convergence:
    """Errors and order with intervals, from squared errors (level, path)."""
    count = squares.shape[1]
    mean = squares.mean(axis=1)
    error = np.sqrt(mean)
    tiny = np.finfo(float).tiny
    half = 1.96 * squares.std(axis=1, ddof=1) / np.sqrt(count) / np.maximum(2 * error, tiny)
    h = time / np.array(steps)
    batches = np.array_split(squares, _BATCHES, axis=1)
    slopes = [_slope(h, np.sqrt(batch.mean(axis=1))) for batch in batches]
    order = _slope(h, error)
    spread = _QUANTILE * np.std(slopes, ddof=1) / np.sqrt(_BATCHES)
    return Convergence(
        scheme=scheme.name,
        model=repr(model),
        reference=reference,
        steps=np.array(steps),
        step=h,
        error=error,
        low=np.maximum(error - half, 0),
        high=error + half,
        order=order,
        order_low=order - spread,
        order_high=order + spread,
        paths=count,
    )


def _slope(h: np.ndarray, error: np.ndarray) -> float:
    """Least-squares slope of log error over log h."""
    x = np.log(np.abs(h))
    y = np.log(np.maximum(error, np.finfo(float).tiny))
    return float(np.dot(x - x.mean(), y) / np.square(x - x.mean()).sum())
