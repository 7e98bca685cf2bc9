# SPDX-License-Identifier: BSD-3-Clause
"""An answer: a number with its interval, method and alternatives; for multilevel methods also all levels.

|E d_l| ~ 2^(-alpha l),   Var d_l ~ 2^(-beta l),   seconds of a path ~ 2^(gamma l)
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...show import tables
from .interval import NORMAL


@dataclass(frozen=True)
class Alternative:
    """A method that was not chosen, and its estimated cost."""

    method: str
    scheme: str
    step: float
    cost: float  #: estimated seconds of processor time for the same interval

    def __str__(self) -> str:
        """The alternative in one line."""
        cells = [self.method, self.scheme, "h =", f"{self.step:.4g}", f"{self.cost:.3g}", "s"]
        return tables.aligned([cells], (-18, -20, 0, -10, 10, 0))


@dataclass(frozen=True)
class Answer:
    """E f with a 95 % interval, as `expect` returns it. All quantities are dimensionless."""

    value: float
    interval: tuple[float, float]  #: low and high end, 95 %, for noise and bias together
    error: float  #: standard error of the value
    bias: float  #: bound of the error that the step leaves in the value
    method: str  #: plain, antithetic, multilevel, multilevel quasi-Monte Carlo
    scheme: str
    step: float  #: step h; of multilevel methods the finest step
    paths: int  #: number of paths computed for the value
    cost: float  #: seconds of processor time, the pilot included
    pilot: float  #: seconds of processor time for the pilot
    alternatives: tuple[Alternative, ...]  #: other methods and schemes, the cheapest first
    reached: bool  #: the interval is as narrow as asked
    why: str  #: the reason for the choice
    notes: tuple[str, ...]  #: doubts about the answer, each a sentence

    @property
    def half_width(self) -> float:
        """Half width of the interval."""
        return (self.interval[1] - self.interval[0]) / 2

    def __str__(self) -> str:
        """The answer as text: value, choice and alternatives."""
        lines = [
            f"{self.value:.10g} +- {self.half_width:.2g}, 95 %: standard error {self.error:.2g}, bias {self.bias:.1g}",
            f"{self.method} by {self.scheme}, h = {self.step:.4g}, {self.paths} paths, {self.cost:.3g} s of the "
            f"processor ({self.pilot:.2g} s for the pilot)",
            self.why,
            *self.notes,
        ]
        if self.alternatives:
            lines.append("others, as the pilot reckons:")
            lines += [f"  {x}" for x in self.alternatives[:8]]
        return "\n".join(lines)


@dataclass(frozen=True)
class Rate:
    """A slope over the levels, in powers of two."""

    value: float  #: NaN if fewer than two levels are significant
    half: float  #: half width of the 95 % interval of the value, from the noise of the levels alone

    def __str__(self) -> str:
        """The slope and its half width, such as 1.98 +- 0.05."""
        return "not seen" if math.isnan(self.value) else f"{self.value:.2f} +- {self.half:.2f}"


UNSEEN = Rate(math.nan, math.nan)


def fall(values: Sequence[float], errors: Sequence[float]) -> Rate:
    """The slope of -log2 |value| over the level, fitted to values (level,) that exceed twice their errors (level,).

    The weights are the squared inverses of the errors of log2 |value|, of which each is at least 1e-3.
    """
    values, errors = (np.abs(np.asarray(x, dtype=float)) for x in (values, errors))
    levels = np.flatnonzero((values > 2 * errors) & (values > 0))
    if levels.size < 2:
        return UNSEEN
    logs = np.log2(values[levels])
    noise = np.maximum(errors[levels] / (values[levels] * math.log(2)), 1e-3)
    weights = noise**-2.0
    centre = np.average(levels, weights=weights)
    spread = float((weights * (levels - centre) ** 2).sum())
    slope = float((weights * (levels - centre) * logs).sum()) / spread
    return Rate(-slope, NORMAL / math.sqrt(spread))


@dataclass(frozen=True)
class Level:
    """One level: d = f fine - f coarse on the same paths; f alone at level 0."""

    steps: int  #: number of steps to the horizon
    paths: int
    mean: float  #: mean of d
    error: float  #: standard error of the mean of d
    variance: float  #: variance of d
    kurtosis: float  #: kurtosis of d; the relative error of the variance is about sqrt(kurtosis/paths)
    fine_mean: float  #: mean of f
    fine_variance: float  #: variance of f
    consistency: float  #: defect of the telescoping sum; if the sum holds, the defect is above 1 in 0.3 % of cases
    seconds: float  #: seconds of processor time
    failed: int  #: number of paths left out because they failed


_HEAD = ("level", "steps", "paths", "mean", "variance", "kurtosis", "consistent", "us a path")


def _cells(number: int, x: Level) -> list[str]:
    """A level as a row of the table."""
    return [
        f"{number}", f"{x.steps}", f"{x.paths}", f"{x.mean:.4e}", f"{x.variance:.2e}", f"{x.kurtosis:.1f}",
        f"{x.consistency:.2f}", f"{1e6 * x.seconds / max(1, x.paths):.3g}",
    ]  # fmt: skip


@dataclass(frozen=True)
class Multilevel:
    """E f with its 95 % interval, and the levels that gave it; made by `mlmc`."""

    value: float
    interval: tuple[float, float]  #: low and high end, 95 %
    error: float  #: standard error of the value
    bias: float  #: bound of the error that the step leaves in the value
    scheme: str
    levels: tuple[Level, ...]
    alpha: Rate  #: |mean of d| falls as 2^(-alpha level)
    beta: Rate  #: the variance of d falls as 2^(-beta level)
    gamma: Rate  #: the seconds of a path grow as 2^(gamma level)
    reached: bool  #: the interval is as narrow as asked
    notes: tuple[str, ...]  #: doubts about the answer, each a sentence
    cost: float  #: seconds of processor time in all

    @property
    def half_width(self) -> float:
        """Half width of the interval."""
        return (self.interval[1] - self.interval[0]) / 2

    def __str__(self) -> str:
        """The levels as a table."""
        lines = [
            f"{self.value:.10g} +- {self.half_width:.2g} (95 %: standard error {self.error:.2g}, bias {self.bias:.1g})"
            f", multilevel {self.scheme}, {self.cost:.3g} s",
            tables.aligned([_HEAD, *map(_cells, range(len(self.levels)), self.levels)], (5, 7, 11, 12, 10, 9, 10, 10)),
            f"alpha {self.alpha}, beta {self.beta}, gamma {self.gamma}",
        ]
        return "\n".join([*lines, *self.notes])
