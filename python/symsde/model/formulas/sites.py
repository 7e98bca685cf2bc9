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

import ast
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ...errors import InvalidArgumentError
from ...native import checks
from ...native.files import optional
from . import actions
from .collective import Outer, make_outer, split
from .derivatives import Derivatives
from .named_formulas import Names, Problem, quoted
from .parse import FormulaTextError, Reader, parse

MAX_SITES = 100_000
MAX_OFFSET = 8
ENDS = ("free", "fixed", "periodic")


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


@dataclass(frozen=True)
class Density:
    """The summand of a sum over sites."""

    weight: Number  #: Hamiltonian of the sum; for a family its first Hamiltonian
    family: bool  #: whether each site has its own Hamiltonian
    first: Place
    last: Place
    offsets: tuple[int, ...]  #: coordinate k of `derivatives` belongs to site + offsets[k]
    derivatives: Derivatives
    is_rest: bool = False  #: whether the density is the part beyond the ends of another density
    #: indices of the sums inside functions that the density adds to, one for each of its Hamiltonians; else empty
    inner: tuple[int, ...] = ()


@dataclass(frozen=True)
class Chain:
    """Sums over sites, and the results derived from them."""

    n: int
    nnoise: int
    ends: str
    densities: tuple[Density, ...]
    outer: Outer | None  #: functions of sums
    texts: tuple[str, ...]
    parameters: dict[str, float]
    traits: dict[str, Any]
    part: actions.Part | None  #: the quadratic part of H between kicks by functions of the actions


@dataclass(frozen=True)
class _Whose:
    """The formula that a density belongs to."""

    text: str
    weight: Number
    family: bool
    parameters: dict[str, float]


class SiteReader(Reader):
    """A parser that also reads q[i + 1], p[i] and Sum(.., i)."""

    def __init__(self, names: Mapping[str, Any], index: str | None = None):
        """`index`: the index in the brackets; "" means the first one found, None means that indices occur in sums
        only.
        """
        super().__init__(names)
        self.index = index
        self.sums: dict[Any, Any] = {}

    def read(self, node: ast.AST, depth: int) -> Any:
        """The expression of a node."""
        if isinstance(node, ast.Subscript):
            return self._site(node)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "Sum":
            return self._sum(node, depth)
        return super().read(node, depth)

    def _named(self, name: str) -> Any:
        if self.index and name == self.index:
            raise FormulaTextError(
                f"it takes {name} as a number: a term may depend on its site only by q[{name}] and p[{name}]; write a "
                "few sites with coefficients of their own as q1, q2, .. without n"
            )
        return super()._named(name)

    def _site(self, node: ast.Subscript) -> Any:
        """q[i + 1] as the coordinate at an offset."""
        letter = node.value.id if isinstance(node.value, ast.Name) else ""
        if letter not in ("q", "p"):
            raise FormulaTextError(
                "it holds an index of something that is not q or p: coefficients are the same at all sites; "
                "few sites that differ are written as q1, q2, .. without n"
            )
        name, offset = node.slice, 0
        if isinstance(name, ast.BinOp) and isinstance(name.op, ast.Add | ast.Sub):
            shift = name.right.value if isinstance(name.right, ast.Constant) else None
            if type(shift) is not int or shift > MAX_OFFSET:
                raise FormulaTextError(f"it holds an index that is not i, i + 1, .. i + {MAX_OFFSET}, i - 1, ..")
            offset = shift if isinstance(name.op, ast.Add) else -shift
            name = name.left
        if isinstance(name, ast.Name) and name.id in self.names:
            raise FormulaTextError(
                f"it holds the index [{name.id}], and {name.id} is a parameter: call the index by another letter, "
                f"as in {letter}[i], or rename the parameter"
            )
        if not isinstance(name, ast.Name):
            raise FormulaTextError(
                "it holds an index that is not i, i + 1, i - 1, ..: neighbours alone are tied, at all sites alike; "
                "few sites that differ are written as q1, q2, .. without n"
            )
        if self.index is None:
            raise FormulaTextError(f"it holds {letter}[{name.id}] outside of a sum: write Sum(.., {name.id})")
        if self.index == "":
            self.index = name.id  # the first index found in a family of noises
        if name.id != self.index:
            raise FormulaTextError(f"it holds the index {name.id}, where there is {self.index}")
        return self.sympy.Symbol(f"{letter}{offset:+d}", real=True)

    def _sum(self, node: ast.Call, depth: int) -> Any:
        if len(node.args) != 2 or node.keywords or not isinstance(node.args[1], ast.Name):
            raise FormulaTextError("it holds a Sum that is not written Sum(formula, i), over all sites by one index")
        if self.index:
            raise FormulaTextError(
                "it holds a Sum in a Sum, or beside an index: write sums over pairs by products of sums, as "
                "Sum(cos(q[i]), i)**2 + Sum(sin(q[i]), i)**2 for all cos(q[i]-q[j])"
            )
        index = node.args[1].id
        if index in self.names or index in ("q", "p"):
            means = "a parameter" if index in self.names else "a coordinate"
            raise FormulaTextError(
                f"it sums over {index}, which means something else, {means}: call the index by another letter, as in "
                "Sum(.., i)"
            )
        before, self.index = self.index, index
        body = self.read(node.args[0], depth + 1)
        self.index = before
        for known, same in self.sums.items():
            if same == body:
                return known
        stand_in = self.sympy.Dummy("Sum", real=True)
        self.sums[stand_in] = body
        return stand_in


