# SPDX-License-Identifier: BSD-3-Clause
"""The work that a plan asks for, and the interval that it gives."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass

from ..errors import BudgetWarning
from ..mlmc.mlmc import Estimate
from ..mlmc.sampler import MOST_LEVELS, LevelSampler
from .answer import Alternative, Answer
from .choice import Plan
from .estimators import NOTHING, Drawn
from .pilot import Pilot
from .tolerance import BIAS_SHARE, half_width

FIRST = 2**46  #: path that answers begin at; of multilevel, index within a level
FIRST_OF_LEVEL = 2**40
_LONG = 600.0  #: seconds that are announced
_LEAST = 256  #: paths of a new level
_NEARLY = 1.05  #: times the half width that was asked for, that count as reached
_SPARE = 1.02  #: units beyond those that the variance asks for, so that a second round is seldom needed


@dataclass
class _Outcome:
    """What a plan gave."""

    value: float
    half: float
    error: float
    bias: float
    paths: int
    seconds: float
    notes: list[str]
    steps: int | None = None  #: where they are not those of the plan


class Work:
    """Draws until the interval is narrow enough, or the time is over."""

    def __init__(self, pilot: Pilot, plans: list[Plan]):
        """The first of the plans is carried out."""
        self.pilot, self.plan, self.others = pilot, plans[0], plans[1:]
        self.tolerance, self.watch = pilot.tolerance, pilot.watch
        left = min(self.watch.max_time - self.watch.elapsed, _LONG)
        if self.plan.seconds > left:
            what = "give a larger tolerance, or max_time, after which the interval is given as it is then"
            if math.isfinite(self.watch.max_time):
                what = f"{max(left, 0):.3g} s of max_time are left, and the interval will be wider"
            warnings.warn(
                f"the interval that was asked for ({self.tolerance}) is reckoned to take {self.plan.seconds:.3g} s of "
                f"the processor: {what}",
                BudgetWarning,
                stacklevel=3,
            )

    def answer(self) -> Answer:
        """Carry the plan out."""
        return self._multilevel() if self.plan.method == "multilevel" else self._one_step()

    def _one_step(self) -> Answer:
        estimator = self.plan.estimator(FIRST, self.pilot.problem)
        bias = math.hypot(*self.plan.bias)
        least = estimator.least_units if self.plan.trial.variance > 0 else 2
        drawn = NOTHING
        wanted = least
        try:
            while drawn.units.n < wanted and not (self.watch.over and drawn.units.n >= 2):
                drawn += estimator.draw(min(estimator.part, wanted - drawn.units.n))
                if drawn.units.n >= least:
                    wanted = max(least, self._units_for(drawn))
                self.watch.tell(drawn.units.n / wanted)
        except KeyboardInterrupt as stop:
            if drawn.units.n > 1:
                stop.partial = self._answer(drawn, bias)
            raise
        return self._answer(drawn, bias)

    def _units_for(self, drawn: Drawn) -> int:
        """Units whose noise has its share of the error, by their variance so far."""
        allowed = (1 - BIAS_SHARE) * self.tolerance.error(drawn.units.mean) ** 2
        return min(2**40, math.ceil(_SPARE * drawn.units.variance / max(allowed, 1e-300)))

    def _answer(self, drawn: Drawn, bias: float) -> Answer:
        units = drawn.units
        half = half_width(units.error, bias, units.n)
        return self._finished(
            _Outcome(units.mean, half, units.error, bias, drawn.paths, drawn.seconds, _failures(drawn))
        )

    def _multilevel(self) -> Answer:
        trial = self.plan.trial
        sampler = LevelSampler(self.pilot.problem, trial.scheme, trial.steps(self.plan.coarsest), first=FIRST_OF_LEVEL)
        found = Estimate(sampler, self.tolerance, levels=MOST_LEVELS, first=_LEAST, watch=self.watch).run()
        paths = sum(x.paths for x in found.levels)
        outcome = _Outcome(found.value, found.half_width, found.error, found.bias, paths, found.cost, list(found.notes))
        outcome.steps = found.levels[-1].steps
        return self._finished(outcome)

    def _finished(self, found: _Outcome) -> Answer:
        horizon = self.plan.trial.problem.horizon
        wanted = self.tolerance.half_width(found.value)
        reached = found.half <= _NEARLY * wanted
        if not reached:
            over = f"max_time = {self.watch.max_time:g} s was over" if self.watch.over else "the pilot misjudged"
            found.notes.append(f"{over}: the half width is {found.half:.3g}, asked was {wanted:.3g}")
        if self.plan.trial.variance == 0 and self.plan.trial.problem.model.nnoise:
            seen = self.pilot.looked_at.units.n + found.paths
            found.notes.append(
                f"f was {found.value:g} on all of {seen} paths: what happens with a probability below {3 / seen:.1g} "
                "was not seen"
            )
        others = (Alternative(x.method, x.trial.scheme.name, horizon / x.steps, x.seconds) for x in self.others)
        return Answer(
            value=found.value,
            interval=(found.value - found.half, found.value + found.half),
            error=found.error,
            bias=found.bias,
            method=self.plan.method,
            scheme=self.plan.trial.scheme.name,
            step=horizon / (found.steps or self.plan.steps),
            paths=found.paths,
            cost=found.seconds + self.pilot.seconds,
            pilot=self.pilot.seconds,
            alternatives=tuple(others),
            reached=reached,
            why=self._why(),
            notes=tuple(found.notes),
        )

    def _why(self) -> str:
        plan = self.plan
        reckoned = f"reckoned at {plan.seconds:.2g} s"
        if not self.others:
            return f"{plan.method}: {reckoned}, nothing else to compare"
        other = self.others[0]
        times = other.seconds / plan.seconds if plan.seconds > 0 else math.inf
        return (
            f"{reckoned}, {times:.2g} times less than the next ({other.method} by {other.trial.scheme.name}, "
            f"h = {plan.trial.problem.horizon / other.steps:.4g})"
        )


def _failures(drawn: Drawn) -> list[str]:
    if not drawn.failed:
        return []
    return [
        f"{drawn.failed} of {drawn.paths} paths failed and are left out: the mean is that of the others; give another "
        "scheme, or look at them with `simulate`"
    ]
