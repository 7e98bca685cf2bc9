# SPDX-License-Identifier: BSD-3-Clause
"""Ways to sample E f at a step: paths, antithetic pairs, and scrambled Sobol points through the Brownian bridge.

Each estimator draws independent units, whose mean is the value, and measures the seconds of the processor:

    plain         f(x)                               x a path
    antithetic    (f(x) + f(x'))/2                   x' driven by -dW
    quasi         2^-k sum_i f(x_i), or of d_l       x_i from the i-th of 2^k Sobol points, d_l as in `coupled.py`

The first coordinates of Sobol points are the most even ones: they determine W(T) of every noise, the next ones W(T/2),
and so on, in order of their share of the path; dZ and K of the steps come last. All units of an estimator share one
random matrix scrambling, and each has its own digital shift: given the matrices they are unbiased and independent, so
that their scatter gives the interval.
"""

from __future__ import annotations

import functools
import importlib.util
import sys
import time
from dataclasses import dataclass
from types import ModuleType

import numpy as np

from ...native.files import optional
from ...schemes import Scheme
from ..coupled import values_of
from .interval import Tally
from .problem import Problem

MOST_DIMENSIONS = 21201  #: largest dimension of SciPy's Sobol points
MOST_POINTS = 30  #: log2 of the number of points of one scrambling; coordinates are multiples of 2^-30
_TO_LOAD = 0.5  #: seconds to load scipy.stats
_HALF = 0.5  #: points are shifted by half of their spacing: no coordinate is 0 or 1, and the mean is 1/2
_HELD = 2**20  #: most numbers of a sequence that are kept for later units


@dataclass(frozen=True)
class Drawn:
    """Drawn units of an estimator."""

    units: Tally
    seconds: float  #: seconds of processor time
    failed: int  #: number of units left out because one of their paths failed
    paths: int  #: number of computed paths, those of failed units included

    def __add__(self, other: Drawn) -> Drawn:
        """The units of both draws together."""
        return Drawn(
            self.units + other.units,
            self.seconds + other.seconds,
            self.failed + other.failed,
            self.paths + other.paths,
        )


NOTHING = Drawn(Tally(), 0.0, 0, 0)


class Estimator:
    """An estimator by paths of one scheme and step, from the index `first` on; `draw` computes the next units."""

    paths_a_unit = 1
    least_units = 256  #: least number of units of an interval

    def __init__(self, problem: Problem, scheme: Scheme, steps: int, first: int):
        """Take a scheme with `steps` steps to the horizon; nothing is drawn yet. first: index of the first path."""
        self.problem, self.scheme, self.steps = problem, scheme, steps
        self._next = self._begin = first  # a subclass that uses earlier paths changes both

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
        """Draw `count` units from the number `unit` on; the first unit has the number 0."""
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

    def _units(self, first: int, count: int) -> tuple[np.ndarray, np.ndarray]:
        return self.problem.values(self.problem.run(self.scheme, self.steps, first_path=first, paths=count))


class Antithetic(Estimator):
    """The mean of f over pairs of paths; the increments of the second path are those of the first with the opposite
    sign.
    """

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
        more = {"increments": dw, "truncation": None}  # dw is truncated already
        return self.problem.values(self.problem.run(self.scheme, self.steps, paths=dw.shape[2], **more))


