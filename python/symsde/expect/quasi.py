# SPDX-License-Identifier: BSD-3-Clause
"""Randomised quasi-Monte Carlo: scrambled Sobol points through the Brownian bridge.

The first points of a Sobol sequence are its most even ones: they go to W(T) of every noise, the next to W(T/2), and so
on, each the larger share of what is left of the path. Each unit is the mean over 2^k points with a scrambling of its
own: unbiased, and independent of the others, so that their scatter gives the interval.
"""

from __future__ import annotations

import importlib.util

import numpy as np

from .._files import optional
from ..schemes import Scheme
from .estimators import Estimator
from .problem import Problem

MOST_DIMENSIONS = 21201  #: of SciPy's Sobol points
MOST_POINTS = 30  #: log2 of the points of one scrambling, which are multiples of 2^-30
_HALF = 2.0**-31  #: half of their distance: none is 0 or 1, and their mean is 1/2


class Quasi(Estimator):
    """The mean over randomisations of Sobol's points."""

    name = "quasi-Monte Carlo"
    least_units = 16

    def __init__(self, problem: Problem, scheme: Scheme, steps: int, first: int, *, log2_points: int):
        """Units of 2^log2_points paths."""
        super().__init__(problem, scheme, steps, first)
        self.log2_points = log2_points
        self.paths_a_unit = 2**log2_points
        self._bridge = Bridge(steps, problem.horizon)
        self._qmc = optional("scipy.stats.qmc", "qmc")
        self._special = importlib.import_module("scipy.special")

    @property
    def part(self) -> int:
        """Units that are computed at a time."""
        return 1

    @property
    def dimension(self) -> int:
        """Of the points."""
        return self.steps * self.problem.model.nnoise

    def _units(self, first: int, count: int) -> tuple[np.ndarray, np.ndarray]:
        sobol = self._qmc.Sobol(self.dimension, scramble=True, rng=self._generator(first))
        total, failed = 0.0, False
        left = self.paths_a_unit
        while left:
            part = min(left, self._part_with_increments)
            part = 1 << (part.bit_length() - 1)  # whole blocks of the sequence
            normals = self._special.ndtri(sobol.random(part).T + _HALF)
            dw = self._bridge.increments(normals.reshape(self.steps, -1, part))
            run = self.problem.run(self.scheme, self.steps, increments=dw, paths=part)
            values, ok = self.problem.values(run)
            failed |= not ok.all()
            total += values[ok].sum()
            left -= part
        return np.array([total / self.paths_a_unit]), np.array([not failed])

    def _generator(self, unit: int) -> np.random.Generator:
        """Of the scrambling of a unit."""
        return np.random.default_rng([self.problem.seed, unit])


class Bridge:
    """Increments of a Brownian path from normals, those of the coarsest features first."""

    def __init__(self, steps: int, horizon: float):
        """For so many steps to the horizon."""
        self.steps, self.step = steps, horizon / steps
        self.order: list[tuple[int, int, int]] = []  #: (left, middle, right) of every point but the last
        waiting = [(0, steps)]
        while waiting:
            left, right = waiting.pop(0)
            if right - left > 1:
                middle = (left + right) // 2
                self.order.append((left, middle, right))
                waiting += [(left, middle), (middle, right)]

    def increments(self, normals: np.ndarray) -> np.ndarray:
        """dW (step, noise, path) from normals of the same shape."""
        w = np.zeros((self.steps + 1, *normals.shape[1:]))
        w[-1] = np.sqrt(self.steps * self.step) * normals[0]
        for row, (left, middle, right) in enumerate(self.order, 1):
            before, after = middle - left, right - middle
            share = before / (right - left)
            spread = np.sqrt(before * after / (right - left) * self.step)
            w[middle] = (1 - share) * w[left] + share * w[right] + spread * normals[row]
        return np.diff(w, axis=0)


def applies(problem: Problem, steps: int) -> bool:
    """There is noise that is not truncated, of a dimension that Sobol points have, and SciPy is there."""
    rows = steps * problem.model.nnoise
    if not 0 < rows <= MOST_DIMENSIONS or problem.options.get("truncation") is not None:
        return False
    return importlib.util.find_spec("scipy") is not None
