# SPDX-License-Identifier: BSD-3-Clause
"""The result of a multilevel estimate."""

from __future__ import annotations

from dataclasses import dataclass

from .rates import Rate


@dataclass(frozen=True)
class Level:
    """One level: d = f fine - f coarse on the same paths; f alone at level 0."""

    steps: int  #: to the horizon
    paths: int
    mean: float  #: of d
    error: float  #: standard error of it
    variance: float  #: of d
    kurtosis: float  #: of d; the relative error of the variance is about sqrt(kurtosis/paths)
    fine_mean: float  #: of f
    fine_variance: float  #: of f
    consistency: float  #: of the telescoping sum: if it holds, this is above 1 in 0.3 % of cases
    seconds: float  #: of the processor
    failed: int  #: paths left out


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
    notes: tuple[str, ...]  #: doubts, each a sentence
    cost: float  #: seconds of the processor in all

    @property
    def half_width(self) -> float:
        """Half width of the interval."""
        return (self.interval[1] - self.interval[0]) / 2

    def __str__(self) -> str:
        """Table of the levels."""
        lines = [
            f"{self.value:.10g} +- {self.half_width:.2g} (95 %: standard error {self.error:.2g}, bias {self.bias:.1g})"
            f", multilevel {self.scheme}, {self.cost:.3g} s",
            f"{'level':>5s} {'steps':>7s} {'paths':>11s} {'mean':>12s} {'variance':>10s} {'kurtosis':>9s} "
            f"{'consistent':>10s} {'us a path':>10s}",
        ]
        for i, x in enumerate(self.levels):
            lines.append(
                f"{i:5d} {x.steps:7d} {x.paths:11d} {x.mean:12.4e} {x.variance:10.2e} {x.kurtosis:9.1f} "
                f"{x.consistency:10.2f} {1e6 * x.seconds / max(1, x.paths):10.3g}"
            )
        lines.append(f"alpha {self.alpha}, beta {self.beta}, gamma {self.gamma}")
        return "\n".join([*lines, *self.notes])
