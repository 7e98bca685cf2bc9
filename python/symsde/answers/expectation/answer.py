# SPDX-License-Identifier: BSD-3-Clause
"""The answer: a number with its interval, how it came about, and what else there was."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Alternative:
    """A method that was not chosen, and its estimated cost."""

    method: str
    scheme: str
    step: float
    cost: float  #: estimated seconds of the processor for the same interval

    def __str__(self) -> str:
        """One line."""
        return f"{self.method:18s} {self.scheme:20s} h = {self.step:<10.4g} {self.cost:10.3g} s"


@dataclass(frozen=True)
class Answer:
    """E f with a 95 % interval, as `expect` returns it. All quantities are dimensionless."""

    value: float
    interval: tuple[float, float]  #: low and high end, 95 %, for noise and bias together
    error: float  #: standard error of the value
    bias: float  #: bound of the error that the step leaves in the value
    method: str  #: plain, antithetic, extrapolated, control variate, multilevel, quasi-Monte Carlo
    scheme: str
    step: float  #: of multilevel: the finest
    paths: int  #: number of paths computed for the value
    cost: float  #: seconds of the processor, the pilot included
    pilot: float  #: seconds of these for the pilot
    alternatives: tuple[Alternative, ...]  #: the cheapest first
    reached: bool  #: the interval is as narrow as asked
    why: str  #: the reason for the choice
    notes: tuple[str, ...]  #: doubts, each a sentence

    @property
    def half_width(self) -> float:
        """Half width of the interval."""
        return (self.interval[1] - self.interval[0]) / 2

    def __str__(self) -> str:
        """Value, choice and alternatives."""
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
