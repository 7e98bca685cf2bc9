# SPDX-License-Identifier: BSD-3-Clause
"""Properties of f that few paths may not show: whether f has a finite variance, and rare events.

Without a finite variance no interval holds, however many paths there are.

P(|f| > x) ~ x^-a has a finite variance if a > 2. Hill's estimate from the k largest values, y_1 >= y_2 >= ..,

    1/a = (1/k) sum_{i=1}^{k} log(y_i/y_{k+1}),    standard error a/k^(1/2)

assumes a power law, for which the logarithms log(y_i/y_{k+1}) are exponential: the mean of their squares over the
square of their mean is 2, with a standard error of 2/k^(1/2). If the ratio is smaller, the law falls off faster than
any power, for example because f is bounded: on the flanks of a peak exp(-c (1 - q)^2), at most 1, the ratio is 6/5.

If f differs from its usual value on j of n paths, by about s, its mean may be wrong by s (z^2/2 + z sqrt(j + z^2/4))/n,
with 97.5 % confidence on this side, z = 1.96 (Wilson 1927, for small j/n). This is z^2 s/n = 3.84 s/n if j = 0, and
10.9 s/n if j = 20.
"""

from __future__ import annotations

import math

import numpy as np

from ...errors import InvalidArgumentError, NumericalError
from ...schemes import Scheme
from .estimators import Drawn, Plain
from .interval import NORMAL, Tally, Tolerance
from .problem import Problem
from .watch import Watch

