# SPDX-License-Identifier: BSD-3-Clause
"""Kinetic and configurational temperature of paths, from observables that a run collects."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..errors import IncompatibleError, InvalidArgumentError
from ..model.definition import Model, require_model
from ..show import tables
from .bath_temperature import NAMES, WHERE
from .moments import Moments


@dataclass(frozen=True)
class Temperatures:
    """Two temperatures kT at each saved time; a difference beyond their errors comes from the step, or shows that the
    paths are not in equilibrium yet."""

    t: np.ndarray  #: (time,)
    kinetic: np.ndarray  #: (time,), mean of p . H_p / dof
    se_kinetic: np.ndarray  #: (time,), its standard error
    configurational: np.ndarray  #: (time,), mean of |H_q|^2 over the mean of the trace of H_qq; it contains no momenta
    se_configurational: np.ndarray  #: (time,), at most so large
    momenta: str  #: a sentence on the times of the momenta

    def __str__(self) -> str:
        """A line for each saved time, the latest time last."""
        rows = [["t", "kinetic", "+-", "configurational", "+-"]]
        for values in zip(
            self.t, self.kinetic, self.se_kinetic, self.configurational, self.se_configurational, strict=True
        ):
            t, kinetic, first, configurational, second = values
            rows.append([f"{t:.6g}", f"{kinetic:.6g}", f"{first:.2g}", f"{configurational:.6g}", f"{second:.2g}"])
        return f"{tables.aligned(rows, (12, 12, 10, 17, 10), '')}\n{self.momenta}"


def temperature(model: Model) -> dict[str, Callable[[np.ndarray, np.ndarray], np.ndarray]]:
    """Observables of `symsde.moments` from which `temperatures` finds both temperatures of a model.

    They are kinetic_temperature, p . H_p / dof, force_squared, |H_q|^2 / dof, and stiffness, the trace of H_qq / dof,
    of the Hamiltonian H at t = 0. Each takes (q, p), (dof, path), and returns (path,). Further observables can be
    added: {**ss.observe.temperature(model), "mine": "q_1**2"}.
    """
    require_model(model)
    if model.paths:
        raise IncompatibleError(
            f"parameters of model {model.name} differ from path to path, and its observables are functions of (q, p): "
            "take moments for each value"
        )

    def kinetic(q: np.ndarray, p: np.ndarray) -> np.ndarray:
        return (p * model.gradient(q, p)[1]).mean(axis=0)

    def force_squared(q: np.ndarray, p: np.ndarray) -> np.ndarray:
        return (model.gradient(q, p)[0] ** 2).mean(axis=0)

    def stiffness(q: np.ndarray, p: np.ndarray) -> np.ndarray:
        return np.einsum("iil->l", model.hessian(q, p)[0]) / model.ndof

    found = dict(zip(NAMES, (kinetic, force_squared, stiffness), strict=True))
    for function in found.values():
        function.of_model = model  # sweeps refuse them
    return found


def temperatures(found: Moments) -> Temperatures:
    """Both temperatures at each saved time, of moments that were collected with the observables of `temperature`.

    The configurational temperature is a ratio of two means. Its standard error is bounded by the sum of the standard
    errors of the two means, whatever their correlation. InvalidArgumentError: the observables are missing.
    """
    mean = getattr(found, "mean", None)
    if not isinstance(mean, dict) or any(name not in mean for name in NAMES):
        raise InvalidArgumentError(
            "temperatures are made of the moments of observables=ss.observe.temperature(model), and these have not "
            f"{', '.join(NAMES)}"
        )
    kinetic, force, stiffness = (np.array(mean[name]) for name in NAMES)
    se_kinetic, se_force, se_stiffness = (np.array(found.se_mean[name]) for name in NAMES)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = force / stiffness
        error = (se_force + np.abs(ratio) * se_stiffness) / np.abs(stiffness)
    return Temperatures(
        t=np.array(found.t),
        kinetic=kinetic,
        se_kinetic=se_kinetic,
        configurational=ratio,
        se_configurational=error,
        momenta=WHERE,
    )
