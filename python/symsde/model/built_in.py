# SPDX-License-Identifier: BSD-3-Clause
"""Formulas of the built-in models, for parameters that differ by path: a built-in model of the library has one
number for all paths.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from ..errors import IncompatibleError

if TYPE_CHECKING:
    from .definition import Model

#: name -> H and the Hamiltonians of its noises
FORMULAS: dict[str, tuple[str, ...]] = {
    "kubo": ("a*(p**2 + q**2)/2", "sigma*(p**2 + q**2)/2"),
    "linear_oscillator": ("(p**2 + q**2)/2", "-sigma*q"),
    "synchrotron": ("p**2/2 - omega**2*cos(q)", "sigma1*sin(q)", "-sigma2*cos(q)"),
    "additive_oscillator": ("(p**2 + q**2)/2", "sigma*p", "-gamma*q"),
    "pendulum": ("p**2/2 - cos(q)", "sigma*(p**2 + q**2)/2"),
    "driven_pendulum": (
        "p**2/2 - omega**2*(1 + epsilon*cos(nu*t))*cos(q)",
        "-sigma1*(1 + alpha*sin(nu*t))*q",
        "-sigma2*(1 + alpha*sin(nu*t))*cos(q)",
    ),
    "noncommutative_oscillator": ("(p**2 + q**2)/2", "s1*p**2/2", "s2*q**2/2"),
    "henon_heiles": ("(p1**2 + p2**2 + q1**2 + q2**2)/2 + alpha*(q1**2*q2 - q2**3/3)", "sigma1*q1", "sigma2*q2"),
}

_MADE: dict[tuple, Model] = {}  #: models made from these formulas, by name and kind of values: others have their code


def is_array(value: Any) -> bool:
    """Whether the value of a parameter is an array with one number for each path."""
    return isinstance(value, list | tuple) or bool(getattr(value, "ndim", 0))


def go_by_path(values: Mapping[str, Any]) -> bool:
    """Whether some values are arrays."""
    return any(map(is_array, values.values()))


def of_formulas(name: str, values: Mapping[str, Any]) -> Model:
    """A model from the formulas of a built-in model, with parameters that differ by path; the chain is refused."""
    from .definition import Model  # noqa: PLC0415 - models from formulas and built-in ones are both models
    from .formulas import model_from_sympy  # noqa: PLC0415
    from .formulas.parameters import kind_of, value_of  # noqa: PLC0415

    if name not in FORMULAS:
        arrays = ", ".join(key for key, x in values.items() if is_array(x))
        raise IncompatibleError(
            f"{arrays} of model {name} cannot differ from path to path: give a number, and a run for each value"
        )
    given = {key: value_of(key, x) for key, x in values.items()}
    kind = name, tuple(given), kind_of(given)
    if kind not in _MADE:
        Model.builtin(name, {key: float(x[0] if is_array(x) else x) for key, x in given.items()})  # refuses other names
        H, *noise = FORMULAS[name]
        first = {key: x[:1] if is_array(x) else x for key, x in given.items()}
        _MADE[kind] = model_from_sympy(H, noise=noise, params=first, name=name)
    return _MADE[kind].with_parameters(**given)
