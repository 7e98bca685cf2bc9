# SPDX-License-Identifier: BSD-3-Clause
"""A control variate from the linear response of the final state to the noise.

z(T) = z_0(T) + Z + .., Z = sum_j G_j dW_j, where z_0 is the path without noise and G_j the derivative of its end by the
increments of step j: what is left of the model where H is replaced by its quadratic part along that path, and every
H_k by its linear part. Z is a Gaussian vector whose covariance h sum_j G_j G_j^T is known exactly, whatever the scheme,
so that Z_i and Z_i Z_j - C_ij have mean zero exactly. f minus its regression on them has the same mean as f, and the
less variance the nearer the paths stay to the linear response.
"""

from __future__ import annotations

import itertools
import math

import numpy as np

from ...schemes import Scheme
from ..coupled import values_of
from . import quasi
from .estimators import Estimator
from .longest_step import fewest_steps
from .problem import Problem

MOST_ROWS = 2048  #: increments of a path, up to which Z is summed
RESPONSES = 64  #: steps with a response of their own; those of finer steps are read off between them
_FINER = 8  #: of the fewest steps of the motion, that these are at least
_CONTROLS = 4.0  #: root of the number of controls, which are 5 or 14
_FULL = 2  #: degrees of freedom up to which every pair of components is a control
_BUMP = 1e-4  #: increment, in sqrt(h), by which derivatives are taken
_BY_INCREMENTS = {"truncation": None, "areas": "path", "area_time": None}  #: options of runs that take these alone
FIT = 256  #: paths that the regression is fitted on at least, none of which count
MOST_FIT = 2048