def make_chain(*, H: Any, noise: list[Any], params: Any, t: Any, n: Any, ends: Any) -> Chain:
    """Read and differentiate sums over sites."""
    sympy = optional("sympy", "sympy")
    count = checks.integer("n", n)
    if not 2 <= count <= MAX_SITES:
        raise InvalidArgumentError(f"n = {count} sites for {quoted(str(H))}: give from 2 to {MAX_SITES}")
    checks.choice("ends", ends, ENDS)
    names = Names(sympy, {}, params, t, count)
    for letter in ("q", "p"):
        if letter in names.known:
            raise InvalidArgumentError(f"the name {letter!r} is a coordinate of sites: give the parameter another one")
    texts = [H, *noise]
    for text in texts:
        if not isinstance(text, str):
            raise InvalidArgumentError(f"{checks.shown(text)} is no text: sums over sites are written as text")
    densities, weight, inner, functions = [], Number(), {}, []
    for j, text in enumerate(texts):
        try:
            family, bodies, rest, sums = _bodies(text, names.known, is_noise=j > 0)
            for body in bodies if family else [part for whole in bodies for part in _apart(whole, ends)]:
                densities += _at_ends(body, _Whose(text, weight, family, names.values), ends, count)
            for stand_in in [x for x in sums if x in rest.free_symbols]:
                at_ends(sums[stand_in], ends, count)  # errors must name the formula that contains the sum
                symbol = sympy.Symbol(f"q{len(inner)}", real=True)
                rest = rest.xreplace({stand_in: inner.setdefault(sums[stand_in], symbol)})
            if rest != 0:
                functions.append((weight, rest, text))
            if j == len(texts) - 1:
                densities += _inner(list(inner), _Whose(", ".join(texts), Number(), False, names.values), ends, count)
        except FormulaTextError as error:
            raise InvalidArgumentError(f"the formula {quoted(text)} cannot be used: {error}") from None
        weight = weight.after(family)
    outer = make_outer(functions, len(inner), names.values) if functions else None
    traits = _traits(densities, outer, count, ends == "periodic")
    kicked = traits["position_noise"] and (traits["identity_mass"] or traits["constant_mass"])
    part = None if kicked else actions.of_sites(densities, count)
    if part and (split := part.at(list(names.values.values()))):
        traits |= {"split": split, "kicks": part.kicks}
    return Chain(
        n=count,
        nnoise=weight.of(count) - 1,
        ends=ends,
        densities=tuple(densities),
        outer=outer,
        texts=tuple(texts),
        parameters=names.values,
        traits=traits | {"touches": _touches(densities, outer, weight.of(count) - 1, count)},
        part=part,
    )


def _inner(bodies: list[Any], whose: _Whose, ends: str, count: int) -> list[Density]:
    """Densities of sums inside functions; sums over the same sites are computed together."""
    together: dict[tuple, list[tuple[int, Any]]] = {}
    for number, body in enumerate(bodies):
        for piece, first, last in at_ends(body, ends, count):
            if offsets := offsets_of(piece):
                together.setdefault((first, last, tuple(sorted({*offsets.values()}))), []).append((number, piece))
    made = []
    for (first, last, offsets), group in together.items():
        numbers, pieces = zip(*group, strict=True)
        made.append(Density(whose.weight, False, first, last, offsets, _differentiated(pieces, whose), inner=numbers))
    return made


