# SPDX-License-Identifier: BSD-3-Clause
"""A rehearsal: a small part of the work of a plan is drawn and timed, just as the work draws it.

The pilot times few paths on one thread. In large arrays, at many more steps, or on threads that wait for each other,
the same paths may take several times as long.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

from ..coupled import LevelSampler
from .estimators import AT_ONCE, ENOUGH, NOTHING, Drawn, Estimator
from .problem import Problem
from .quasi import Quasi
from .variants import UNITS

if TYPE_CHECKING:
    from .choice import Plan

FIRST = 2**45 + 2**43  #: path that rehearsals begin at, far from those of levels and of answers
FIRST_OF_LEVEL = 2**39  #: of multilevel, index within a level
_SHARE = 0.04  #: of the work
_LEAST = 6  #: log2 of the units, or points of one


def rehearse(plan: Plan, problem: Problem) -> None:
    """Correct the seconds of the plan, and the variance of its units, by a part of its work."""
    told = sum(units * unit for units, unit in plan.parts)
    seconds = sum(_of_levels(plan, problem) if plan.method == "multilevel" else _of_units(plan, problem))
    plan.seconds *= seconds / told if told > 0 else 1.0
    plan.is_rehearsed = True


def _of_levels(plan: Plan, problem: Problem) -> Iterator[float]:
    """Give the estimated seconds of each level of multilevel."""
    sampler = LevelSampler(problem, plan.scheme, plan.coarsest_steps, first=FIRST_OF_LEVEL)
    for level, (units, _) in enumerate(plan.parts):
        yield _seconds(lambda count, level=level: sampler.draw(level, count).seconds, units, problem.chunk)


def _of_units(plan: Plan, problem: Problem) -> Iterator[float]:
    """Give the estimated seconds of the estimator, or of the estimator of each level, set-up apart."""
    for i, (units, _) in enumerate(plan.parts):
        begin = time.process_time()
        estimator = plan.even_level(i, FIRST + i, problem) if len(plan.parts) > 1 else plan.estimator(FIRST, problem)
        yield time.process_time() - begin
        if isinstance(estimator, Quasi):
            yield units * _seconds(lambda count, quasi=estimator: _of_points(quasi, count), 1 << estimator.log2_points)
        else:
            yield _of_draws(plan, estimator, units)


def _of_draws(plan: Plan, estimator: Estimator, units: float) -> float:
    """Estimated seconds of the units that the plan needs.

    Their number is corrected by the variance of the units drawn here. The cheapest of several plans is often one whose
    variance the pilot, from few units, estimated too small.
    """
    drawn: list[Drawn] = []

    def draw(count: int) -> float:
        drawn.append(estimator.draw(count))
        return drawn[-1].seconds

    call, unit = _times(draw, units, estimator.part)
    seen, known = sum(drawn, NOTHING).units, plan.variance
    if known > 0 and not seen.few:
        plan.variance = (UNITS * known + seen.n * seen.variance) / (UNITS + seen.n)
        units *= plan.variance / known
    return _whole(call, unit, max(units, min(ENOUGH * units, AT_ONCE)), estimator.part)


def _of_points(estimator: Quasi, count: int) -> float:
    """Seconds of one unit of so many points, a power of two."""
    estimator.log2_points = round(math.log2(count))
    return estimator.draw(1).seconds


def _seconds(draw: Callable[[int], float], units: float, part: float = math.inf) -> float:
    """Estimated seconds of so many units, drawn `part` at a time."""
    return _whole(*_times(draw, units, part), units, part)


def _times(draw: Callable[[int], float], units: float, part: float) -> tuple[float, float]:
    """Seconds of a call, and of a unit beyond that, from two draws of few units."""
    most = 1 << max(_LEAST, math.ceil(math.log2(max(min(_SHARE * units, part), 1))))
    few, many = draw(most >> 2), draw(most)
    unit = min(max(many - few, 0.0) / (most - (most >> 2)), many / most)
    return many - unit * most, unit


def _whole(call: float, unit: float, units: float, part: float) -> float:
    """Seconds of so many units, if each call draws `part` of them."""
    return math.ceil(units / part if part < math.inf else 1) * call + units * unit
