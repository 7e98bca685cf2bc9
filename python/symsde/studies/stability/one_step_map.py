# SPDX-License-Identifier: BSD-3-Clause
"""Fixed points and cycles of the map of a step without noise, and whether they are stable, by the library itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import symsde as ss

from ...errors import IncompatibleError, InvalidArgumentError
from ...model.definition import Model
from ...native import checks
from ...schemes import Scheme, as_scheme
from .scenario import quiet

CLOSED = 1e-9  #: largest distance of a closed cycle's ends, over the size of the box
SAME = 1e-5  #: largest distance of two points that count as one, over the size of the box
MARGIN = 1e-4  #: margin of |multiplier|: at parabolic points it is 1 up to the root of rounding
_SHIFT = 1e-5  #: shift of the difference quotients, over the size of the box
_NEWTON = 30  #: most iterations
_LINE, _GRID = 401, (17, 11)  #: numbers of starts along p = 0, and in the box
_LONGEST = 16


@dataclass(frozen=True)
class FixedPoint:
    """A point that returns after `period` steps, and not earlier."""

    q: float
    p: float
    period: int
    multipliers: tuple[complex, complex]  #: eigenvalues of the Jacobian matrix of `period` steps
    spurious: bool  #: whether the equation does not rest at this point

    @property
    def stable(self) -> bool:
        """Whether no multiplier is outside the unit circle."""
        return max(abs(m) for m in self.multipliers) <= 1 + MARGIN


def fixed_points(
    model: Model, scheme: str | Scheme = "midpoint", *, step: float, period: int = 1, box: tuple[float, float] = (4, 4)
) -> list[FixedPoint]:
    """Points that `period` steps without noise map to themselves, with |q| <= box[0], |p| <= box[1], by rising q, p.

    The model must have one degree of freedom and no noise, or noise of strength zero. It must not depend on time, since
    all steps are taken from t = 0. Newton's iteration starts at points of the axis p = 0 and of a grid; a point that it
    reaches from none of these is not found. All points of a cycle are returned. Everything is dimensionless.
    """
    if not isinstance(model, Model):
        raise ss.errors.WrongTypeError(f"model = {checks.shown(model)} is no model: give one of ss.models")
    if model.ndof != 1 or len(model.traits.silent) < model.nnoise:
        raise IncompatibleError(
            f"model {model.name} has {model.ndof} degrees of freedom and {model.nnoise} noises: give one with one "
            "degree of freedom, and noise of strength zero or none"
        )
    step = checks.finite("step", step)
    if step == 0:
        raise InvalidArgumentError("step = 0 leaves every point where it is: give a step that is not zero")
    if isinstance(period, bool) or not isinstance(period, int) or not 1 <= period <= _LONGEST:
        raise InvalidArgumentError(f"period = {checks.shown(period)}: give an integer from 1 to {_LONGEST}")
    if np.shape(box) != (2,) or not all(isinstance(x, int | float) and 0 < x < np.inf for x in box):
        raise InvalidArgumentError(f"box = {checks.shown(box)}: give two positive numbers, those of |q| and |p|")
    turn = _Map(model, as_scheme(scheme), step, period, float(max(box)))
    found = []
    for z in turn.closed(_starts(box), box):
        if not _returns_sooner(turn, z):
            found.append(_told(turn, z))
    return sorted(found, key=lambda one: (round(one.q, 6), one.p))


_step = quiet(ss.step)


class _Map:
    """`period` steps of points (2, n), with their Jacobian matrix by central differences."""

    def __init__(self, model: Model, scheme: Scheme, step: float, period: int, size: float):
        self.model, self.scheme, self.step, self.period, self.size = model, scheme, step, period, size

    def __call__(self, z: np.ndarray, steps: int) -> np.ndarray:
        """Take steps; points whose steps fail are NaN from there on."""
        for _ in range(steps):
            going = np.isfinite(z).all(axis=0)
            with np.errstate(all="ignore"):
                z = np.concatenate(_step(self.model, self.scheme, *np.where(going, z, 0.0)[:, None], self.step))
            z[:, ~going] = np.nan
        return z

    def jacobian(self, z: np.ndarray) -> np.ndarray:
        """The Jacobian matrices (2, 2, n) at the points."""
        shift = _SHIFT * self.size
        sides = [np.array([[a], [b]]) * shift for a, b in ((1, 0), (-1, 0), (0, 1), (0, -1))]
        ends = self(np.concatenate([z + side for side in sides], axis=1), self.period).reshape(2, 4, -1)
        return np.stack([ends[:, 0] - ends[:, 1], ends[:, 2] - ends[:, 3]], axis=1) / (2 * shift)

    def closed(self, z: np.ndarray, box: tuple[float, float]) -> list[np.ndarray]:
        """The distinct points in the box at which Newton's iteration ends."""
        for _ in range(_NEWTON):
            gap = self(z, self.period) - z
            matrix = self.jacobian(z) - np.eye(2)[:, :, None]
            with np.errstate(all="ignore"):
                determinant = matrix[0, 0] * matrix[1, 1] - matrix[0, 1] * matrix[1, 0]
                moved = np.stack([matrix[1, 1] * gap[0] - matrix[0, 1] * gap[1],
                                  matrix[0, 0] * gap[1] - matrix[1, 0] * gap[0]]) / determinant  # fmt: skip
                z = z - moved
                inside = (np.abs(z) <= 4 * self.size).all(axis=0)  # NaN is outside
            z = z[:, inside]
            if not z.size:
                return []
        gap = np.abs(self(z, self.period) - z).max(axis=0)
        inside = (np.abs(z) <= np.array(box)[:, None]).all(axis=0)
        points: list[np.ndarray] = []
        for point in z[:, (gap <= CLOSED * self.size) & inside].T:
            if all(np.abs(point - other).max() > SAME * self.size for other in points):
                points.append(point)
        return points


def _starts(box: tuple[float, float]) -> np.ndarray:
    """Starting points, arranged without symmetry, so that no start is a point of symmetry."""
    line = np.stack([np.linspace(-box[0], 1.01 * box[0], _LINE), np.full(_LINE, 1e-3 * box[1])])
    q, p = np.meshgrid(np.linspace(-0.98 * box[0], box[0], _GRID[0]), np.linspace(-0.97 * box[1], box[1], _GRID[1]))
    return np.concatenate([line, [q.ravel(), p.ravel()]], axis=1)


def _returns_sooner(turn: _Map, z: np.ndarray) -> bool:
    """Which points return after fewer steps, by a divisor of the period."""
    near = 10 * SAME * turn.size
    return any(
        np.abs(turn(z[:, None], steps)[:, 0] - z).max() <= near
        for steps in range(1, turn.period)
        if turn.period % steps == 0
    )


def _told(turn: _Map, z: np.ndarray) -> FixedPoint:
    multipliers = np.linalg.eigvals(turn.jacobian(z[:, None])[:, :, 0])
    at_rest = np.abs(turn.model.gradient(z[:1], z[1:], np.eye(turn.model.nnoise + 1)[0])).max()
    spurious = turn.period > 1 or at_rest > 100 * SAME * turn.size
    return FixedPoint(float(z[0]), float(z[1]), turn.period, tuple(complex(m) for m in multipliers), bool(spurious))
