# SPDX-License-Identifier: BSD-3-Clause
"""Multilevel Monte Carlo (Giles 2008, Oper. Res. 56, 607; 2015, Acta Numerica 24, 259).

    E f ~ sum_l mean d_l,    N_l = (V_l/C_l)^(1/2) sum_k (V_k C_k)^(1/2)/((1 - s) e^2)

with d_l, V_l, C_l as in `coupled.py`, e the error that the tolerance allows and s the share of its bias. A level is
added while the bias of the finest level is more than s^(1/2) e.
"""

from __future__ import annotations

import math
import os
from functools import partial
from typing import Any, Unpack

from ...errors import NumericalError
from ...model.definition import Model
from ...native import checks
from ...native.progress import Progress
from ...native.signals import carry
from ...run.options import EndOptions
from ...schemes import Scheme, as_scheme
from ..coupled import MOST_LEVELS, NOTHING, Levels, LevelSampler
from . import bias as weak
from .answer import Level, Multilevel, fall
from .candidates import best_coupled, fewest_steps, mild_steps, of_phases, weak_order
from .draw_store import InFolder, Nowhere, inputs_of, open_folder
from .estimators import Plain
from .interval import BIAS_SHARE, SEEN, Tally, Tolerance, half_width, make_tolerance, may_be_zero, quantile
from .problem import OPTIONS, Function, make_problem
from .tails import Doubt, look, widened
from .watch import Watch

FIRST_LEVELS = 3  #: number of levels that are drawn before anything is judged, if so many are allowed
_LOOKED_AT_FROM = 2**46 + 2**45  #: index of the first path on which f is examined
_HEAVY = 100.0  #: kurtosis above which the variance of a level is doubtful
_INCONSISTENT = 1.5  #: consistency above which a warning is given: 4.5 standard errors
_TIMING = 0.1  #: relative error of seconds that the interval of gamma assumes
_NOISE_SHARE = 0.5  #: share of the allowed bias that may be noise; above it the finest level is given more paths


@checks.hinted(*OPTIONS)
def mlmc(
    model: Model,
    f: Function | str,
    *,
    q0: Any,
    p0: Any,
    horizon: float,
    abs: float | None = None,
    rel: float | None = None,
    scheme: str | Scheme | None = None,
    steps: int | None = None,
    levels: int = 12,
    first: int = 1024,
    seed: int = 0,
    antithetic: bool = False,
    max_time: float | None = None,
    progress: Progress = False,
    out: str | os.PathLike | None = None,
    **options: Unpack[EndOptions],
) -> Multilevel:
    """Estimate E f(q, p) at t0 + horizon by multilevel Monte Carlo, with a 95 % interval of the half width asked for.

    - f: a function of q, p, (dof, path) each, that returns (path,); or a formula as text, such as `"q**2"`
    - q0, p0: initial state of all paths, a number or (dof,)
    - abs, rel: half width of the interval, or half width over the value; give one of the two
    - scheme: by default gauss_dkdkd if the noises depend on position and H = p.p/2 + U(q), else midpoint
    - steps: number of steps of level 0; by default as few as the fastest frequency, and the noise in implicit steps,
      allow. Level l has 2^l times as many
    - levels: the largest number of levels, 2 .. 31; first: paths with which a new level begins, 16 .. 2^30
    - antithetic: fine paths come in pairs whose increments are exchanged within every coarse step, for noises that do
      not commute
    - max_time: seconds of the clock after which the interval reached so far is returned
    - out: a folder that keeps the draws; the same call resumes it, and several processes can share it
    - options: t0, correction, truncation, areas, area_time, damping_noise, compensated and threads of `simulate`

    The number of paths of each level follows from its measured variance and cost. Levels are added until the bias,
    estimated from the means of the finest levels, is small beside the noise. The interval includes both. All quantities
    are dimensionless. Bad input raises a ValueError before long work. Ctrl-C raises KeyboardInterrupt. Its attribute
    `partial` is the estimate of the levels begun so far, or None before the first. If f varies on too few paths,
    the interval is widened for rare events that may be missing, as in `expect`.
    """
    watch = Watch(max_time, progress)
    with watch.carrying(Multilevel):
        problem = make_problem(model, f, q0=q0, p0=p0, horizon=horizon, seed=seed, **options)
        tolerance = make_tolerance(abs, rel)
        chosen = best_coupled(problem) if scheme is None else as_scheme(scheme)
        coarsest = max(fewest_steps(problem), mild_steps(problem)) if steps is None else steps
        most = checks.integer("levels", levels, (2, MOST_LEVELS))
        first = checks.integer("first", first, (16, 2**30))
        sampler = LevelSampler(problem, chosen, coarsest, antithetic=antithetic)
        given = {"levels": most, "first": first, "watch": watch}
        if out is None:
            return Estimate(sampler, tolerance, **given).run()
        inputs = inputs_of(problem, tolerance, chosen, "multilevel")
        inputs["mlmc"] = {"steps": sampler.coarsest, "levels": most, "first": first, "antithetic": sampler.antithetic}
        with open_folder(out, inputs, problem, [chosen], watch) as store:
            return Estimate(sampler, tolerance, **given, store=store).run()


