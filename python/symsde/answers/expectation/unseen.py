# SPDX-License-Identifier: BSD-3-Clause
"""What paths may not have shown of f: where few or none of them carry its variation, their scatter tells nothing.

Of n paths j are those that differ, by about a size s: then f is off its mean by up to s (z^2/2 + z sqrt(j + z^2/4))/n
with 97.5 % on that side, z = 1.96 (Wilson 1927, for small j/n): 3.8 s/n where none was seen, 11 s/n where 20 were.
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
    """Values of f that have a variance, and so many that what they did not show is no more than the half width asked
    for, or that enough of them differ: of what happens seldom fewer tell neither its mean nor its bias."""
    drawn = first_values(plain)
    while drawn.units.n and drawn.paths <= _MOST and not watch.over and watch.seconds <= _LONG:
        hidden = unseen(plain.problem, plain.scheme, plain.steps, drawn.units)
        if hidden <= tolerance.half_width(drawn.units.mean):
            break
        drawn += plain.draw(drawn.units.n)
    return drawn


def unseen(problem: Problem, scheme: Scheme, steps: int, seen: Tally) -> float:
    """Half width that an interval must have for what these values of f did not show; 0 mostly.

    It counts where fewer than about 20 values differ from the rest. The scale is that of those values; where f is flat
    around the ends of most paths, so that it may jump elsewhere, that of f between and beside them, 1 for truth values.
    An f that changes with the state and is yet the same on all paths is one that the motion keeps: nothing is unseen.
    """
    if not problem.model.nnoise or not seen.few:
        return 0.0
    apart = seen.size if seen.size > _ROUNDING * math.fabs(seen.mean) else 0.0
    scale = max(apart, _scale(problem, scheme, steps, seen.mean, beside=apart == 0))
    return _share(seen) * scale


def widened(  # noqa: PLR0917
    half: float, problem: Problem, scheme: Scheme, steps: int, seen: Tally, notes: list[str]
) -> float:
    """The half width of an interval that holds what was not seen, with a note where that decides."""
    hidden = unseen(problem, scheme, steps, seen)
    if hidden > half or (seen.m2 == 0 and problem.model.nnoise):
        notes.append(doubt(seen, hidden))
    return max(half, hidden)


def _share(seen: Tally) -> float:
    """Probability by which what differs may be off the share of it that was seen."""
    differ = seen.n / seen.kurtosis if seen.kurtosis > 0 else 0.0
    return (NORMAL**2 / 2 + NORMAL * math.sqrt(differ + NORMAL**2 / 4)) / seen.n


def doubt(seen: Tally, hidden: float) -> str:
    """The same as a sentence."""
    below = f"what happens with a probability below {_share(seen):.1g} was not seen"
    if seen.m2 == 0:
        text = f"f was {seen.mean:g} on all of {seen.n} paths: {below}"
    else:
        text = f"f varies on only a few of {seen.n} paths: {below}"
    return f"{text}; it may change the mean by {hidden:.1g}, and the interval includes this" if hidden > 0 else text


def _scale(problem: Problem, scheme: Scheme, steps: int, mean: float, *, beside: bool) -> float:
    """How far f is from its mean in the box of the first state and of ends of paths, or as wide again on each side."""
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
    """f at states where no path may ever come: NaN where it does not work."""
    dof = problem.model.ndof
    with np.errstate(all="ignore"):
        try:
            return problem.target(states[:dof], states[dof:])
        except Exception:  # of a function that is not ours, outside of what it was made for
            return np.full(states.shape[1], np.nan)
