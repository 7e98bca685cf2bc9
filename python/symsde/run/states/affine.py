# SPDX-License-Identifier: BSD-3-Clause
"""Normal and uniform initial states."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...errors import InvalidArgumentError, WrongShapeError, WrongTypeError
from ...model.definition import Model
from ...native import checks
from .law import NORMAL, TOLERANCE, UNIFORM, States, drawn, of_both, root_of


class Normal(States):
    """Normal states; see `normal`."""

    def __init__(self, mean: Any, sd: Any, cov: Any, seed: int | None):
        """Check what does not depend on the model."""
        super().__init__(seed)
        if (sd is None) == (cov is None):
            raise WrongTypeError("states.normal takes sd, standard deviations, or cov, a covariance matrix: give one")
        self._mean = _finite("mean", mean)
        self._sd = None if sd is None else _finite("sd", sd)
        self._cov = None if cov is None else _finite("cov", cov)
        if self._sd is not None and (self._sd < 0).any():
            raise InvalidArgumentError("sd holds a negative number: give standard deviations, zero or above")
        if self._cov is not None:
            if self._cov.ndim != 2 or self._cov.shape[0] != self._cov.shape[1]:
                raise WrongShapeError(
                    f"cov has shape {self._cov.shape}: give (dof, dof), or (2 dof, 2 dof) for q and p"
                )
            scale = np.sqrt(np.abs(np.diag(self._cov)))
            if (np.abs(self._cov - self._cov.T) > TOLERANCE * np.outer(scale, scale)).any():
                raise InvalidArgumentError(
                    "the covariance of initial states is not symmetric: give cov with cov[i, j] = cov[j, i]"
                )
            root_of(self._cov)

    def told(self) -> dict[str, Any]:
        """See `States`."""
        return self._told("normal", mean=self._mean, sd=self._sd, cov=self._cov)

    def one(self) -> tuple[float, float]:
        """Mean and standard deviation of a law of one number."""
        if self._cov is not None or self._mean.ndim or self._sd.ndim:
            raise WrongTypeError(
                "a variable of states.formula is one number: give states.normal(mean, sd) with numbers"
            )
        return float(self._mean), float(self._sd)

    def _draw(self, model: Model, t: float, seed: int, where: tuple[int, int], letters: str) -> tuple:
        n = model.ndof
        centre = of_both("mean", self._mean, n)
        if self._sd is not None:
            return drawn(NORMAL, seed, where, centre, of_both("sd", self._sd, n)[:, np.newaxis])
        size = len(self._cov)
        if size not in (n, 2 * n):
            raise WrongShapeError(
                f"cov of initial states has shape {self._cov.shape}: give ({n}, {n}) for q0 or p0, or "
                f"({2 * n}, {2 * n}) for q_1 .. and then p_1 .. of both"
            )
        factor = np.kron(np.eye(2 * n // size), root_of(self._cov))
        return drawn(NORMAL, seed, where, centre, factor)


class Uniform(States):
    """Uniform states; see `uniform`."""

    def __init__(self, low: Any, high: Any, seed: int | None):
        """Check what does not depend on the model."""
        super().__init__(seed)
        self._low, self._high = _finite("low", low), _finite("high", high)
        if self._low.ndim and self._high.ndim and self._low.shape != self._high.shape:
            raise WrongShapeError(f"low has shape {self._low.shape} and high {self._high.shape}: give the same")
        if (self._low > self._high).any():
            raise InvalidArgumentError("low is above high: give the lower end first")

    def told(self) -> dict[str, Any]:
        """See `States`."""
        return self._told("uniform", low=self._low, high=self._high)

    def one(self) -> tuple[float, float]:
        """Centre and half width of a law of one number."""
        if self._low.ndim or self._high.ndim:
            raise WrongTypeError(
                "a variable of states.formula is one number: give states.uniform(low, high) with numbers"
            )
        return float(self._low / 2 + self._high / 2), float(self._high / 2 - self._low / 2)

    def _draw(self, model: Model, t: float, seed: int, where: tuple[int, int], letters: str) -> tuple:
        low, high = (of_both(name, x, model.ndof) for name, x in (("low", self._low), ("high", self._high)))
        return drawn(UNIFORM, seed, where, low / 2 + high / 2, (high / 2 - low / 2)[:, np.newaxis])


def _finite(name: str, value: Any) -> np.ndarray:
    array = np.array(checks.real_array(name, value))
    if not np.isfinite(array).all():
        raise InvalidArgumentError(f"{name} of initial states is not finite: give finite numbers")
    return array


def normal(mean: Any = 0.0, sd: Any = None, *, cov: Any = None, seed: int | None = None) -> Normal:
    """Normal initial states with a mean and either standard deviations or a covariance matrix.

        law = ss.states.normal(0.0, 0.1)
        ss.simulate(model, q0=law, p0=0.0, step=0.05, steps=200, paths=1000)     # q drawn, p at rest
        both = ss.states.normal(cov=[[0.01, -0.005], [-0.005, 0.01]])
        ss.simulate(model, q0=both, p0=both, step=0.05, steps=200, paths=1000)   # drawn together

    - mean, sd: a number, or (dof,) for q0 or p0; (2 dof,) for q_1 .. and then p_1 ..
    - cov: (dof, dof) for q0 or p0; (2 dof, 2 dof) for both
    - seed: 0 .. 2^64 - 1, by default the run's

    With numbers and (dof,) the same law as q0 and p0 draws both independently. WrongShapeError,
    InvalidArgumentError: shapes that do not fit the model, a covariance that is not symmetric or has a negative
    eigenvalue.
    """
    return Normal(mean, sd, cov, seed)


def uniform(low: Any, high: Any, *, seed: int | None = None) -> Uniform:
    """Independent uniform initial states between low and high: a number, (dof,), or (2 dof,) as of `normal`.

    seed: 0 .. 2^64 - 1, by default the run's.
    """
    return Uniform(low, high, seed)