def _bodies(text: str, names: Mapping[str, Any], is_noise: bool) -> tuple[bool, list[Any], Any, dict[Any, Any]]:
    """Split a formula: whether it is a family with one member per site; its densities; the rest in symbols, and
    their sums.
    """
    for family in (False, True) if is_noise else (False,):
        reader = SiteReader(names, "" if family else None)
        try:
            total = parse(text, names, reader)
        except FormulaTextError as error:
            if is_noise and not family and "outside of a sum" in str(error):
                continue
            raise
        if family:
            return True, [total], reader.sympy.Integer(0), {}
        if not reader.sums:
            raise FormulaTextError("it holds no Sum(.., i): with n sites, write sums over them")
        factors, rest = split(total, list(reader.sums))
        return False, [factor * reader.sums[x] for x, factor in factors.items()], rest, reader.sums
    raise AssertionError


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
        local.append(term.xreplace({x: sympy.Symbol(f"{x.name[0]}+0", real=True) for x in symbols}))
        if ends == "fixed":
            rest.append(term.xreplace(dict.fromkeys(symbols, sympy.Integer(0))))
            local[-1] -= rest[-1]
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
    pieces = [_density(whole[0], whose, *whole[1:])]
    pieces += [_density(cut, whose, first, last, is_rest=True) for cut, first, last in rest]
    return [x for x in pieces if x is not None]


def at_ends(body: Any, ends: str, count: int, every_site: bool = True) -> list[tuple[Any, Place, Place]]:
    """The summand with its first and last site: the complete one, then its remaining parts at fixed ends.
    every_site: also count sites beyond the ends that have neighbours in the chain."""
    symbols = offsets_of(body)
    if not symbols:
        raise FormulaTextError("it holds a sum without q[i] or p[i]: write the number of sites times the term instead")
    low, high = min(symbols.values()), max(symbols.values())
    before, after = max(0, -low), max(0, high)
    if before + after >= count:
        raise FormulaTextError(f"its neighbours reach over {before + after + 1} of {count} sites: give more sites")
    if ends == "periodic":
        return [(body, Place(0), Place(0, from_last=True))]
    pieces = [(body, Place(before), Place(-after, from_last=True))]
    if ends == "free":
        return pieces
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
    """The q and p of neighbouring sites that a body contains, each with its offset."""
    return {x: int(x.name[1:]) for x in body.free_symbols if _is_local(x)}


def _is_local(symbol: Any) -> bool:
    """Whether a symbol is q or p of a neighbouring site."""
    return symbol.name[1:2] in ("+", "-")


def _density(expression: Any, whose: _Whose, first: Place, last: Place, is_rest: bool = False) -> Density | None:
    """A density with its derivatives; None where it is constant."""
    offsets = tuple(sorted(set(offsets_of(expression).values())))
    if not offsets:
        return None
    return Density(whose.weight, whose.family, first, last, offsets, _differentiated((expression,), whose), is_rest)


def _differentiated(expressions: tuple[Any, ...], whose: _Whose) -> Derivatives:
    """Differentiate with respect to the density's own names q0 .. and p0 .."""
    sympy = optional("sympy", "sympy")
    local = {x: o for e in expressions for x, o in offsets_of(e).items()}
    offsets = sorted({*local.values()})
    places = {x: sympy.Symbol(f"{x.name[0]}{offsets.index(o)}", real=True) for x, o in local.items()}
    renamed = tuple(e.xreplace(places) for e in expressions)
    return Derivatives(Problem(renamed, (), (whose.text,), len(offsets), whose.parameters))


def _block(d: Density, name: str, j: int = 0) -> list[Any]:
    """Second derivatives of the j-th Hamiltonian of a density."""
    q, p = d.derivatives.problem.coordinates("q"), d.derivatives.problem.coordinates("p")
    rows, columns = {"qq": (q, q), "qp": (q, p), "pp": (p, p)}[name]
    return [d.derivatives.of(x, y)[j] for x in rows for y in columns]


