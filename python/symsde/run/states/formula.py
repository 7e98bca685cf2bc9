# SPDX-License-Identifier: BSD-3-Clause
"""Initial states from formulas of variables that are drawn."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from ...errors import InvalidArgumentError, WrongShapeError, WrongTypeError
from ...model.definition import Model
from ...model.formulas.formula_observables import FormulaObservables
from ...model.formulas.parse import is_name, names_in
from ...native import checks
from .affine import Normal, Uniform
from .law import NORMAL, UNIFORM, States, drawn

_STREAM = 1  #: of the numbers of variables; states have stream 0
_MOST = 1024  #: variables


class Formula(States):
    """Formulas of variables; see `formula`."""

    def __init__(self, variables: Mapping[str, Any], q: Any, p: Any, seed: int | None):
        """Read the formulas; they are compiled when states are drawn first."""
        super().__init__(seed)
        self._variables = {name: _variable(name, x) for name, x in checks.table("variables", variables).items()}
        if not 1 <= len(self._variables) <= _MOST:
            raise InvalidArgumentError(
                f"variables of states.formula: give 1 to {_MOST}, as {{'a': states.uniform(0, 1)}}"
            )
        self._rows = {letter: _texts(letter, x) for letter, x in (("q", q), ("p", p)) if x is not None}
        if not self._rows:
            raise WrongTypeError("states.formula takes q, p or both: a formula, or a list with one for each dof")
        for row in self._rows.values():
            for text in row:
                for name in names_in(text):
                    if re.fullmatch(r"[qp](_?\d+)?", name) and name not in self._variables:
                        raise InvalidArgumentError(
                            f"{text!r} holds {name}, and states are formulas of the variables alone: "
                            f"{', '.join(self._variables)}"
                        )

    def told(self) -> dict[str, Any]:
        """See `States`."""
        named = {name: x if isinstance(x, float) else x.told() for name, x in self._variables.items()}
        rows = {letter: list(row) for letter, row in self._rows.items()}
        return {"law": "formula", "variables": named, **rows, **self._seed()}

    def _draw(self, model: Model, t: float, seed: int, where: tuple[int, int], letters: str) -> tuple:
        for letter in letters:
            if letter not in self._rows:
                raise WrongTypeError(
                    f"states.formula has no formulas of {letter}: give {letter}=, or {letter}0 by itself"
                )
            if len(self._rows[letter]) != model.ndof:
                raise WrongShapeError(
                    f"states.formula has {checks.counted(len(self._rows[letter]), 'formula')} of {letter}, and model "
                    f"{model.name} {checks.counted(model.ndof, 'degree of freedom')}: give one for each"
                )
        values = self._values(seed, where)
        found = []
        for letter in "qp":
            if letter not in letters:
                found.append(None)
                continue
            named = {f"{letter}_{i + 1}": text for i, text in enumerate(self._rows[letter])}
            try:
                read = FormulaObservables.of_variables(tuple(self._variables), named)
            except InvalidArgumentError as error:
                raise type(error)(f"states.formula: {str(error).removeprefix('observable ')}") from None
            states = read(0.0, values, np.zeros_like(values))
            if not np.isfinite(states).all():
                i = int(np.flatnonzero(~np.isfinite(states).all(axis=0))[0])
                raise InvalidArgumentError(
                    f"states.formula: {letter} of path {where[0] + i} is not finite, where "
                    f"{', '.join(f'{x} = {y:.6g}' for x, y in zip(self._variables, values[:, i], strict=True))}: give "
                    "formulas that are finite for all values of the variables"
                )
            found.append(states)
        return tuple(found)

    def _values(self, seed: int, where: tuple[int, int]) -> np.ndarray:
        """Values of the variables, (variable, path): variable k has the number k of stream 1, seed and path."""
        values = np.empty((len(self._variables), where[1]))
        count = len(self._variables) + len(self._variables) % 2
        for kind, of in ((NORMAL, Normal), (UNIFORM, Uniform)):
            mine = [(k, x) for k, x in enumerate(self._variables.values()) if isinstance(x, of)]
            if not mine:
                continue
            centre, factor = np.zeros(count), np.zeros(count)
            for k, x in mine:
                place = k // 2 + (k % 2) * (count // 2)
                centre[place], factor[place] = x.one()
            pairs = drawn(kind, seed, where, centre, factor[:, np.newaxis], stream=_STREAM)
            for k, _ in mine:
                values[k] = pairs[k % 2][k // 2]
        for k, x in enumerate(self._variables.values()):
            if isinstance(x, float):
                values[k] = x
        return values


def _variable(name: str, given: Any) -> Normal | Uniform | float:
    """A law of one number, or a number."""
    if not is_name(checks.name_of("name of a variable", name)):
        raise InvalidArgumentError(f"{name!r} is no name of a variable: give letters, digits and _, a letter first")
    if not isinstance(given, Normal | Uniform):
        if isinstance(given, States):
            raise WrongTypeError(
                f"variable {name}: give states.normal(mean, sd), states.uniform(low, high), or a number"
            )
        return checks.finite(f"variable {name}", given)
    if given.seed is not None:
        raise InvalidArgumentError(f"variable {name} has a seed: give the seed to states.formula, for all variables")
    given.one()
    return given


def _texts(letter: str, given: Any) -> tuple[str, ...]:
    rows = (given,) if isinstance(given, str) else tuple(checks.items(given) or ())
    if not rows or not all(isinstance(x, str) for x in rows):
        raise WrongTypeError(
            f"{letter} of states.formula = {checks.shown(given)}: give a formula as text, or a list with one for each "
            "degree of freedom"
        )
    return rows


def formula(variables: Mapping[str, Any], *, q: Any = None, p: Any = None, seed: int | None = None) -> Formula:
    """Initial states as formulas of variables that are drawn independently for every path.

        ring = ss.states.formula(
            {"action": ss.states.uniform(0, 0.5), "phase": ss.states.uniform(0, 6.283185307179586)},
            q="sqrt(2*action)*cos(phase)", p="-sqrt(2*action)*sin(phase)",
        )
        ss.simulate(model, q0=ring, p0=ring, step=0.05, steps=200, paths=1000)

    - variables: name -> `normal` or `uniform` of one number, or a number
    - q, p: a formula, or a list with one for each degree of freedom; one of the two may be left out
    - seed: 0 .. 2^64 - 1, by default the run's

    Formulas need sympy. InvalidArgumentError: a name that is no variable, a state that is not finite.
    """
    return Formula(variables, q, p, seed)
