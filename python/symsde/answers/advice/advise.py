# SPDX-License-Identifier: BSD-3-Clause
"""Scheme and step for a tolerance, with the reasons."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Any, Unpack

import numpy as np

from ...errors import InvalidArgumentError, MissingOperationError, NumericalError
from ...model.commutator import commutator
from ...model.definition import Model
from ...native import checks
from ...native.progress import Progress, told_by
from ...run.options import EndOptions
from ...schemes import Scheme
from ...show import tables
from ..expectation.candidates import fitting, frequency
from ..expectation.problem import OPTIONS, Problem, make_problem
from ..linear_stability import stable_up_to
from .ladder import Ladder
from .wants import KINDS

#: longest step as a fraction of the stability limit. If a spring hardens, orbits are lost below the limit: orbits of
#: symplectic_euler from 0.67 of it on, of verlet_dz from 0.72, of stormer_verlet from 0.82 (stability/bifurcation).
_ROOM = 0.65
_LONGEST = 6.4  #: omega h of the longest step, for schemes without a stability limit
_PATHS = 64  #: paths on which the fastest frequency is measured
_FARTHEST = 20.0  #: largest number of halvings over which steps are foretold when the time has ended
_FIRST = 10.0  #: the first measurement may take this many times the time of the search
_PART = 4  #: the cost of a scheme is timed with at most this part of the time that is left
_SHORTEST = 1e-13  #: smallest relative tolerance: below it rounding decides


@dataclass(frozen=True)
class Option:
    """A scheme at the longest step that keeps the tolerance."""

    scheme: str
    steps: int
    step: float
    seconds: float  #: seconds of processor time for one path

    def __str__(self) -> str:
        """The option in one line."""
        cells = [self.scheme, "h =", f"{self.step:.4g}", f"{1e6 * self.seconds:.3g}", "us a path"]
        return tables.aligned([cells], (-24, 0, -10, 10, 0))


@dataclass(frozen=True)
class Advice:
    """A scheme and a step, with the reasons for them; made by `advise`."""

    scheme: str
    step: float
    steps: int  #: number of steps to the horizon
    seconds: float  #: seconds of processor time for one path
    reasons: tuple[str, ...]
    alternatives: tuple[Option, ...]  #: further schemes, the cheapest first

    def __str__(self) -> str:
        """The advice with its reasons and alternatives."""
        steps = checks.counted(self.steps, "step")
        lines = [f"{self.scheme}, h = {self.step:.4g} ({steps}), {1e6 * self.seconds:.3g} us a path"]
        lines += [f"- {reason}" for reason in self.reasons]
        if self.alternatives:
            lines += ["others:", *(f"  {x}" for x in self.alternatives[:8])]
        return "\n".join(lines)


@checks.hinted(*OPTIONS)
def advise(
    model: Model, *, q0: Any, p0: Any, horizon: float, tolerance: float, want: str = "paths", seconds: float = 5.0,
    seed: int = 0, progress: Progress = False, **options: Unpack[EndOptions],
) -> Advice:  # fmt: skip
    """Find the scheme and the step that keep a tolerance at the lowest cost of a path, from short runs.

    - tolerance: bound of the error at t0 + horizon; for invariants, relative to H
    - want: "paths", the root mean square distance in (q, p); "moments", the largest error of the means of q, p and H;
      "invariants", the largest change of H up to the horizon (with noise if the noise keeps H, else without)
    - q0, p0: initial state, a number or (dof,); options: those of `expect`
    - seconds: processor time that the search may take; a measurement that would end later is left out, but the first
      one may take ten times as long. A reason names the schemes left out; if none is found in time, steps are foretold
      from measured and claimed orders
    - progress: True shows a bar of the schemes that were tried, with the name and the steps of the present one; a
      function f(done, total) may return True: the advice is then among the schemes tried so far

    All schemes climb together: the next measurement is always the cheapest one. Errors are differences to runs with
    half the step on the same Brownian paths. Costs are timed on one thread. A step is at most 0.65 of the scheme's
    stability limit for the fastest motion that 64 paths reach. Schemes that are not symplectic are not tried. All
    quantities are dimensionless. Bad input raises a ValueError. If no scheme keeps the tolerance, a NumericalError says
    so.
    """
    checks.choice("want", want, list(KINDS))
    problem = make_problem(model, _nothing, q0=q0, p0=p0, horizon=horizon, seed=seed, **options)
    tolerance = checks.finite("tolerance", tolerance)
    if tolerance <= _SHORTEST:
        raise InvalidArgumentError(
            f"tolerance = {tolerance:g} is not allowed: give one above {_SHORTEST:g}, below which rounding decides"
        )
    if want == "invariants" and not model.traits.has_value:
        raise MissingOperationError("want = 'invariants' needs H itself: give the model a value function")
    seconds = checks.finite("seconds", seconds)
    if seconds <= 0:
        raise InvalidArgumentError(f"seconds = {seconds:g} is not allowed: give the processor time to spend, above 0")
    until = time.process_time() + seconds
    kind = KINDS[want](problem)
    fastest = frequency(problem, _PATHS)
    ladders = [
        Ladder(problem, scheme, kind, fewest=_fewest_steps(problem, scheme, fastest), tolerance=tolerance)
        for scheme in candidates(problem)
    ]
    bar, tell = told_by(progress)
    try:
        found, stopped = _climb(ladders, until, _FIRST * seconds, bar, tell)
    finally:
        if bar:
            bar.close()
    tried = [ladder.scheme.name for ladder in ladders if ladder.rungs]
    if not tried and stopped:
        raise NumericalError(f"advice was stopped before a scheme was tried ({stopped}): let it go on for longer")
    if not found:
        ended = f" ({stopped})" if stopped else ""
        raise NumericalError(
            f"none of {', '.join(tried) or 'the schemes that suit the model'} keeps an error of {tolerance:g} at steps "
            f"that a pilot can afford{ended}: give a larger tolerance, a shorter horizon or more `seconds`"
        )
    found.sort(key=lambda pair: pair[0].seconds)
    best, ladder = found[0]
    others = tuple(option for option, _ in found[1:])
    reasons = _reasons(problem, ladder, fastest, best, others)
    return Advice(best.scheme, best.step, best.steps, best.seconds, (*reasons, *([stopped] if stopped else [])), others)


def _climb(
    ladders: list[Ladder], until: float, first: float, bar: Any, tell: Any
) -> tuple[list[tuple[Option, Ladder]], str]:  # fmt: skip
    """Climb the ladders, the cheapest rung first, until this processor time; the first rung may take `first` seconds.
    Gives the options with their ladders, and a sentence if schemes were left out for lack of time or by the progress
    function.
    """
    found: list[tuple[Option, Ladder]] = []
    stopped, cheapest, shown = "", math.inf, -1
    for ladder in ladders:
        ladder.prepare()
    while climbing := [ladder for ladder in ladders if ladder.climbing]:
        ladder = min(climbing, key=lambda ladder: ladder.ahead)
        done = len(ladders) - len(climbing)
        if tell is not None and done > shown and tell(shown := done, len(ladders)):
            stopped = "the progress function ended the search"
        elif time.process_time() + ladder.ahead > until and (
            ladder.ahead > first or any(ladder.rungs for ladder in ladders)
        ):
            stopped = "the time for advice ended (`seconds`)"
        if stopped:
            break
        if bar:
            bar.say(str(ladder))
        ladder.climb(cheapest)
        if ladder.needed:
            found.append((_option(ladder, until), ladder))
            cheapest = min(cheapest, found[-1][0].seconds)
    if not stopped:
        if tell is not None:
            tell(len(ladders), len(ladders))
        return found, ""
    if not found:
        for ladder in ladders:
            ladder.foretell(_FARTHEST)
        found = [(_option(ladder, until), ladder) for ladder in ladders if ladder.needed]
        stopped += "; steps are foretold from measured and claimed orders" if found else ""
    left = [str(ladder) for ladder in climbing]
    return found, f"{stopped}; not measured: {'; '.join(left)}"


def _option(ladder: Ladder, until: float) -> Option:
    """The scheme of a ladder with the steps that it needs; its cost is timed, if there is time for it."""
    count = max(1, math.ceil(ladder.needed or 0))
    most = max(0.0, until - time.process_time()) / _PART
    return Option(ladder.scheme.name, count, ladder.problem.horizon / count, ladder.seconds(count, most))


def _fewest_steps(problem: Problem, scheme: Scheme, fastest: float) -> int:
    """Fewest steps to the horizon with which the fastest motion is stable."""
    longest = min(_ROOM * stable_up_to(scheme.name)[0], _LONGEST)
    return max(1, math.ceil(problem.horizon * fastest / longest))


def candidates(problem: Problem) -> list[Scheme]:
    """Symplectic schemes that the traits of a model allow; each is set up once."""
    return fitting(problem, scheme_names(problem.model, problem.options.get("t0", 0.0)))


def scheme_names(model: Model, t0: float = 0.0) -> list[str]:
    """Names of the schemes to try, by the traits of a model and its brackets at t0."""
    traits = model.traits
    if not traits.has_gradient:
        return ["gauss_dkdkd"]
    names = ["midpoint"]
    if traits.separable:
        names.append("stormer_verlet")
    if traits.separable and (traits.position_noise or traits.additive):
        names.append("symplectic_euler")
    if traits.kicked:
        names += ["gauss_dkdkd", "chin4a"]
    elif traits.turned:
        names.append("gauss_dkdkd")
    elif traits.position_noise and model.nnoise:
        names.append("gauss_dkdkd_midpoint")
    if not traits.additive:  # with additive noise these two have strong order 2 as they are
        names += [f"{name}_strong2" for name in names if name in ("gauss_dkdkd", "chin4a")]
    if traits.additive:
        names += ["verlet_dz"] if traits.kicked and traits.identity_mass else ["averaged_shift_midpoint"]
    brackets = commutator(model, t=t0) if model.nnoise else None
    if brackets is None or brackets.flows_commute:
        names += ["gauss2", "gauss3"]
    elif not brackets.commutative:
        names += ["midpoint_areas", "gauss2_strong32_areas"]
    elif not (traits.kicked or traits.turned):
        names.append("gauss2_strong32")
    return names


def _nothing(q: np.ndarray, p: np.ndarray) -> np.ndarray:
    """A placeholder for f: advice needs no function of the final state."""
    return np.zeros(q.shape[1])


def _reasons(
    problem: Problem, ladder: Ladder, fastest: float, best: Option, others: tuple[Option, ...]
) -> tuple[str, ...]:  # fmt: skip
    """The reasons as sentences: pilot, stability, brackets, cost."""
    limit = stable_up_to(ladder.scheme.name)[0]
    until = "is stable at every step" if limit == math.inf else f"is stable up to {limit:.3g}"
    made = "explicit here" if "solver: the step is explicit" in problem.try_out(ladder.scheme).left_out else "implicit"
    reasons = [
        f"pilot on {ladder.want.count} paths: {ladder.want.words} falls with order {ladder.order:.2f}, is "
        f"{ladder.error(-1):.2g} at {ladder.steps[-1]} steps",
        f"the fastest frequency times h is {fastest * best.step:.2g}, of paths with noise, too; {best.scheme} {until}",
        f"{best.scheme} is {made}, and symplectic",
    ]
    if problem.model.nnoise and problem.model.traits.has_gradient:
        reasons.append(commutator(problem.model, t=problem.options.get("t0", 0.0)).text)
    if others:
        reasons.append(f"{others[0].scheme} would take {others[0].seconds / best.seconds:.2g} times as long")
    return tuple(reasons)
