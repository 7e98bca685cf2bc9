# SPDX-License-Identifier: BSD-3-Clause
"""The temperatures of a model in a heat bath that reports of runs tell: kinetic and configurational, both."""

from __future__ import annotations

import math

import numpy as np

from ..model.definition import Model

#: observables of which both temperatures are made (run/temperature.py)
NAMES = ("kinetic_temperature", "force_squared", "stiffness")
WHERE = "positions and momenta stand at the same times, the ends of whole steps"
_NUMBERS = 2**24  #: most numbers of Hessians for the temperatures of a report; further paths are left out


def of_states(model: Model, q: np.ndarray, p: np.ndarray, t: float) -> str:
    """Both temperatures kT of states (dof, path) at the time t, in words; "" without a bath.

    The kinetic one is the mean of p . H_p / dof, the configurational one the mean of |H_q|^2 over that of the trace of
    H_qq, with standard errors over the paths.
    """
    if not model._bath or model.paths:  # of parameters by path a state alone does not know its path
        return ""
    finite = np.isfinite(q).all(axis=0) & np.isfinite(p).all(axis=0)
    most = max(1, _NUMBERS // (3 * model.ndof**2))
    q, p = q[:, finite][:, :most], p[:, finite][:, :most]
    if not q.shape[1]:
        return ""
    try:
        hq, hp = model.gradient(q, p, t=t)
        stiffness = np.einsum("iil->l", model.hessian(q, p, t=t)[0]) / model.ndof
    except Exception as error:  # functions of a model may raise anything, and a report does not fail by them
        return f"not known: at the last states {error}"
    kinetic, force = (p * hp).mean(axis=0), (hq**2).mean(axis=0)
    ratio = force.mean() / stiffness.mean() if stiffness.mean() else math.nan
    spread = force - ratio * stiffness
    found = (
        ("kinetic", kinetic.mean(), _error(kinetic)),
        ("configurational", ratio, _error(spread) / abs(stiffness.mean()) if stiffness.mean() else math.nan),
    )
    return _sentence(model, found, f"at t = {t:.6g} over {q.shape[1]} of {finite.size} paths")


def of_moments(model: Model, kinetic: tuple[float, float], configurational: tuple[float, float], t: float) -> str:
    """The same of values with their errors that moments hold; NaN where they hold none."""
    found = (("kinetic", *kinetic), ("configurational", *configurational))
    known = [x for x in found if not math.isnan(x[1])]
    if not known:
        return "not collected: give observables=ss.observe.temperature(model)"
    more = "" if len(known) == 2 else "; observables=ss.observe.temperature(model) collects both"
    return _sentence(model, known, f"at t = {t:.6g}{more}")


def _sentence(model: Model, found: object, where: str) -> str:
    """Values with errors beside that of the bath."""
    told = ", ".join(f"{name} {value:.4g}" + ("" if math.isnan(e) else f" +- {e:.2g}") for name, value, e in found)
    ends = sorted({1 / beta for beta in (model._bath[0], *model._bath)})
    bath = f"{ends[0]:.4g}" if len(ends) == 1 else f"{ends[0]:.4g} to {ends[-1]:.4g}"
    return f"{told}, of the bath kT = {bath}, {where}; {WHERE}"


def _error(values: np.ndarray) -> float:
    """Standard error of a mean; NaN of one value."""
    return float(values.std(ddof=1) / np.sqrt(values.size)) if values.size > 1 else math.nan
