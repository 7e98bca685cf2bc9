# SPDX-License-Identifier: BSD-3-Clause
"""Traits of sums over sites: what vanishes identically in the derivatives of their summands."""

from __future__ import annotations

from typing import Any

from . import kinks
from .chain import Density
from .collective import Outer


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


def is_quadratic(d: Density) -> bool:
    """Whether second derivatives of a density do not depend on the state."""
    return all(_state_free(e, d) for name in ("qq", "qp", "pp") for e in _block(d, name))


def traits_of(densities: list[Density], outer: Outer | None, shape: tuple[int, int], periodic: bool) -> dict[str, Any]:
    """Traits of the whole model, from derivatives that vanish identically; shape: sites, and coordinates of each."""
    count, size = shape
    plain = [d for d in densities if not d.inner]
    drift = [d for d in plain if d.weight.is_drift]
    noises = [d for d in plain if not d.weight.is_drift]
    kinked = [names for d in densities for names in _kinked(d)]
    identity, constant, diagonal = _mass([d for d in drift if any(x != 0 for x in _slopes(d, "p"))], size)
    places = [[row.offset * size + row.component for row in d.rows] for d in densities]
    reach = max(max(x) - min(x) for x in places)
    if any(d.is_pair for d in densities):
        reach = count * size
    traits = {
        "separable": _all_zero(densities, "qp") and not any({x[0] for x in names} >= {*"qp"} for names in kinked),
        "additive": _all_zero(noises, "qq", "qp", "pp") and not any(_kinked(d) for d in noises),
        "position_noise": all(x == 0 for d in noises for x in _slopes(d, "p")),
        "quadratic": not kinked and all(map(is_quadratic, plain)),
        "identity_mass": identity,
        "constant_mass": constant,
        "diagonal_mass": diagonal,
        "bandwidth": reach if 2 * reach < count * size - 1 and not (periodic and reach) else None,
    }
    return (
        traits
        if outer is None
        else {key: left and traits[key] for key, left in _with_functions(densities, outer).items()}
    )


def _kinked(d: Density) -> list[set[str]]:
    """Names of the coordinates and momenta that meet at each kink of a density."""
    return [names for h in d.derivatives.problem.hamiltonians for names in kinks.moving(h)]


def _mass(kinetic: list[Density], size: int) -> tuple[bool, bool, bool]:
    """Whether H = p.p/2 + U(q); else whether H = p.M p/2 + U(q) with a matrix M of constants, and a diagonal one."""
    if any(d.is_pair or any(d.offsets) for d in kinetic) or not _all_zero(kinetic, "qp") or not kinetic:
        return False, False, False
    if any(x[0] == "p" for d in kinetic for names in _kinked(d) for x in names):
        return False, False, False
    mass: dict[tuple[int, int], Any] = {}
    for d in kinetic:
        p, known = d.derivatives.problem.coordinates("p"), d.derivatives.symbol
        first = len(d.derivatives.problem.parameters) - len(d.given)
        named = {known[f"c{first + k}"]: d.derivatives._engine.Symbol(str(row)) for k, row in enumerate(d.given)}
        for x, row in zip(p, d.rows, strict=True):
            entries = [d.derivatives.of(x, y)[0] for y in p]
            if not all(_state_free(e, d) and not any(s.name == "t" for s in e.free_symbols) for e in entries):
                return False, False, False
            rest = d.derivatives.of(x)[0] - sum(e * known[y] for e, y in zip(entries, p, strict=True))
            if rest.expand() != 0:
                return False, False, False
            for e, other in zip(entries, d.rows, strict=True):
                at = row.component, other.component
                mass[at] = mass.get(at, 0) + e.subs(named)
    every = [(i, j, mass.get((i, j), 0)) for i in range(size) for j in range(size)]
    identity = all((e - int(i == j)) == 0 for i, j, e in every)
    return identity, not identity, not identity and all(e == 0 for i, j, e in every if i != j)


def touches_of(densities: list[Density], outer: Outer | None, nnoise: int, shape: tuple[int, int]) -> list[list[int]]:
    """The degrees of freedom, from 1, that each noise touches."""
    count, size = shape
    every = set(range(1, count * size + 1))
    found: list[set[int]] = [set() for _ in range(nnoise)]
    for d in densities:
        if d.inner or d.weight.is_drift:
            continue
        first = d.weight.of(count) - 1
        for site in range(d.first.of(count), d.last.of(count) + 1):
            for row in d.rows:
                at = range(count) if d.is_pair else ((site + row.offset) % count,)
                found[first + (site if d.family else 0)] |= {x * size + row.component + 1 for x in at}
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
