# SPDX-License-Identifier: BSD-3-Clause
"""Carry out a plan: draw its units, and compute the interval.

Units of the levels of the plan are drawn until the variance of the value is small enough,

    sum_l V_l/N_l <= (1 - s) (half/t)^2,

with V_l from the units so far, `half` the wanted half width, s the share of the bias, and t the quantile of Student's
law for the effective number of units (Satterthwaite 1946). The level with the largest V_l/N_l over its seconds gets the
next units, or twice the points. Multilevel by paths is in `mlmc.py`, which also adds levels.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

from ...errors import BudgetWarning, NumericalError
from ...native import checks
from ...native.signals import carry
from ..coupled import MOST_LEVELS, LevelSampler
from .answer import Alternative, Answer, Multilevel
from .choice import EVEN_LEVELS, FIRST_PATHS, MULTILEVEL, Plan, allowed
from .draw_store import InFolder, Nowhere, StoredPilot
from .estimators import MOST_POINTS, NOTHING, Drawn, Estimator, Quasi
from .interval import BIAS_SHARE, NORMAL, Tally, half_width_when_stopped, quantile
from .mlmc import Estimate
from .pilot import Pilot
from .tails import Doubt, widened
from .trial import USUAL
from .watch import told

FIRST = 2**46  #: index of the first path of answers; for multilevel methods, an index within a level
FIRST_OF_LEVEL = 2**40
AT_ONCE = 4096  #: most units of the first part of the work: they take a moment
#: work begins with this many times the units that the pilot's variance asks for, so that few answers need more
_ENOUGH = 1.2
_LONG = 600.0  #: plans of more seconds are announced
_LEAST_POINTS = 6  #: log2 of the least points of a scrambling where time is short: with fewer points paths are as good
#: if the standard error is less than this part of the bias, the interval counts as a bound of the bias
_SILENT = 0.2
_FEWER = 2  #: work begins with this many halvings of the planned points, and doubles them if they are too few
_LOWEST = 8  #: log2 of the number of points that is not halved further: a call alone takes as long as these points
_TOP_UP = 3  #: least number of units of points added to a level: frequent checks of the variance would end too early
#: more units are drawn than the variance asks for, by this factor, so that a second round is seldom needed
_SPARE = 1.02


@dataclass
class _Outcome:
    """The result of carrying out a plan."""

    value: float
    half: float
    error: float
    bias: float
    paths: int
    notes: list[str]
    steps: int | None = None  #: number of steps, if it differs from the number of the plan


class Execution:
    """Carries out a plan: units are drawn until the interval is narrow enough, or the time is over."""

    def __init__(self, pilot: Pilot | StoredPilot, plans: Sequence[Plan], store: Nowhere | InFolder | None = None):
        """Take the first of the plans, and warn if it will take long; the store keeps its draws."""
        self.pilot, self.plan, self.others = pilot, plans[0], plans[1:]
        self.store = Nowhere(pilot.watch) if store is None else store
        self.tolerance, self.watch = pilot.tolerance, pilot.watch
        self._begin = self.watch.seconds
        self._is_even = self.plan.method == EVEN_LEVELS
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
        if self._is_even and self.plan.seconds > left and store is None:  # leave time for enough scramblings
            halvings = math.ceil(math.log2(self.plan.seconds / max(left, 1e-3)))
            shorter = [max(points - halvings, min(points, _LEAST_POINTS)) for points in self.plan.points]
            self.plan = dataclasses.replace(self.plan, points=shorter)

    def answer(self) -> Answer:
        """Carry the plan out. After Ctrl-C the exception has the answer so far, or None if there is none."""
        plan, step = self.plan, self.pilot.problem.horizon / self.plan.steps
        done = f"{self.pilot.seconds:.2g} s for the pilot"
        self.watch.announce(
            f"plan after {done}: {plan.method} by {plan.scheme.name}, h = {step:.4g}, {self._why()}", plan.seconds
        )
        return self._multilevel() if plan.method == MULTILEVEL else self._by_units()

    def _by_units(self) -> Answer:
        """The answer from units of the plan's estimators: of one estimator, or of one per level."""
        problem, tails = self.pilot.problem, Doubt(self.pilot.problem)
        levels = [self._begun(x) for x in self.plan.estimators(FIRST, problem)]
        drawn = [NOTHING] * len(levels)
        try:
            for i, level in enumerate(levels):
                planned = self._planned(level)
                while drawn[i].units.n < planned and self._add(i, levels, drawn, planned - drawn[i].units.n):
                    if drawn[i].failed >= max(level.least_units, drawn[i].units.n):
                        raise NumericalError(_failures(drawn[i])[0])
                    tails.look(drawn[i].units, self.plan.scheme, self.plan.steps)
                    if not self._is_even:
                        self.watch.tell(self._share(drawn))
                    if self.watch.over and drawn[i].units.n >= 2:
                        break
            while not self.watch.over and (excess := self._excess(drawn)) > 0:
                noise = self._noises(drawn)
                i = max(range(len(drawn)), key=lambda j: noise[j] / drawn[j].seconds)
                missing = drawn[i].units.n * excess / max(noise[i] - excess, 1e-3 * excess)
                if doubled := self._is_doubled(levels[i], drawn[i], missing):
                    more = levels[i].doubled()
                    drawn[i] = dataclasses.replace(more, seconds=more.seconds + drawn[i].seconds)
                elif not self._add(i, levels, drawn, self._rounded(missing, drawn[i].units.n)):
                    break
                tails.look(drawn[i].units, self.plan.scheme, self.plan.steps)
                share = self._share(drawn)
                self.watch.tell(share ** (1 / USUAL) if doubled else share)  # share of points or units
        except BaseException as stop:
            carry(stop, lambda: self._answer(drawn) if all(x.units.n > 1 for x in drawn) else None)
            raise
        return self._answer(drawn)

    def _begun(self, estimator: Estimator) -> Estimator:
        """The estimator to start with: with a quarter of the planned points, if points can be added later."""
        if isinstance(estimator, Quasi) and isinstance(self.store, Nowhere):
            planned = estimator.log2_points
            estimator.log2_points = max(planned - _FEWER, min(planned, _LOWEST))
        return estimator

    def _planned(self, level: Estimator) -> int:
        """Number of units to begin with, from the variance that the pilot measured; at most as many as can be computed
        in a moment.

        The mean and the variance of skew units are correlated. If the variance of the units themselves decides how many
        are drawn, their mean has a bias of skewness times standard deviation over their number. With few units this
        bias matters; so their number follows from other units, those of the pilot.
        """
        least = level.least_units if self.pilot.problem.model.nnoise else 2
        if self._is_even:
            return least
        error = self.tolerance.error(self.pilot.looked_at.units.mean)
        return max(least, min(AT_ONCE, math.ceil(_ENOUGH * self.plan.variance / allowed(error))))

    def _add(self, i: int, levels: list[Estimator], drawn: list[Drawn], missing: int) -> bool:
        """Draw the next part of the missing units of a level; false if the time is over."""
        name = f"even-{i:02d}" if self._is_even else "units"
        part = self.store.more(name, drawn[i], missing, levels[i].part, levels[i].draw_from)
        if part is not None:
            drawn[i] += part
        return part is not None

    def _rounded(self, missing: float, held: int) -> int:
        """Number of units to add: the missing ones and a few more; for units of points at least 3 and at most 17."""
        if self._is_even:
            return max(_TOP_UP, math.ceil(_SPARE * min(missing, Quasi.least_units)))
        return min(2**40, math.ceil(_SPARE * missing + (_SPARE - 1) * held))

    def _is_doubled(self, estimator: Estimator, drawn: Drawn, missing: float) -> bool:
        """Whether to double the points of all units, instead of drawing more units.

        Points are not doubled if a folder keeps the draws, since kept units must not change.
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
        """Variance of the value minus the variance that the plan allows for noise."""
        noise = self._noises(drawn)
        error = self.tolerance.half_width(_value(drawn)) / quantile(_units_of(drawn, noise))
        return sum(noise) - (1 - BIAS_SHARE) * error**2

    def _share(self, drawn: list[Drawn]) -> float:
        """Share of the needed units that are drawn: the allowed variance over the variance so far."""
        total = sum(self._noises(drawn))
        return min(1.0, 1 - self._excess(drawn) / total) if total > 0 else 1.0

    def _noises(self, drawn: list[Drawn]) -> list[float]:
        """Variance of the mean of every level (level,).

        If f differs on few paths of the first level, or on none of its scramblings, f may jump on rare paths, which the
        pilot may have seen: the variance is then at least the variance of as many independent units, or paths, of the
        pilot.
        """
        noise, first = [x.units.variance / x.units.n if x.units.n > 1 else math.inf for x in drawn], drawn[0]
        if first.units.n > 1 and (first.units.m2 == 0 if self._is_even else first.units.few):
            noise[0] = max(noise[0], self.plan.variance / (first.paths if self._is_even else first.units.n))
        return noise

    def _answer(self, drawn: list[Drawn]) -> Answer:
        """The answer from the units of every level."""
        noise, value, bias = self._noises(drawn), _value(drawn), math.hypot(*self.plan.bias)
        error, wanted = math.sqrt(sum(noise)), self.tolerance.half_width(value)
        notes = [note for x in drawn for note in _failures(x)]
        half = half_width_when_stopped(error, bias, _units_of(drawn, noise), wanted)
        half = widened(half, self.pilot.problem, self.plan.scheme, self.plan.steps, self._seen(drawn), notes)
        return self._finished(_Outcome(value, half, error, bias, sum(x.paths for x in drawn), notes))

    def _seen(self, drawn: list[Drawn]) -> Tally:
        """The values of f that were seen, as a tally. A unit of one path counts as a value.

        Means over many points do not show how few points contribute; then the pilot's values represent all paths.
        """
        known, first = self.pilot.looked_at.units, drawn[0]
        if not self._is_even or known.m2 == 0:
            return known + first.units
        share = 1 + first.paths / known.n
        return Tally(known.n + first.paths, known.mean, *(share * x for x in (known.m2, known.m3, known.m4)))

    def _multilevel(self) -> Answer:
        """The answer by multilevel Monte Carlo."""
        plan = self.plan
        sampler = LevelSampler(self.pilot.problem, plan.scheme, plan.coarsest_steps, first=FIRST_OF_LEVEL)
        estimate = Estimate(
            sampler, self.tolerance, levels=MOST_LEVELS, first=FIRST_PATHS, watch=self.watch,
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
        paths = first + 2 * sum(finer)  # each pair has a fine and a coarse path
        outcome = _Outcome(found.value, found.half_width, found.error, found.bias, paths, list(found.notes))
        outcome.steps = found.levels[-1].steps
        return self._finished(outcome)

    def _finished(self, found: _Outcome) -> Answer:
        """The answer from an outcome. If the interval is wider than requested, notes give the reason."""
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
        """The reason for the plan: its estimated seconds, and the estimated seconds of the next plan."""
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


def _value(drawn: list[Drawn]) -> float:
    """The estimate of E f: the sum of the means of the levels."""
    return sum(x.units.mean for x in drawn)


def _units_of(drawn: list[Drawn], shares: list[float]) -> int:
    """Number of units of a single sample whose variance would be as well known as that of the sum of levels /
    (Satterthwaite 1946).

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
