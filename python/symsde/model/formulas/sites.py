# SPDX-License-Identifier: BSD-3-Clause
"""Chains: sums over sites, Sum((q[i+1] - q[i])**2/2, i), which stay loops for any number of sites.

A sum is a density in the coordinates of a few neighbouring sites. The density is differentiated once, whatever the
number of sites; generated code loops over sites and adds to the rows of the neighbours. At the ends

    free       the sum is over the sites whose neighbours all exist
    fixed      q and p beyond the ends are zero: a density counts if one of its sites exists, so that the bonds before
               the first site and after the last one count
    periodic   the first site follows the last

A noise with an index outside of a sum, "-sigma*q[k]", is one noise for each site. Formulas other than sums of terms
number * Sum(.., i) make their sums collective variables (`collective.py`).
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from ...errors import InvalidArgumentError, WrongShapeError
from ...native import checks
from ...native.files import optional
from . import kinks, site_parts
from .collective import Outer, make_outer, split
from .derivatives import Derivatives
from .graph import Graph
from .named_formulas import Names, Problem, quoted
from .parse import FormulaTextError, check_name, folded, parse
from .site_reader import Number, Place, Row, Shape, SiteReader, local_symbol, locals_of, rows_of
from .site_traits import touches_of, traits_of

MAX_SITES = 100_000
MAX_COMPONENTS = 8  #: most coordinates of a site: a pair has twice as many, and their third derivatives
ENDS = ("free", "fixed", "periodic")


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
    part: site_parts.Part | None  #: the quadratic part of H between kicks
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


@dataclass(frozen=True)
class _Whose:
    """The formula that a density belongs to."""

    text: str
    weight: Number
    family: bool
    parameters: dict[str, Any]
    fixed: dict[Any, Row]  #: parameters that are positions: name of a number, or place of one of sites -> row


def make_chain(
    *,
    H: Any,
    noise: list[Any],
    params: Any,
    t: Any,
    n: Any,
    ends: Any,
    components: Any = None,
    split: Any = None,
    fixed: Sequence[str] = (),
) -> Chain:
    """Read and differentiate sums over sites; components: names of the coordinates and of the momenta of a site; split:
    a quadratic part of H by hand; fixed: parameters that are positions which do not move (`wide.py`).
    """
    sympy = optional("sympy", "sympy")
    count = checks.integer("n", n)
    if not 2 <= count <= MAX_SITES:
        raise InvalidArgumentError(f"n = {count} sites for {quoted(str(H))}: give from 2 to {MAX_SITES}")
    checks.choice("ends", ends, ENDS)
    names = Names(sympy, {}, params, t, count)
    components = _components(components, names, count)
    arrays = _arrays(names.values, count)
    fixed = tuple(sorted(fixed, key=lambda x: x not in arrays))
    rows = _fixed_rows(fixed, arrays, list(names.values))
    texts = [H, *noise]
    for text in texts:
        if not isinstance(text, str):
            raise InvalidArgumentError(f"{checks.shown(text)} is no text: sums over sites are written as text")
    densities, weight, inner, functions, kinked = [], Number(), {}, [], []
    for j, text in enumerate(texts):
        try:
            family, bodies, rest, sums = _bodies(text, (names.known, components, arrays), is_noise=j > 0)
            kinked += [j] if any(kinks.moving(x) for x in bodies) else []
            for body in bodies if family else [part for whole in bodies for part in _apart(whole, ends)]:
                densities += _at_ends(body, _Whose(text, weight, family, names.values, rows), ends, count)
            for stand_in in [x for x in sums if x in rest.free_symbols]:
                at_ends(sums[stand_in], ends, count)  # errors must name the formula that contains the sum
                symbol = sympy.Symbol(f"q{len(inner)}", real=True)
                rest = rest.xreplace({stand_in: inner.setdefault(sums[stand_in], symbol)})
            for symbol in sorted((x for x in rest.free_symbols if x.name in rows), key=str):
                rest = rest.xreplace({symbol: inner.setdefault(symbol, sympy.Symbol(f"q{len(inner)}", real=True))})
            if rest != 0:
                functions.append((weight, rest, text))
            if j == len(texts) - 1:
                whole = _Whose(", ".join(texts), Number(), False, names.values, rows)
                densities += _inner(list(inner), whole, ends, count)
        except FormulaTextError as error:
            raise InvalidArgumentError(f"the formula {quoted(text)} cannot be used: {error}") from None
        weight = weight.after(family)
    outer = make_outer(functions, len(inner), names.values) if functions else None
    size = len(components[0])
    traits = traits_of(densities, outer, (count, size), ends == "periodic")
    kicked = traits["position_noise"] and (traits["identity_mass"] or traits["constant_mass"])
    chain = Chain(
        n=count,
        components=components,
        arrays=arrays,
        nnoise=weight.of(count) - 1,
        ends=ends,
        densities=tuple(densities),
        outer=outer,
        texts=tuple(texts),
        parameters=names.values,
        kinked=tuple(kinked),
        traits=traits | {"touches": touches_of(densities, outer, weight.of(count) - 1, (count, size))},
        part=None,
        fixed=fixed,
    )
    if fixed:
        return _with_positions(chain)
    if any(kinked) and not traits["position_noise"]:
        raise InvalidArgumentError(kinks.REFUSED.format(quoted(texts[max(kinked)])))
    form = _form(split, (names.known, components, arrays), names.values, ends, count)
    return _with_part(chain, form, is_sought=not (kicked or any(kinked)))


def _with_part(chain: Chain, form: list[Density], is_sought: bool) -> Chain:
    """The chain with the quadratic part that is given, or found if it is sought."""
    known = list(chain.parameters)
    sites = site_parts.Sites(chain.n, chain.size, tuple(known.index(x) for x in chain.arrays))
    part, why = None, ""
    if form:
        part = site_parts.given(form, chain.densities, sites)
    elif is_sought:
        part, why = site_parts.found(chain.densities, sites)
    if part and (second := part.at(list(chain.parameters.values()))):
        return replace(chain, part=part, traits={**chain.traits, "split": second, "kicks": part.kicks})
    return replace(chain, unsplit=why)


def _form(
    text: Any, known: tuple[Mapping[str, Any], Any, Any], values: dict[str, Any], ends: str, count: int
) -> list[Density]:
    """The summands of a quadratic part that is given as sums over sites; none without one."""
    if text is None:
        return []
    if not isinstance(text, str):
        raise InvalidArgumentError(f"split = {checks.shown(text)} is no text: sums over sites are written as text")
    try:
        _, bodies, rest, _ = _bodies(text, known, is_noise=False)
        if rest != 0:
            raise FormulaTextError("it is no sum of terms number * Sum(.., i), as a quadratic form of sites is")
        return [d for body in bodies for d in _at_ends(body, _Whose(text, Number(), False, values, {}), ends, count)]
    except FormulaTextError as error:
        raise InvalidArgumentError(f"split = {quoted(text)} cannot be used: {error}") from None


def _fixed_rows(fixed: tuple[str, ...], arrays: tuple[str, ...], names: list[str]) -> dict[Any, Row]:
    """The rows of parameters that are positions: by the number among arrays, or by the internal name of a number."""
    of_sites = [x for x in fixed if x in arrays]
    found: dict[Any, Row] = {arrays.index(x): Row(component=k, fixed="site") for k, x in enumerate(of_sites)}
    alone = fixed[len(of_sites) :]
    return found | {f"c{names.index(x)}": Row(component=k, fixed="all") for k, x in enumerate(alone)}


def _with_positions(chain: Chain) -> Chain:
    """The chain whose parameters are positions, of which nothing is proved but what steps of it are chosen by."""
    unknown = {"bandwidth": None, "touches": None}
    unknown |= dict.fromkeys(("identity_mass", "constant_mass", "diagonal_mass"), False)
    return replace(chain, traits=chain.traits | unknown)


def _components(given: Any, names: Names, count: int) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names of the coordinates and momenta of a site, q and p by default."""
    own = tuple(tuple(map(folded, x)) for x in given or (("q",), ("p",)))
    every = [x for letter in own for x in letter]
    if len(own[0]) != len(own[1]) or not own[0]:
        raise InvalidArgumentError(
            f"q names {len(own[0])} coordinates of a site and p {len(own[1])} momenta: give as many of each"
        )
    if len(own[0]) > MAX_COMPONENTS or len(own[0]) * count > MAX_SITES:
        raise InvalidArgumentError(
            f"q names {len(own[0])} coordinates of each of {count} sites: allowed are {MAX_COMPONENTS}, and "
            f"{MAX_SITES} at all sites together; the names stand for coordinates of one site, as q='x y z'"
        )
    for x in every:
        check_name(x)
        if x in names.known or every.count(x) > 1:
            raise InvalidArgumentError(f"the name {x!r} is a coordinate of sites: give the parameter another one")
    return own