class Quasi(Estimator):
    """The mean over randomisations of Sobol points of f, or of its change from step 2h to h."""

    least_units = 16

    def __init__(
        self, problem: Problem, scheme: Scheme, steps: int, first: int, *, log2_points: int, differences: bool = False
    ):
        """A unit has 2^log2_points paths; `differences` selects the change of f."""
        super().__init__(problem, scheme, steps, first)
        self.log2_points, self._differences = log2_points, differences
        self._columns = columns(problem, scheme)
        self._means, self._good = np.zeros(0), np.ones(0, bool)  # results of all units from the first one on
        self._bridge = Bridge(steps, problem.horizon)
        self._points = Points(self.dimension, [problem.seed, first])

    @property
    def paths_a_unit(self) -> int:
        """Number of paths of a unit: one per point, or two if a point needs a fine and a coarse path."""
        return (2 if self._differences else 1) << self.log2_points

    @property
    def part(self) -> int:
        """Number of units that are computed at a time."""
        return max(1, self._at_a_time >> self.log2_points)

    def doubled(self) -> Drawn:
        """Double the points of all units drawn so far: the next points of the same sequences are added."""
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
        """Dimension of the points: steps times noises times numbers per step."""
        return self.steps * self.problem.model.nnoise * self._columns

    @property
    def _at_a_time(self) -> int:
        """Number of paths that are computed at a time, a power of two."""
        most = max(8, self.problem.chunk_of(self.steps) // self._columns)
        return 1 << (most.bit_length() - 1)

    def _units(self, first: int, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Means (unit,) and which units are ok (unit,). They are kept for `doubled` if units are drawn in sequence."""
        both, ok = self.fine_and_difference(first, count)
        means = both[int(self._differences)]
        if first - self._begin == len(self._means):
            self._means, self._good = np.append(self._means, means), np.append(self._good, ok)
        return means, ok

    def fine_and_difference(
        self, first: int, count: int, points: range | None = None
    ) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
        """Means (2, unit) of f and of its change from step 2h, and which units are ok (unit,).

        The change is 0 if it is not wanted. points: a range of the points of a unit, by default all; its start and its
        length are powers of two, or the start is 0.
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
        """Give pairs of values (path,) and ok (path,): of f, and of its change if wanted."""
        driven = {"increments": dw, "paths": dw.shape[2]}
        if not self._differences:
            return [self.problem.values(self.problem.run(self.scheme, self.steps, **driven))]
        fine, coarse, ok = values_of(self.problem, self.scheme, self.steps, driven)
        return [(fine, ok), (fine - coarse, ok)]


class Points:
    """Standard normal numbers from Sobol points with one matrix scrambling, and a digital shift for every unit."""

    def __init__(self, dimension: int, seed: list[int]):
        """Make the sequence of this dimension; the seed determines the scrambling and all shifts."""
        self._dimension, self._seed = dimension, seed
        generator = np.random.default_rng(seed)
        self._sobol = load().Sobol(dimension, rng=generator, bits=MOST_POINTS)
        self._ndtri = importlib.import_module("scipy.special").ndtri
        self._shifts = np.zeros((0, dimension), np.uint32)
        self._held = np.zeros((dimension, 0), np.uint32)
        self._drawn = 0

    def normals(self, unit: int, units: int, start: int, count: int) -> np.ndarray:
        """Normals (dimension, units*count): `count` points from `start` on, of `units` units from `unit` on."""
        shifts = self._shifts_of(unit + units)[unit:].T
        points = self._integers(start, count)
        shifted = points[:, np.newaxis, :] ^ shifts[:, :, np.newaxis]
        return self._ndtri((shifted.reshape(self._dimension, units * count) + _HALF) * 2.0**-MOST_POINTS)

    def _shifts_of(self, units: int) -> np.ndarray:
        """Shifts (unit, dimension) of all units from the first on; they do not depend on the number of units."""
        if units > len(self._shifts):
            generator = np.random.default_rng([*self._seed, 1])
            shape = (max(units, 16), self._dimension)
            self._shifts = generator.integers(0, 2**MOST_POINTS, shape, dtype=np.uint32)
        return self._shifts[:units]

    def _integers(self, start: int, count: int) -> np.ndarray:
        """Points (dimension, count) of the sequence from `start` on, in multiples of 2^-30."""
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
    """The Brownian bridge: increments of a path from normals, the first of which determine its coarsest features."""

    def __init__(self, steps: int, horizon: float):
        """Prepare the halvings of the interval from 0 to the horizon with this many steps."""
        self.steps, self.step = steps, horizon / steps
        #: for each halving: rows of normals; left, middle and right of the points that it adds; weights
        self._halvings = []
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
        """Increments (step, group*noise, path): dW, with two groups also dZ, with three also K.

        normals has the shape (group, step, noise, path). dZ = h (dW/2 + H) with H ~ N(0, h/12), and K ~ N(0, h/720); H
        and K are independent of dW.
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
    """How many numbers drive a noise in a step: 1 for dW, 2 with dZ, 3 with K; 0 if the scheme needs areas or J, or
    if initial states are drawn, since increments that are given drive the same paths again and again."""
    if problem.laws:
        return 0
    info, traits = scheme.info, problem.model.traits
    areas = info.uses_areas and problem.model.nnoise > 1 and not (traits.additive or traits.position_noise)
    constant = traits.additive and problem.model._forces.noise_force is None
    if info.law != "Gaussian" or areas or (info.uses_magnus and not constant):
        return 0
    return 3 if info.uses_stt_area else 2 if info.uses_dz else 1


@functools.cache
def load() -> ModuleType:
    """Load and return scipy.stats.qmc, where the points come from, with its table of direction numbers."""
    found = optional("scipy.stats.qmc", "qmc")
    importlib.import_module("scipy.special")
    found.Sobol(1)
    return found


def seconds_to_load() -> float:
    """Approximate seconds to load SciPy, once per process; 0 if it is loaded."""
    return 0.0 if "scipy.stats.qmc" in sys.modules else _TO_LOAD


def quasi_applies(problem: Problem, scheme: Scheme, steps: int) -> bool:
    """Whether quasi-Monte Carlo applies: noise without truncation, a dimension within Sobol points, and SciPy."""
    rows = steps * problem.model.nnoise * columns(problem, scheme)
    if not 0 < rows <= MOST_DIMENSIONS or problem.options.get("truncation") is not None:
        return False
    return _is_there("scipy")


@functools.cache
def _is_there(package: str) -> bool:
    """Whether the package can be loaded; looked up once, because this takes 50 us."""
    return importlib.util.find_spec(package) is not None