def _slopes(d: Density, letter: str, j: int = 0) -> list[Any]:
    """First derivatives of the j-th Hamiltonian of a density."""
    return [d.derivatives.of(x)[j] for x in d.derivatives.problem.coordinates(letter)]


def _all_zero(densities: list[Density], *names: str) -> bool:
    return all(e == 0 for d in densities for name in names for e in _block(d, name))


def _state_free(e: Any, d: Density) -> bool:
    return not any(d.derivatives.problem.lanes[s.name] for s in getattr(e, "free_symbols", ()))


def _traits(densities: list[Density], outer: Outer | None, count: int, periodic: bool) -> dict[str, Any]:
    """Traits of the whole model, from derivatives that vanish identically."""
    plain = [d for d in densities if not d.inner]
    drift = [d for d in plain if d.weight.is_drift]
    noises = [d for d in plain if not d.weight.is_drift]
    kinetic = [d for d in drift if any(x != 0 for x in _slopes(d, "p"))]
    identity = len(kinetic) == 1 and kinetic[0].offsets == (0,)
    if identity:
        [d] = kinetic
        identity = d.derivatives.of("p0")[0] == d.derivatives.symbol["p0"]
    constant = len(kinetic) == 1 and kinetic[0].offsets == (0,) and not identity and _all_zero(kinetic, "qp")
    if constant:  # a number times p^2
        [d] = kinetic
        mass, p0 = d.derivatives.of("p0", "p0")[0], d.derivatives.symbol["p0"]
        timeless = not any(s.name == "t" for s in getattr(mass, "free_symbols", ()))
        constant = _state_free(mass, d) and timeless and (d.derivatives.of("p0")[0] - mass * p0).expand() == 0
    reach = max(d.offsets[-1] - d.offsets[0] for d in densities)
    traits = {
        "separable": _all_zero(densities, "qp"),
        "additive": _all_zero(noises, "qq", "qp", "pp"),
        "position_noise": all(x == 0 for d in noises for x in _slopes(d, "p")),
        "quadratic": all(_state_free(e, d) for d in plain for name in ("qq", "qp", "pp") for e in _block(d, name)),
        "identity_mass": identity,
        "constant_mass": constant,
        "diagonal_mass": constant,
        "bandwidth": reach if 2 * reach < count - 1 and not (periodic and reach) else None,
    }
    return (
        traits
        if outer is None
        else {key: left and traits[key] for key, left in _with_functions(densities, outer).items()}
    )


def _touches(densities: list[Density], outer: Outer | None, nnoise: int, count: int) -> list[list[int]]:
    """The sites, from 1, that each noise touches."""
    every = set(range(1, count + 1))
    found: list[set[int]] = [set() for _ in range(nnoise)]
    for d in densities:
        if d.inner or d.weight.is_drift:
            continue
        first = d.weight.of(count) - 1
        for site in range(d.first.of(count), d.last.of(count) + 1):
            found[first + (site if d.family else 0)] |= {(site + o) % count + 1 for o in d.offsets}
    for number in outer.numbers if outer else ():
        if not number.is_drift:
            found[number.of(count) - 1] = every
    return [sorted(x) for x in found]


def _with_functions(densities: list[Density], outer: Outer) -> dict[str, Any]:
    """The traits that remain valid in the presence of functions of sums."""
    places = [(d, j, number) for d in densities for j, number in enumerate(d.inner)]
    of_q, of_p = ({a for d, j, a in places if any(x != 0 for x in _slopes(d, letter, j))} for letter in "qp")
    bent = {a for d, j, a in places if any(e != 0 for name in ("qq", "qp", "pp") for e in _block(d, name, j))}
    mixed = {a for d, j, a in places if any(e != 0 for e in _block(d, "qp", j))}
    drift, noise = outer.used(True), outer.used(False)
    return {
        "separable": not mixed
        and not any((a in of_q and b in of_p) or (a in of_p and b in of_q) for a, b in outer.pairs),
        "additive": not noise,
        "position_noise": not noise & of_p,
        "quadratic": outer.is_quadratic() and not (drift | noise) & bent,
        "identity_mass": not drift & of_p,
        "constant_mass": not drift & of_p,
        "diagonal_mass": not drift & of_p,
        "bandwidth": None if drift | noise else True,
    }
