# SPDX-License-Identifier: BSD-3-Clause
"""Sums over sites in Fortran: procedures of the model that loop over sites, whatever their number."""

from __future__ import annotations

from collections.abc import Callable

from ..model.formulas.chain import Chain, Density
from ..model.formulas.site_loops import entries
from ..model.formulas.site_reader import Place, Row
from .expressions import PRODUCT, Expressions, wrapped
from .given import Given, harmless

#: procedure -> its comment, the arguments that are arrays of states, and its results
PROCEDURES = {
    "value": ("S = sum_j w_j H_j, lane by lane: one lane is one path", (), ("value",)),
    "gradient": ("S_q and S_p; what is absent is not wanted", (), ("hq", "hp")),
    "hessian_vector": ("The Hessian of S times (vq, vp)", ("vq", "vp"), ("uq", "up")),
}


def procedure(given: Given, kind: str, width: int, number: Callable[[str], str]) -> list[str]:
    """Write a procedure of the model; number: how numbers are written."""
    about, vectors, results = PROCEDURES[kind]
    chain = given.model._chain
    pieces = [_Piece(given, d, x, number) for x in results for d in chain.densities]
    names = ", ".join([*vectors, *results])
    lines = [f"   !> {about}", f"   subroutine weighted_{kind}(self, nlane, ndof, nnoise, t, w, q, p, {names})"]
    lines += ["      class(formula_model), intent(in) :: self", "      integer, intent(in) :: nlane, ndof, nnoise"]
    lines += ["      real(wp), intent(in) :: t, w(nlane, 0:nnoise), q(nlane, ndof), p(nlane, ndof)"]
    lines += [f"      real(wp), intent(in) :: {', '.join(f'{x}(nlane, ndof)' for x in vectors)}"] if vectors else []
    optional = ", optional" if kind == "gradient" else ""
    shape = "(nlane)" if kind == "value" else "(nlane, ndof)"
    lines += [f"      real(wp), intent(out){optional} :: {', '.join(x + shape for x in results)}"]
    if most := max(len(piece.parts) for piece in pieces):
        lines += wrapped(f"      real(wp) :: {', '.join(f'x{k + 1}' for k in range(most))}", width, " " * 9, " &")
    rows = sorted({x for piece in pieces for x in piece.rows})
    names = ["i", "site", *(["other"] if any(piece.density.is_pair for piece in pieces) else []), *rows]
    lines += [f"      integer :: {', '.join(names)}", ""]
    for x in results:
        body = [f"{x} = 0", *(line for piece in pieces if piece.output == x for line in piece.lines())]
        if optional:
            body = [f"if (present({x})) then", *(f"   {line}" for line in body), "end if"]
        for line in body:
            indent = " " * (len(line) - len(line.lstrip()) + 12)
            lines += wrapped(f"      {line}", width, indent, " &")
    return [*lines, f"   end subroutine weighted_{kind}"]


