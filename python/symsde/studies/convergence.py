# SPDX-License-Identifier: BSD-3-Clause
"""Strong errors over step sizes on shared Brownian paths, with confidence intervals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Unpack

import numpy as np

from ..answers.coupled import end, squares
from ..answers.coupled_errors import References, strong_error
from ..answers.error_plan import BATCHES, OPTIONS, Plan, StudyOptions, check_options, make_plan
from ..errors import NumericalError, ReferenceWarning
from ..model.definition import Model
from ..native import checks
from ..schemes import Scheme
from ..show import look, tables
from ..show.plot import draw
from .study import orders

_MARKS = {"reference": "at the floor", "rounding": "rounding", "saturated": "saturated", "diverged": "diverged"}


@dataclass(frozen=True)
class Convergence:
    """Root-mean-square errors of (q, p) at the final time, with 95 % confidence intervals."""

    scheme: str
    model: str
    reference: str  #: name of the solution that the paths are compared with
    reference_error: float  #: rms error of the reference itself, the floor; 0 = exact
    steps: np.ndarray  #: (level,), numbers of steps
    step: np.ndarray  #: (level,), h
    error: np.ndarray  #: (level,)
    low: np.ndarray  #: (level,), lower ends of the intervals; likewise high
    high: np.ndarray
    status: tuple[str, ...]  #: (level,), ok; reference: at the floor; rounding, saturated, diverged: not counted
    order: float  #: fitted slope of log error over log h of the points that are ok; NaN if there are fewer than two
    order_low: float
    order_high: float
    paths: int  #: number of paths that are ok at every step

    def __str__(self) -> str:
        """The errors as a table."""
        floor = f", whose own error is {self.reference_error:.1e}" if self.reference_error else ""
        rows = [
            [f"{n}", f"{h:.5g}", f"{e:.4e}", f"  {lo:.3e} .. {up:.3e}  {_MARKS.get(state, '')}"]
            for n, h, e, lo, up, state in zip(
                self.steps, self.step, self.error, self.low, self.high, self.status, strict=True
            )
        ]
        counted = self.status.count("ok")
        order = f"order {self.order:.3f}, {self.order_low:.3f} .. {self.order_high:.3f}"
        if counted < len(self.status):
            order = f"{order if counted > 1 else 'no order'}, {counted} of {len(self.status)} steps counted"
        return "\n".join(
            [
                f"{self.scheme} on {self.model}, {self.paths} paths, against {self.reference}{floor}",
                tables.aligned([["steps", "h", "error", "  95 % interval"], *rows], (8, 12, 11, 0)),
                order,
            ]
        )

    def plot(self, path=None, *, ax=None, axes=None):
        """Draw errors over h with their intervals: a matplotlib figure, written if a path is given, or drawn into `ax`.

        Points with hollow markers do not enter the order. Until 0.2 axes may be given in place of path: a warning says
        what to write instead, and the axes are returned.
        """
        axes = path if hasattr(path, "errorbar") else axes
        if axes is None:
            return draw.finish([self._draw], f"{self.model}, {self.paths} paths", path, ax)
        checks.warn("plot(axes) is now plot(ax=axes): call that", DeprecationWarning)
        return self._draw(axes)

    def _draw(self, axes):
        bars = np.abs(np.stack([self.low, self.high]) - self.error)
        style = look.of_scheme(self.scheme)
        axes.errorbar(self.step, self.error, yerr=bars, label=f"{self.scheme}: order {self.order:.2f}", **style)
        hollow = np.array(self.status) != "ok"
        axes.plot(self.step[hollow], self.error[hollow], ls="", mfc="white", zorder=5, **style)
        if self.reference_error:
            axes.axhline(self.reference_error, ls=":", color=look.GREY, lw=0.9, label="error of the reference")
        axes.set(xscale="log", yscale="log", xlabel="step h", ylabel="strong error (rms), 95 % intervals")
        axes.legend()
        return axes


@checks.hinted(*OPTIONS)
def convergence(
    model: Model,
    scheme: str | Scheme = "midpoint",
    *,
    q0: Any,
    p0: Any,
    horizon: float = 1.0,
    steps: Sequence[int] = (16, 32, 64, 128, 256),
    paths: int = 1000,
    reference: str = "auto",
    reference_steps: int | None = None,
    **options: Unpack[StudyOptions],
) -> Convergence:
    """Strong errors at time `horizon` (> 0) for several numbers of steps, all on the same Brownian paths.

    Scheme and reference use sums of the same finest draws (refine >= 0), whichever functionals besides dW they need.

    - steps: numbers of steps, each the largest one divided by a power of two
    - reference: "exact", the name of a scheme, or "auto": the exact solution if the model has one, else a better scheme
      with `reference_steps` steps (a power of two times the largest). Its own error is estimated and shown
    - options: t0, seed, correction, truncation, compensated and threads of `simulate`

    Steps whose error is less than four times that of the reference are marked and do not enter the order; a
    ReferenceWarning names them. Paths that fail at any step are left out.
    """
    check_options(options)
    plan = make_plan(
        model,
        q0=q0,
        p0=p0,
        schemes=[scheme],
        steps=steps,
        horizon=horizon,
        paths=paths,
        reference=reference,
        reference_steps=reference_steps,
        **options,
    )
    rows = _rows(plan)
    if any(row["status"] == "reference" for row in rows):
        checks.warn(
            f"the error of {plan.schemes[0].name} is not above that of its reference "
            f"({plan.references[plan.schemes[0].name]}: {rows[0]['ref_error']:.1e}) at some steps, which were not "
            "counted: give more reference_steps, or longer steps",
            ReferenceWarning,
        )
    return _table(plan, rows)


def _rows(plan: Plan) -> list[dict]:
    """Errors of the scheme at every step, over the paths that are ok at all steps."""
    scheme = plan.schemes[0]
    fine, own_error = References(plan).get(plan.references[scheme.name])
    runs = [plan.run(scheme, steps, shared=True) for steps in plan.steps]
    square = np.stack([squares(end(run), fine) for run in runs])
    ok = np.isfinite(square).all(axis=0) & np.all([run.status == 0 for run in runs], axis=0)
    if ok.sum() < 2 * BATCHES:
        raise NumericalError(f"only {ok.sum()} of {plan.paths} paths are ok at every step size: use smaller steps")
    rows = []
    for steps, row in zip(plan.steps, square[:, ok], strict=True):
        known = {"h": plan.horizon / steps, "ref_error": own_error, "failed": 0, "counted": int(ok.sum())}
        rows.append(known | strong_error(row, fine[:, :, ok]))
        rows[-1]["status"] = orders.judge(rows[-1])
    return rows


def _table(plan: Plan, rows: list[dict]) -> Convergence:
    scheme = plan.schemes[0]
    order = orders.fitted(rows)
    return Convergence(
        scheme=scheme.name,
        model=repr(plan.model),
        reference=f"the {plan.references[scheme.name]}"
        if not rows[0]["ref_error"]
        else str(plan.references[scheme.name]),
        reference_error=rows[0]["ref_error"],
        steps=np.array(plan.steps),
        step=np.array([row["h"] for row in rows]),
        error=np.array([row["err_strong"] for row in rows]),
        low=np.array([row["err_strong_low"] for row in rows]),
        high=np.array([row["err_strong_high"] for row in rows]),
        status=tuple(row["status"] for row in rows),
        order=order.value,
        order_low=order.value - order.half,
        order_high=order.value + order.half,
        paths=rows[0]["counted"],
    )