def _arrays(values: dict[str, Any], count: int) -> tuple[str, ...]:
    """The parameters with a number for each site, whose values become tuples."""
    found = tuple(x for x, value in values.items() if np.ndim(value))
    for x in found:
        values[x] = by_site(x, values[x], count)
    return found


def by_site(name: str, value: Any, count: int) -> tuple[float, ...]:
    """The values of a parameter at all sites."""
    if np.shape(value) != (count,):
        raise WrongShapeError(
            f"the parameter {name} has {np.size(value)} value{'s' * (np.size(value) != 1)} for {count} sites: in sums "
            "over sites an array holds a number for each site; for parameters that differ by path make a run for each "
            "value"
        )
    return tuple(np.asarray(value, dtype=float).tolist())


def _inner(bodies: list[Any], whose: _Whose, ends: str, count: int) -> list[Density]:
    """Densities of sums inside functions, together those over the same sites; a number of a fixed row is one, too."""
    together: dict[tuple, list[tuple[int, Any]]] = {}
    made = []
    for number, body in enumerate(bodies):
        if body.is_Symbol and body.name in whose.fixed:
            made.append(_derived((body,), whose, Place(0), Place(0), inner=(number,)))
            continue
        for piece, first, last in at_ends(body, ends, count):
            if rows := rows_of(piece):
                key = first, last, *sorted({(row.second, row.offset) for row in rows.values()})
                together.setdefault(key, []).append((number, piece))
    for (first, last, *_), group in together.items():
        numbers, pieces = zip(*group, strict=True)
        made.append(_derived(pieces, whose, first, last, inner=numbers))
    return made


