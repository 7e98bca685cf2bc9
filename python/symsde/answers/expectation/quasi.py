# SPDX-License-Identifier: BSD-3-Clause
"""Randomised quasi-Monte Carlo: scrambled Sobol points through the Brownian bridge.

The first points of a Sobol sequence are its most even ones: they go to W(T) of every noise, the next to W(T/2), and so
on, each the larger share of what is left of the path; what a step takes beside its increment (dZ, K) comes last. Each
unit is the mean over 2^k points. All units of an estimator share one random matrix scrambling, and each has a digital
shift of its own: given the matrices they are unbiased and independent, so that their scatter gives the interval.
"""

from __future__ import annotations

import functools
import importlib.util
import sys
import time
from types import ModuleType

import numpy as np

from ...native.files import optional
from ...schemes import Scheme
from ..coupled import values_of
from .estimators import Drawn, Estimator
from .problem import Problem
from .tally import Tally

MOST_DIMENSIONS = 21201  #: of SciPy's Sobol points
MOST_POINTS = 30  #: log2 of the points of one scrambling, which are multiples of 2^-30
_TO_LOAD = 0.5  #: seconds of scipy.stats
_HALF = 0.5  #: of their distance: none is 0 or 1, and their mean is 1/2
_HELD = 2**20  #: numbers of a sequence that are kept for the next units


