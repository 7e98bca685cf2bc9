# SPDX-License-Identifier: BSD-3-Clause
"""Observables of a run, formulas and Python functions together, as one callback of the library."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

import numpy as np

from ...errors import InvalidArgumentError, WrongTypeError
from ...model.definition import Model, fits_files
from ...model.formulas import compiler
from ...model.formulas.formula_observables import FormulaObservables, is_formula
from ...native import callbacks, checks

Observable = str | Callable[[np.ndarray, np.ndarray], np.ndarray]  # a formula, or a function of q and p
Rows = Callable[[float, np.ndarray, np.ndarray], Iterator[tuple[str, np.ndarray]]]  # a function of (t, q, p)

_PYTHON_NUMBERS = 8192  # most numbers of q in one call of an observable: a call costs microseconds
_TAKEN = re.compile(r"energy|[qp](_\d+)?")


def check_observables(given: object) -> dict[str, Observable]:
    """A dict of formulas and functions whose names fit files; empty for None."""
    if given is None:
        return {}
    if not isinstance(given, Mapping):
        raise WrongTypeError(
            f"observables = {checks.shown(given)} is not allowed: give a dict of names and formulas or functions"
        )
    for name, observable in given.items():
        _check_name(name)
        if callable(observable) and not is_formula(observable):
            checks.takes(f"observable {name!r}", observable, "q", "p")
        elif not is_formula(observable):
            given_text = checks.shown(observable)
            raise WrongTypeError(
                f"observable {name!r} cannot be called: give f(q, p), or a formula as text, not {given_text}"
            )
    return dict(given)


def _check_name(name: object) -> None:
    """Check a name: in files it becomes the name of variables and columns, next to those of q, p and the energy."""
    if _TAKEN.fullmatch(checks.name_of("name of an observable", name)):
        raise InvalidArgumentError(
            f"observable {name!r}: this name is taken, files would hold two of it (q, p, energy, q_1, p_1, ...): "
            f"give another one, such as {'my_' + name!r}"
        )
    if not fits_files(name):
        raise InvalidArgumentError(
            f"observable {name!r}: this cannot be a name in a file: give printable characters, without '/' and '#' and "
            "without spaces around them"
        )


def refuse_coordinates(names: Iterable[str], model: Model) -> None:
    """Refuse names of observables that already denote a coordinate in formulas or results."""
    for name in names:
        numbered = re.fullmatch(r"[qp]([0-9]{1,9})", name)
        if name in model.coordinates or (numbered and 1 <= int(numbered[1]) <= model.ndof):
            raise InvalidArgumentError(
                f"observable {name!r}: this name is taken, results and formulas call a coordinate so: give another "
                f"one, such as {'my_' + name!r}"
            )


def are_in_python(observables: Mapping[str, Observable]) -> bool:
    """Whether some observable is a Python function, which only one thread at a time can call."""
    if not observables:
        return False
    return compiler.command() is None or not all(is_formula(x) for x in observables.values())


def described(observables: Mapping[str, Observable] | Iterable[str]) -> dict[str, str]:
    """Descriptions of the observables for files; empty if only names are given."""
    if not isinstance(observables, Mapping):
        return dict.fromkeys(observables, "")
    return {name: str(x) if is_formula(x) else _name_of(x) for name, x in observables.items()}


def _name_of(function: Any) -> str:
    module, name = getattr(function, "__module__", None), getattr(function, "__qualname__", type(function).__name__)
    return f"Python: {module}.{name}" if module else f"Python: {name}"


def bind(observables: Mapping[str, Observable], model: Model, struct: Any, failures: callbacks.Failures) -> Any:
    """Store the callback in the struct of the C interface; the caller keeps the returned object alive while the
    callback may be called."""
    if not observables:
        return None
    texts = {name: x for name, x in observables.items() if is_formula(x)}
    formulas = FormulaObservables(model, texts) if texts else None
    struct.nobservable = len(observables)
    if formulas and formulas.is_compiled and len(texts) == len(observables):
        struct.observables, struct.observables_user = formulas.callback()
        return formulas
    struct.observables = callbacks.observables(_rows(observables, formulas), failures)
    if formulas is None or not formulas.needs_time:
        struct.observables_lanes = _PYTHON_NUMBERS // model.ndof
    return formulas


def rows_of(observables: Mapping[str, Observable], model: Model) -> Rows | None:
    """A function of (t, q, p), (dof, lane) each, that yields names and values; None without observables."""
    texts = {name: x for name, x in observables.items() if is_formula(x)}
    return _rows(observables, FormulaObservables(model, texts) if texts else None) if observables else None


def _rows(observables: Mapping[str, Observable], formulas: FormulaObservables | None) -> Rows:
    """A function of (t, q, p) that yields names and values, all formulas at once."""

    def rows(t: float, q: np.ndarray, p: np.ndarray):
        known = iter(formulas(t, q, p) if formulas else ())
        for name, observable in observables.items():
            yield name, next(known) if is_formula(observable) else observable(q.copy(), p.copy())

    return rows
