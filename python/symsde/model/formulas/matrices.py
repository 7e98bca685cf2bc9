# SPDX-License-Identifier: BSD-3-Clause
"""Matrices of sympy as coordinates and momenta: their elements become symbols, row by row, and formulas are written
in these.
"""

from __future__ import annotations

from typing import Any

from ...errors import InvalidArgumentError
from ...native import checks
from ...native.files import optional


def in_symbols(given: dict[str, Any]) -> dict[str, Any]:
    """Arguments of `model_from_sympy` without matrices: q and p as lists of symbols, formulas in these.

    A MatrixSymbol q has the symbols q1, q2, ..; of a Matrix the elements are taken.
    """
    letters = {key: given[key] for key in "qp"}
    if not any(map(_is_matrix, letters.values())):
        return given
    symbols: dict[Any, Any] = {}
    found = {key: _listed(key, x, symbols) for key, x in letters.items()}
    formulas = {key: given[key] for key in ("H", "noise", "invariants", "force", "noise_force")}
    return given | found | {key: _written(key, x, symbols) for key, x in formulas.items()}


def _is_matrix(x: Any) -> bool:
    return hasattr(x, "shape") and hasattr(x, "free_symbols")


def _listed(letter: str, given: Any, symbols: dict[Any, Any]) -> Any:
    """The elements of a matrix, row by row; symbols that are made are added to the table."""
    sympy = optional("sympy", "sympy")
    if not _is_matrix(given):
        return given
    rows, columns = given.shape
    if not all(isinstance(n, int | sympy.Integer) for n in (rows, columns)):
        raise InvalidArgumentError(
            f"{letter} = {checks.shown(given)} has no number of elements: give its shape in numbers"
        )
    elements = [given[i, j] for i in range(int(rows)) for j in range(int(columns))]
    if isinstance(given, sympy.MatrixSymbol):
        symbols.update((x, sympy.Symbol(f"{given.name}{i}", real=True)) for i, x in enumerate(elements, 1))
    return [symbols.get(x, x) for x in elements]


def _written(what: str, given: Any, symbols: dict[Any, Any]) -> Any:
    """A formula, or formulas in lists and matrices, in symbols."""
    sympy = optional("sympy", "sympy")
    if isinstance(given, list | tuple):
        return [_written(what, x, symbols) for x in given]
    if not hasattr(given, "free_symbols"):
        return given
    explicit = given.as_explicit() if hasattr(given, "as_explicit") else given
    if _is_matrix(explicit):
        parts = [_written(what, x, symbols) for x in explicit]
        return parts[0] if len(parts) == 1 and what == "H" else parts
    for name in ("Trace", "Determinant"):
        explicit = explicit.replace(getattr(sympy, name), lambda m, name=name: _number_of(name, m))
    explicit = explicit.xreplace(symbols)
    if left := sorted(map(str, explicit.atoms(sympy.MatrixSymbol))):
        raise InvalidArgumentError(
            f"a formula of {what} holds the matrix {left[0]}, which is neither q nor p: write its numbers, as "
            "sympy.Matrix"
        )
    return explicit


def _number_of(name: str, matrix: Any) -> Any:
    """The trace or determinant of a matrix, written out."""
    explicit = matrix.as_explicit()
    return explicit.trace() if name == "Trace" else explicit.det()