class Quasi(Estimator):
    """The mean over randomisations of Sobol's points: of f, or of its change from twice the step to the step."""

    name = "quasi-Monte Carlo"
    least_units = 16

    def __init__(
        self, problem: Problem, scheme: Scheme, steps: int, first: int, *, log2_points: int, differences: bool = False
    ):
        """Units of 2^log2_points paths."""
        super().__init__(problem, scheme, steps, first)
        self.log2_points, self._differences = log2_points, differences
        self._columns = columns(problem, scheme)
        self._means, self._good = np.zeros(0), np.ones(0, bool)  # of the units drawn in turn from the first one on
        self._bridge = Bridge(steps, problem.horizon)
        self._points = Points(self.dimension, [problem.seed, first])

    @property
    def paths_a_unit(self) -> int:
        """Fine and coarse ones."""
        return (2 if self._differences else 1) << self.log2_points

    @property
    def part(self) -> int:
        """Units that are computed at a time."""
        return max(1, self._at_a_time >> self.log2_points)

    def doubled(self) -> Drawn:
        """All units drawn so far with twice the points: those that they have, and as many more of their sequences."""
        begin, count = time.process_time(), len(self._means)
        points = range(1 << self.log2_points, 2 << self.log2_points)
        means, good = self._means.copy(), self._good.copy()
        for first in range(0, count, self.part):
            units = slice(first, min(first + self.part, count))
            both, ok = self.fine_and_difference(self._begin + first, units.stop - first, points)
            means[units] = (means[units] + both[int(self._differences)]) / 2
            good[units] &= ok
        self._means, self._good = means, good
        self.log2_points += 1
        seconds = time.process_time() - begin
        return Drawn(Tally.of(means[good]), seconds, int((~good).sum()), count * self.paths_a_unit)

    @property
    def dimension(self) -> int:
        """Of the points."""
        return self.steps * self.problem.model.nnoise * self._columns

    @property
    def _at_a_time(self) -> int:
        """Paths, whole blocks of the sequence."""
        most = max(8, self.problem.chunk_of(self.steps) // self._columns)
        return 1 << (most.bit_length() - 1)

    def _units(self, first: int, count: int) -> tuple[np.ndarray, np.ndarray]:
        both, ok = self.fine_and_difference(first, count)
        means = both[int(self._differences)]
        if first - self._begin == len(self._means):
            self._means, self._good = np.append(self._means, means), np.append(self._good, ok)
        return means, ok

    def fine_and_difference(
        self, first: int, count: int, points: range | None = None
    ) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
        """Means of f and of its change from twice the step, (2, unit); the latter 0 where it is not wanted.

        Over so many of the points, all of a unit where none are given: powers of two.
        """
        begin = first - self._begin
        total, ok = np.zeros((2, count)), np.ones(count, bool)
        points = range(1 << self.log2_points) if points is None else points
        part = min(len(points), self._at_a_time)
        for start in points[::part]:
            normals = self._points.normals(begin, count, start, part)
            dw = self._bridge.increments(normals.reshape(self._columns, self.steps, -1, count * part))
            for i, (values, good) in enumerate(self._values(dw)):
                total[i] += np.where(good, values, 0.0).reshape(count, part).sum(axis=1)
                ok &= good.reshape(count, part).all(axis=1)
        return total / len(points), ok

    def _values(self, dw: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """f, and where it is wanted its change, with the paths that are ok."""
        driven = {"increments": dw, "paths": dw.shape[2]}
        if not self._differences:
            return [self.problem.values(self.problem.run(self.scheme, self.steps, **driven))]
        fine, coarse, ok = values_of(self.problem, self.scheme, self.steps, driven)
        return [(fine, ok), (fine - coarse, ok)]


class Points:
    """Normals from Sobol's points by one matrix scrambling, and a shift for every unit."""

    def __init__(self, dimension: int, seed: list[int]):
        """Of a dimension; the seed tells the scrambling and all shifts."""
        self._dimension, self._seed = dimension, seed
        generator = np.random.default_rng(seed)
        self._sobol = load().Sobol(dimension, rng=generator, bits=MOST_POINTS)
        self._ndtri = importlib.import_module("scipy.special").ndtri
        self._shifts = np.zeros((0, dimension), np.uint32)
        self._held = np.zeros((dimension, 0), np.uint32)
        self._drawn = 0

    def normals(self, unit: int, units: int, start: int, count: int) -> np.ndarray:
        """(dimension, units*count): of so many units the points from `start` on."""
        shifts = self._shifts_of(unit + units)[unit:].T
        points = self._integers(start, count)
        shifted = points[:, np.newaxis, :] ^ shifts[:, :, np.newaxis]
        return self._ndtri((shifted.reshape(self._dimension, units * count) + _HALF) * 2.0**-MOST_POINTS)

    def _shifts_of(self, units: int) -> np.ndarray:
        """(unit, dimension), of all units from the first one; the same whatever their number."""
        if units > len(self._shifts):
            generator = np.random.default_rng([*self._seed, 1])
            shape = (max(units, 16), self._dimension)
            self._shifts = generator.integers(0, 2**MOST_POINTS, shape, dtype=np.uint32)
        return self._shifts[:units]

    def _integers(self, start: int, count: int) -> np.ndarray:
        """(dimension, count) of the sequence, as multiples of 2^-30."""
        if start + count <= self._held.shape[1]:
            return self._held[:, start : start + count]
        if start != self._drawn:
            self._sobol.reset()
            if start:
                self._sobol.fast_forward(start)
        found = np.ascontiguousarray((self._sobol.random(count).T * 2.0**MOST_POINTS).astype(np.uint32))
        self._drawn = start + count
        if start == 0 and found.size <= _HELD:
            self._held = found
        return found


class Bridge:
    """Increments of a Brownian path from normals, those of the coarsest features first."""

    def __init__(self, steps: int, horizon: float):
        """For so many steps to the horizon."""
        self.steps, self.step = steps, horizon / steps
        self._halvings = []  #: rows of normals, left, middle and right of the points that one halving adds, and weights
        row, waiting = 1, [(0, steps)]
        while waiting := [(a, b) for a, b in waiting if b - a > 1]:
            left, right = np.array(waiting).T
            middle = (left + right) // 2
            share = ((middle - left) / (right - left))[:, np.newaxis, np.newaxis]
            spread = np.sqrt((middle - left) * (right - middle) / (right - left) * self.step)[:, np.newaxis, np.newaxis]
            self._halvings.append((slice(row, row + len(middle)), left, middle, right, share, spread))
            row += len(middle)
            ends = zip(left, middle, right, strict=True)
            waiting = [half for a, m, b in ends for half in ((a, m), (m, b))]

    def increments(self, normals: np.ndarray) -> np.ndarray:
        """dW, and where there are two or three groups of normals dZ and K beside it: (step, group*noise, path).

        normals: (group, step, noise, path). dZ = h (dW/2 + H), H ~ N(0, h/12); K ~ N(0, h/720): independent of dW.
        """
        w = np.zeros((self.steps + 1, *normals.shape[2:]))
        w[-1] = np.sqrt(self.steps * self.step) * normals[0, 0]
        for rows, left, middle, right, share, spread in self._halvings:
            w[middle] = (1 - share) * w[left] + share * w[right] + spread * normals[0, rows]
        found = [np.diff(w, axis=0)]
        if len(normals) > 1:
            found.append(self.step * (0.5 * found[0] + np.sqrt(self.step / 12) * normals[1]))
        if len(normals) > 2:
            found.append(np.sqrt(self.step / 720) * normals[2])
        return found[0] if len(found) == 1 else np.concatenate(found, axis=1)


def columns(problem: Problem, scheme: Scheme) -> int:
    """Numbers that drive a noise in a step: 1 where it is dW, 2 with dZ, 3 with K; 0 where areas or J are needed."""
    info, traits = scheme.info, problem.model.traits
    areas = info.uses_areas and problem.model.nnoise > 1 and not (traits.additive or traits.position_noise)
    if info.law != "Gaussian" or areas or (info.uses_magnus and not traits.additive):
        return 0
    return 3 if info.uses_stt_area else 2 if info.uses_dz else 1


def load() -> ModuleType:
    """Where the points come from."""
    return optional("scipy.stats.qmc", "qmc")


def seconds_to_load() -> float:
    """That SciPy takes once a process, about; 0 where it is there already."""
    return 0.0 if "scipy.stats.qmc" in sys.modules else _TO_LOAD


def applies(problem: Problem, scheme: Scheme, steps: int) -> bool:
    """There is noise that is not truncated, of a dimension that Sobol points have, and SciPy is there."""
    rows = steps * problem.model.nnoise * columns(problem, scheme)
    if not 0 < rows <= MOST_DIMENSIONS or problem.options.get("truncation") is not None:
        return False
    return _is_there("scipy")


@functools.cache
def _is_there(package: str) -> bool:
    """It can be loaded; looked for once, as that takes 50 us."""
    return importlib.util.find_spec(package) is not None
