# SPDX-License-Identifier: BSD-3-Clause
"""The given formulas, checked, with internal names for coordinates, parameters and time.

Users may call variables A0, E, pi or double; here they are renamed to q0 .. , p0 .. , c0 .. and t, so that no text of a
user reaches generated code.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ...errors import InvalidArgumentError, WrongTypeError
from ...native import checks
from ...native.files import optional
from ..definition import fits_files
from . import kinks, parameters
from .graph import FUNCTIONS
from .parse import FormulaTextError, Reader, check_name, folded, names_in, parse

MAX_DOF = 64
MAX_NOISES = 256  #: most noises: for every pair of noises brackets are computed


@dataclass(frozen=True)
class Problem:
    """H_0 = H, H_1 .. H_m in the symbols q0 .. , p0 .. (coordinates), c0 .. (parameters) and t."""

    hamiltonians: tuple[Any, ...]  #: expressions of sympy
    invariants: tuple[Any, ...]  #: candidates for invariants, expressions of sympy
    texts: tuple[str, ...]  #: formulas as the user wrote them, for messages
    ndof: int
    parameters: dict[str, Any]  #: name -> value, in the order of c0, c1, ..
    columns: tuple[str, ...] = ()  #: names of coordinates and momenta in results; () = q_1 .., p_1 ..
    by_path: bool = False  #: parameters differ from path to path

    @property
    def nnoise(self) -> int:
        """Number m of noises."""
        return len(self.hamiltonians) - 1

    def coordinates(self, letter: str) -> list[str]:
        """Names q0 .. or p0 .."""
        return [f"{letter}{i}" for i in range(self.ndof)]

    @property
    def lanes(self) -> dict[str, bool]:
        """Name -> whether its value differs from lane to lane, for every name."""
        names = {"t": False} | dict.fromkeys((f"c{k}" for k in range(len(self.parameters))), self.by_path)
        return names | dict.fromkeys([*self.coordinates("q"), *self.coordinates("p")], True)


def quoted(text: str) -> str:
    """A formula as the user wrote it, shortened to fit into a sentence."""
    return repr(text if len(text) <= 80 else text[:77] + "...")


def unused(params: Mapping | None, formulas: Sequence[Any]) -> list[str]:
    """Parameters that no formula contains."""
    used: set[str] = set()
    for x in formulas:
        names = (
            names_in(x)
            if isinstance(x, str)
            else {s.name for s in getattr(x, "free_symbols", ()) if hasattr(s, "name")}
        )
        used.update(map(folded, names))
    return [name for name in map(folded, (getattr(x, "name", x) for x in params or {})) if name not in used]


def written(formula: Any) -> str:
    """A formula as text."""
    try:
        return str(formula)
    except Exception as error:  # a foreign object may raise any exception; so do integers of thousands of digits
        kind = type(formula).__name__
        raise InvalidArgumentError(f"a formula of type {kind} cannot be written as text: {error}") from None


def make_problem(*, H, noise, q, p, params, t, invariants=(), most=MAX_DOF) -> Problem:
    """Check all arguments; errors quote the formula."""
    sympy = optional("sympy", "sympy")
    given = [H, *several("noise", noise)]
    if len(given) - 1 > MAX_NOISES:
        raise InvalidArgumentError(
            f"{len(given) - 1} noises beside {quoted(written(H))}: "
            f"formulas without sums over sites are for {MAX_NOISES} at most"
        )
    candidates = several("invariants", invariants)
    texts = [x for x in (*given, *candidates) if isinstance(x, str)]
    coordinates = {"q": named("q", default_names("q", texts) if q is None else q)}
    coordinates["p"] = named("p", default_names("p", texts, len(coordinates["q"])) if p is None else p)
    ndof = len(coordinates["q"])
    if ndof == 0 or len(coordinates["p"]) != ndof:
        raise InvalidArgumentError(
            f"q names {ndof} coordinates and p {len(coordinates['p'])} momenta: give as many of each, one at least"
        )
    if ndof > most:
        raise InvalidArgumentError(
            f"q names {ndof} coordinates: formulas without sums over sites are for {most} at most"
        )
    names = Names(sympy, coordinates, params, t, ndof)
    expressions = [names.canonical(x) for x in (*given, *candidates)]
    return Problem(
        hamiltonians=tuple(expressions[: len(given)]),
        invariants=tuple(expressions[len(given) :]),
        texts=tuple(written(x) for x in (*given, *candidates)),
        ndof=ndof,
        parameters=names.values,
        columns=_columns(coordinates),
        by_path=parameters.kind_of(names.values)[0],
    )


def default_names(letter: str, texts: Sequence[str], count: int = 0) -> str | list[str]:
    """Default names of coordinates: q1, q2, .. if the texts contain such names, else q."""
    numbers = {x[1:] for text in texts for x in names_in(text) if x[0] == letter and x[1:].isdecimal()}
    last = max([count if count > 1 else 0, *(int(x) for x in numbers if len(x) <= 6)])
    return [f"{letter}{i}" for i in range(1, last + 1)] if last and "0" not in numbers else letter


def several(what: str, given: Any) -> list[Any]:
    """A single object or a sequence as a list."""
    if isinstance(given, Mapping | set):
        raise WrongTypeError(f"{what} = {checks.shown(given)} has no order: give a list")
    found = checks.items(given)
    return ([] if given is None else [given]) if found is None else found


def named(what: str, given: Any) -> list[Any]:
    """Symbols or names, as a list; a text is names with blanks or commas between them."""
    return [x for x in re.split(r"[\s,]+", given) if x] if isinstance(given, str) else several(what, given)


def _columns(coordinates: Mapping[str, Sequence]) -> tuple[str, ...]:
    """Names of coordinates and momenta in results: the user's names, unless columns use them for something else."""
    found, own = [], False
    for letter, given in coordinates.items():
        for i, name in enumerate(folded(x).partition("(")[0] for x in given):
            taken = name in ("energy", "t", "path", *found) or re.fullmatch(r"[qp]_?[0-9]*", name)
            taken = taken or not fits_files(name)
            found.append(f"{letter}_{i + 1}" if taken else name)
            own = own or not taken
    return tuple(found) if own else ()


