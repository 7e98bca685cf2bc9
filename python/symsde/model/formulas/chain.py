# SPDX-License-Identifier: BSD-3-Clause
"""Chains: densities, which are summands of sums over sites with their derivatives, and what is derived from them."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

from .collective import Outer
from .derivatives import Derivatives
from .graph import Graph
from .site_reader import Number, Place, Row, Shape

if TYPE_CHECKING:
    from .site_parts import Part


class Summand(Protocol):
    """The term of a sum over sites or pairs, as loops in C need it."""

    first: Place
    last: Place
    given: tuple[Row, ...]  #: parameters of sites: those behind the last one of the model -> which, and the site
    is_pair: bool  #: whether the sum is over pairs of sites
    graph: Graph
    numbers: int  #: number of parameters before those of sites

    def load(self, name: str, shape: Shape) -> str:
        """An input of the term in C."""
        ...


@dataclass(frozen=True)
class Density:
    """The summand of a sum over sites."""

    weight: Number  #: Hamiltonian of the sum; for a family its first Hamiltonian
    family: bool  #: whether each site has its own Hamiltonian
    first: Place
    last: Place
    rows: tuple[Row, ...]  #: where coordinate k of `derivatives` stands
    derivatives: Derivatives
    is_rest: bool = False  #: whether the density is the part beyond the ends of another density
    #: indices of the sums inside functions that the density adds to, one for each of its Hamiltonians; else empty
    inner: tuple[int, ...] = ()
    #: parameters of sites: those behind the last parameter of the chain in `derivatives` -> component, and the row
    given: tuple[Row, ...] = ()

    @property
    def offsets(self) -> tuple[int, ...]:
        """Coordinate k of `derivatives` belongs to site + offsets[k]."""
        return tuple(row.offset for row in self.rows)

    @property
    def is_pair(self) -> bool:
        """Whether the sum is over pairs of sites."""
        return any(row.second for row in (*self.rows, *self.given))

    @property
    def graph(self) -> Graph:
        """The operations of the summand and of its derivatives."""
        return self.derivatives.graph

    @property
    def numbers(self) -> int:
        """Number of parameters before those of sites."""
        return len(self.derivatives.problem.parameters) - len(self.given)

    def load(self, name: str, shape: Shape) -> str:
        """An input of the summand in C."""
        letter = name.rstrip("0123456789")
        if letter == "w":
            row = self.inner[int(name[1:])] if self.inner else f"({self.weight}{' + site' if self.family else ''})"
            return f"w[{row} * (ptrdiff_t)n + i]"
        return f"{letter}[{shape.row(self.rows[int(name[len(letter) :])])} * n + i]"

    @property
    def is_own(self) -> bool:
        """Whether each site adds to its own rows alone."""
        return not self.is_pair and not any(self.offsets) and all(row.fixed in ("", "site") for row in self.rows)


@dataclass(frozen=True)
class Chain:
    """Sums over sites, and the results derived from them."""

    n: int
    components: tuple[tuple[str, ...], tuple[str, ...]]  #: names of coordinates and of momenta of a site
    arrays: tuple[str, ...]  #: parameters with a number for each site
    nnoise: int
    ends: str
    densities: tuple[Density, ...]
    outer: Outer | None  #: functions of sums
    texts: tuple[str, ...]
    parameters: dict[str, float]
    kinked: tuple[int, ...]  #: numbers of the formulas with kinks or jumps in the state
    traits: dict[str, Any]
    part: Part | None  #: the quadratic part of H between kicks
    unsplit: str = ""  #: what keeps H from having one; empty if nothing does, or nothing could be
    fixed: tuple[str, ...] = ()  #: parameters that are positions, those of sites first

    @property
    def size(self) -> int:
        """Number of coordinates of a site."""
        return len(self.components[0])

    @property
    def shape(self) -> Shape:
        """The rows of a state."""
        arrays = len({*self.fixed} & {*self.arrays})
        return Shape(self.size, arrays, len(self.fixed) - arrays)

    def standing(self) -> tuple[str, ...]:
        """The momenta of sites that H lacks, if it holds those of other sites: free ends leave out what would reach
        beyond an end."""
        missing = []
        for k, name in enumerate(self.components[1]):
            held: set[int] = set()
            for d in self.densities:
                used = {x.name for e in d.derivatives.problem.hamiltonians for x in e.free_symbols}
                for j, row in enumerate(d.rows):
                    if d.weight.is_drift and row.component == k and not row.fixed and f"p{j}" in used:
                        first, last = (0, self.n - 1) if d.is_pair else (d.first.of(self.n), d.last.of(self.n))
                        held |= set(range(first + row.offset, last + row.offset + 1))
            missing += [f"{name}[{i}]" for i in range(self.n) if held and i not in held and self.ends == "free"]
        return tuple(missing)

    def columns(self) -> tuple[str, ...]:
        """Names of coordinates and momenta in results; empty for q_1, q_2, .., p_1, p_2, .."""
        if self.components == (("q",), ("p",)) or self.fixed:
            return ()
        names = [f"{x}_{i + 1}" for own in self.components for i in range(self.n) for x in own]
        odd = any(re.fullmatch(r"[qp]_[0-9]+|.*[^a-zA-Z0-9_].*", x) for x in names) or len(set(names)) < len(names)
        return () if odd else tuple(names)

    @property
    def is_line(self) -> bool:
        """Whether sites have one coordinate each, are all alike, and are summed one by one."""
        return self.shape == Shape(1) and not any(d.is_pair or d.given for d in self.densities)
