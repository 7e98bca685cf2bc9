# SPDX-License-Identifier: BSD-3-Clause
"""Texts about sites: q[i + 1] of neighbours, m[i] of parameters, Sum(.., i) over all sites, Sum(.., i < j) over all
pairs of them."""

from __future__ import annotations

import ast
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ...native.files import optional
from .parse import FormulaTextError, Reader

MAX_OFFSET = 8
#: names of coordinates, momenta and parameters of sites: letter, component, and the offset, or ! for the site j
_LOCAL = re.compile(r"([qpc])(\d*)(?:([+-]\d+)|!)")


@dataclass(frozen=True, order=True)
class Row:
    """Where a number of a summand stands."""

    second: bool = False  #: at the second site j of a pair, not at the first one
    offset: int = 0  #: number of sites behind the site
    component: int = 0  #: which coordinate of the site, or which parameter
    #: "" for a coordinate, or for a parameter that is none; of parameters that are positions "site" or "all"; "at" for
    #: a coordinate of one site, the component being its row
    fixed: str = ""

    @property
    def site(self) -> str:
        """The site, in C."""
        return "other" if self.second else f"ROW({self.offset})"


@dataclass(frozen=True)
class Shape:
    """The rows of all sites: coordinates site by site; then those parameters that are positions (`wide.py`): each
    parameter of sites with its sites, and behind these the parameters with one number."""

    size: int  #: coordinates of a site
    arrays: int = 0  #: parameters of sites
    alone: int = 0  #: parameters with one number

    @property
    def each(self) -> int:
        """Rows that belong to a site."""
        return self.size + self.arrays

    def rows(self, sites: int) -> int:
        """The number of rows."""
        return self.each * sites + self.alone

    def row(self, row: Row) -> str:
        """The number of a row, in C."""
        if row.fixed == "at":
            return str(row.component)
        if row.fixed == "all":
            return f"({self.each} * sites + {row.component})"
        if row.fixed:
            return f"({self.size + row.component} * sites + {row.site})"
        return row.site if self.size == 1 else f"({self.size} * {row.site} + {row.component})"

    @property
    def sites(self) -> str:
        """The number of sites of ndof rows, in C."""
        rows = f"(ndof - {self.alone})" if self.alone else "ndof"
        return rows if self.each == 1 else f"{rows} / {self.each}"

    @property
    def count(self) -> str:
        """The number of rows, in C."""
        rows = "sites" if self.each == 1 else f"{self.each} * sites"
        return f"({rows} + {self.alone})" if self.alone else f"({rows})" if self.each > 1 else rows


@dataclass(frozen=True)
class Place:
    """A site, counted from the first or from the last one."""

    shift: int
    from_last: bool = False

    def __str__(self) -> str:
        """The number in C, given the number of sites."""
        return f"sites - 1 + ({self.shift})" if self.from_last else str(self.shift)

    def of(self, sites: int) -> int:
        """The number of the site, given the number of sites."""
        return self.shift + (sites - 1 if self.from_last else 0)


@dataclass(frozen=True)
class Number:
    """Index of a Hamiltonian as a function of the number of sites: `alone` single Hamiltonians come before
    it, and `families` families with one Hamiltonian for each site."""

    alone: int = 0
    families: int = 0

    def __str__(self) -> str:
        """The index in C, given the number of sites."""
        return f"({self.alone} + {self.families} * sites)" if self.families else str(self.alone)

    def after(self, family: bool) -> Number:
        """The index of the next Hamiltonian, after a single one or a family."""
        return Number(self.alone + (not family), self.families + family)

    def of(self, sites: int) -> int:
        """The index, given the number of sites."""
        return self.alone + self.families * sites

    @property
    def is_drift(self) -> bool:
        """Whether the Hamiltonian is H."""
        return self == Number()


def local_symbol(letter: str, row: Row) -> Any:
    """The symbol of a coordinate, a momentum or a parameter (c) of a site."""
    where = "!" if row.second else f"{row.offset:+d}"
    return optional("sympy", "sympy").Symbol(f"{letter}{row.component or ''}{where}", real=True)


def locals_of(body: Any) -> dict[Any, Row]:
    """The coordinates, momenta and parameters of sites that a summand contains."""
    found = ((x, _LOCAL.fullmatch(x.name)) for x in body.free_symbols)
    return {x: Row(not there[3], int(there[3] or 0), int(there[2] or 0)) for x, there in found if there}


def rows_of(body: Any) -> dict[Any, Row]:
    """The coordinates and momenta of sites that a summand contains."""
    return {x: row for x, row in locals_of(body).items() if x.name[0] != "c"}


