# SPDX-License-Identifier: BSD-3-Clause
"""Counts, means and central moments of samples that arrive in parts."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

_FEW = 20  #: values that differ from the rest, below which a variance is not trusted


@dataclass(frozen=True)
class Tally:
    """A sample as far as it is kept: its size, mean, and sums of powers of deviations from the mean."""

    n: int = 0
    mean: float = 0.0
    m2: float = 0.0
    m3: float = 0.0
    m4: float = 0.0

    @classmethod
    def of(cls, values: np.ndarray) -> Tally:
        """The tally of values (n,), which are all finite."""
        if not values.size:
            return cls()
        with np.errstate(over="ignore", invalid="ignore"):  # of values that blow up, whose variance then says so
            mean = float(values.mean())
            deviations = values - mean
            squares = deviations * deviations
            powers = (squares, squares * deviations, squares * squares)
            return cls(values.size, mean, *(float(power.sum()) for power in powers))

    def __add__(self, other: Tally) -> Tally:
        """The tally of both samples together, by the update of central moments of Pebay (2008)."""
        if not self.n or not other.n:
            return self if self.n else other
        n, a, b = self.n + other.n, self.n, other.n
        d = other.mean - self.mean
        d2 = d * d  # a power of floats that overflows raises, a product does not
        return Tally(
            n,
            self.mean + d * b / n,
            self.m2 + other.m2 + d2 * a * b / n,
            self.m3 + other.m3 + d2 * d * a * b * (a - b) / n**2 + 3 * d * (a * other.m2 - b * self.m2) / n,
            self.m4
            + other.m4
            + d2 * d2 * a * b * (a * a - a * b + b * b) / n**3
            + 6 * d2 * (a * a * other.m2 + b * b * self.m2) / n**2
            + 4 * d * (a * other.m3 - b * self.m3) / n,
        )

    @property
    def variance(self) -> float:
        """The unbiased estimate m2/(n - 1) of the variance; infinite for fewer than two values."""
        return self.m2 / (self.n - 1) if self.n > 1 else math.inf

    @property
    def error(self) -> float:
        """Standard error (variance/n)^(1/2) of the mean."""
        return math.sqrt(self.variance / self.n) if self.n > 1 else math.inf

    @property
    def kurtosis(self) -> float:
        """Fourth central moment over the squared second: 3 for a normal law, 0 where nothing varies."""
        return self.n * (self.m4 / self.m2) / self.m2 if self.m2 > 0 else 0.0

    @property
    def size(self) -> float:
        """Distance (m4/m2)^(1/2) of the few values that differ from the rest; one standard deviation at least."""
        return math.sqrt(self.m4 / self.m2) if self.m2 > 0 else 0.0

    @property
    def few(self) -> bool:
        """Whether so few values differ from the rest that their scatter does not tell the variance.

        If j of n values are not 0, the kurtosis is about n/j, so this asks whether j < 20. m4 = 0 says nothing about j,
        because fourth powers of deviations below 1e-81 underflow; then the answer is yes.
        """
        return self.m4 == 0 or self.few_of(self.n)

    def few_of(self, count: int) -> bool:
        """The same for `count` values, if values differ from the rest as often as they do here."""
        return self.kurtosis * _FEW > count
