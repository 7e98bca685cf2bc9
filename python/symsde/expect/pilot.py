# SPDX-License-Identifier: BSD-3-Clause
"""The pilot: short runs of every scheme that fits, and the plan that they speak for."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ..errors import InvalidArgumentError, NumericalError
from ..mlmc.sampler import driven_by_more
from ..schemes import Scheme
from . import choice
from .choice import Plan
from .control import MOST_ROWS
from .estimators import Drawn, Plain
from .problem import Problem
from .stability import fewest_steps
from .tails import require_variance
from .tally import Tally
from .tolerance import Tolerance
from .trial import LEVELS, UNSTABLE, Trial
from .watch import Watch

METHODS = ("plain", "antithetic", "extrapolated", "control variate", "multilevel", "quasi-Monte Carlo")
_PATHS = 512  #: of each level of a trial
_LOOKED_AT = 4096  #: values of f that tell of its tails
_MOST_LOOKED_AT = 2**17  #: the same where the mean is to be told from 0
_SHARE = 0.1  #: of the seconds of a plan that the pilot may take to know its bias better
_DOUBLINGS = 12
_LONG = 600.0  #: seconds of a plan, above which the pilot is made no longer
_AFFORDED = 0.03  #: seconds that the pilot of a variant may take in any case
_SEEN = 3.0  #: standard errors by which a mean is told from 0
_FIRST = 2**45 + 2**44  #: path that values of f are looked at from
_VARIES = "; {} needs an f that varies"
_DRIVEN = "; {} needs noise, no truncation, {}"
_ALONE = "and a scheme that takes increments alone"
#: what a method takes beside a small error
_NEEDS = {
    "extrapolated": _VARIES.format("extrapolated"),
    "multilevel": _VARIES.format("multilevel"),
    "antithetic": _DRIVEN.format("antithetic", _ALONE),
    "quasi-Monte Carlo": _DRIVEN.format("quasi-Monte Carlo", f"SciPy, {_ALONE}"),
    "control variate": _DRIVEN.format("control variate", f"and at most {MOST_ROWS} increments a path"),
}


class Pilot:
    """Trials of the schemes, and the value as far as they tell it."""

    def __init__(
        self, problem: Problem, tolerance: Tolerance, watch: Watch, schemes: Sequence[Scheme], method: str | None
    ):
        """Try every scheme; refuse what no work could answer."""
        self.problem, self.tolerance, self.watch, self.method = problem, tolerance, watch, method
        if not schemes:
            raise InvalidArgumentError("no scheme that is tried by itself fits these options: give scheme")
        coarsest = fewest_steps(problem)
        paths = _PATHS if problem.model.nnoise else 2
        self.seconds = 0.0  #: of the processor, until there is a choice
        tried = [Trial(problem.on_one_thread(), scheme, coarsest, paths) for scheme in schemes]
        self.trials = [trial for trial in tried if trial.usable]
        if not self.trials:
            names = ", ".join(scheme.name for scheme in schemes)
            raise NumericalError(
                f"paths fail with every scheme that fits ({names}) up to {coarsest << (UNSTABLE + LEVELS - 2)} steps: "
                "E f may not exist because paths escape; look at them with `simulate`"
            )
        self._look_at_f()

    def _look_at_f(self) -> None:
        """Values of f at a trustworthy step: their variance, their mean, their tails."""
        trial = min(self.trials, key=lambda x: x.spread(LEVELS - 1) + x.seconds(LEVELS - 1) * 1e-12)
        plain = Plain(trial.problem, trial.scheme, trial.steps(LEVELS - 1), _FIRST)
        values, ok = plain.sample(_LOOKED_AT if self.problem.model.nnoise else 2)
        require_variance(values[ok], self.problem.target.name)
        self.looked_at = Drawn(Tally.of(values[ok]), 0.0, int((~ok).sum()), values.size)
        self.tolerance.check(self.looked_at.units.mean, float(np.sqrt(np.mean(values[ok] ** 2))))
        while self._may_be_zero():
            if self.looked_at.units.n > _MOST_LOOKED_AT or self.watch.over:
                raise InvalidArgumentError(
                    f"the mean of f is {self.value:.3g} +- {self.looked_at.units.error:.3g}: a half width relative to "
                    "it cannot be kept where it may be 0; give abs, the half width itself"
                )
            self.looked_at += plain.draw(self.looked_at.units.n)
        for x in self.trials:
            x.known_variance = self.looked_at.units.variance

    def _may_be_zero(self) -> bool:
        seen = self.looked_at.units
        return self.tolerance.relative is not None and math.fabs(seen.mean) < _SEEN * seen.error

    @property
    def value(self) -> float:
        """The mean of f as far as it is known."""
        return self.looked_at.units.mean

    @property
    def error(self) -> float:
        """Root mean square error that the tolerance allows."""
        return self.tolerance.error(self.value)

    def choose(self) -> list[Plan]:
        """Every plan, the cheapest first."""
        most = _LONG  #: seconds that the work may take as far as is known, variants looked at once
        for doubling in range(_DOUBLINGS):
            plans = self._simple()
            best = min(plans, key=lambda plan: plan.seconds) if plans else None
            if doubling == 0 and self.method is None and best is not None and self._may_learn(best, most):
                most = min([most, *(plan.seconds for plan in self._variants(plans))])
            if self.watch.over or not self._learn(best, most):
                break
        plans = self._simple()
        if self.method is None or not any(plan.method == self.method for plan in plans):
            plans += self._variants(plans)
        if self.method is not None:
            plans = [plan for plan in plans if plan.method == self.method]
        self.seconds = self.watch.seconds
        if not plans:
            raise NumericalError(self._hopeless())
        return sorted(plans, key=lambda plan: plan.seconds)

    def _hopeless(self) -> str:
        way = f"by {self.method} " if self.method else ""
        return (
            f"no scheme reaches a standard error of {self.error:.3g} {way}up to "
            f"{max(trial.steps(LEVELS + choice.MOST_HALVINGS - 1) for trial in self.trials)} steps, as far as a pilot "
            f"tells: give a larger tolerance, a shorter horizon, or another scheme{_NEEDS.get(self.method, '')}"
        )

    def _simple(self) -> list[Plan]:
        """Plans of every trial that need no pilot of their own."""
        found = []
        for trial in self.trials:
            found += [kind(trial, self.error) for kind in (choice.plain, choice.extrapolated, choice.multilevel)]
        return [plan for plan in found if plan is not None]

    def _learn(self, best: Plan | None, most: float) -> bool:
        """Better know the bias of the best plan, where noise in it asks for a finer step and knowing it is cheap."""
        if best is None:
            trial = min(self.trials, key=lambda x: x.seconds_spent)
            trial.double()
            return True
        if not self._may_learn(best, most):
            return False
        best.trial.double()
        return True

    def _may_learn(self, best: Plan, most: float) -> bool:
        """Its step is that of noise in its bias, and twice the paths cost little beside work of so many seconds."""
        seen, noise = best.bias
        doubled = sum(draw.seconds for draw in best.trial.draws[1:])
        afforded = _SHARE * min(best.seconds, self.watch.max_time, most)
        return best.level != 0 and noise >= math.fabs(seen) and doubled <= afforded

    def _variants(self, plans: list[Plan]) -> list[Plan]:
        """Of the cheapest plain plans, and of the cheapest one whose scheme takes increments alone."""
        simple = sorted((plan for plan in plans if plan.method == Plain.name), key=lambda plan: plan.seconds)
        tried = simple[:2] + [plan for plan in simple if not driven_by_more(plan.trial.scheme)][:1]
        found: list[Plan] = []
        for plan in dict.fromkeys(tried):
            budget = math.inf
            if self.method is None:
                budget = max(_SHARE * min(x.seconds for x in [*plans, *found]), _AFFORDED)
            found += choice.variants(plan.trial, plan.level, self.error, budget)
        return found
