# SPDX-License-Identifier: BSD-3-Clause
"""Sums over sites in observables, Sum(q[i]**2, i): loops in C for any number of sites, added in the order of sites.

An observable may be any formula of such sums, also over pairs. Summands are read as in chains (`sites.py`), with the
same rule at the ends; the sums of all lanes are computed first, and are leaves w0, w1, .. of the observable's graph.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from . import pair_loops
from .graph import Graph
from .in_numpy import values_of
from .site_ends import at_ends, row_macro
from .site_reader import Place, Row, Shape, locals_of

#: letters of a site's coordinates in graphs: u0, v0 at the first of the rows, u1, v1 .. at the next ones
LOCAL = {"q": "u", "p": "v"}
ARRAY = {letter: array for array, letter in LOCAL.items()}


@dataclass(frozen=True)
class Piece:
    """The summand of a sum over some of the sites, or over all pairs."""

    graph: Graph
    root: int
    rows: tuple[Row, ...]  #: u0, v0 stand at rows[0]
    given: tuple[Row, ...]  #: parameters of sites: those behind the last number -> which, and the site
    numbers: int  #: number of parameters that are one number
    first: Place
    last: Place

    @property
    def is_pair(self) -> bool:
        """Whether the sum is over pairs."""
        return any(row.second for row in (*self.rows, *self.given))

    def load(self, name: str, shape: Shape) -> str:
        """An input of the summand in C."""
        letter, number = name.rstrip("0123456789"), int(name.lstrip("uvqp"))
        if letter in ARRAY:
            return f"{ARRAY[letter]}[{shape.row(self.rows[number])} * n + i]"
        return f"{letter}[{number} * (ptrdiff_t)n + i]"


@dataclass(frozen=True)
class Sum:
    """A sum over sites or pairs."""

    pieces: tuple[Piece, ...]  #: for the interior of the chain and for its ends
    size: int  #: number of coordinates of a site


def make_sum(body: Any, ends: str, shape: tuple[int, int], numbers: int, node_of: Any) -> Sum:
    """A sum. shape: how many sites there are, and the coordinates of each; numbers: how many parameters are one
    number; node_of: adds an expression to a graph, node_of(graph, expression)."""
    sites, size = shape
    pieces = []
    for cut, first, last in at_ends(body, ends, sites):
        local = locals_of(cut)
        rows = tuple(sorted({row for x, row in local.items() if x.name[0] != "c"}))
        given = tuple(sorted({row for x, row in local.items() if x.name[0] == "c"}))
        places = {
            x: f"c{numbers + given.index(row)}" if x.name[0] == "c" else f"{LOCAL[x.name[0]]}{rows.index(row)}"
            for x, row in local.items()
        }
        graph = Graph()
        root = node_of(graph, cut.xreplace({x: type(x)(name, real=True) for x, name in places.items()}))
        pieces.append(Piece(graph, root, rows, given, numbers, first, last))
    return Sum(tuple(pieces), size)


# ---- in C ----------------------------------------------------------------------------------------------------------


def source(sums: Sequence[Sum], ends: str) -> str:
    """C functions that fill w[k * n + lane] with sum k, and one that calls them all."""
    text, calls = row_macro(ends), ""
    text += pair_loops.HEAD if any(piece.is_pair for total in sums for piece in total.pieces) else ""
    given, names = "IN, const ptrdiff_t sites, OUT sum", "t, w, q, p, c, sites, sum"
    for k, total in enumerate(sums):
        loops = ""
        for j, piece in enumerate(total.pieces):
            name, adds = f"sum_{k}_{j}", [("sum[i]", piece.root)]
            text += pair_loops.function(piece, Shape(total.size), name, adds, given=(given, ["sites", "sum"]))
            loops += pair_loops.call(piece, name, names)
        text += f"INLINE all_{k}({given}, const int far) {{\n   int64_t beyond = 0;\n"
        text += f"   memset(sum, 0, (size_t)n * sizeof(double));\n{loops}   return beyond;\n}}\n\n"
        text += f"static __attribute__((noinline)) void sum_{k}({given}) {{\n"
        text += f"   if (all_{k}(n, {names}, 0) < 0)\n      all_{k}(n, {names}, 1);\n}}\n\n"
        calls += f"   sum_{k}(n, t, q, q, p, c, {Shape(total.size).sites}, sums + {k} * (ptrdiff_t)n);\n"
    head = "static void all_sums(const int n, const double t, const double *q, const double *p, const double *c,\n"
    return f"{text}{head}                     const ptrdiff_t ndof, double *sums) {{\n{calls}}}\n"


# ---- without a compiler --------------------------------------------------------------------------------------------


def in_numpy(
    sums: Sequence[Sum], given: Mapping[str, Any], q: np.ndarray, p: np.ndarray, of_sites: np.ndarray
) -> np.ndarray:
    """The sums of (dof, lane) states, (sum, lane). given: values of all other leaves; of_sites: parameters
    (parameter, site) with a number for each site."""
    found = np.zeros((len(sums), q.shape[-1]))
    for k, total in enumerate(sums):
        count = len(q) // total.size
        for piece in total.pieces:
            for site in range(piece.first.of(count), piece.last.of(count) + 1):
                for other in range(site + 1, count) if piece.is_pair else (site,):
                    here = dict(given)
                    for j, row in enumerate(piece.rows):
                        at = total.size * (other if row.second else (site + row.offset) % count) + row.component
                        here |= {f"u{j}": q[at], f"v{j}": p[at]}
                    for j, row in enumerate(piece.given):
                        at = other if row.second else (site + row.offset) % count
                        here[f"c{piece.numbers + j}"] = of_sites[row.component, at]
                    found[k] += values_of(piece.graph, [piece.root], here, q.shape[-1])[0]
    return found
