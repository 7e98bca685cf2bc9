# SPDX-License-Identifier: BSD-3-Clause
"""The work that a plan asks for, and the interval that it gives.

N units are drawn until Var/N <= (1 - s) (half/t_N)^2. Here Var is the variance of a unit, estimated from the units so
far; half is the half width that is wanted, t_N the quantile of Student's law, and s the share of the bias.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...errors import BudgetWarning, NumericalError
from ...native import checks
from ...native.signals import carry
from ..coupled import MOST_LEVELS, LevelSampler
from .answer import Alternative, Answer
from .choice import EVEN_LEVELS, Plan
from .draw_store import InFolder, Nowhere, StoredPilot, StoredPlan
from .estimators import AT_ONCE, ENOUGH, NOTHING, Drawn, Estimator
from .mlmc import Estimate
from .multilevel_answer import Multilevel
from .pilot import Pilot
from .quasi import MOST_POINTS, Quasi
from .tails import Doubt
from .tally import Tally
from .tolerance import BIAS_SHARE, NORMAL, half_width_when_stopped, quantile
from .unseen import widened
from .variants import USUAL
from .watch import told

FIRST = 2**46  #: path that answers begin at; of multilevel, index within a level
FIRST_OF_LEVEL = 2**40
_LONG = 600.0  #: seconds that are announced
_LEAST_POINTS = 6  #: log2 of the points of a scrambling that the time cuts short
_LEAST = 256  #: paths of a new level
_SILENT = 0.2  #: noise over bias, below which an interval is a bound: 1.96 biases are then five of its errors and more
_FEWER = 2  #: halvings of the points that are planned, which work begins with, to double them where that is too few
_LOWEST = 8  #: log2 of the points that are not halved: a call takes as long as these
_TOP_UP = 3  #: units of a level that are added at least, as each look at the variance may end too early
_SPARE = 1.02  #: units beyond those that the variance asks for, so that a second round is seldom needed


@dataclass
class _Outcome:
    """The result of a plan."""

    value: float
    half: float
    error: float
    bias: float
    paths: int
    notes: list[str]
    steps: int | None = None  #: where they are not those of the plan


class Execution:
    """Carries out a plan: units are drawn until the interval is narrow enough, or the time is over."""

    def __init__(
        self, pilot: Pilot | StoredPilot, plans: Sequence[Plan | StoredPlan], store: Nowhere | InFolder | None = None
    ):
        """Take the first of the plans, and warn if it will take long; its draws are kept in the store."""
        self.pilot, self.plan, self.others = pilot, plans[0], plans[1:]
        self.store = Nowhere(pilot.watch) if store is None else store
        self.tolerance, self.watch = pilot.tolerance, pilot.watch
        self._begin = self.watch.seconds
        left = max(self.watch.max_time - self.watch.elapsed, 0.0)
        if self.plan.seconds > min(left, _LONG):
            what = "give a larger tolerance, or max_time, after which the interval reached so far is returned"
            if self.plan.seconds > left:
                what = f"{left:.3g} s of max_time are left, and the interval may be wider"
            checks.warn(
                f"the interval that was asked for ({self.tolerance}) is estimated to take {self.plan.seconds:.3g} s of "
                f"the processor: {what}",
                BudgetWarning,
            )
        if self.plan.method in (Quasi.name, EVEN_LEVELS) and self.plan.seconds > left and store is None:
            self._shorten(left)

    def _shorten(self, left: float) -> None:
        """Reduce the points of a scrambling, so that the time allows as many scramblings as an interval needs."""
        halvings = math.ceil(math.log2(self.plan.seconds / max(left, 1e-3)))
        given = self.plan.options["log2_points"]
        fewer = [max(points - halvings, min(points, _LEAST_POINTS)) for points in np.atleast_1d(given).tolist()]
        self.plan.options["log2_points"] = fewer if self.plan.method == EVEN_LEVELS else fewer[0]

    def answer(self) -> Answer:
        """Carry the plan out. Ctrl-C carries the answer so far, or None if there is none."""
        plan, step = self.plan, self.pilot.problem.horizon / self.plan.steps
        done = f"{self.pilot.seconds:.2g} s for the pilot"
        self.watch.announce(
            f"plan after {done}: {plan.method} by {plan.scheme.name}, h = {step:.4g}, {self._why()}", plan.seconds
        )
        ways = {"multilevel": self._multilevel, EVEN_LEVELS: self._even_levels}
        return ways.get(self.plan.method, self._one_step)()

    def _one_step(self) -> Answer:
        """The answer by units of one estimator."""
        drawn, tails = NOTHING, Doubt(self.pilot.problem)
        try:
            estimator = self._begun(self.plan.estimator(FIRST, self.pilot.problem))
            least = estimator.least_units if self.pilot.problem.model.nnoise else 2
            wanted = planned = max(least, self._planned())
            while drawn.units.n < wanted and not (self.watch.over and drawn.units.n >= 2):
                missing = wanted - drawn.units.n
                if drawn.units.n >= least and self._is_doubled(estimator, drawn, missing):
                    drawn = _with_twice_the_points(estimator, drawn)
                elif (part := self._more(estimator, drawn, missing)) is not None:
                    drawn += part
                else:
                    break
                if drawn.failed >= max(least, drawn.units.n):
                    raise NumericalError(_failures(drawn)[0])
                tails.look(drawn.units, self.plan.scheme, self.plan.steps)
                if drawn.units.n >= planned:
                    wanted = max(least, self._units_for(drawn.units))
                share = drawn.units.n / wanted
                doubles = self._is_doubled(estimator, drawn, wanted - drawn.units.n)
                self.watch.tell(_share_of_points(share) if doubles else share)
        except BaseException as stop:
            carry(stop, lambda: self._answer(drawn) if drawn.units.n > 1 else None)
            raise
        return self._answer(drawn)

    def _even_levels(self) -> Answer:
        """The answer by multilevel quasi-Monte Carlo.

        Every level begins with the same number of scramblings. Then the level with the largest variance per second gets
        more points or units.
        """
        plan, least, problem = self.plan, Quasi.least_units, self.pilot.problem
        count = len(plan.options["log2_points"])
        levels = [self._begun(plan.even_level(i, FIRST + i, problem)) for i in range(count)]
        drawn = [NOTHING] * len(levels)
        try:
            for i, level in enumerate(levels):
                while drawn[i].units.n < least:
                    part = self._more(level, drawn[i], least - drawn[i].units.n, f"even-{i:02d}")
                    if part is None:
                        break  # of this level: each has as few as an interval takes
                    drawn[i] += part
                    if drawn[i].failed >= least:
                        raise NumericalError(_failures(drawn[i])[0])
            while not self.watch.over and (excess := self._excess(drawn)) > 0:
                noise = self._noises(drawn)
                i = max(range(len(drawn)), key=lambda j: noise[j] / drawn[j].seconds)
                missing = drawn[i].units.n * excess / max(noise[i] - excess, 1e-3 * excess)
                if doubles := self._is_doubled(levels[i], drawn[i], missing):
                    drawn[i] = _with_twice_the_points(levels[i], drawn[i])
                elif (part := self._more(levels[i], drawn[i], _more(missing), f"even-{i:02d}")) is not None:
                    drawn[i] += part
                else:
                    break
                total = sum(self._noises(drawn))
                share = 1 - max(self._excess(drawn), 0.0) / total if total > 0 else 1.0
                self.watch.tell(_share_of_points(share) if doubles else share)
        except BaseException as stop:
            carry(stop, lambda: self._of_even_levels(drawn) if all(x.units.n > 1 for x in drawn) else None)
            raise
        return self._of_even_levels(drawn)

    def _begun(self, estimator: Estimator) -> Estimator:
        """The estimator with which the work begins: a quarter of the planned points, if points can be added later."""
        if isinstance(estimator, Quasi) and isinstance(self.store, Nowhere):
            planned = estimator.log2_points
            estimator.log2_points = max(planned - _FEWER, min(planned, _LOWEST))
        return estimator

    def _is_doubled(self, estimator: Estimator, drawn: Drawn, missing: float) -> bool:
        """Whether the points of all units are doubled, instead of drawing so many more units.

        They are not if a folder keeps the draws: units that are kept do not change.
        """
        return (
            isinstance(estimator, Quasi)
            and isinstance(self.store, Nowhere)
            and missing >= drawn.units.n
            and estimator.log2_points < MOST_POINTS
            and drawn.units.m2 > 0
            and drawn.seconds < self.watch.max_time - self.watch.elapsed
        )

    def _excess(self, drawn: list[Drawn]) -> float:
        """Variance of the value minus the variance that noise may have."""
        noise = self._noises(drawn)
        error = self.tolerance.half_width(sum(x.units.mean for x in drawn)) / quantile(_units_of(drawn, noise))
        return sum(noise) - (1 - BIAS_SHARE) * error**2

    def _noises(self, drawn: list[Drawn]) -> list[float]:
        """Variance of the mean of every level (level,).

        If all units of the coarsest level are equal, it is that of as many independent paths: f may jump seldom, which
        the pilot saw.
        """
        noise = [x.units.variance / x.units.n for x in drawn]
        if drawn[0].units.m2 == 0:
            noise[0] = self.plan.variance / max(drawn[0].paths, 1)
        return noise

    def _of_even_levels(self, drawn: list[Drawn]) -> Answer:
        """The answer from the units of every level."""
        value, bias = sum(x.units.mean for x in drawn), math.hypot(*self.plan.bias)
        noise = self._noises(drawn)
        error = math.sqrt(sum(noise))
        notes = [note for x in drawn for note in _failures(x)]
        paths = sum(x.paths for x in drawn)
        half = half_width_when_stopped(error, bias, _units_of(drawn, noise), self.tolerance.half_width(value))
        return self._finished(_Outcome(value, half, error, bias, paths, notes))

    def _more(self, estimator: Estimator, drawn: Drawn, missing: int, name: str = "units") -> Drawn | None:
        """The next part of the missing units; None if the time is over."""
        return self.store.more(name, drawn, missing, estimator.part, estimator.draw_from)

    def _planned(self) -> int:
        """Number of units to begin with, from the variance that the pilot knows; no more than a moment takes.

        The mean and the variance of skew units are correlated. If the variance of the units themselves decides how many
        are drawn, their mean has a bias of skewness times standard deviation over their number. Beside the error of few
        units this counts; so their number follows from other units, those of the pilot.
        """
        if self.plan.method == Quasi.name:
            return 0
        error = self.tolerance.error(self.pilot.looked_at.units.mean)
        return min(AT_ONCE, math.ceil(ENOUGH * self.plan.variance / max((1 - BIAS_SHARE) * error**2, 1e-300)))

    def _units_for(self, units: Tally) -> int:
        """Number of units whose noise keeps its share of the error, from the variance so far."""
        error = self.tolerance.half_width(units.mean) / quantile(units.n)
        allowed = (1 - BIAS_SHARE) * error**2
        return min(2**40, math.ceil(_SPARE * self._variance(units) / max(allowed, 1e-300)))

    def _variance(self, units: Tally) -> float:
        """Variance of a unit; at least that of the pilot if few units differ, because f may jump seldom."""
        few = units.m2 == 0 if self.plan.method == Quasi.name else units.few
        return max(units.variance, self.plan.variance) if few else units.variance

    def _answer(self, drawn: Drawn) -> Answer:
        """The answer from these units."""
        units, bias = drawn.units, math.hypot(*self.plan.bias)
        error = math.sqrt(self._variance(units) / units.n)
        wanted, notes = self.tolerance.half_width(units.mean), _failures(drawn)
        half = half_width_when_stopped(error, bias, units.n, wanted)
        half = widened(half, self.pilot.problem, self.plan.scheme, self.plan.steps, self._seen(drawn), notes)
        return self._finished(_Outcome(units.mean, half, error, bias, drawn.paths, notes))

    def _seen(self, drawn: Drawn) -> Tally:
        """The values of f that were seen, as a tally. A unit of one path counts as a value.

        Means over many points do not show how few points carry them; then the pilot's values stand for all paths.
        """
        known = self.pilot.looked_at.units
        if self.plan.method != Quasi.name or known.m2 == 0:
            return known + drawn.units
        share = 1 + drawn.paths / known.n
        return Tally(known.n + drawn.paths, known.mean, *(share * x for x in (known.m2, known.m3, known.m4)))

    def _multilevel(self) -> Answer:
        """The answer by multilevel Monte Carlo."""
        plan = self.plan
        sampler = LevelSampler(self.pilot.problem, plan.scheme, plan.coarsest_steps, first=FIRST_OF_LEVEL)
        estimate = Estimate(
            sampler, self.tolerance, levels=MOST_LEVELS, first=_LEAST, watch=self.watch,
            known=self.pilot.looked_at.units, store=self.store,
        )  # fmt: skip
        try:
            return self._of_levels(estimate.run())
        except BaseException as stop:
            if isinstance(found := getattr(stop, "partial", None), Multilevel):
                carry(stop, lambda: self._of_levels(found))
            raise

    def _of_levels(self, found: Multilevel) -> Answer:
        """The answer from a multilevel estimate."""
        first, *finer = (x.paths + x.failed for x in found.levels)
        paths = first + 2 * sum(finer)  # a fine and a coarse one
        outcome = _Outcome(found.value, found.half_width, found.error, found.bias, paths, list(found.notes))
        outcome.steps = found.levels[-1].steps
        return self._finished(outcome)

    def _finished(self, found: _Outcome) -> Answer:
        """The answer from an outcome, with notes on what was not reached, and why."""
        horizon = self.pilot.problem.horizon
        wanted = self.tolerance.half_width(found.value)
        reached, unknown = self.tolerance.is_reached(found.half, found.value), NORMAL * found.bias > wanted
        if not reached and not any(", as asked" in note for note in found.notes):
            over = self.watch.why if self.watch.over else "paths were too few"
            enough = not self.watch.over and NORMAL * found.error <= wanted < NORMAL * math.hypot(
                found.error, found.bias
            )
            if unknown or enough:
                over = (
                    f"the bias of the step is known only to {found.bias:.2g}: final states at steps h and h/2 differ "
                    "too much, or too few paths were drawn; give a larger tolerance, a shorter horizon or another "
                    "scheme"
                )
            found.notes.append(f"{over}: the half width is {found.half:.3g}, not {wanted:.3g}, as asked")
        if found.error < _SILENT * found.bias and not unknown and self.pilot.problem.model.nnoise:
            found.notes.append(
                f"the standard error {found.error:.1g} is negligible beside the bias of the step {found.bias:.1g}: the "
                "interval is a bound of this bias for every seed, not a 95 % interval"
            )
        others = (Alternative(x.method, x.scheme.name, horizon / x.steps, x.seconds) for x in self.others)
        return Answer(
            value=found.value,
            interval=(found.value - found.half, found.value + found.half),
            error=found.error,
            bias=found.bias,
            method=self.plan.method,
            scheme=self.plan.scheme.name,
            step=horizon / (found.steps or self.plan.steps),
            paths=found.paths,
            cost=self.pilot.seconds + self.store.seconds + self.watch.seconds - self._begin,
            pilot=self.pilot.seconds,
            alternatives=tuple(others),
            reached=reached,
            why=self._why(),
            notes=tuple(found.notes),
        )

    def _why(self) -> str:
        """The reason for the plan: its estimated seconds, and those of the next."""
        plan = self.plan
        reckoned = told(plan.seconds)
        if not self.others:
            return f"{reckoned}, nothing else to compare"
        other = self.others[0]
        times = other.seconds / plan.seconds if plan.seconds > 0 else math.inf
        return (
            f"{reckoned}, {times:.2g} times less than the next ({other.method} by {other.scheme.name}, "
            f"h = {self.pilot.problem.horizon / other.steps:.4g})"
        )


def _more(missing: float) -> int:
    """Number of units that are added to a level at a time: the missing ones, at least 3 and at most 17."""
    return max(_TOP_UP, math.ceil(_SPARE * min(missing, Quasi.least_units)))


def _share_of_points(share: float) -> float:
    """Share of the points that are drawn, given the ratio of the variance that is wanted to the variance so far."""
    return min(1.0, share) ** (1 / USUAL)


def _with_twice_the_points(estimator: Quasi, drawn: Drawn) -> Drawn:
    """The same units with twice the points; their seconds are added."""
    new = estimator.doubled()
    return dataclasses.replace(new, seconds=new.seconds + drawn.seconds)


def _units_of(drawn: list[Drawn], shares: list[float]) -> int:
    """Number of units of one sample that tell the variance of the sum of levels as well (Satterthwaite 1946).

    shares: variance of the mean of each level (level,).
    """
    doubt = sum(share**2 / (x.units.n - 1) for share, x in zip(shares, drawn, strict=True))
    return 1 + int(sum(shares) ** 2 / doubt) if doubt > 0 else max(x.units.n for x in drawn)


def _failures(drawn: Drawn) -> list[str]:
    """A note on the units that failed, if there are any."""
    if not drawn.failed:
        return []
    size = drawn.paths // (drawn.failed + drawn.units.n)
    what = "paths" if size == 1 else f"groups of {size} paths"
    return [
        f"{drawn.failed} of {drawn.failed + drawn.units.n} {what} failed and are left out: the mean is that of the "
        "others; give another scheme, or look at paths with `simulate`"
    ]
