# SPDX-License-Identifier: BSD-3-Clause
"""The pilot: short runs of suitable schemes, and the cheapest plan that follows from them.

The ladder of one scheme is always measured. A further measurement is made if its price, together with earlier ones, is
at most a fifth of the seconds of the best plan so far, which is the most that it can save. So the pilot is short if
the work is, and pilot and work together cost at most 1.2 times the work, besides the first ladder.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial

from ...errors import InvalidArgumentError, NumericalError
from ...schemes import Scheme
from . import choice
from .candidates import fewest_steps
from .choice import ANTITHETIC, EVEN_LEVELS, METHODS, MULTILEVEL, Plan
from .estimators import Plain
from .interval import SEEN, Tolerance, may_be_zero
from .problem import Problem
from .tails import look
from .trial import LEVELS, UNSTABLE, Trial
from .watch import Watch

Task = tuple[float, Callable[[], None]]

_PATHS = 256  #: initial paths of each level of a trial: enough to know a variance to a tenth of its value
_MOST_LOOKED_AT = 2**17  #: most values of f that are drawn to tell the mean from 0
_SHARE = 0.2  #: measurements beyond the first scheme may take this share of the seconds of the best plan so far
_FURTHER = 3  #: a plan may extrapolate from the measured points to 2^3 times as many; measuring more costs a sixteenth
_AT_A_TIME = 2  #: one measurement doubles the points at most this many times, since fewer points are often enough
_DOUBLINGS = 12  #: most doublings of the paths of a ladder if no plan reaches the tolerance: up to a million paths
_WIDER = 20  #: most doublings of the requested error: a factor of a million
_LONG = 600.0  #: the pilot does not take longer for a plan of more seconds
_FIRST = 2**45 + 2**44  #: index of the first path on which f is examined
_DRIVEN = "; {} needs noise, one initial state, no truncation, {}"
#: conditions of a method besides noise
_NEEDS = {
    EVEN_LEVELS: _DRIVEN.format(EVEN_LEVELS, "SciPy, and a scheme that takes no areas"),
    MULTILEVEL: f"; {MULTILEVEL} needs an f that varies",
    ANTITHETIC: _DRIVEN.format(ANTITHETIC, "and a scheme that takes increments alone"),
}


class Pilot:
    """The trials of the schemes, the first values of f, and the plans that follow from them."""

    def __init__(
        self,
        problem: Problem,
        tolerance: Tolerance,
        watch: Watch,
        schemes: Sequence[Scheme],
        methods: Sequence[str] = METHODS,
    ):
        """Try schemes until one works, and examine f; refuse questions that no work could answer."""
        self.problem, self.tolerance, self.watch, self.methods = problem, tolerance, watch, methods
        if not schemes:
            raise InvalidArgumentError(
                "none of the schemes that are tried automatically fits these options: give a scheme"
            )
        self._coarsest, self._untried = fewest_steps(problem), list(schemes)
        self.seconds = 0.0  #: seconds of processor time until a plan is chosen
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
        self._least = watch.seconds  #: seconds of processor time that every pilot needs

    def try_all(self) -> None:
        """Try all remaining schemes."""
        while self._untried:
            self._try_next()

    def _highest(self) -> float:
        """The highest weak order among the schemes not yet tried. A scheme of higher order may need far fewer steps."""
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
        """Draw values of f at the step whose levels differ least. They show the variance, the mean and the tails of
        f."""
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
        """The mean of the first values of f."""
        return self.looked_at.units.mean

    @property
    def error(self) -> float:
        """Root mean square error that the tolerance allows."""
        return self.tolerance.error(self.value)

    def choose(self) -> list[Plan]:
        """All plans, the cheapest first; if none keeps the tolerance, plans for the smallest error that some plan
        keeps.
        """
        plans = self.plans()
        while not self.watch.over and (task := self._next(plans)) is not None:
            task()
            plans = self.plans()
        error = self.error
        for _ in range(_WIDER):
            if plans:
                self.seconds = self.watch.seconds
                return plans
            plans = self.plans(error := 2 * error)
        raise NumericalError(self._hopeless())

    def _hopeless(self) -> str:
        """The message if no plan reaches even a much larger error."""
        alone = len(self.methods) < len(METHODS)
        way = f"by {' or '.join(self.methods)} " if alone else ""
        needs = "".join(_NEEDS.get(method, "") for method in self.methods) if alone else ""
        return (
            f"no scheme reaches a standard error of {self.error:.3g} {way}up to "
            f"{max(trial.steps(LEVELS + choice.MOST_HALVINGS - 1) for trial in self.trials)} steps, as far as a pilot "
            f"tells: give a larger tolerance, a shorter horizon, or another scheme{needs}"
        )

    def plans(self, error: float | None = None) -> list[Plan]:
        """Plans of every trial for the allowed methods, from all measurements so far; the cheapest comes first.
        error: root mean square error that the plans keep; by default the error that the tolerance allows.
        """
        found = [plan for trial in self.trials for plan in choice.plans(trial, error or self.error)]
        return sorted((plan for plan in found if plan.method in self.methods), key=lambda plan: plan.seconds)

    def _next(self, plans: list[Plan]) -> Callable[[], None] | None:
        """The next measurement; None if no measurement is worth its time."""
        if not plans:  # measure at any cost until there is a plan
            tasks = sorted(self._tasks(), key=lambda task: task[0]) + self._last_tasks()
            return tasks[0][1] if tasks else None
        worth = _SHARE * min(plans[0].seconds, _LONG, self.watch.max_time - self.watch.elapsed)
        left = worth - (self.watch.seconds - self._least - sum(trial.loading for trial in self.trials))
        return next((task for seconds, task in self._tasks(plans[0]) if seconds <= left), None)

    def _tasks(self, best: Plan | None = None) -> Iterator[Task]:
        """Give possible measurements as (seconds, measurement), with estimated seconds; the most promising comes first.

        They are: more points, if the best plan uses far more than were tried; a scheme of higher order, if steps must
        be finer than all tried steps; antithetic pairs and Sobol points (first at levels that show f and its change)
        for the scheme with the cheapest paths and for that of the best plan; and the next scheme. If noise in the bias
        determines the step of the best plan, finer levels by Sobol points and more paths come before the next scheme.
        """
        levels = [(choice.longest(trial.bias, self.error), trial) for trial in self.trials]
        known = [(choice.plain(trial, self.error, level), trial) for level, trial in levels if level is not None]
        known.sort(key=lambda x: x[0].seconds)
        trials = [trial for _, trial in known[:1]]
        if best is not None:
            yield from self._again(best)
            trials += [best.trial] if best.trial not in trials else []
        if known and known[0][0].level > LEVELS - 1 and self._highest() > max(_order(x.scheme) for x in self.trials):
            yield self._seconds_to_try, self._try_highest
        for trial in trials:
            planned = [plan.level for plan in (best, *(x for x, _ in known)) if plan and plan.trial is trial]
            finest = min(math.ceil(max(planned)), LEVELS - 1)
            if ANTITHETIC in self.methods and trial.pairs is None and math.isfinite(trial.price_of_pairs(finest)):
                yield trial.price_of_pairs(finest), partial(trial.look_at_pairs, finest)
            yield from self._points(trial, sorted(range(finest + 1), key=lambda level: (level != 1, level)))
        if best is not None and _noise_decides(best):
            yield from self._points(best.trial, range(1, LEVELS))
            yield best.trial.seconds_to_double, best.trial.double
        if known and self._untried:
            yield self._seconds_to_try, self._try_next
        if best is not None and not known:  # no scheme is well measured yet, and plans may be far too expensive
            yield from self._last_tasks()

    @property
    def _seconds_to_try(self) -> float:
        """Estimated seconds to try another scheme."""
        return min(trial.seconds_spent for trial in self.trials)

    @staticmethod
    def _again(best: Plan) -> Iterator[Task]:
        """Measurements of more points, on those levels of the best plan for which the variance would be extrapolated
        far.
        """
        trial, first = best.trial, best.level + 1 - len(best.points)
        for i, points in enumerate(best.points):
            even = trial.even.get(first + i)
            if even and points - even.most > _FURTHER:
                most = even.most + min(points - even.most - _FURTHER, _AT_A_TIME)
                yield trial.price_of_points(even.level, most), partial(trial.look_at_points, even.level, most)

    def _points(self, trial: Trial, levels: Iterable[int]) -> Iterator[Task]:
        """Measurements of Sobol points on those of the given levels that have none yet."""
        for level in levels if EVEN_LEVELS in self.methods else ():
            if level not in trial.even and math.isfinite(seconds := trial.price_of_points(level)):
                yield seconds, partial(trial.look_at_points, level)

    def _last_tasks(self) -> list[Task]:
        """Measurements as long as no plan reaches the tolerance: other schemes; then finer steps or more paths."""
        if self._untried:
            higher = self._highest() > max(_order(x.scheme) for x in self.trials)
            return [(0.0, self._try_highest if higher else self._try_next)]
        ways = [x for x in self.trials if x.may_go_finer or x.doubled < _DOUBLINGS]
        if not ways or self.watch.seconds > _LONG or not self.plans(self.error * 2**_WIDER):
            return []
        best = min(ways, key=lambda x: x.seconds_to_tell(self.error))
        return [(0.0, best.go_finer if best.may_go_finer else best.double)]


def _order(scheme: Scheme) -> float:
    """The weak order in the certificate of the scheme; 0 if there is none."""
    return scheme.info.orders["weak"].value or 0.0


def _noise_decides(best: Plan) -> bool:
    """Whether noise in the bias determines the step of this plan: more paths may then allow a longer step."""
    seen, noise = best.bias
    return best.level != 0 and noise >= math.fabs(seen)
