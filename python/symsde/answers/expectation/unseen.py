# SPDX-License-Identifier: BSD-3-Clause
"""A bound of what paths may not have shown of f: if few of them carry its variation, their scatter tells little.

If f differs on j of n paths, by about a size s, its mean may be wrong by s (z^2/2 + z sqrt(j + z^2/4))/n, at 97.5 % on
this side, with z = 1.96 (Wilson 1927, for small j/n). This is z^2 s/n = 3.84 s/n if j = 0, and 10.9 s/n if j = 20.
"""

from __future__ import annotations

import math

import numpy as np

from ...schemes import Scheme
from .estimators import Drawn, Plain
from .problem import Problem
from .tails import first_values
from .tally import Tally
from .tolerance import NORMAL, Tolerance
from .watch import Watch

_MOST, _LONG = 2**24, 60.0  #: values that are looked at, and seconds, where few differ
_PATHS = 256  #: whose ends f is tried around
_FIRST = 2**45 + 2**43  #: path that these begin at
_MOVED = 1e-3  #: shift of these ends, in widths of the box around them
_RESPONDS = 1e-6  #: change of f by this shift, over its range in the box, that is more than none
_ROUNDING = 1e-13  #: relative variation of f that is none


def look(plain: Plain, tolerance: Tolerance, watch: Watch) -> Drawn:
    """Draw values of f until enough of them differ, or until the unseen part is within the half width asked for.

    Fewer values of a rare event tell neither its mean nor its bias. Values without a variance are refused.
    """
    drawn = first_values(plain)
    while drawn.units.n and drawn.paths <= _MOST and not watch.over and watch.seconds <= _LONG:
        hidden = unseen(plain.problem, plain.scheme, plain.steps, drawn.units)
        if hidden <= tolerance.half_width(drawn.units.mean):
            break
        drawn += plain.draw(drawn.units.n)
    return drawn


def unseen(problem: Problem, scheme: Scheme, steps: int, seen: Tally) -> float:
    """Half width that an interval must have because of what these values of f did not show; it is mostly 0.

    It is above 0 if fewer than about 20 values differ from the rest. Its scale s is that of those values. If f is flat
    around the ends of most paths, it may jump elsewhere: then s is the range of f between and beside these ends, 1 for
    truth values. If f changes with the state and is equal on all paths, the motion conserves it: nothing is unseen.
    """
    if not problem.model.nnoise or not seen.few:
        return 0.0
    apart = seen.size if seen.size > _ROUNDING * math.fabs(seen.mean) else 0.0
    scale = max(apart, _scale(problem, scheme, steps, seen.mean, beside=apart == 0))
    return _share(seen) * scale


def widened(  # noqa: PLR0917
    half: float, problem: Problem, scheme: Scheme, steps: int, seen: Tally, notes: list[str]
) -> float:
    """The half width `half`, or a larger one that includes what was not seen; a note is added if that decides."""
    hidden = unseen(problem, scheme, steps, seen)
    if hidden > half or (seen.m2 == 0 and problem.model.nnoise):
        notes.append(doubt(seen, hidden))
    return max(half, hidden)


def _share(seen: Tally) -> float:
    """Bound of the error of the share of paths that differ: the formula of the header with s = 1."""
    differ = seen.n / seen.kurtosis if seen.kurtosis > 0 else 0.0
    return (NORMAL**2 / 2 + NORMAL * math.sqrt(differ + NORMAL**2 / 4)) / seen.n


def doubt(seen: Tally, hidden: float) -> str:
    """The note on what was not seen, which may change the mean by `hidden`."""
    below = f"what happens with a probability below {_share(seen):.1g} was not seen"
    if seen.m2 == 0:
        text = f"f was {seen.mean:g} on all of {seen.n} paths: {below}"
    else:
        text = f"f varies on only a few of {seen.n} paths: {below}"
    return f"{text}; it may change the mean by {hidden:.1g}, and the interval includes this" if hidden > 0 else text


def _scale(problem: Problem, scheme: Scheme, steps: int, mean: float, *, beside: bool) -> float:
    """The largest distance of f from its mean in the box of the initial state and of the ends of paths.

    beside: the box is three times as wide, with these in the middle. The result is 0 if f changes around most ends.
    """
    run = problem.run(scheme, steps, first_path=_FIRST, paths=_PATHS)
    ends = np.concatenate([run.q[-1], run.p[-1]])[:, run.status == 0]
    if not ends.size or not np.ptp(ends, axis=1).any():
        return 0.0  # the noise moves nothing
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
        except Exception:  # of a function that is not ours, outside of what it was made for
            return np.full(states.shape[1], np.nan)
