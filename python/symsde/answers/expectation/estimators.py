# SPDX-License-Identifier: BSD-3-Clause
"""Ways to sample E f at one step.

Each estimator draws independent units, whose mean is the value: a unit is f on one path, a combination of f on two
paths, or f minus a control variate. It also measures the seconds of the processor that the units took.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from ...schemes import Scheme
from ..coupled import values_of
from .problem import Problem
from .tally import Tally

AT_ONCE = 4096  #: units that are begun with at most
ENOUGH = 1.2  #: times the units that the pilot's variance asks for, so that few answers take more of them


@dataclass(frozen=True)
class Drawn:
    """Some units of an estimator."""

    units: Tally
    seconds: float  #: of the processor
    failed: int  #: units left out, for a path of theirs that failed
    paths: int  #: computed, those of failed units too

    def __add__(self, other: Drawn) -> Drawn:
        """The units of both together."""
        return Drawn(
            self.units + other.units,
            self.seconds + other.seconds,
            self.failed + other.failed,
            self.paths + other.paths,
        )


NOTHING = Drawn(Tally(), 0.0, 0, 0)


class Estimator:
    """An estimator by paths of one scheme and step, from the index `first` on; `draw` computes the next units."""

    name = ""
    paths_a_unit = 1
    least_units = 256  #: of an interval

    def __init__(self, problem: Problem, scheme: Scheme, steps: int, first: int):
        """Take a scheme with `steps` steps to the horizon; nothing is drawn yet. first: index of the first path."""
        self.problem, self.scheme, self.steps = problem, scheme, steps
        self._next = self._begin = first  # a subclass that uses up some paths moves both

    @property
    def begin(self) -> int:
        """Index of the path of the first unit."""
        return self._begin

    @property
    def step(self) -> float:
        """The step h = horizon/steps."""
        return self.problem.horizon / self.steps

    @property
    def part(self) -> int:
        """Number of units that are computed at a time."""
        return self.problem.chunk

    def sample(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Values (unit,) of the next `count` units, and which of them are ok (unit,)."""
        first, self._next = self._next, self._next + count
        return self._units(first, count)

    def draw_from(self, unit: int, count: int) -> Drawn:
        """Draw `count` units, beginning with the one of this number, counted from 0."""
        self._next = self._begin + unit
        return self.draw(count)

    def draw(self, count: int) -> Drawn:
        """Draw the next `count` units."""
        result = NOTHING
        while count > 0:
            part = min(count, self.part)
            begin = time.process_time()
            values, ok = self.sample(part)
            seconds = time.process_time() - begin
            failed = int((~ok).sum())
            result += Drawn(Tally.of(values[ok]), seconds, failed, part * self.paths_a_unit)
            count -= part
        return result

    def _units(self, first: int, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Values (unit,) of `count` units from the index `first` on, and which of them are ok (unit,)."""
        raise NotImplementedError


class Plain(Estimator):
    """The mean of f over independent paths."""

    name = "plain"

    def _units(self, first: int, count: int) -> tuple[np.ndarray, np.ndarray]:
        return self.problem.values(self.problem.run(self.scheme, self.steps, first_path=first, paths=count))


class Extrapolated(Estimator):
    """The mean of P_h + (P_h - P_2h)/(2^a - 1), P_h being f at step h: it has no term h^a in its bias.

    See Talay and Tubaro 1990, Stoch. Anal. Appl. 8, 483. Both paths follow one Brownian path here, so the difference
    adds little variance.
    """

    name = "extrapolated"
    paths_a_unit = 2

    def __init__(self, problem: Problem, scheme: Scheme, steps: int, first: int, *, order: float):
        """`steps`, an even number, are those of the finer path; a = order is the weak order of the scheme."""
        super().__init__(problem, scheme, steps, first)
        self._share = 1 / (2**order - 1)

    def _units(self, first: int, count: int) -> tuple[np.ndarray, np.ndarray]:
        paths = {"first_path": first, "paths": count}
        fine, coarse, ok = values_of(self.problem, self.scheme, self.steps, paths)
        return fine + self._share * (fine - coarse), ok


class Antithetic(Estimator):
    """The mean of f over pairs of paths; the increments of the second are those of the first with the other sign."""

    name = "antithetic"
    paths_a_unit = 2

    @property
    def part(self) -> int:
        """Number of pairs that are computed at a time; their increments are held in memory."""
        return self.problem.chunk_of(self.steps)

    def _units(self, first: int, count: int) -> tuple[np.ndarray, np.ndarray]:
        dw = self.problem.increments(self.scheme, self.steps, first, count)
        one, ok = self._driven(dw)
        np.negative(dw, out=dw)
        other, also = self._driven(dw)
        return (one + other) / 2, ok & also

    def _driven(self, dw: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Values (path,) of f on the paths that dw (step, noise, path) drives, and which paths are ok (path,)."""
        more = {"increments": dw, "truncation": None}  # they are truncated already
        return self.problem.values(self.problem.run(self.scheme, self.steps, paths=dw.shape[2], **more))
