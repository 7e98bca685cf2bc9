# SPDX-License-Identifier: BSD-3-Clause
"""Intervals: the requested half width, the information in a sample, and the shares of noise and bias in the half width.

    half^2 = (t error)^2 + (1.96 bias)^2,    bias^2 <= s (half/1.96)^2,    s = BIAS_SHARE

where t is the quantile of Student's law for the number of units, and error the standard error of the value.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...errors import InvalidArgumentError, WrongTypeError
from ...native import checks

NORMAL = 1.96  #: half width of a 95 % interval, in standard errors
SEEN = 3.0  #: a mean differs from 0 if it is larger than this many standard errors
BIAS_SHARE = 0.1  #: share of the squared error that the bias may have: the interval holds with the bias or without it
_SCATTER = 0.75  #: the standard error at which work ends is enlarged by this many of its own standard errors
_NEARLY = 1.05  #: half widths up to this many times the half width asked for count as reached
_ROUNDING = 64 * np.finfo(float).eps  #: smallest relative half width: sums and steps have no more digits
_LARGEST = 1e70  #: largest number whose fourth power is sure not to overflow


@dataclass(frozen=True)
class Tolerance:
    """Half width of the interval: absolute, or relative to the value."""

    absolute: float | None
    relative: float | None

    def half_width(self, value: float) -> float:
        """Half width that the interval around this value is to have."""
        return self.absolute if self.absolute is not None else self.relative * math.fabs(value)

    def error(self, value: float) -> float:
        """Root mean square error of noise and bias together that gives this half width."""
        return self.half_width(value) / NORMAL

    def is_reached(self, half: float, value: float) -> bool:
        """Whether this half width is at most 1.05 times the requested half width."""
        return half <= _NEARLY * self.half_width(value)

    def check(self, value: float, size: float) -> None:
        """Refuse a half width that rounding makes impossible for values of f whose root mean square is `size`."""
        half = self.half_width(value)
        if half < _ROUNDING * max(size, math.fabs(value)):
            raise InvalidArgumentError(
                f"a half width of {half:.3g} is below what double precision can hold for values of size {size:.3g}: "
                f"give a tolerance above {_ROUNDING * size:.1e}"
            )

    def __str__(self) -> str:
        """The tolerance as text, such as abs = 0.01."""
        return f"abs = {self.absolute:g}" if self.absolute is not None else f"rel = {self.relative:g}"


def make_tolerance(absolute: object, relative: object) -> Tolerance:
    """The tolerance of the arguments abs and rel; exactly one of them is not None."""
    if (absolute is None) == (relative is None):
        raise WrongTypeError(
            "give one of abs and rel: the half width of the 95 % interval, or this half width over the value"
        )
    name, value = ("abs", absolute) if relative is None else ("rel", relative)
    number = checks.finite(name, value)
    if not 0 < number <= _LARGEST:
        raise InvalidArgumentError(
            f"{name} = {number:g} is not allowed: give a half width above 0, and no larger than {_LARGEST:g}"
        )
    return Tolerance(number, None) if relative is None else Tolerance(None, number)


def may_be_zero(value: float, error: float) -> InvalidArgumentError:
    """The refusal of a relative half width, if the mean is this value with this error and may be 0."""
    return InvalidArgumentError(
        f"the mean of f is {value:.3g} +- {error:.3g} and may be 0, so that no half width relative to it can be kept: "
        "give abs, the half width itself"
    )


#: 97.5 % quantiles of Student's law with 1, 2, .. degrees of freedom
_STUDENT = (12.7062, 4.3027, 3.1824, 2.7764, 2.5706, 2.4469, 2.3646, 2.3060, 2.2622, 2.2281)


def quantile(units: int) -> float:
    """The 97.5 % quantile t of Student's law with units - 1 degrees of freedom.

    For up to ten degrees of freedom it is taken from a table; beyond them the expansion of Cornish and Fisher (1938)
    holds to 1e-3.
    """
    z, n = NORMAL, units - 1
    if n <= len(_STUDENT):
        return _STUDENT[max(n, 1) - 1]
    return z + (z**3 + z) / (4 * n) + (5 * z**5 + 16 * z**3 + 3 * z) / (96 * n * n) + 2.556 / n**3


def half_width(error: float, bias: float, units: int) -> float:
    """Half width of a 95 % interval, given the standard error of the mean of `units` units, and a bias of unknown sign:
    ((t error)^2 + (1.96 bias)^2)^(1/2). If BIAS_SHARE is kept, the bias is at most a third of the error; the interval
    then holds with 94.9 to 95.9 %, whatever part of this bias the value really has. Student's t multiplies the error
    alone, because the bias is not known from these units.
    """
    return math.hypot(quantile(units) * error, NORMAL * bias)


def half_width_when_stopped(error: float, bias: float, units: int, wanted: float) -> float:
    """Half width of a 95 % interval for work that ended because its error had become small enough.

    Such work ends when its estimated error is small, so the estimate is more often too small than too large. Therefore
    0.75 of the standard error of this estimate is added to it, as far as the half width stays below `wanted`. Without
    this, 92.8 % of the intervals of 16 or 48 units hold (whether their points were doubled or not); with it, 94.8 % and
    more do.
    """
    larger = error * (1 + _SCATTER / math.sqrt(2 * units))
    return max(half_width(error, bias, units), min(wanted, half_width(larger, bias, units)))


_FEW = 20  #: a variance is trusted if at least about so many values differ from the rest


@dataclass(frozen=True)
class Tally:
    """A summary of a sample: its size, its mean, and sums of powers of deviations from the mean."""

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
        with np.errstate(over="ignore", invalid="ignore"):  # overflow gives an infinite variance or NaN
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
        d2 = d * d  # a power of floats raises an error on overflow, a product does not
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

        If j of n values are not 0, the kurtosis is about n/j, so the question is whether j < 20. m4 = 0 says nothing
        about j, because fourth powers of deviations below 1e-81 underflow; the result is then true.
        """
        return self.m4 == 0 or self.few_of(self.n)

    def few_of(self, count: int) -> bool:
        """Whether `few` would be true for `count` values, if values differ from the rest as often as in this sample."""
        return self.kurtosis * _FEW > count