class Estimate(Levels):
    """A multilevel estimate: levels and paths are added until its interval is narrow enough."""

    def __init__(
        self, sampler: LevelSampler, tolerance: Tolerance, *, levels: int, first: int, watch: Watch,
        known: Tally | None = None, store: Nowhere | InFolder | None = None,
    ):  # fmt: skip
        """Nothing is drawn yet.

        levels: the largest number of levels; first: paths with which a level begins; known: values of f that were
        looked at already (if there are none, some are drawn first); store: where draws are kept.
        """
        super().__init__(weak_order(sampler.problem, sampler.scheme), known or Tally())
        self.sampler, self.tolerance, self.watch = sampler, tolerance, watch
        self.most, self.first = levels, first
        self.store = Nowhere(watch) if store is None else store
        self._tails = Doubt(sampler.problem)
        self.notes: list[str] = []

    def run(self) -> Multilevel:
        """Draw until the interval is narrow enough, or until the levels or the time are used up."""
        try:
            if not self.known.n:
                self.known = self._look_at_f()
            for _ in range(min(FIRST_LEVELS, self.most)):
                self._add_level()
            self._check()
            while not self.watch.over and self._work():
                pass
            return self.answer()
        except BaseException as stop:
            carry(stop, lambda: self.answer() if self.begun else None)
            raise

    def _look_at_f(self) -> Tally:
        """Draw values of f at a step of moderate length, and refuse f if they have no variance."""
        sampler, level = self.sampler, min(FIRST_LEVELS, self.most) - 1
        plain = Plain(sampler.problem, sampler.scheme, sampler.steps(level), _LOOKED_AT_FROM)
        return look(plain, self.tolerance, self.watch).units

    def _work(self) -> bool:
        """Draw missing paths, or add a level; false if nothing is left to do."""
        wanted = self._wanted()
        missing = [max(0, n - draw.difference.n) for n, draw in zip(wanted, self.draws, strict=True)]
        if any(missing):
            # estimates of variance improve with more paths: draw a part at a time, first on the level that needs it
            # most
            level = max(range(len(missing)), key=lambda i: missing[i] * self._seconds(i))
            held = self.draws[level].difference.n
            self._draw(level, min(missing[level], max(held, self.first)))
            self._tell(wanted)
            return True
        allowed = self._allowed()
        seen, noise = self._left()
        if math.hypot(seen, noise) <= allowed:
            return False
        more = self.draws[-1].difference.few or self._finest_is_cheap()  # a finer level would tell less
        if noise > _NOISE_SHARE * allowed and math.fabs(seen) < 2 * noise and more:
            self._draw(len(self.draws) - 1, self.draws[-1].difference.n)
            return True
        if len(self.draws) == self.most:
            self.notes.append(
                f"the bias is not small at {self.sampler.steps(self.most - 1)} steps, the finest of {self.most} "
                "levels: give more levels, or a scheme of higher weak order"
            )
            return False
        self._add_level()
        return True

    def _add_level(self) -> None:
        """Begin the next level; refuse if fewer than two of its paths come to the end."""
        level = len(self.draws)
        self.draws.append(NOTHING)
        self._draw(level, self.first)
        if self.draws[level].difference.n < 2:
            raise NumericalError(
                f"{self.draws[level].failed} paths failed at {self.sampler.steps(level)} steps and "
                f"{self.draws[level].difference.n} came to the end: give more steps on level 0, or another scheme; E f "
                "may not exist because paths escape, look at them with `simulate`"
            )

    def _draw(self, level: int, count: int) -> None:
        """Draw `count` more samples of a level in parts, and check the clock between them."""
        usual, name = max(256, self.sampler.problem.chunk), f"level-{level:02d}"
        draw = partial(self.sampler.draw_from, level)
        while count > 0 and not (self.watch.over and self.draws[level].difference.n > 1):
            found = self.store.more(name, self.draws[level], count, usual, draw, exactly=True)
            if found is None:
                return
            self.draws[level] += found
            count -= found.difference.n + found.failed
        self._tails.look(self.draws[level].fine, self.sampler.scheme, self.sampler.steps(level))

    def _finest_is_cheap(self) -> bool:
        """Whether the finest level took less than a fifth of all seconds, so that its paths may be doubled."""
        return self.draws[-1].seconds < 0.2 * sum(draw.seconds for draw in self.draws)

    def _check(self) -> None:
        """Refuse a tolerance that further work cannot reach, as the first samples show."""
        fine, (value, error) = self.draws[0].fine, self._told()
        self.tolerance.check(value, math.sqrt(fine.mean**2 + fine.variance))
        if self.tolerance.relative is not None and math.fabs(value) < error:
            raise may_be_zero(value, error)

    def _told(self) -> tuple[float, float]:
        """The value and its error; the mean of the first values of f, if these are known to differ from 0 and the
        levels are not.
        """
        known, levels = self.known, (self.value, self.error)
        seen = math.fabs(known.mean) > SEEN * known.error
        return (known.mean, known.error) if seen and math.fabs(self.value) < self.error else levels

    def _wanted(self) -> list[int]:
        """Number of paths of each level (level,), by which the noise keeps its share of the error at the least cost."""
        noise = (1 - BIAS_SHARE) * self._error_wanted() ** 2
        levels = range(len(self.draws))
        spread = [math.sqrt(self._variance(i) / self._seconds(i)) for i in levels]
        total = sum(math.sqrt(self._variance(i) * self._seconds(i)) for i in levels)
        if total == 0:
            return [self.first] * len(self.draws)
        return [min(2**40, math.ceil(s * total / max(noise, 1e-300))) for s in spread]

    def _error_wanted(self) -> float:
        """Root mean square error that gives the half width; Student's t is that of the level with the fewest paths."""
        fewest = min(draw.difference.n for draw in self.draws)
        return self.tolerance.half_width(self._told()[0]) / quantile(fewest)

    def _variance(self, level: int) -> float:
        """V_l. For level 0 it is at least the variance of the first values of f, if few values of the level differ."""
        few = level == 0 and self.draws[level].difference.few and self.known.n > 1
        return max(self.variance_of(level), self.known.variance if few else 0.0)

    def _error(self, level: int) -> float:
        """Standard error (V_l/N_l)^(1/2) of the mean of a level."""
        n = self.draws[level].difference.n
        return math.sqrt(self._variance(level) / n) if n > 1 else math.inf

    def _seconds(self, level: int) -> float:
        """Seconds C_l of a path of a level."""
        draw = self.draws[level]
        return max(draw.seconds, 1e-9) / max(1, draw.difference.n)

    def _tell(self, wanted: list[int]) -> None:
        """Report the share of the work that is done, if this many paths of each level (level,) are wanted."""
        done = sum(draw.seconds for draw in self.draws)
        missing = sum(
            max(0, n - draw.difference.n) * self._seconds(i)
            for i, (n, draw) in enumerate(zip(wanted, self.draws, strict=True))
        )
        self.watch.tell(done / max(done + missing, 1e-300))

    def _allowed(self) -> float:
        """Largest allowed bias s^(1/2) e."""
        return math.sqrt(BIAS_SHARE) * self._error_wanted()

    def _left(self) -> tuple[float, float]:
        """The bias E f - E f(x_L) of the finest level, and the standard error of this estimate."""
        finer = range(1, max(self.begun, 1))
        means, errors = [self.draws[i].difference.mean for i in finer], [self._error(i) for i in finer]
        order = self.order if len(means) >= weak.TERMS else weak.order_of(means, errors, self.order)
        settled = self.are_settled(means, errors, order)
        return self.left_by(means, errors, order, phases=of_phases(self.sampler.scheme, order), settled=settled)

    @property
    def value(self) -> float:
        """The estimate of E f: the sum of the means of the levels."""
        return math.fsum(draw.difference.mean for draw in self.draws[: self.begun])

    @property
    def error(self) -> float:
        """Standard error of the value."""
        return math.sqrt(math.fsum(self._error(i) ** 2 for i in range(self.begun)))

    def answer(self) -> Multilevel:
        """The result so far, from the levels that were begun, of which there is at least one."""
        value, error, begun = self.value, self.error, self.begun
        bias = math.hypot(*self._left()) if begun > 1 else math.inf
        half = half_width(error, bias, min(draw.difference.n for draw in self.draws[:begun]))
        seen = sum((draw.fine for draw in self.draws), self.known)
        notes = [*self.notes]
        half = widened(half, self.sampler.problem, self.sampler.scheme, self.sampler.steps(0), seen, notes)
        reached = self.tolerance.is_reached(half, value)
        levels = tuple(self._level(i) for i in range(begun))
        finer = range(1, len(levels))
        spread = [math.sqrt(max(levels[i].kurtosis - 1, 0) / levels[i].paths) * levels[i].variance for i in finer]
        speeds = [levels[i].paths / max(levels[i].seconds, 1e-9) for i in finer]
        slopes = {
            "alpha": fall([levels[i].mean for i in finer], [levels[i].error for i in finer]),
            "beta": fall([levels[i].variance for i in finer], spread),
            "gamma": fall(speeds, [_TIMING * x for x in speeds]),
        }
        notes += _doubts(levels)
        if not reached and self.watch.over:
            notes.append(
                f"{self.watch.why}: the half width is {half:.3g}, not {self.tolerance.half_width(value):.3g}, as asked"
            )
        return Multilevel(
            value=value,
            interval=(value - half, value + half),
            error=error,
            bias=bias,
            scheme=self.sampler.scheme.name,
            levels=levels,
            **slopes,
            reached=reached,
            notes=tuple(notes),
            cost=self.watch.seconds + self.store.seconds,
        )

    def _level(self, i: int) -> Level:
        """The row of a level in the result."""
        draw, consistency = self.draws[i], 0.0
        if i:
            before = self.draws[i - 1].fine
            apart = math.fabs(before.mean - draw.coarse.mean)
            error = math.hypot(before.error, draw.coarse.error)
            consistency = apart / (3 * error) if error > 0 else float(apart > 0) * math.inf
        d = draw.difference
        return Level(
            self.sampler.steps(i), d.n, d.mean, self._error(i), self._variance(i), d.kurtosis, draw.fine.mean,
            draw.fine.variance, consistency, draw.seconds, draw.failed,
        )  # fmt: skip


def _doubts(levels: tuple[Level, ...]) -> list[str]:
    """Doubts about the levels that the interval does not include, each a sentence."""
    notes = []
    failed = sum(x.failed for x in levels)
    if failed:
        notes.append(
            f"{failed} of {failed + sum(x.paths for x in levels)} paths failed and are left out: the mean is that of "
            "the others; give more steps on level 0, or another scheme"
        )
    for i, x in enumerate(levels):
        if x.kurtosis > _HEAVY and x.paths < x.kurtosis * 100:
            notes.append(
                f"level {i}: the kurtosis {x.kurtosis:.0f} makes its variance uncertain by "
                f"{100 * math.sqrt(x.kurtosis / x.paths):.0f} %: f may jump; begin levels with more paths (first=)"
            )
        if x.consistency > _INCONSISTENT:
            notes.append(
                f"level {i}: its coarse paths and the paths of level {i - 1} have different means, {x.consistency:.1f} "
                "times what noise allows: areas by the path depend on the step, give areas='law'"
            )
    return notes
