# SPDX-License-Identifier: BSD-3-Clause
"""Does f have a variance? Without one no interval holds, however many paths there are.

P(|f| > x) ~ x^-a has one where a > 2. Hill's estimate by the k largest of the values, y_1 >= y_2 >= ..,

    1/a = (1/k) sum_{i=1}^{k} log(y_i/y_{k+1}),    standard error a/k^(1/2)

takes them for a power law, whose logarithms log(y_i/y_{k+1}) are exponential: the mean of their squares over the square
of their mean is 2, with a standard error of 2/k^(1/2). Where it is less, the law falls off faster than any power, as
below an end that few values come near: on the flanks of a peak exp(-c (1 - q)^2), which is at most 1, it is 6/5.
"""

from __future__ import annotations

import math

import numpy as np

from ...errors import InvalidArgumentError, NumericalError
from ...schemes import Scheme
from .estimators import Drawn, Plain
from .problem import Problem
from .tally import Tally

_LOOKED_AT = 4096  #: values of f that tell of its tails
_AGAIN, _OF_THESE = 2**16, 256  #: values, of which these outermost decide where the first ones seem to have no variance
_MANY = 2**15  #: values, of which a few that differ are looked at again
_OUTERMOST = 32  #: of these
_FIRST = 2**45 + 2**42  #: path that they begin at
_SMALLEST = 1e-135  #: of the values: squares of errors a millionth of that do not vanish
LEAST = 256  #: values below which nothing can be told
_DOUBT = 2.0  #: standard errors of the index that decide


def _logarithms(values: np.ndarray, count: int) -> np.ndarray:
    """log(y_i/y_{k+1}), (k,), with y_1 >= y_2 >= .. the distances of the values (n,) from their median.

    k is `count`, or the root of n if that is 0. The array is empty if y_{k+1} = 0.
    """
    size = np.sort(np.abs(values - np.median(values)))[::-1]
    count = count or int(np.sqrt(size.size))
    return np.log(size[:count]) - np.log(size[count]) if size[count] > 0 else np.zeros(0)


def tail_index(values: np.ndarray, count: int = 0) -> tuple[float, float]:
    """Hill's estimate of a in P(|f| > x) ~ x^-a from the `count` largest of the values (n,), and its standard error."""
    logarithms = _logarithms(values, count)
    index = 1 / logarithms.mean() if logarithms.any() else np.inf
    return index, index / np.sqrt(logarithms.size) if np.isfinite(index) else 0.0


def _ends(values: np.ndarray, count: int) -> bool:
    """Whether the largest values fall off faster than any power: the ratio of the header is below 2 by two errors."""
    logarithms = _logarithms(values, count)
    return (logarithms**2).mean() / logarithms.mean() ** 2 < 2 - _DOUBT * 2 / math.sqrt(logarithms.size)


def require_variance(values: np.ndarray, name: str, count: int = 0) -> None:
    """Refuse values (n,) if the largest fall off so slowly that the variance is infinite, or if squares underflow.

    Small values are not refused if few of them carry f, as on the flanks of a peak: values elsewhere may then be of any
    size, and a factor of f would not help.
    """
    if values.size < LEAST:
        return
    if 0 < (largest := float(np.abs(values).max())) < _SMALLEST and not Tally.of(values / largest).few:
        raise InvalidArgumentError(
            f"f = {name} was at most {largest:.3g} on {values.size} paths, and squares of such values underflow in "
            f"double precision: multiply f by a constant, so that its values are larger than {_SMALLEST:g}"
        )
    index, error = tail_index(values, count)
    if index + _DOUBT * error < 2 and not _ends(values, count):
        raise NumericalError(
            f"f = {name} seems to have no finite variance: of {values.size} values the largest fall off as "
            f"x^-{index:.2g} (below 2), and the variance grows with the number of paths, so that no interval would "
            "hold; bound f, as by np.clip, or take another one"
        )


def first_values(plain: Plain) -> Drawn:
    """Draw some values of f, and refuse f if they have no variance.

    Few values of a lognormal law look like those of a power law; further out their index grows. So if the first values
    seem to have no variance, the outermost 256 of 65536 more values decide.
    """
    values, ok = plain.sample(_LOOKED_AT if plain.problem.model.nnoise else 2)
    drawn, count, good = Drawn(Tally.of(values[ok]), 0.0, int((~ok).sum()), values.size), 0, values[ok]
    if good.size >= LEAST and tail_index(good)[0] < 2:
        parts = [plain.sample(_LOOKED_AT) for _ in range(_AGAIN // _LOOKED_AT)]
        good, count = np.concatenate([values[ok] for values, ok in parts]), _OF_THESE
    require_variance(good, plain.problem.target.name, count)
    return drawn


class Doubt:
    """Looks at f again, once, if few of many values carry all of its variation: one path in thousands may escape."""

    def __init__(self, problem: Problem):
        """Nothing was looked at yet."""
        self._problem, self._looked = problem, False

    def look(self, seen: Tally, scheme: Scheme, steps: int) -> None:
        """Refuse f if its values have no variance.

        seen: the values of the work so far, by paths of this scheme with so many steps. If few of at least 2^15 of them
        differ, 2^15 new values are drawn, and the outermost 32 of these decide.
        """
        name = self._problem.target.name
        if seen.n > 1 and not math.isfinite(seen.m2):
            raise NumericalError(
                f"f = {name} has values so large that their variance overflows: paths may escape; look at them with "
                "`simulate`, bound f, as by np.clip, or take another one"
            )
        if self._looked or seen.n < _MANY or not seen.few:
            return
        self._looked = True
        values, ok = Plain(self._problem, scheme, steps, _FIRST).sample(_MANY)
        require_variance(values[ok], name, _OUTERMOST)