class _Piece:
    """The contribution of a density to one output."""

    def __init__(self, given: Given, density: Density, output: str, number: Callable[[str], str]):
        """Write the formulas of the density."""
        self.density, self.output = density, output
        self.chain: Chain = given.model._chain
        self.names = list(given.identifiers.values())
        self.of_sites = [given.identifiers[x] for x in self.chain.arrays]
        self.sites = _sites(self.chain)
        self.rows: dict[str, int] = {}  #: for periodic ends: name of a neighbouring site -> offset
        graph = density.derivatives.graph
        added = [(at, node) for at, node in entries(density, output) if not graph.is_number(node, 0.0)]
        text = Expressions(graph, [node for _, node in added], self._leaf, number)
        self.parts = text.parts
        self.adds = [
            (f"{output}({', '.join(['i', *(self._row(density.rows[k]) for k in at)])})", text.held(node, PRODUCT))
            for at, node in added
        ]
        self.about = _about(density, given)

    def _row(self, row: Row) -> str:
        """The row of a coordinate of a site."""
        site, size = self._site(row), self.chain.size
        if size == 1:
            return site
        behind = size - 1 - row.component
        return f"{size}*{site if site.isidentifier() else f'({site})'}{f' - {behind}' if behind else ''}"

    def _site(self, row: Row) -> str:
        """The name of the site of a row."""
        if row.second:
            return "other"
        offset = row.offset
        if offset and self.chain.ends == "periodic":
            name = f"{'next' if offset > 0 else 'last'}_{abs(offset)}"
            self.rows[name] = offset
            return name
        return "site" if offset == 0 else f"site {'+' if offset > 0 else '-'} {abs(offset)}"

    def _leaf(self, name: str) -> str:
        letter = name.rstrip("0123456789")
        number = int(name[len(letter) :] or 0)
        if letter == "t":
            return "t"
        if letter == "c" and number >= len(self.names):
            row = self.density.given[number - len(self.names)]
            return f"self%{self.of_sites[row.component]}({self._site(row)})"
        if letter == "c":
            return f"self%{self.names[number]}"
        if letter == "w":
            return f"w(i, {self._weight()})"
        return f"{letter}(i, {self._row(self.density.rows[number])})"

    def _weight(self) -> str:
        """The weight of the Hamiltonian; for noises of each site the weight depends on the site."""
        number = self.density.weight
        alone = number.alone - int(self.density.family)
        terms = ["site"] if self.density.family else []
        terms += [f"{number.families}*{self.sites}" if number.families > 1 else self.sites] if number.families else []
        return " + ".join([*terms, *([str(alone)] if alone or not terms else [])])

    def lines(self) -> list[str]:
        """The loop over sites, and inside it the loop over lanes."""
        if not self.adds:
            return []
        first, last = _site(self.density.first, self.sites), _site(self.density.last, self.sites)
        shifts = {x: "" if o == 1 else f" {'+' if o > 1 else '-'} {abs(o - 1)}" for x, o in self.rows.items()}
        neighbours = [f"{x} = modulo(site{shift}, {self.sites}) + 1" for x, shift in shifts.items()]
        body = [*neighbours, "do i = 1, nlane"]
        body += [f"   {name} = {value}" for name, value in self.parts]
        body += [f"   {target} = {target} + {value}" for target, value in self.adds]
        body += ["end do"]
        if self.density.is_pair:
            body = [f"do other = site + 1, {self.sites}", *(f"   {line}" for line in body), "end do"]
        if first == last:
            return [f"! {self.about}", f"site = {first}", *body]
        return [f"! {self.about}", f"do site = {first}, {last}", *(f"   {line}" for line in body), "end do"]


def _sites(chain: Chain) -> str:
    """The number of sites."""
    return "ndof" if chain.size == 1 else f"(ndof/{chain.size})"


def _site(place: Place, sites: str) -> str:
    """The index of a site, counted from 1."""
    if place.from_last:
        return f"{sites} {'+' if place.shift > 0 else '-'} {abs(place.shift)}" if place.shift else sites
    return str(place.shift + 1)


def _about(density: Density, given: Given) -> str:
    """The formula of a density, in the names of the scene."""
    problem = density.derivatives.problem
    chain, scalars = given.model._chain, len(given.parameters)

    def at(row: Row) -> str:
        return "[j]" if row.second else f"[i{f'{row.offset:+d}' if row.offset else ''}]"

    names = {f"c{k}": x for k, x in enumerate(given.parameters)}
    names |= {f"c{scalars + k}": chain.arrays[row.component] + at(row) for k, row in enumerate(density.given)}
    for letter, own in zip("qp", chain.components, strict=True):
        names |= {f"{letter}{k}": own[row.component] + at(row) for k, row in enumerate(density.rows)}
    [formula] = problem.hamiltonians
    shown = formula.xreplace({x: type(x)(names[x.name]) for x in formula.free_symbols if x.name in names})
    number = density.weight
    which = "H" if number.is_drift else f"H_{number.of(chain.n)}{' ..' if density.family else ''}"
    return f"of {which}: {harmless(str(shown))}"
