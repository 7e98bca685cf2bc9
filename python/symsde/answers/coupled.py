# SPDX-License-Identifier: BSD-3-Clause
"""One Brownian path at several steps: the change when a step is halved, and its cost.

Level l has n_l = n_0 2^l steps of the size h_l = T/n_l. One path drives all levels: increments are sums of finer
increments,

    dW_n^l = dW_{2n}^{l+1} + dW_{2n+1}^{l+1},

and the library merges dZ, K and areas likewise (`refine` = halvings from a level to the level that is drawn).
If truncation is on, each level truncates by its own step. For the ends x_l of these paths and a function f,

    D_l^2 = E |x_l - x_{l-1}|^2                                                      strong, of whole states
    d_0 = f(x_0),   d_l = f(x_l) - f(x_{l-1}),   E f(x_L) = sum_l E d_l              weak, telescoping
    E d_l ~ h_l^a,   V_l = Var d_l,   C_l = seconds of a path,   error^2 = sum_l V_l/N_l

with N_l samples on separate paths for each level. The bias of a step, E f(x) - E f(x_l), follows from the means of
the finest d_l (`expectation/bias.py`); N_l ~ (V_l/C_l)^(1/2) costs least (Giles 2008, Oper. Res. 56, 607).

`runs_of` and `values_of` follow one path at several steps, `LevelSampler` draws samples of d_l, `Levels` holds them.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Unpack

import numpy as np

from ..errors import InvalidArgumentError, PathsFailedWarning
from ..native import checks
from ..run.options import EndOptions
from ..run.simulate import Run
from ..schemes import Scheme, as_scheme
from .expectation import bias
from .expectation.interval import Tally
from .expectation.problem import OPTIONS, Problem, make_problem

MOST_LEVELS = 31
_STRIDE = 2**41  #: number of path indices of a level; there are 2^47 in all


def halvings(fine: int, coarse: int) -> int:
    """Number of halvings that lead from the step of a run with `coarse` steps to the step of a run with `fine`
    steps.
    """
    return (fine // coarse).bit_length() - 1


def runs_of(problem: Any, scheme: Any, counts: Sequence[int], **paths: Any) -> Iterator[Run]:
    """Runs with these numbers of steps, all driven by the path drawn for the largest number."""
    return (problem.run(scheme, n, refine=halvings(max(counts), n), **paths) for n in counts)


def values_of(
    problem: Problem, scheme: Scheme, steps: int, paths: dict[str, Any]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Values of f with this many steps, an even number, and with half as many, on the same paths; and which paths
    are ok in both.
    """
    (fine, ok), (coarse, also) = map(problem.values, runs_of(problem, scheme, (steps, steps // 2), **paths))
    return fine, coarse, ok & also


def end(run: Run) -> np.ndarray:
    """Final state (2, dof, path) of a run."""
    return np.stack([run.q[-1], run.p[-1]])


def squares(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """|x - y|^2 of each path; overflow counts as not finite."""
    with np.errstate(over="ignore", invalid="ignore"):
        return np.square(one - other).sum(axis=(0, 1))


def rms(square: np.ndarray) -> float:
    """Root of the mean of squares."""
    return float(np.sqrt(np.mean(square)))


@dataclass(frozen=True)
class Draw:
    """Samples of a level."""

    difference: Tally  #: tally of f fine - f coarse; at level 0 of f alone
    fine: Tally
    coarse: Tally
    seconds: float  #: seconds of processor time
    failed: int  #: number of paths that failed at one of the two steps and are left out

    @property
    def units(self) -> Tally:
        """The tally that decides how many samples are needed: the differences."""
        return self.difference

    def error_by(self, size: float) -> float:
        """Standard error of the mean difference, where `size` is the distance of values of f that differ from the rest.
        If f jumps, it differs between the two steps on few paths or on none, and the scatter of the differences is
        unreliable: then one more path counts as different, by as much as the paths that differ, or by `size` if no path
        differs.
        """
        d = self.difference
        if d.n < 2 or not d.few:
            return d.error
        return math.hypot(d.error, (d.size or max(size, self.fine.size)) / d.n)

    @property
    def error(self) -> float:
        """Standard error of the mean difference from these paths alone."""
        return self.error_by(0.0)

    @property
    def variance(self) -> float:
        """Variance of the difference that corresponds to `error`."""
        return self.error**2 * self.difference.n

    def __add__(self, other: Draw) -> Draw:
        """Join two sets of samples."""
        return Draw(
            self.difference + other.difference,
            self.fine + other.fine,
            self.coarse + other.coarse,
            self.seconds + other.seconds,
            self.failed + other.failed,
        )


NOTHING = Draw(Tally(), Tally(), Tally(), 0.0, 0)


class LevelSampler:
    """Draws new samples of a level at each call, in the form that drivers of multilevel Monte Carlo expect.

        sampler = ss.level_sampler(model, "q**2", q0=1.0, p0=0.0, horizon=2.0, scheme="midpoint", steps=4)
        sums, cost = sampler(level, count)

    sums has the shape (6,). Let d be f on the fine path minus f on the coarse path (f itself at level 0). sums holds
    the sums of d, d^2, d^3, d^4, of f on the fine path and of its square, as `mlmc_fn(l, N)` in the programs of M. B.
    Giles. cost is in seconds of the processor. If level 0 has n steps, level l has n 2^l. Path i of level l is path l
    2^41 + i of the seed. Paths that fail are not in the sums; a PathsFailedWarning says how many failed.
    """

    def __init__(
        self, problem: Problem, scheme: str | Scheme, coarsest: int, *, antithetic: bool = False, first: int = 0
    ):
        """Store the levels of a scheme without drawing. See `level_sampler`."""
        self.problem = problem
        self.scheme = as_scheme(scheme)
        self.coarsest = checks.integer("steps", coarsest, (1, 2**40))
        self.antithetic = checks.flag("antithetic", antithetic)
        self._first, self._used = first, {}
        if self.scheme.info.law != "Gaussian":
            raise InvalidArgumentError(
                f"scheme {self.scheme.name} draws two- or three-point increments, which follow no Brownian path, so "
                "that its steps cannot be coupled: give another scheme, such as midpoint"
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
        """Draw new samples as tallies of centred sums, which keep a small variance of large numbers accurate."""
        result = NOTHING
        for fine, coarse, failed, seconds in self._samples(level, count):
            result += Draw(Tally.of(fine - coarse), Tally.of(fine), Tally.of(coarse), seconds, failed)
        return result

    def draw_from(self, level: int, sample: int, count: int) -> Draw:
        """Draw samples as tallies, beginning with the sample of this number, counted from 0."""
        level = checks.integer("level", level, (0, MOST_LEVELS))
        self._used[level] = self._first + checks.integer("sample", sample, (0, _STRIDE))
        return self.draw(level, count)

    def steps(self, level: int) -> int:
        """Number of steps of a level."""
        return self.coarsest << checks.integer("level", level, (0, MOST_LEVELS))

    def _samples(self, level: int, count: int) -> Iterator[tuple[np.ndarray, np.ndarray, int, float]]:
        """Give f on the fine and on the coarse path, failed paths and seconds, in parts of the new samples."""
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
        """Number of paths computed at a time."""
        return self.problem.chunk_of(self.steps(level)) if self.antithetic else self.problem.chunk

    def _pair(self, level: int, first: int, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """f on the fine path, f on the coarse path, and which paths are ok in both."""
        problem, steps = self.problem, self.steps(level)
        paths: dict[str, Any] = {"first_path": first, "paths": count}
        if level == 0:
            fine, ok = problem.values(problem.run(self.scheme, steps, **paths))
            return fine, np.zeros_like(fine), ok
        fine, coarse, ok = values_of(problem, self.scheme, steps, paths)
        if self.antithetic:
            paths["increments"] = self._swapped(steps, paths)
            swapped, also = problem.values(problem.run(self.scheme, steps, **paths))
            fine, ok = (fine + swapped) / 2, ok & also
        return fine, coarse, ok

    def _swapped(self, steps: int, paths: dict[str, int]) -> np.ndarray:
        """The fine increments with the two of each coarse step exchanged: the same coarse path, with areas of opposite
        sign.

        Giles and Szpruch 2014, Ann. Appl. Probab. 24: the mean of both fine paths is nearer to the coarse path if
        noises do not commute.
        """
        dw = self.problem.increments(self.scheme, steps, paths["first_path"], paths["paths"])
        return dw.reshape(steps // 2, 2, *dw.shape[1:])[:, ::-1].reshape(dw.shape)


class Levels:
    """Samples of the levels of one scheme: E d_l, V_l, Var f, and the bias of the finest level."""

    def __init__(self, order: float, known: Tally):
        """Start without samples. order: weak order; known: values of f on other paths."""
        self.order, self.known = order, known
        self.draws: list[Draw] = []

    @property
    def begun(self) -> int:
        """Number of levels that have values; the last level may have none after an interruption."""
        return sum(draw.difference.n > 1 for draw in self.draws)

    @property
    def variance(self) -> float:
        """Var f from the finest level; at least the variance of the known values, if few values of the finest level
        differ from the rest.
        """
        own = self.draws[self.begun - 1].fine
        return max(own.variance, self.known.variance) if own.few and self.known.n > 1 else own.variance

    def error_of(self, level: int) -> float:
        """Standard error of the mean of d_l."""
        return self.draws[level].error_by(self.known.size)

    def variance_of(self, level: int) -> float:
        """V_l, the variance of d_l, computed from the standard error of its mean."""
        return self.error_of(level) ** 2 * self.draws[level].difference.n

    def square_of(self, level: int) -> float:
        """E d_l^2 of a level above 0: the mean square change of f when the step is halved."""
        return self.variance_of(level) + self.draws[level].difference.mean ** 2

    def are_settled(self, means: Sequence[float], errors: Sequence[float], order: float) -> bool:
        """Whether powers of h are reliable: the paths of the two finest levels end near each other, or the means of d_l
        fall regularly.
        """
        return bias.settled(self.square_of(self.begun - 1), self.variance, means, errors, order)

    def left_by(
        self, means: Sequence[float], errors: Sequence[float], order: float, *, phases: float, settled: bool,
        halved: float = 0,
    ) -> tuple[float, float]:  # fmt: skip
        """E f - E f(x_l) and its standard error, from means of d_l, for a step `halved` halvings finer than the finest
        level.

        phases: the power of h in the error of phases.
        """
        last = self.begun - 1
        second = bias.second_powers(self.square_of(last), self.variance, phases, self.draws[last].difference.size)
        return bias.left(means, errors, order, halved, settled=settled, second=second)


def driven_by_more(scheme: Scheme) -> bool:
    """Whether the scheme uses more of the Brownian path than its increments."""
    info = scheme.info
    return info.uses_dz or info.uses_areas or info.uses_stt_area or info.uses_magnus


@checks.hinted(*OPTIONS)
def level_sampler(
    model, f, *, q0: Any, p0: Any, horizon: float, scheme: str | Scheme = "midpoint", steps: int = 1, seed: int = 0,
    antithetic: bool = False, **options: Unpack[EndOptions],
) -> LevelSampler:  # fmt: skip
    """A `LevelSampler` for your own driver of multilevel Monte Carlo; symsde's driver is `mlmc`.

    steps: number of steps of level 0. antithetic: fine paths come in pairs; within every coarse step one path has the
    two increments of the other in reverse order. This is for noises that do not commute. The other arguments are those
    of `mlmc`.
    """
    return LevelSampler(
        make_problem(model, f, q0=q0, p0=p0, horizon=horizon, seed=seed, **options), scheme, steps,
        antithetic=antithetic,
    )  # fmt: skip