def _bodies(
    text: str, known: tuple[Mapping[str, Any], Any, Any], is_noise: bool
) -> tuple[bool, list[Any], Any, dict[Any, Any]]:
    """Split a formula: whether it is a family with one member per site; its densities; the rest in symbols, and
    their sums.
    """
    names, components, arrays = known
    for family in (False, True) if is_noise else (False,):
        reader = SiteReader(names, "" if family else None, components, arrays)
        try:
            total = parse(text, names, reader)
        except FormulaTextError as error:
            if is_noise and not family and "outside of a sum" in str(error):
                continue
            raise
        if family:
            if not rows_of(total):
                raise FormulaTextError("it holds no coordinate of its site: one noise for each site is written as q[k]")
            return True, [_in_cases(total, text)], reader.sympy.Integer(0), {}
        if not reader.sums:
            raise FormulaTextError("it holds no Sum(.., i): with n sites, write sums over them")
        factors, rest = split(total, list(reader.sums))
        sums = {x: _in_cases(body, text) for x, body in reader.sums.items()}
        if _in_cases(rest, text).has(*kinks.kinds()) or any(kinks.moving(sums[x]) for x in rest.free_symbols & {*sums}):
            raise FormulaTextError(
                "it holds a kink or jump in a function of sums: kinks may stand in summands alone, or write it smoothly"
            )
        return False, [factor * sums[x] for x, factor in factors.items()], rest, sums
    raise AssertionError


def _in_cases(e: Any, text: str) -> Any:
    """The expression with its kinks as cases."""
    e = kinks.in_cases(e)
    kinks.require_cases(e, quoted(text))
    return e


def _apart(body: Any, ends: str) -> list[Any]:
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


def _at_ends(body: Any, whose: _Whose, ends: str, count: int) -> list[Density]:
    """A density, and its remaining parts at the ends of the chain."""
    if ends == "free" and whose.family and set(offsets_of(body).values()) - {0}:
        raise FormulaTextError("one noise for each site reaches beyond free ends: say ends = fixed or periodic")
    whole, *rest = at_ends(body, ends, count, every_site=not whose.family)
    pieces = [_derived((whole[0],), whose, *whole[1:])]
    pieces += [_derived((cut,), whose, first, last, is_rest=True) for cut, first, last in rest if rows_of(cut)]
    return pieces


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


def _derived(expressions: Sequence[Any], whose: _Whose, first: Place, last: Place, **more: Any) -> Density:
    """A density, differentiated with respect to its own names q0 .. and p0 .."""
    sympy = optional("sympy", "sympy")
    local = {x: row for e in expressions for x, row in locals_of(e).items()}
    held = {x: row for x, row in local.items() if x.name[0] == "c"}
    still = {
        x: replace(whose.fixed[row.component], second=row.second, offset=row.offset)
        for x, row in held.items()
        if row.component in whose.fixed
    }
    still |= {x: whose.fixed[x.name] for e in expressions for x in e.free_symbols if x.name in whose.fixed}
    rows = [*sorted({row for x, row in local.items() if x not in held}), *sorted({*still.values()})]
    given = sorted({row for x, row in held.items() if x not in still})
    places = {x: f"{x.name[0]}{rows.index(row)}" for x, row in local.items() if x not in held}
    places |= {x: f"{'p' if x.name[0] == 'p' else 'q'}{rows.index(row)}" for x, row in still.items()}
    places |= {x: f"c{len(whose.parameters) + given.index(row)}" for x, row in held.items() if x not in still}
    places = {x: sympy.Symbol(name, real=True) for x, name in places.items()}
    renamed = tuple(e.xreplace(places) for e in expressions)
    parameters = whose.parameters | {f"{k} of a site": 0.0 for k in range(len(given))}
    kinked = any(e.has(sympy.Piecewise) for e in renamed)
    made = Derivatives(Problem(renamed, (), (whose.text,), len(rows), parameters), folds=kinked)
    weight, family = whose.weight, whose.family
    return Density(weight, family, first, last, tuple(rows), made, given=tuple(given), **more)
