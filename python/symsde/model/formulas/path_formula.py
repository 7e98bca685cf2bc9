# SPDX-License-Identifier: BSD-3-Clause
"""A formula of the state at the end of a path, with its derivatives by the state and by parameters."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...errors import IncompatibleError, InvalidArgumentError
from ...native import checks
from ...native.files import optional
from ..definition import Model
from .formula_observables import FormulaObservables, _known, _own
from .parse import is_name


class PathFormula:
    """f at the last of the saved times; callable as (t, q, p) -> value, fq, fp, ftheta."""

    def __init__(self, model: Model, formula: Any, positions: list[str]):
        """Read and differentiate the formula; positions: parameters by which it is differentiated."""
        sympy = optional("sympy", "sympy")
        numbers = {key: x for key, x in model.parameters.items() if is_name(key) and np.isscalar(x)}
        given = model._remade[1][0] if hasattr(model, "formula") else {}
        if isinstance(formula, str) and "Sum" in formula:
            raise IncompatibleError(
                f"f = {formula!r} is a sum over sites, whose derivatives are not known: give a pair"
            )
        letters = tuple((letter, _own(given.get(letter)), model.ndof) for letter in "qp")
        known = _known((("f", formula),), letters, tuple(numbers), given.get("t"))
        try:
            expression = known.canonical(formula)
        except InvalidArgumentError as error:
            raise type(error)(f"f: {error}") from None
        by_path = {x for x in positions if x not in numbers}
        if by_path & {str(x) for x in getattr(formula, "free_symbols", ())}:
            raise IncompatibleError("f holds parameters that go by path: give it as a pair of functions")
        new = {sympy.Symbol(f"{x}{i}", real=True): f"{x}_{i + 1}" for x in "qp" for i in range(model.ndof)}
        new |= {sympy.Symbol(f"c{k}", real=True): name for k, name in enumerate(numbers)}
        places = {name: x for x, name in new.items()}
        self._ndof, self._terms, formulas = model.ndof, [], {"f": expression}
        rows = [*(("q", i) for i in range(model.ndof)), *(("p", i) for i in range(model.ndof))]
        rows += [("theta", k) for k in range(len(positions))]
        for what, i in rows:
            name = positions[i] if what == "theta" else f"{what}_{i + 1}"
            if name not in places:
                continue
            derivative = sympy.diff(expression, places[name])
            if derivative.has(sympy.Derivative, sympy.Subs, sympy.DiracDelta):
                raise InvalidArgumentError(f"f = {checks.shown(str(formula))} has no derivative by {name}: give a pair")
            if derivative != 0:
                formulas[f"f_{len(formulas)}"] = derivative
                self._terms.append((what, i))
        symbols = {x: sympy.Symbol(name) for x, name in new.items()}
        self._observables = FormulaObservables(model, {key: e.xreplace(symbols) for key, e in formulas.items()})
        self._nparameter = len(positions)

    def __call__(self, t: np.ndarray, q: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, ...]:
        """Value and derivatives of these paths: (path,), (time, dof, path) twice, (parameter, path)."""
        found = self._observables(float(t[-1]), q[-1], p[-1])
        fq, fp = np.zeros_like(q), np.zeros_like(p)
        ftheta = np.zeros((self._nparameter, q.shape[-1]))
        for (what, i), row in zip(self._terms, found[1:], strict=True):
            if what == "theta":
                ftheta[i] = row
            else:
                (fq if what == "q" else fp)[-1, i] = row
        return found[0], fq, fp, ftheta
