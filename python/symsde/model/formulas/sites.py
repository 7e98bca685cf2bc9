# SPDX-License-Identifier: BSD-3-Clause
"""Chains: sums over sites, Sum((q[i+1] - q[i])**2/2, i), which stay loops for any number of sites.

A sum is a density in the coordinates of a few neighbouring sites. The density is differentiated once, whatever the
number of sites; generated code loops over sites and adds to the rows of the neighbours. At the ends

    free       the sum is over the sites whose neighbours all exist
    fixed      q and p beyond the ends are zero: a density counts if one of its sites exists, so that the bonds before
               the first site and after the last one count
    periodic   the first site follows the last

A noise with an index outside of a sum, "-sigma*q[k]", is one noise for each site. Formulas other than sums of terms
number * Sum(.., i) make their sums collective variables (`collective.py`). What is read becomes a chain (`chain.py`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...errors import InvalidArgumentError, WrongShapeError
from ...native import checks
from ...native.files import optional
from . import kinks, site_parts
from .chain import Chain, Density
from .collective import make_outer, split
from .derivatives import Derivatives
from .named_formulas import Names, Problem, quoted
from .parse import FormulaTextError, check_name, folded, parse
from .site_ends import apart, at_ends, offsets_of
from .site_reader import Number, Place, Row, SiteReader, locals_of, rows_of
from .site_traits import touches_of, traits_of

MAX_SITES = 100_000
MAX_COMPONENTS = 8  #: most coordinates of a site: a pair has twice as many, and their third derivatives
ENDS = ("free", "fixed", "periodic")


@dataclass(frozen=True)
class Owner:
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
    rows = fixed_rows(fixed, arrays, list(names.values))
    texts = [H, *noise]
    for text in texts:
        if not isinstance(text, str):
            raise InvalidArgumentError(f"{checks.shown(text)} is no text: sums over sites are written as text")
    densities, weight, inner, functions, kinked = [], Number(), {}, [], []
    for j, text in enumerate(texts):
        try:
            family, bodies, rest, sums = _bodies(text, (names.known, components, arrays), is_noise=j > 0)
            kinked += [j] if any(kinks.moving(x) for x in bodies) else []
            for body in bodies if family else [part for whole in bodies for part in apart(whole, ends)]:
                densities += _at_ends(body, Owner(text, weight, family, names.values, rows), ends, count)
            for stand_in in [x for x in sums if x in rest.free_symbols]:
                at_ends(sums[stand_in], ends, count)  # errors must name the formula that contains the sum
                symbol = sympy.Symbol(f"q{len(inner)}", real=True)
                rest = rest.xreplace({stand_in: inner.setdefault(sums[stand_in], symbol)})
            for symbol in sorted((x for x in rest.free_symbols if x.name in rows), key=str):
                rest = rest.xreplace({symbol: inner.setdefault(symbol, sympy.Symbol(f"q{len(inner)}", real=True))})
            if rest != 0:
                functions.append((weight, rest, text))
            if j == len(texts) - 1:
                whole = Owner(", ".join(texts), Number(), False, names.values, rows)
                densities += inner_densities(list(inner), whole, ends, count)
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
        return [d for body in bodies for d in _at_ends(body, Owner(text, Number(), False, values, {}), ends, count)]
    except FormulaTextError as error:
        raise InvalidArgumentError(f"split = {quoted(text)} cannot be used: {error}") from None


def fixed_rows(fixed: tuple[str, ...], arrays: tuple[str, ...], names: list[str]) -> dict[Any, Row]:
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


def inner_densities(bodies: list[Any], owner: Owner, ends: str, count: int) -> list[Density]:
    """Densities of sums inside functions, together those over the same sites; a number of a fixed row is one, too."""
    together: dict[tuple, list[tuple[int, Any]]] = {}
    made = []
    for number, body in enumerate(bodies):
        if body.is_Symbol and body.name in owner.fixed:
            made.append(_derived((body,), owner, Place(0), Place(0), inner=(number,)))
            continue
        for piece, first, last in at_ends(body, ends, count):
            if rows := rows_of(piece):
                key = first, last, *sorted({(row.second, row.offset) for row in rows.values()})
                together.setdefault(key, []).append((number, piece))
    for (first, last, *_), group in together.items():
        numbers, pieces = zip(*group, strict=True)
        made.append(_derived(pieces, owner, first, last, inner=numbers))
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


def _at_ends(body: Any, owner: Owner, ends: str, count: int) -> list[Density]:
    """A density, and its remaining parts at the ends of the chain."""
    if ends == "free" and owner.family and set(offsets_of(body).values()) - {0}:
        raise FormulaTextError("one noise for each site reaches beyond free ends: say ends = fixed or periodic")
    whole, *rest = at_ends(body, ends, count, every_site=not owner.family)
    pieces = [_derived((whole[0],), owner, *whole[1:])]
    pieces += [_derived((cut,), owner, first, last, is_rest=True) for cut, first, last in rest if rows_of(cut)]
    return pieces


def _derived(expressions: Sequence[Any], owner: Owner, first: Place, last: Place, **more: Any) -> Density:
    """A density, differentiated with respect to its own names q0 .. and p0 .."""
    sympy = optional("sympy", "sympy")
    local = {x: row for e in expressions for x, row in locals_of(e).items()}
    held = {x: row for x, row in local.items() if x.name[0] == "c"}
    still = {
        x: replace(owner.fixed[row.component], second=row.second, offset=row.offset)
        for x, row in held.items()
        if row.component in owner.fixed
    }
    still |= {x: owner.fixed[x.name] for e in expressions for x in e.free_symbols if x.name in owner.fixed}
    rows = [*sorted({row for x, row in local.items() if x not in held}), *sorted({*still.values()})]
    given = sorted({row for x, row in held.items() if x not in still})
    places = {x: f"{x.name[0]}{rows.index(row)}" for x, row in local.items() if x not in held}
    places |= {x: f"{'p' if x.name[0] == 'p' else 'q'}{rows.index(row)}" for x, row in still.items()}
    places |= {x: f"c{len(owner.parameters) + given.index(row)}" for x, row in held.items() if x not in still}
    places = {x: sympy.Symbol(name, real=True) for x, name in places.items()}
    renamed = tuple(e.xreplace(places) for e in expressions)
    parameters = owner.parameters | {f"{k} of a site": 0.0 for k in range(len(given))}
    kinked = any(e.has(sympy.Piecewise) for e in renamed)
    made = Derivatives(Problem(renamed, (), (owner.text,), len(rows), parameters), folds=kinked)
    weight, family = owner.weight, owner.family
    return Density(weight, family, first, last, tuple(rows), made, given=tuple(given), **more)
