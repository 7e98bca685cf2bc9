# SPDX-License-Identifier: BSD-3-Clause
"""Sums over sites in observables, Sum(q[i]**2, i): loops in C for any number of sites, added in the order of sites.

An observable may be any formula of such sums. Summands are read as in chains (`sites.py`), with the same
rule at the ends; the sums of all lanes are computed first, and are leaves w0, w1, .. of the observable's graph.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .emit_c import Writer
from .graph import Graph
from .in_numpy import values_of
from .parse import FormulaTextError
from .site_reader import locals_of
from .sites import Place, at_ends, offsets_of, row_macro

#: letters of a site's coordinates in graphs: u0, v0 at the first offset, u1, v1 .. at the next ones
LOCAL = {"q": "u", "p": "v"}


@dataclass(frozen=True)
class Piece:
    """The summand of a sum over some of the sites."""

    graph: Graph
    root: int
    offsets: tuple[int, ...]  #: u0, v0 belong to site + offsets[0]
    first: Place
    last: Place


Sum = tuple[Piece, ...]  #: pieces for the interior of the chain and for its ends


def make_sum(body: Any, ends: str, count: int, node_of: Any) -> Sum:
    """A sum over `count` sites; node_of: adds an expression to a graph, node_of(graph, expression)."""
    if any(row.second for row in locals_of(body).values()):
        raise FormulaTextError("it sums over pairs, which observables do not: compute it from saved paths")
    pieces = []
    for cut, first, last in at_ends(body, ends, count):
        local = offsets_of(cut)
        offsets = tuple(sorted(set(local.values())))
        places = {x: type(x)(f"{LOCAL[x.name[0]]}{offsets.index(o)}", real=True) for x, o in local.items()}
        graph = Graph()
        pieces.append(Piece(graph, node_of(graph, cut.xreplace(places)), offsets, first, last))
    return tuple(pieces)


# ---- in C ----------------------------------------------------------------------------------------------------------


def source(sums: Sequence[Sum], ends: str) -> str:
    """C functions that fill w[k * n + lane] with sum k, and one that calls them all."""
    text, calls = row_macro(ends), ""
    given, names = "IN, const ptrdiff_t sites, OUT sum", "n, t, w, q, p, c, sites, sum"
    for k, pieces in enumerate(sums):
        loops = ""
        for j, piece in enumerate(pieces):
            text += f"INLINE sum_{k}_{j}({given}, const ptrdiff_t site, const int far) {{\n{_site(piece)}}}\n\n"
            loops += f"   for (ptrdiff_t site = {piece.first}; site <= {piece.last}; site++)\n"
            loops += f"      beyond |= sum_{k}_{j}({names}, site, far);\n"
        text += f"INLINE all_{k}({given}, const int far) {{\n   int64_t beyond = 0;\n"
        text += f"   memset(sum, 0, (size_t)n * sizeof(double));\n{loops}   return beyond;\n}}\n\n"
        text += f"static __attribute__((noinline)) void sum_{k}({given}) {{\n"
        text += f"   if (all_{k}({names}, 0) < 0)\n      all_{k}({names}, 1);\n}}\n\n"
        calls += f"   sum_{k}(n, t, NULL, q, p, c, sites, sums + {k} * (ptrdiff_t)n);\n"
    head = "static void all_sums(const int n, const double t, const double *q, const double *p, const double *c,\n"
    return f"{text}{head}                     const ptrdiff_t sites, double *sums) {{\n{calls}}}\n"


def _site(piece: Piece) -> str:
    """One site: a loop over lanes that adds to the sum."""

    def load(name: str) -> str:
        letter, number = name.rstrip("0123456789"), int(name.lstrip("uvqp"))
        if letter in "uv":
            return f"{'q' if letter == 'u' else 'p'}[ROW({piece.offsets[number]}) * n + i]"
        return f"{letter}[{number} * (ptrdiff_t)n + i]"

    writer = Writer(piece.graph, load)
    before, inside, _ = writer.lines([piece.root])
    head = ["   int64_t beyond = 0;", *before, "#pragma GCC ivdep", "   for (int i = 0; i < n; i++) {", *inside]
    return "\n".join([*head, f"      sum[i] += {writer.operand(piece.root)};", "   }", "   return beyond;", ""])


# ---- without a compiler --------------------------------------------------------------------------------------------


def in_numpy(sums: Sequence[Sum], given: Mapping[str, Any], q: np.ndarray, p: np.ndarray) -> np.ndarray:
    """The sums of (dof, lane) states, (sum, lane); given: values of all other leaves."""
    count, lanes = q.shape
    found = np.zeros((len(sums), lanes))
    for k, pieces in enumerate(sums):
        for piece in pieces:
            for site in range(piece.first.of(count), piece.last.of(count) + 1):
                here = dict(given)
                for j, offset in enumerate(piece.offsets):
                    here |= {f"u{j}": q[(site + offset) % count], f"v{j}": p[(site + offset) % count]}
                found[k] += values_of(piece.graph, [piece.root], here, lanes)[0]
    return found
