# SPDX-License-Identifier: BSD-3-Clause
"""The ends of a chain: which sites a summand counts at, and what is left of it where neighbours do not exist."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from ...native.files import optional
from .parse import FormulaTextError
from .site_reader import Place, local_symbol, locals_of, rows_of


def apart(body: Any, ends: str) -> list[Any]:
    """A summand in two with the same sum: terms that touch one site each, as of q[i], and all others.

    It stays whole at free ends, where a bond's sites are not all sites, and where the value of a term at zero, which
    fixed ends count beyond them, has no other terms to stand with.
    """
    sympy = optional("sympy", "sympy")
    symbols = offsets_of(body)
    if ends == "free" or not set(symbols.values()) - {0}:
        return [body]
    local, rest = [], []
    for term in _terms(body, symbols):
        shifts = {o for x, o in symbols.items() if x in term.free_symbols}
        if len(shifts) != 1:
            rest.append(term)
            continue
        here = {x: local_symbol(x.name[0], replace(row, offset=0)) for x, row in locals_of(body).items()}
        local.append(term.xreplace(here))
        still = term.xreplace(dict.fromkeys(rows_of(body), sympy.Integer(0)))
        if ends == "fixed" and not locals_of(still):  # numbers of sites have no value beyond the ends
            rest.append(still)
            local[-1] -= still
    own, others = sympy.Add(*local), sympy.Add(*rest)
    if not offsets_of(own) or (others != 0 and not offsets_of(others)):
        return [body]
    return [x for x in (own, others) if x != 0]


def _terms(e: Any, symbols: Any) -> list[Any]:
    """The terms of a sum, also of one that is multiplied by what no site has."""
    factor, own = e.as_independent(*symbols, as_Add=False)
    if not own.is_Add:
        return [e]
    return [x for term in own.args for x in _terms(factor * term, symbols)]


def at_ends(body: Any, ends: str, count: int, every_site: bool = True) -> list[tuple[Any, Place, Place]]:
    """The summand with its first and last site: the complete one, then its remaining parts at fixed ends.
    every_site: also count sites beyond the ends that have neighbours in the chain."""
    symbols = offsets_of(body)
    if not rows_of(body):
        raise FormulaTextError("it holds a sum without q[i] or p[i]: write the number of sites times the term instead")
    if any(row.second for row in locals_of(body).values()):  # pairs have no ends
        return [(body, Place(0), Place(-1, from_last=True))]
    low, high = min(symbols.values()), max(symbols.values())
    before, after = max(0, -low), max(0, high)
    if before + after >= count:
        raise FormulaTextError(f"its neighbours reach over {before + after + 1} of {count} sites: give more sites")
    if ends == "periodic":
        return [(body, Place(0), Place(0, from_last=True))]
    pieces = [(body, Place(before), Place(-after, from_last=True))]
    if ends == "free":
        return pieces
    if (low or high) and len(symbols) > len(rows_of(body)):
        raise FormulaTextError(
            "it ties neighbours by a parameter with a number for each site, which has none beyond fixed ends: say "
            "ends = free or periodic, and write bonds to walls as terms of single sites"
        )
    for site in range(-high if every_site else 0, before):  # some neighbours lie before the first site
        cut = body.xreplace({x: 0 for x, o in symbols.items() if site + o < 0})
        pieces.append((cut, Place(site), Place(site)))
    for back in range(1 - after, 1 - low if every_site else 1):  # some neighbours lie beyond the last site
        cut = body.xreplace({x: 0 for x, o in symbols.items() if back + o > 0})
        pieces.append((cut, Place(back, from_last=True), Place(back, from_last=True)))
    sympy = optional("sympy", "sympy")
    if any(cut.has(sympy.nan, sympy.oo, -sympy.oo, sympy.zoo) for cut, *_ in pieces):
        raise FormulaTextError(
            "it is not finite beyond fixed ends, where q and p are zero: write terms of single sites, as 1/q[i], in a "
            "sum of their own"
        )
    return pieces


def row_macro(ends: str) -> str:
    """C for the row of a neighbour. In a ring a comparison wraps the index: neighbours are less than one turn away
    (at_ends), and a division for each of them would take longer than most forces."""
    if ends != "periodic":
        return "#define ROW(offset) (site + (offset))\n"
    behind = "site + (offset) >= sites ? site + (offset) - sites"
    before = "site + (offset) < 0 ? site + (offset) + sites"
    return f"#define ROW(offset) ({behind} : {before} : site + (offset))\n"


def offsets_of(body: Any) -> dict[Any, int]:
    """The coordinates, momenta and parameters of neighbouring sites that a body contains, each with its offset."""
    return {x: row.offset for x, row in locals_of(body).items()}
