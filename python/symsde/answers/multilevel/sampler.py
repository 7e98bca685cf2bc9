# SPDX-License-Identifier: BSD-3-Clause
"""Samples of the levels of a multilevel estimate: the same Brownian path at the step h and at 2h.

The coarse path is driven by the sums of the increments of the fine one (`refine=1`), with dZ, K and areas merged by the
library, and is truncated, where that is asked for, by its own step. So what is subtracted at level l has the law of
what is added at level l - 1, and the sum over the levels telescopes. Levels and calls use paths of their own.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...errors import InvalidArgumentError, PathsFailedWarning
from ...native import checks
from ...run.step import increments
from ...schemes import Scheme, as_scheme
from ..expectation.problem import OPTIONS, Problem, make_problem
from ..expectation.tally import Tally

MOST_LEVELS = 31
_STRIDE = 2**41  #: path indices of a level; there are 2^47
_NUMBERS = 2**20  #: of the increments that are held at a time


@dataclass(frozen=True)
class Draw:
    """Some samples of a level."""

    difference: Tally  #: f fine - f coarse; f alone at level 0
    fine: Tally
    coarse: Tally
    seconds: float  #: of the processor
    failed: int  #: paths that failed at one of the two steps, left out

    def error_by(self, size: float) -> float:
        """Standard error of the mean difference, of an f whose values that differ lie so far from the rest.

        Where f jumps, few paths differ or none, and their scatter tells too little: then as if one more differed, by as
        much as those do; where none does, by as much as values of f.
        """
        d = self.difference
        if d.n < 2 or not d.few:
            return d.error
        return math.hypot(d.error, (d.size or max(size, self.fine.size)) / d.n)

    @property
    def error(self) -> float:
        """The same by these paths alone."""
        return self.error_by(0.0)

    @property
    def variance(self) -> float:
        """Of the difference, by that error."""
        return self.error**2 * self.difference.n

    def __add__(self, other: Draw) -> Draw:
        """Both together."""
        return Draw(
            self.difference + other.difference,
            self.fine + other.fine,
            self.coarse + other.coarse,
            self.seconds + other.seconds,
            self.failed + other.failed,
        )


NOTHING = Draw(Tally(), Tally(), Tally(), 0.0, 0)


class LevelSampler:
    """Calls give new samples of a level, in the form that drivers of multilevel Monte Carlo take.

        sampler = ss.level_sampler(model, "q**2", q0=1.0, p0=0.0, horizon=2.0, scheme="midpoint", steps=4)
        sums, cost = sampler(level, count)

    sums: (6,), of d, d^2, d^3, d^4 with d = f fine - f coarse (f alone at level 0), of f fine, and of its square, as
    `mlmc_fn(l, N)` of M. B. Giles' programs returns them; cost: seconds of the processor. Level l has steps 2^l steps
    of the size horizon/(steps 2^l). Path i of level l is path l 2^41 + i of the seed. Paths that fail are not in the
    sums; a PathsFailedWarning tells how many.
    """

    def __init__(
        self, problem: Problem, scheme: str | Scheme, coarsest: int, *, antithetic: bool = False, first: int = 0
    ):
        """Levels of a scheme; nothing is drawn yet. See `level_sampler`."""
        self.problem = problem
        self.scheme = as_scheme(scheme)
        self.coarsest = checks.integer("steps", coarsest, (1, 2**40))
        self.antithetic = checks.flag("antithetic", antithetic)
        self._first, self._used = first, {}
        if self.scheme.info.law != "Gaussian":
            raise InvalidArgumentError(
                f"scheme {self.scheme.name} draws increments of a law of its own and follows no Brownian path, so that "
                "its steps cannot be coupled: give another scheme, such as midpoint"
            )
        if antithetic and driven_by_more(self.scheme):
            raise InvalidArgumentError(
                f"antithetic = True exchanges increments alone, and scheme {self.scheme.name} takes more of the path: "
                "give midpoint or another scheme that takes increments alone"
            )

    def __call__(self, level: int, count: int) -> tuple[np.ndarray, float]:
        """Sums (6,) and cost of `count` new samples of a level."""
        sums, cost, lost = np.zeros(6), 0.0, 0
        for fine, coarse, failed, seconds in self._samples(level, count):
            d = fine - coarse
            sums += [d.sum(), (d**2).sum(), (d**3).sum(), (d**4).sum(), fine.sum(), (fine**2).sum()]
            cost += seconds
            lost += failed
        if lost:
            checks.warn(
                f"{lost} of {count} paths failed at level {level} and are not in the sums: divide by {count - lost}",
                PathsFailedWarning,
            )
        return sums, cost

    def draw(self, level: int, count: int) -> Draw:
        """The same as tallies, which do not lose small variances of large numbers."""
        result = NOTHING
        for fine, coarse, failed, seconds in self._samples(level, count):
            result += Draw(Tally.of(fine - coarse), Tally.of(fine), Tally.of(coarse), seconds, failed)
        return result

    def draw_from(self, level: int, sample: int, count: int) -> Draw:
        """The same from a sample on, counted from 0."""
        level = checks.integer("level", level, (0, MOST_LEVELS))
        self._used[level] = self._first + checks.integer("sample", sample, (0, _STRIDE))
        return self.draw(level, count)

    def steps(self, level: int) -> int:
        """Steps of a level."""
        return self.coarsest << checks.integer("level", level, (0, MOST_LEVELS))

    def _samples(self, level: int, count: int) -> Iterator[tuple[np.ndarray, np.ndarray, int, float]]:
        """f fine, f coarse, failed paths and seconds of parts of new samples."""
        level = checks.integer("level", level, (0, MOST_LEVELS))
        count = checks.integer("count", count, (1, 2**40))
        while count:
            part = min(count, self._part(level))
            first = self._used.get(level, self._first)
            self._used[level] = first + part
            begin = time.process_time()
            fine, coarse, ok = self._pair(level, _STRIDE * level + first, part)
            yield fine[ok], coarse[ok], int((~ok).sum()), time.process_time() - begin
            count -= part

    def _part(self, level: int) -> int:
        """Paths that are computed at a time."""
        if not self.antithetic:
            return self.problem.chunk
        row = self.steps(level) * max(1, self.problem.model.nnoise)
        return max(8, min(self.problem.chunk, _NUMBERS // row))

    def _pair(self, level: int, first: int, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """f fine, f coarse, and which paths are ok in both."""
        problem, steps = self.problem, self.steps(level)
        paths: dict[str, Any] = {"first_path": first, "paths": count}
        if level == 0:
            fine, ok = problem.values(problem.run(self.scheme, steps, **paths))
            return fine, np.zeros_like(fine), ok
        fine, coarse, ok = coupled(problem, self.scheme, steps, paths)
        if self.antithetic:
            paths["increments"] = self._swapped(steps, **paths)
            swapped, also = problem.values(problem.run(self.scheme, steps, **paths))
            fine, ok = (fine + swapped) / 2, ok & also
        return fine, coarse, ok

    def _swapped(self, steps: int, **paths: int) -> np.ndarray:
        """The fine increments, the two of each coarse step exchanged: the same coarse path, areas of the other sign.

        Giles and Szpruch 2014, Ann. Appl. Probab. 24: the mean of both fine paths is nearer to the coarse one where
        noises do not commute.
        """
        problem = self.problem
        truncation = problem.options.get("truncation")
        step = problem.horizon / steps
        dw = increments(problem.model, step=step, steps=steps, seed=problem.seed, truncation=truncation, **paths)
        return dw.reshape(steps // 2, 2, *dw.shape[1:])[:, ::-1].reshape(dw.shape)


def coupled(
    problem: Problem, scheme: Scheme, steps: int, paths: dict[str, Any]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """f at so many steps, an even number, and at half of them, on the same paths, and which are ok in both."""
    fine, ok = problem.values(problem.run(scheme, steps, **paths))
    coarse, also = problem.values(problem.run(scheme, steps // 2, refine=1, **paths))
    return fine, coarse, ok & also


def driven_by_more(scheme: Scheme) -> bool:
    """The scheme takes more of the Brownian path than its increments."""
    info = scheme.info
    return info.uses_dz or info.uses_areas or info.uses_stt_area or info.uses_magnus


@checks.hinted(*OPTIONS)
def level_sampler(
    model, f, *, q0: Any, p0: Any, horizon: float, scheme: str | Scheme = "midpoint", steps: int = 1, seed: int = 0,
    antithetic: bool = False, **options: Any,
) -> LevelSampler:  # fmt: skip
    """A `LevelSampler` for drivers of multilevel Monte Carlo of your own; `mlmc` is one in symsde.

    steps: of level 0. antithetic: fine paths come in pairs whose halves of every coarse step are exchanged, for noises
    that do not commute. The other arguments are those of `mlmc`.
    """
    return LevelSampler(
        make_problem(model, f, q0=q0, p0=p0, horizon=horizon, seed=seed, **options), scheme, steps,
        antithetic=antithetic,
    )  # fmt: skip