class SiteReader(Reader):
    """A parser that also reads q[i + 1], p[i], m[i], Sum(.., i) and Sum(.., i < j)."""

    def __init__(
        self,
        names: Mapping[str, Any],
        index: str | None = None,
        components: tuple[Sequence[str], Sequence[str]] = (("q",), ("p",)),
        arrays: Sequence[str] = (),
    ):
        """`index`: the index in the brackets; "" means the first one found, None means that indices occur in sums
        only. `components`: names of the coordinates and momenta of a site; `arrays`: parameters with a number for each
        site.
        """
        super().__init__(names)
        self.index, self.second = index, ""
        self.sums: dict[Any, Any] = {}
        self._letters = {x: ("c", k) for k, x in enumerate(arrays)}
        for letter, own in zip("qp", components, strict=True):
            self._letters |= {x: (letter, k) for k, x in enumerate(own)}
        self._shown = " or ".join(f"{x}[i]" for own in components for x in own)

    def read(self, node: ast.AST, depth: int) -> Any:
        """The expression of a node."""
        if isinstance(node, ast.Subscript):
            return self._site(node)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "Sum":
            return self._sum(node, depth)
        return super().read(node, depth)

    def _named(self, name: str) -> Any:
        if name in (self.index, self.second) and name:
            raise FormulaTextError(
                f"it takes {name} as a number: a term may depend on its site only by "
                f"{self._shown.replace('[i]', f'[{name}]')}, and by parameters that are arrays with a number for each "
                f"site, as k[{name}]"
            )
        if name in self._letters:
            kind = "a parameter" if self._letters[name][0] == "c" else "a coordinate"
            raise FormulaTextError(
                f"it takes {name} as a number, which is {kind} with a value for each site: write {name}[i]"
            )
        return super()._named(name)

    def _site(self, node: ast.Subscript) -> Any:
        """q[i + 1] as the coordinate at an offset."""
        name = node.value.id if isinstance(node.value, ast.Name) else ""
        if name not in self._letters:
            if name in self.names:
                raise FormulaTextError(
                    f"it holds an index of {name}, whose value is one number: give an array with a number for each "
                    f"site, or write {name} without an index"
                )
            if f"{name}_1" in self.names:
                raise FormulaTextError(
                    f"it holds an index of {name}: an index stands behind other names here, as in {self._shown}; of "
                    f"{name} there are {name}_1, {name}_2, .."
                )
            raise FormulaTextError(
                f"it holds an index of something that is not {self._shown}, and no parameter with a number for each "
                "site"
            )
        letter, component = self._letters[name]
        index, offset = self._index(node.slice, name)
        if self.second and offset:
            raise FormulaTextError(
                f"it holds neighbours in a sum over pairs: write {name}[{self.index}] and {name}[{self.second}] there"
            )
        if self.second and index == self.second:
            return local_symbol(letter, Row(True, 0, component))
        if self.index is None:
            raise FormulaTextError(f"it holds {name}[{index}] outside of a sum: write Sum(.., {index})")
        if self.index == "":
            self.index = index  # the first index found in a family of noises
        if index != self.index:
            there = f"there are {self.index} and {self.second}" if self.second else f"there is {self.index}"
            raise FormulaTextError(
                f"it holds the index {index}, where {there}; pairs are summed as Sum(.., {self.index} < {index})"
            )
        return local_symbol(letter, Row(False, offset, component))

    def _index(self, name: ast.AST, of: str) -> tuple[str, int]:
        """The letter in brackets, and the number behind it."""
        offset = 0
        if isinstance(name, ast.BinOp) and isinstance(name.op, ast.Add | ast.Sub):
            shift = name.right.value if isinstance(name.right, ast.Constant) else None
            if type(shift) is not int or shift > MAX_OFFSET:
                raise FormulaTextError(f"it holds an index that is not i, i + 1, .. i + {MAX_OFFSET}, i - 1, ..")
            offset = shift if isinstance(name.op, ast.Add) else -shift
            name = name.left
        if isinstance(name, ast.Name) and name.id in self.names:
            raise FormulaTextError(
                f"it holds the index [{name.id}], and {name.id} is a parameter: call the index by another letter, "
                f"as in {of}[i], or rename the parameter"
            )
        if not isinstance(name, ast.Name):
            raise FormulaTextError(
                "it holds an index that is not i, i + 1, i - 1, ..: neighbours alone are tied, at all sites alike; "
                "few sites that differ are written as q1, q2, .. without n"
            )
        return name.id, offset

    def _sum(self, node: ast.Call, depth: int) -> Any:
        over = [_indices(x) for x in node.args[1:]]
        if len(over) != 1 or node.keywords or not over[0]:
            raise FormulaTextError(
                "it holds a Sum that is not written Sum(formula, i), over all sites by one index, or "
                "Sum(formula, i < j), over all pairs of sites"
            )
        if self.index:
            raise FormulaTextError(
                "it holds a Sum in a Sum, or beside an index: write sums over pairs as Sum(.., i < j), or by products "
                "of sums, as Sum(cos(q[i]), i)**2 + Sum(sin(q[i]), i)**2 for all cos(q[i]-q[j])"
            )
        [indices] = over
        for index in indices:
            if index in self.names or index in self._letters:
                means = "a coordinate" if self._letters.get(index, "c")[0] != "c" else "a parameter"
                raise FormulaTextError(
                    f"it sums over {index}, which means something else, {means}: call the index by another letter, as "
                    "in Sum(.., i)"
                )
        before = self.index
        self.index, self.second = (*indices, "")[:2]
        if self.index == self.second:
            raise FormulaTextError(f"it sums over pairs of {self.index} and itself: give two letters, as in i < j")
        body = self.read(node.args[0], depth + 1)
        if self.second and {row.second for row in locals_of(body).values()} != {False, True}:
            raise FormulaTextError(
                f"it sums over pairs what does not depend on both, {self.index} and {self.second}: write Sum(.., i)"
            )
        self.index, self.second = before, ""
        for known, same in self.sums.items():
            if same == body:
                return known
        stand_in = self.sympy.Dummy("Sum", real=True)
        self.sums[stand_in] = body
        return stand_in


def _indices(node: ast.AST) -> tuple[str, ...]:
    """(i,) or, of i < j, (i, j); empty for anything else."""
    if isinstance(node, ast.Name):
        return (node.id,)
    if isinstance(node, ast.Compare) and len(node.ops) == 1 and isinstance(node.ops[0], ast.Lt):
        sides = (node.left, node.comparators[0])
        return tuple(x.id for x in sides) if all(isinstance(x, ast.Name) for x in sides) else ()
    return ()