_LOOKED_AT = 4096  #: number of values of f whose tails are examined first
#: if these first values seem to have no finite variance: number of further values, and number of the outermost of them,
#: which decide
_AGAIN, _OF_THESE = 2**16, 256
_MANY = 2**15  #: number of values from which f is examined again if few values differ
_OUTERMOST = 32  #: number of outermost values that decide in this second look
_FIRST_AGAIN = 2**45 + 2**42  #: index of the first path of this second look
_SMALLEST = 1e-135  #: smallest allowed value of max |f|: the square of a millionth of it does not underflow
_MOST, _LONG = 2**24, 60.0  #: most values, and most seconds, spent on an f of which few values differ
_PATHS = 256  #: number of paths; f is tried at points around the ends of these paths
_FIRST = 2**45 + 2**43  #: index of the first of these paths
_MOVED = 1e-3  #: shift of an end, in widths of the box around all ends
_RESPONDS = 1e-6  #: f responds if such a shift changes it by more than this part of its range in the box
_SAME = 1e-13  #: f counts as constant if its relative variation is smaller
LEAST = 256  #: least number of values from which tails can be judged
_DOUBT = 2.0  #: standard errors by which the tail index must differ to decide


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
    """Whether the largest values fall off faster than any power: the ratio of the module docstring is below 2 by two
    errors.
    """
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

    A small sample of a lognormal law looks like one of a power law; further out the index of its tail grows. So if the
    first values seem to have no variance, the outermost 256 of 65536 further values decide.
    """
    values, ok = plain.sample(_LOOKED_AT if plain.problem.model.nnoise else 2)
    drawn, count, good = Drawn(Tally.of(values[ok]), 0.0, int((~ok).sum()), values.size), 0, values[ok]
    if good.size >= LEAST and tail_index(good)[0] < 2:
        parts = [plain.sample(_LOOKED_AT) for _ in range(_AGAIN // _LOOKED_AT)]
        good, count = np.concatenate([values[ok] for values, ok in parts]), _OF_THESE
    require_variance(good, plain.problem.target.name, count)
    return drawn


class Doubt:
    """Examines f again, once, if few of many values cause all of its variation: one path in thousands may escape."""

    def __init__(self, problem: Problem):
        """Start without an examination."""
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
        values, ok = Plain(self._problem, scheme, steps, _FIRST_AGAIN).sample(_MANY)
        require_variance(values[ok], name, _OUTERMOST)


def look(plain: Plain, tolerance: Tolerance, watch: Watch) -> Drawn:
    """Draw values of f until enough of them differ, or until the possible effect of unseen events is below the
    requested half width. From few values of a rare event neither the mean nor the bias can be determined. Values
    without a variance are refused.
    """
    drawn = first_values(plain)
    while drawn.units.n and drawn.paths <= _MOST and not watch.over and watch.seconds <= _LONG:
        hidden = unseen(plain.problem, plain.scheme, plain.steps, drawn.units)
        if hidden <= tolerance.half_width(drawn.units.mean):
            break
        drawn += plain.draw(drawn.units.n)
    return drawn


def unseen(problem: Problem, scheme: Scheme, steps: int, seen: Tally) -> float:
    """Half width that an interval must have because of events that these values of f may have missed; usually 0.

    It is above 0 if fewer than about 20 values differ from the rest; its scale s is the distance of these values from
    the rest. If f is flat around the ends of most paths, it may jump elsewhere: then s is the range of f between and
    beside these ends, 1 for truth values. If f changes with the state and is equal on all paths, the motion conserves
    it: no event can be unseen.
    """
    if not problem.model.nnoise or not seen.few:
        return 0.0
    apart = seen.size if seen.size > _SAME * math.fabs(seen.mean) else 0.0
    scale = max(apart, _scale(problem, scheme, steps, seen.mean, beside=apart == 0))
    return _share(seen) * scale


def widened(  # noqa: PLR0917
    half: float, problem: Problem, scheme: Scheme, steps: int, seen: Tally, notes: list[str]
) -> float:
    """The half width `half`, or a larger one that covers missed events; then a note is added."""
    hidden = unseen(problem, scheme, steps, seen)
    if hidden > half or (seen.m2 == 0 and problem.model.nnoise):
        notes.append(doubt(seen, hidden))
    return max(half, hidden)


def _share(seen: Tally) -> float:
    """Bound of the error of the share of paths that differ: the formula of the header with s = 1."""
    differ = seen.n / seen.kurtosis if seen.kurtosis > 0 else 0.0
    return (NORMAL**2 / 2 + NORMAL * math.sqrt(differ + NORMAL**2 / 4)) / seen.n


def doubt(seen: Tally, hidden: float) -> str:
    """The note on missed events, which may change the mean by `hidden`."""
    below = f"what happens with a probability below {_share(seen):.1g} was not seen"
    if seen.m2 == 0:
        text = f"f was {seen.mean:g} on all of {seen.n} paths: {below}"
    else:
        text = f"f varies on only a few of {seen.n} paths: {below}"
    return f"{text}; it may change the mean by {hidden:.1g}, and the interval includes this" if hidden > 0 else text


def _scale(problem: Problem, scheme: Scheme, steps: int, mean: float, *, beside: bool) -> float:
    """The largest distance of f from its mean in the box of the initial state and of the ends of paths.

    The box is three times as wide as the range of these states, and centred on it. The result is 0 if f changes around
    most ends.
    """
    run = problem.run(scheme, steps, first_path=_FIRST, paths=_PATHS)
    ends = np.concatenate([run.q[-1], run.p[-1]])[:, run.status == 0]
    if not ends.size or not np.ptp(ends, axis=1).any():
        return 0.0  # no path has moved
    begin = np.concatenate([problem.q0, problem.p0])
    low, high = (side(np.concatenate([begin, ends], axis=1), axis=1, keepdims=True) for side in (np.min, np.max))
    width, more = high - low, float(beside)
    rng = np.random.default_rng(problem.seed)
    box = low + width * ((1 + 2 * more) * rng.random((len(low), 4 * _PATHS)) - more)
    tried = _values(problem, np.concatenate([begin, box], axis=1))
    size = float(np.abs(tried - mean)[np.isfinite(tried)].max(initial=0.0))
    change = np.abs(_values(problem, ends + _MOVED * width) - _values(problem, ends))
    if np.mean(change > _RESPONDS * size) > 0.5:
        return 0.0
    return max(size, 1.0) if problem.target.is_truth else size


def _values(problem: Problem, states: np.ndarray) -> np.ndarray:
    """f (state,) at states (2 dof, state) that no path may reach; NaN if f does not work there."""
    dof = problem.model.ndof
    with np.errstate(all="ignore"):
        try:
            return problem.target(states[:dof], states[dof:])
        except Exception:  # a user's function may raise anything outside its domain
            return np.full(states.shape[1], np.nan)
