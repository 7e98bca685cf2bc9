# SPDX-License-Identifier: BSD-3-Clause
"""The pilot: short runs of every scheme that fits, and the plan that is the cheapest by them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial

import numpy as np

from ...errors import InvalidArgumentError, NumericalError
from ...schemes import Scheme
from . import choice, variants
from .choice import Plan
from .control import MOST_ROWS, Control
from .estimators import Antithetic, Plain
from .longest_step import fewest_steps
from .problem import Problem
from .quasi import Quasi
from .rehearsal import rehearse
from .tolerance import SEEN, Tolerance, may_be_zero
from .trial import LEVELS, UNSTABLE, Trial
from .unseen import look
from .watch import Watch

METHODS = (
    "plain",
    "antithetic",
    "extrapolated",
    "control variate",
    "multilevel",
    "quasi-Monte Carlo",
    choice.EVEN_LEVELS,
)
MEASURED = {Antithetic.name: Antithetic, Control.name: Control}
_PATHS = 256  #: of each level of a trial, to begin with
_MOST_LOOKED_AT = 2**17  #: values of f, where the mean is to be told from 0
_SHARE = 0.2  #: of the seconds of the best plan so far that all measurements beyond the first scheme may take
_HOPE = 0.1  #: of the seconds of the best plan, below which a way is worth to know its bias better
_FURTHER = 3  #: log2 of the points of a plan, over those that were looked at: a sixteenth of its seconds tells more
_LITTLE = 0.1  #: of the variance of f, below which a control variate tells changes from level to level, too
_CHEAP = 1e-2  #: seconds that it may take to know changes where nothing is known to reach the tolerance
_NEAR = 0.5  #: levels, within which the variance of a method is taken to be the same
_DOUBLINGS = 12
_WIDER = 20  #: doublings of the error that is asked for
_LONG = 600.0  #: seconds of a plan, above which the pilot is made no longer
_REHEARSALS = 3  #: at most
_AT_ONCE = 5e-3  #: seconds of work that is done before anybody has read of it
_FIRST = 2**45 + 2**44  #: path that values of f are looked at from
_VARIES = "; {} needs an f that varies"
_DRIVEN = "; {} needs noise, no truncation, {}"
_ALONE = "and a scheme that takes increments alone"
#: what a method takes beside a small error
_NEEDS = {
    choice.EVEN_LEVELS: _DRIVEN.format(choice.EVEN_LEVELS, "SciPy, and a scheme that takes no areas"),
    "extrapolated": _VARIES.format("extrapolated"),
    "multilevel": _VARIES.format("multilevel"),
    "antithetic": _DRIVEN.format("antithetic", _ALONE),
    "quasi-Monte Carlo": _DRIVEN.format("quasi-Monte Carlo", "SciPy, and a scheme that takes no areas"),
    "control variate": _DRIVEN.format("control variate", f"and at most {MOST_ROWS} increments a path"),
}


class Pilot:
    """The trials of the schemes, the values of f that were looked at, and the plans that follow from them."""

    def __init__(
        self, problem: Problem, tolerance: Tolerance, watch: Watch, schemes: Sequence[Scheme], method: str | None
    ):
        """Try schemes until one works, and look at f; refuse what no work could answer."""
        self.problem, self.tolerance, self.watch, self.method = problem, tolerance, watch, method
        if not schemes:
            raise InvalidArgumentError(
                "none of the schemes that are tried automatically fits these options: give a scheme"
            )
        self._coarsest, self._untried = fewest_steps(problem), list(schemes)
        self.seconds = 0.0  #: of the processor, until there is a choice
        self.trials: list[Trial] = []
        while self._untried and not self.trials:
            self._try_next()
        if not self.trials:
            names = ", ".join(scheme.name for scheme in schemes)
            last = self._coarsest << (UNSTABLE + LEVELS - 2)
            raise NumericalError(
                f"paths fail with every scheme that fits ({names}) up to {last} steps: "
                "E f may not exist because paths escape; look at them with `simulate`"
            )
        self._look_at_f()
        self._least = watch.seconds  #: of the processor, that nothing could be known without

    def try_all(self) -> None:
        """Try every scheme that is left."""
        while self._untried:
            self._try_next()

    def _highest(self) -> float:
        """The highest weak order of the schemes that were not tried. A higher order may need far fewer steps."""
        return max(map(_order, self._untried), default=0.0)

    def _try_highest(self) -> None:
        """Try the first scheme of this order."""
        highest = max(self._untried, key=_order)
        self._untried.remove(highest)
        self._untried.insert(0, highest)
        self._try_next()

    def _try_next(self) -> None:
        """Try the next scheme on a ladder of steps."""
        paths = _PATHS if self.problem.model.nnoise else 2
        trial = Trial(self.problem.on_one_thread(), self._untried.pop(0), self._coarsest, paths)
        if trial.usable:
            self.trials.append(trial)
            if len(self.trials) > 1:
                trial.known = self.looked_at.units

    def _look_at_f(self) -> None:
        """Draw values of f at the step whose levels differ least: they tell its variance, its mean and its tails."""
        trial = min(self.trials, key=lambda x: x.spread(LEVELS - 1) + x.seconds(LEVELS - 1) * 1e-12)
        plain = Plain(trial.problem, trial.scheme, trial.steps(LEVELS - 1), _FIRST)
        self.looked_at = look(plain, self.tolerance, self.watch)
        seen = self.looked_at.units
        self.tolerance.check(seen.mean, math.sqrt(seen.mean**2 + seen.m2 / seen.n))
        while self._may_be_zero():
            if self.looked_at.units.n > _MOST_LOOKED_AT or self.watch.over:
                raise may_be_zero(self.value, self.looked_at.units.error)
            self.looked_at += plain.draw(self.looked_at.units.n)
        for x in self.trials:
            x.known = self.looked_at.units

    def _may_be_zero(self) -> bool:
        """Whether the tolerance is relative and the mean of f is within three standard errors of 0."""
        seen = self.looked_at.units
        return self.tolerance.relative is not None and math.fabs(seen.mean) < SEEN * seen.error

    @property
    def value(self) -> float:
        """The mean of the values of f that were looked at."""
        return self.looked_at.units.mean

    @property
    def error(self) -> float:
        """Root mean square error that the tolerance allows."""
        return self.tolerance.error(self.value)

    def choose(self) -> list[Plan]:
        """All plans, the cheapest first.

        The ladder of one scheme is always measured. All further measurements, method by method and scheme by scheme,
        together take no more than a fifth of the estimated time of the best plan so far.
        """
        plans = self.plans()
        while not self.watch.over and (task := self._next(plans)) is not None:
            task()
            plans = self.plans()
        plans = self._rehearsed(plans or self._best_known())
        self.seconds = self.watch.seconds
        return plans

    def _rehearsed(self, plans: list[Plan]) -> list[Plan]:
        """The plans in the order of their seconds, after a part of the work of the cheapest was timed.

        This is repeated while another plan becomes the cheapest, three times at most.
        """
        for _ in range(_REHEARSALS):
            best = plans[0]
            if best.is_rehearsed or best.seconds < _AT_ONCE or self.watch.over or not self.problem.model.nnoise:
                break
            rehearse(best, self.problem)
            plans = sorted(plans, key=lambda plan: plan.seconds)
        return plans

    def _best_known(self) -> list[Plan]:
        """Plans for the smallest error, doubled step by step, that any plan reaches: the bias is not known better."""
        error = self.error
        for _ in range(_WIDER):
            error *= 2
            if found := self.plans(error):
                return found
        raise NumericalError(self._hopeless())

    def _hopeless(self) -> str:
        """The message if no plan reaches even a much larger error."""
        way = f"by {self.method} " if self.method else ""
        return (
            f"no scheme reaches a standard error of {self.error:.3g} {way}up to "
            f"{max(trial.steps(LEVELS + choice.MOST_HALVINGS - 1) for trial in self.trials)} steps, as far as a pilot "
            f"tells: give a larger tolerance, a shorter horizon, or another scheme{_NEEDS.get(self.method, '')}"
        )

    def plans(self, error: float | None = None) -> list[Plan]:
        """Plans of every trial by all that was measured, for the method that was asked for; the cheapest first.

        error: root mean square error that they keep; by default the one that the tolerance allows.
        """
        ways = [choice.plain, choice.extrapolated, choice.multilevel, choice.even, choice.even_levels]
        ways += [partial(choice.of_variant, method=method) for method in MEASURED]
        found = [way(trial, error=error or self.error) for trial in self.trials for way in ways]
        wanted = [plan for plan in found if plan is not None and self.method in (None, plan.method)]
        return sorted(wanted, key=lambda plan: plan.seconds)

    def _next(self, plans: list[Plan]) -> Callable[[], None] | None:
        """The measurement that is made next; None if none is worth its time."""
        if not plans:  # whatever it takes, the way to one at least
            tasks = sorted(self._tasks(), key=lambda task: task[0]) + self._last_tasks()
            return tasks[0][1] if tasks else None
        worth = _SHARE * min(plans[0].seconds, _LONG, self.watch.max_time - self.watch.elapsed)
        left = worth - (self.watch.seconds - self._least - sum(trial.loading for trial in self.trials))
        return next((task for seconds, task in self._tasks(plans[0]) if seconds <= left), None)

    def _tasks(self, best: Plan | None = None) -> Iterator[tuple[float, Callable[[], None]]]:
        """Give (seconds, measurement), with estimated seconds; the most promising comes first."""
        known = [(plan, trial) for trial in self.trials if (plan := choice.plain(trial, self.error)) is not None]
        known.sort(key=lambda x: x[0].seconds)
        if best is not None:
            yield from self._again(best)
        for plan, trial in known:
            yield from self._variants(trial, min(plan.level, LEVELS - 1))
        for rank, (plan, trial) in enumerate(known):
            if rank == 0 and plan.level > LEVELS - 1 and self._highest() > max(_order(x.scheme) for x in self.trials):
                yield trial.seconds_spent / 2**trial.doubled, self._try_highest
            elif rank == 0 and best is not None:
                yield from self._hopes(best)
                if self.method in (None, choice.EVEN_LEVELS):
                    yield from self._evenly(trial, range(math.ceil(min(plan.level, LEVELS - 1)) + 1))
                    yield from self._evenly(best.trial, range(math.ceil(min(best.level, LEVELS - 1)) + 1))
            if self.method in (None, Quasi.name):
                yield from self._evenly(trial, [math.ceil(min(plan.level, LEVELS - 1))])
            if best is not None and best.trial is trial and _noise_decides(best):
                yield from self._changes(trial)
                yield from self._evenly(trial, range(1, LEVELS))
                yield sum(draw.seconds for draw in trial.draws[1:]), trial.double
            if rank == 0 and self._untried:
                yield trial.seconds_spent / 2**trial.doubled, self._try_next
        if best is not None and not known:  # no scheme is known well enough by itself: what there is may take for ever
            yield from self._last_tasks()
        for _, trial in known[:2]:
            if self.method in (None, choice.EVEN_LEVELS):
                yield from self._evenly(trial, range(LEVELS))

    @staticmethod
    def _again(best: Plan) -> Iterator[tuple[float, Callable[[], None]]]:
        """Measurements of the best plan that were made too far from it.

        Its step may be much longer than the one at which its units were measured, which then vary more. Its levels may
        have far more points than were tried, so that the fall of their variance is extrapolated far.
        """
        known = best.trial.measured.get(best.method)
        if known is not None and best.level < known.level - _NEAR:
            seconds = variants.price(best.trial, best.method, best.level)
            yield seconds, partial(best.trial.look_at, MEASURED[best.method], best.level)
        trial = best.trial
        planned = np.atleast_1d(best.options.get("log2_points", [])).tolist()
        first = best.coarsest if best.method == choice.EVEN_LEVELS else min(math.ceil(best.level), LEVELS - 1)
        for level, points in enumerate(planned, first):
            even = trial.even.get(level)
            if even and points - even.most > _FURTHER:
                most = points - _FURTHER
                yield variants.price(trial, Quasi.name, level, most), partial(trial.look_evenly, level, most)

    def _hopes(self, best: Plan) -> Iterator[tuple[float, Callable[[], None]]]:
        """Differences by Sobol points of trials that would be far cheaper if noise alone hides a small bias."""
        for trial in self.trials:
            if choice.without_bias(trial, self.error) < _HOPE * best.seconds:
                yield from self._changes(trial)
                yield from self._evenly(trial, range(1, LEVELS))

    @staticmethod
    def _changes(trial: Trial, *, of_all: bool = False) -> Iterator[tuple[float, Callable[[], None]]]:
        """Differences with the control variate, if it leaves little variance of f; with `of_all`, of any trial."""
        known = trial.measured.get(Control.name)
        little = known is not None and known.variance < _LITTLE * trial.variance
        if not trial.changes and (of_all or little):
            seconds = variants.price_of_changes(trial, range(1, LEVELS))
            if math.isfinite(seconds):
                yield seconds, trial.look_at_changes

    def _variants(self, trial: Trial, level: float) -> Iterator[tuple[float, Callable[[], None]]]:
        """Methods whose units were not measured yet; each takes about a millisecond."""
        for method, kind in MEASURED.items():
            if self.method in (None, method) and method not in trial.measured:
                seconds = variants.price(trial, method, level)
                if math.isfinite(seconds):
                    yield seconds, partial(trial.look_at, kind, level)

    @staticmethod
    def _evenly(trial: Trial, levels: Iterable[int]) -> Iterator[tuple[float, Callable[[], None]]]:
        """Those of these levels that were not measured by Sobol points yet."""
        for level in levels:
            if level not in trial.even and math.isfinite(seconds := variants.price(trial, Quasi.name, level)):
                yield seconds, partial(trial.look_evenly, level)

    def _last_tasks(self) -> list[tuple[float, Callable[[], None]]]:
        """Measurements to make while no plan reaches the tolerance.

        They are a control variate of the changes from level to level, if it is cheap; then other schemes; then finer
        steps or more paths.
        """
        cheap = [x for trial in self.trials for x in self._changes(trial, of_all=True) if x[0] < _CHEAP]
        if self._untried:
            higher = self._highest() > max(_order(x.scheme) for x in self.trials)
            return [*cheap, (0.0, self._try_highest if higher else self._try_next)]
        ways = [x for x in self.trials if x.may_go_finer or x.doubled < _DOUBLINGS]
        if not ways or self.watch.seconds > _LONG or not self.plans(self.error * 2**_WIDER):
            return cheap
        best = min(ways, key=lambda x: x.seconds_to_tell(self.error))
        return [*cheap, (0.0, best.go_finer if best.may_go_finer else best.double)]


def _order(scheme: Scheme) -> float:
    """The weak order in the certificate of the scheme; 0 if there is none."""
    return scheme.info.orders["weak"].value or 0.0


def _noise_decides(best: Plan) -> bool:
    """Whether noise in the bias determines the step of this plan: more paths may then allow a longer step."""
    seen, noise = best.bias
    return best.level != 0 and noise >= math.fabs(seen)