class Control(Estimator):
    """The mean over independent paths of f minus its regression on the linear response Z."""

    name = "control variate"

    def __init__(
        self, problem: Problem, scheme: Scheme, steps: int, first: int, *, fit: int = FIT, differences: bool = False
    ):
        """Compute the responses, and fit the regression on `fit` paths that are not used otherwise.

        differences: a unit is the change of f from step 2h to h, not f itself.
        """
        super().__init__(problem, scheme, steps, first)
        self._fit_on, self._differences = fit, differences
        self._response = self._differing() if differences else _directions(problem, responses(problem, steps))
        step = problem.horizon / steps
        self._covariance = step * self._response @ self._response.T
        self._pairs = list(itertools.combinations_with_replacement(range(len(self._response)), 2))
        self.coefficients = self._fit()
        self._begin = self._next

    def _differing(self) -> np.ndarray:
        """Responses (direction, step*noise) at step h, and those at 2h minus these.

        They are those of the scheme, or of midpoint if the scheme takes more than increments.
        """
        problem, noises = self.problem, self.problem.model.nnoise
        by = self.scheme if quasi.columns(problem, self.scheme) == 1 else "midpoint"
        fine, coarse = (_responses(problem, steps, by) for steps in (self.steps, self.steps // 2))
        twice = np.repeat(coarse.reshape(len(coarse), -1, noises), 2, axis=1).reshape(fine.shape)
        return np.concatenate([_directions(problem, x) for x in (fine, twice - fine)])

    @property
    def part(self) -> int:
        """Number of paths that are computed at a time; their increments are held in memory."""
        return self.problem.chunk_of(self.steps)

    def _units(self, first: int, count: int) -> tuple[np.ndarray, np.ndarray]:
        values, ok = self._values(first, count)
        return values - self.coefficients @ self._controls(first, count), ok

    def _values(self, first: int, count: int) -> tuple[np.ndarray, np.ndarray]:
        """f or its change (path,) without the controls, and which paths are ok (path,)."""
        paths = {"first_path": first, "paths": count}
        if not self._differences:
            return self.problem.values(self.problem.run(self.scheme, self.steps, **paths))
        fine, coarse, ok = values_of(self.problem, self.scheme, self.steps, paths)
        return fine - coarse, ok

    def _controls(self, first: int, count: int) -> np.ndarray:
        """Controls (control, path): Z_i and Z_i Z_j - C_ij, each divided by its size; their means are 0."""
        dw = self.problem.increments(self.scheme, self.steps, first, count)
        z = self._response @ dw.reshape(-1, count)
        c = self._covariance
        rows = [z[i] / np.sqrt(c[i, i]) for i in range(len(z))]
        rows += [(z[i] * z[j] - c[i, j]) / np.sqrt(c[i, i] * c[j, j]) for i, j in self._pairs]
        return np.array(rows).reshape(len(rows), count)

    def _fit(self) -> np.ndarray:
        """Coefficients (control,) of the regression of f on the controls, by least squares."""
        parts = []
        for _ in range(0, self._fit_on, min(self.part, self._fit_on)):
            count = min(self.part, self._fit_on)
            values, ok = self._values(self._next, count)
            parts.append((values[ok], self._controls(self._next, count)[:, ok]))
            self._next += count
        values = np.concatenate([part[0] for part in parts])
        controls = np.concatenate([part[1] for part in parts], axis=1)
        design = np.vstack([np.ones(values.size), controls]).T
        return np.linalg.lstsq(design, values, rcond=1e-10)[0][1:]


def fit_for(units: float) -> int:
    """Number of paths on which the regression for so many units is fitted.

    A fit on n paths increases the variance of the units by a fraction of about the number of controls over n.
    """
    return int(min(max(_CONTROLS * math.sqrt(units), FIT), MOST_FIT))


def applies(problem: Problem, steps: int) -> bool:
    """Whether there is noise, its increments are Gaussian, and they are not too many for a control variate."""
    rows = steps * problem.model.nnoise
    return 0 < rows <= MOST_ROWS and problem.options.get("truncation") is None


def responses(problem: Problem, steps: int) -> np.ndarray:
    """Derivatives G (2 dof, step*noise) of the final state by every increment.

    They change smoothly along the way. If there are many steps, G is therefore computed for fewer, and interpolated
    by a polynomial of third degree through the four nearest. Any G gives a Z with a known covariance, so an error of G
    adds no bias; a better G leaves less variance.
    """
    coarse = max(RESPONSES, _FINER * fewest_steps(problem))
    if steps <= coarse:
        return _responses(problem, steps)
    known = _responses(problem, coarse).reshape(-1, coarse, problem.model.nnoise)
    place = (np.arange(steps) + 0.5) * coarse / steps - 0.5  # middles of steps, counted in those of the coarse ones
    nearest = np.clip(np.floor(place).astype(int) - 1, 0, coarse - 4)
    found = np.zeros((known.shape[0], steps, problem.model.nnoise))
    for i in range(4):
        others = [j for j in range(4) if j != i]
        weight = np.prod([(place - nearest - j) / (i - j) for j in others], axis=0)
        found += weight[:, np.newaxis] * known[:, nearest + i]
    return found.reshape(known.shape[0], -1)


def _responses(problem: Problem, steps: int, scheme: str | Scheme = "midpoint") -> np.ndarray:
    """The same derivatives for every step, by central differences of runs of this scheme."""
    rows, noises = steps * problem.model.nnoise, problem.model.nnoise
    bump = _BUMP * np.sqrt(problem.horizon / steps)
    ends = []
    for sign in (1, -1):
        dw = np.zeros((rows, rows))
        np.fill_diagonal(dw, sign * bump)
        dw = dw.reshape(steps, noises, rows)
        run = problem.run(scheme, steps, increments=dw, paths=rows, **_BY_INCREMENTS)
        ends.append(np.concatenate([run.q[-1], run.p[-1]]))
    return (ends[0] - ends[1]) / (2 * bump)


def _directions(problem: Problem, response: np.ndarray) -> np.ndarray:
    """Rows (direction, step*noise) of the response: all components of the state if these are few, else f alone.

    Rows that noise does not reach are left out.
    """
    if problem.model.ndof > _FULL:
        response = _slope(problem) @ response
    size = np.linalg.norm(response, axis=1)
    return response[size > 1e-12 * max(size.max(), 1e-300)]


def _slope(problem: Problem) -> np.ndarray:
    """The gradient of f at the end of the path without noise, (1, 2 dof), by central differences."""
    model = problem.model
    run = problem.run("midpoint", 64, increments=np.zeros((64, model.nnoise)), paths=1, **_BY_INCREMENTS)
    z = np.concatenate([run.q[-1], run.p[-1]])
    bump = 1e-6 * (1 + np.abs(z).max())
    moved = z + bump * np.concatenate([np.eye(len(z)), -np.eye(len(z))], axis=1)
    with np.errstate(all="ignore"):
        values = problem.target(moved[: model.ndof], moved[model.ndof :])
    slope = (values[: len(z)] - values[len(z) :]) / (2 * bump)
    return np.where(np.isfinite(slope), slope, 0.0)[np.newaxis]
