# SPDX-License-Identifier: BSD-3-Clause
"""A formula of the state at the end of a path, with its derivatives by the state and by parameters."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np

from ...errors import InvalidArgumentError
from ...native.files import optional
from ..definition import Model
from .formula_observables import FormulaObservables, known_names, letters_of
from .parse import is_name, names_in
from .path_sums import PathSums, require_derivative
from .wide import Positions


class PathFormula:
    """f at the last of the saved times; callable as (t, q, p) -> value, fq, fp, ftheta."""

    def __init__(self, model: Model, formula: Any, positions: Positions):
        """Read and differentiate the formula; positions: of parameters by which it is differentiated."""
        numbers = tuple(key for key, x in model.parameters.items() if is_name(key) and np.isscalar(x))
        given = model._remade[1][0] if hasattr(model, "formula") else {}
        self._nparameter, self._sums = len(positions), None
        if isinstance(formula, str) and "Sum" in names_in(formula):
            self._observables = FormulaObservables(model, {"f": formula})
            self._sums = PathSums(model, formula, positions)
            return
        formulas, self._terms = _derived(formula, letters_of(model), numbers, given.get("t"), tuple(positions))
        self._observables = FormulaObservables(model, formulas)

    def __call__(self, t: np.ndarray, q: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, ...]:
        """Value (path,), derivatives by q and by p (time, dof, path), and derivatives by parameters (parameter,
        path).
        """
        found = self._observables(float(t[-1]), q[-1], p[-1])
        fq, fp = np.zeros_like(q), np.zeros_like(p)
        ftheta = np.zeros((self._nparameter, q.shape[-1]))
        if self._sums:
            fq[-1], fp[-1], ftheta[self._sums.places] = self._sums(float(t[-1]), q[-1], p[-1])
            return found[0], fq, fp, ftheta
        for (what, i), row in zip(self._terms, found[1:], strict=True):
            if what == "theta":
                ftheta[i] = row
            else:
                (fq if what == "q" else fp)[-1, i] = row
        return found[0], fq, fp, ftheta


@functools.lru_cache(maxsize=64)
def _derived(
    formula: Any, letters: tuple, numbers: tuple[str, ...], time: Any, positions: tuple[str, ...]
) -> tuple[dict[str, Any], list[tuple[str, int]]]:
    """f and those of its derivatives that do not vanish, in names of observables; and for each derivative its
    variable.
    """
    sympy, ndof = optional("sympy", "sympy"), letters[0][2]
    known = known_names((("f", formula),), letters, numbers, time)
    try:
        expression = known.canonical(formula)
    except InvalidArgumentError as error:
        raise type(error)(f"f: {error}") from None
    new = {sympy.Symbol(f"{x}{i}", real=True): f"{x}_{i + 1}" for x in "qp" for i in range(ndof)}
    new |= {sympy.Symbol(f"c{k}", real=True): name for k, name in enumerate(numbers)}
    places = {name: x for x, name in new.items()}
    rows = [(x, i, f"{x}_{i + 1}") for x in "qp" for i in range(ndof)]
    rows += [("theta", k, name) for k, name in enumerate(positions)]
    formulas, terms = {"f": expression}, []
    for what, i, name in rows:
        if name not in places:
            continue
        derivative = sympy.diff(expression, places[name])
        require_derivative(derivative, formula, name)
        if derivative != 0:
            formulas[f"f_{len(formulas)}"] = derivative
            terms.append((what, i))
    symbols = {x: sympy.Symbol(name) for x, name in new.items()}
    return {key: e.xreplace(symbols) for key, e in formulas.items()}, terms