class Names:
    """The user's symbols, and their internal names."""

    def __init__(self, sympy, coordinates: dict[str, Sequence], params: Mapping | None, t: Any, ndof: int):
        """Store coordinates, parameters with their values, and the time, for this many degrees of freedom."""
        self.sympy = sympy
        self.values: dict[str, Any] = {}
        self.known: dict[str, Any] = {}  # the user's name -> internal symbol
        self.moving: dict[Any, Any] = {}  # functions q(t) -> internal symbol
        self._ndof = ndof
        for letter, given in coordinates.items():
            for i, x in enumerate(given):
                self._coordinate(letter, i, x)
        each = "path" if coordinates else "site"  # sites have names of their own
        self._parameters({} if params is None else params, each)
        self._time(t)

    def _coordinate(self, letter: str, i: int, given: Any) -> None:
        symbol = self.sympy.Symbol(f"{letter}{i}", real=True)
        if isinstance(given, self.sympy.core.function.AppliedUndef):  # a symbol made by dynamicsymbols
            self.moving[given] = symbol
            given = str(given)
        self._name(given, symbol)
        there = re.fullmatch(r"([qp])_?([0-9]*)", folded(given).partition("(")[0])
        if there and (there[1] != letter or there[2] not in ("", str(i + 1))):
            raise InvalidArgumentError(
                f"{given} is at place {i + 1} of {letter}, which results, observables and files call {letter}_{i + 1}: "
                f"count coordinates {letter}1, {letter}2, .. from 1, or give them names without q, p and numbers"
            )

    def _parameters(self, params: Mapping, each: str) -> None:
        if not isinstance(params, Mapping):
            raise WrongTypeError(f"params = {checks.shown(params)} is no table: give a dict, name -> number")
        for k, (key, value) in enumerate(params.items()):
            symbol = self.sympy.Symbol(f"c{k}", real=True)
            self._name(key, symbol, "the parameter")
            self.values[folded(getattr(key, "name", key))] = parameters.value_of(str(key), value, each)

    def _time(self, t: Any) -> None:
        symbol = self.sympy.Symbol("t", real=True)
        if t is not None:
            self._name(t, symbol, "the time")
        elif "t" not in self.known:
            self.known["t"] = symbol

    def _name(self, given: Any, symbol: Any, what: str = "") -> None:
        if isinstance(given, self.sympy.Indexed):
            check_name(str(given))
        if not isinstance(given, str | self.sympy.Symbol):
            raise WrongTypeError(f"{checks.shown(given)} is no name: give symbols of sympy, or their names as text")
        name = folded(getattr(given, "name", given))
        if name in self.known:
            raise InvalidArgumentError(
                f"the name {name!r} is given twice: q, p, params and t need names of their own (letters that "
                "look alike, as both signs of micro, are one)"
            )
        column = re.fullmatch(r"[qp]_([0-9]{1,9})", name)
        if what and column and 1 <= int(column[1]) <= self._ndof:
            raise InvalidArgumentError(
                f"{name} is a coordinate in results, observables and files: give {what} another name"
            )
        self.known[name] = symbol

    def canonical(self, given: Any, reader: Reader | None = None) -> Any:
        """A formula in internal names; reader: reads texts that may contain more than plain formulas."""
        sympy = self.sympy
        if isinstance(given, str):
            return self._read(given, reader)
        try:
            expression = sympy.sympify(given, strict=True)
        except (sympy.SympifyError, TypeError):
            raise WrongTypeError(f"{checks.shown(given)} is no formula: give an expression of sympy") from None
        if not isinstance(expression, sympy.Expr) or expression.is_Matrix:
            raise WrongTypeError(f"{checks.shown(given)} is no scalar formula: give one expression")
        text = quoted(written(given))
        self._refuse_strangers(expression, text)
        expression = expression.xreplace(
            {**{x: self.known[folded(x.name)] for x in expression.free_symbols}, **self.moving}
        )
        if expression.has(sympy.I, sympy.zoo, sympy.nan, sympy.oo, -sympy.oo):
            raise InvalidArgumentError(f"the formula {text} is not real and finite: formulas are real")
        return self._in_cases(expression, text)

    def _in_cases(self, expression: Any, text: str) -> Any:
        """The formula with its kinks written as cases."""
        expression = kinks.in_cases(expression)
        kinks.require_cases(expression, text)
        return expression

    def _read(self, text: str, reader: Reader | None) -> Any:
        """Read a formula given as text."""
        for name in self.known:
            check_name(name.split("(")[0])
        try:
            expression = parse(text, self.known, reader)
        except FormulaTextError as error:
            raise InvalidArgumentError(f"the formula {quoted(text)} cannot be used: {error}") from None
        if not isinstance(expression, self.sympy.Expr) or expression.is_finite is False:
            raise InvalidArgumentError(f"the formula {quoted(text)} is not real and finite: formulas are real")
        return self._in_cases(expression, quoted(text)) if reader is None else expression

    def _refuse_strangers(self, expression: Any, text: str) -> None:
        sympy = self.sympy
        if expression.has(sympy.Derivative):
            raise InvalidArgumentError(f"the formula {text} holds a derivative: write Hamiltonians in q and p")
        for x in sorted(expression.atoms(sympy.core.function.AppliedUndef) - set(self.moving), key=str):
            raise InvalidArgumentError(
                f"the formula {text} holds {x}, which is no coordinate: name it in q or p, or write out the function; "
                f"there are {', '.join(FUNCTIONS)}"
            )
        seen: dict[str, Any] = {}
        for x in sorted(expression.free_symbols, key=str):
            name = folded(getattr(x, "name", ""))
            other = seen.setdefault(name, x)
            if str(other) != str(x) or (other is not x and isinstance(x, sympy.Dummy)):
                same = "which are one name" if str(other) != str(x) else "two symbols of one name"
                raise InvalidArgumentError(f"the formula {text} holds {other} and {x}, {same}: {name}")
            if name not in self.known:
                near = checks.nearest(str(x), self.known)
                raise InvalidArgumentError(
                    f"the formula {text} holds {x}, which is not given: there are {near}; "
                    "name it in q or p, or give its value in params"
                )
