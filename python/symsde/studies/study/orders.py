# SPDX-License-Identifier: BSD-3-Clause
"""Orders without the plateaus, and the points that no other point beats.

The order a is the slope of log error = a log h + c by least squares; its interval comes from the scatter of the slopes
of groups of paths.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...answers.error_plan import BATCHES
from ...answers.expectation.interval import quantile

ABOVE_REFERENCE = 4.0  #: an error counts if it is at least this many times the error of the reference
SATURATED = 0.5  #: error over the size of the solution beyond which it grows no further
DIVERGED = 100.0  #: error over the size of the solution beyond which a finite solution is meaningless
ROUNDING = 1e-11  #: error over the size of the solution below which rounding dominates


@dataclass(frozen=True)
class Order:
    """Slope of log error over log h with its 95 % interval; NaN if fewer than two points show a slope."""

    value: float
    half: float
    points: int

    def __str__(self) -> str:
        """The slope and its half width."""
        return f"{self.value:.2f} +- {self.half:.2f}" if self.points > 1 else "-"


def judge(row: dict) -> str:
    """The status of a point: ok, failed, diverged, saturated, rounding, or reference (not above the reference's
    error).
    """
    if row["failed"] or "err_strong" not in row:
        return "failed"
    if not row["err_strong"] < DIVERGED * row["size"]:
        return "diverged"
    if row["err_strong"] < ABOVE_REFERENCE * row["ref_error"]:
        return "reference"
    if row["err_strong"] > SATURATED * row["size"]:
        return "saturated"
    if row["err_strong"] < ROUNDING * row["size"]:
        return "rounding"
    return "ok"


def fitted(rows: list[dict]) -> Order:
    """Order of the points of one scheme that are neither failed nor on a plateau."""
    good = [row for row in rows if row["status"] == "ok"]
    if len(good) < 2:
        return Order(float("nan"), float("nan"), len(good))
    h = np.log([row["h"] for row in good])
    groups = np.log([row["batches"] for row in good]) / 2
    slopes = np.polyfit(h, groups, 1)[0]
    value = np.polyfit(h, np.log([row["err_strong"] for row in good]), 1)[0]
    return Order(float(value), float(quantile(BATCHES) * np.std(slopes, ddof=1) / np.sqrt(BATCHES)), len(good))


def pareto(rows: list[dict]) -> set[int]:
    """Indices of the points for which no other point is both faster and at least as accurate."""
    usable = [i for i, row in enumerate(rows) if row["status"] in ("ok", "rounding")]
    front, best = set(), np.inf
    for i in sorted(usable, key=lambda i: (rows[i]["seconds"], rows[i]["err_strong"])):
        if rows[i]["err_strong"] < best:
            best = rows[i]["err_strong"]
            front.add(i)
    return front
