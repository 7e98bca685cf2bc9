# SPDX-License-Identifier: BSD-3-Clause
"""C functions of one lane, of which whole steps are made (flow_*.h): derivatives, kicks and drifts, eliminations."""

from __future__ import annotations

from collections.abc import Container, Iterable

from .derivatives import Derivatives
from .emit_c import Writer
from .graph import Graph


def function(derivatives: Derivatives, name: str, blocks: list[str]) -> str:
    """Blocks of derivatives of one lane."""
    outputs = [(f"{block}[{k}]", x) for block in blocks for k, x in enumerate(derivatives.outputs[block])]
    return stores(derivatives, name, ", ".join(f"double *restrict {block}" for block in blocks), outputs)


def stores(derivatives: Derivatives, name: str, targets: str, outputs: list[tuple[str, int]]) -> str:
    """A function of one lane that stores these nodes."""
    writer = Writer(derivatives.graph, _load, _constants(derivatives))
    before, inside, _ = writer.lines([x for _, x in outputs])
    head = f"INLINE {name}(LANE_IN, const state *s, {targets}, const int far) {{"
    lines = [head, "   int64_t beyond = 0;", *before, *(line[3:] for line in inside)]
    lines += [f"   {target} = {writer.operand(x)};" for target, x in outputs]
    return "\n".join([*lines, "   return beyond;", "}", ""])


def move(
    derivatives: Derivatives,
    name: str,
    block: str,
    kept: Iterable[int] = (),
    *,
    by_state: str = "part",
    only: str = "",
    into: str = "",
) -> str:
    """p - part S_q or q + part S_p in place, term by term: first terms that do not depend on the state, last terms that
    depend on kept parts, so that a step waits as little as possible for the step before.

    by_state: the part of terms that depend on the state; only: "free", terms that do not depend on it, or "bound";
    into: what is moved in the place of p or q, "d", or "s->d", a kick less the force of the quadratic part.
    """
    graph, n, subtracts = derivatives.graph, derivatives.problem.ndof, block == "hq"
    target = into or ("s->p" if subtracts else "s->q")
    given = {**_constants(derivatives), **{x: f"s->e[{k}]" for k, x in enumerate(kept)}}
    state, late = above(graph, coordinates(graph)), above(graph, set(kept))
    pairs = [
        [
            (minus, *_factors(graph, x, state, given))
            for minus, x in signed_terms(graph, node)
            if only in ("", "bound" if x in state else "free")
        ]
        for node in derivatives.outputs[block]
    ]
    writer = Writer(graph, _load, given)
    before, inside, _ = writer.lines([x for terms in pairs for _, *factors in terms for x in factors if x >= 0])
    of = "const state *s, double *restrict d" if into == "d" else "state *s"
    lines = [f"INLINE {name}(LANE_IN, {of}, const double part, const int far) {{", "   int64_t beyond = 0;"]
    lines += ["   const double shrunk = FMA(0.5 * part, fade.whole, part);"] if by_state == "shrunk" else []
    lines += [*before, *(line[3:] for line in inside)]
    for k, terms in enumerate(pairs):
        terms.sort(key=lambda x: (x[1] in state or x[2] in state, x[1] in late or x[2] in late, max(x[1:])))
        back = [f"FMA(part * h * D.stiffness[{k * n + j}], s->q[{j}], {target}[{k}])" for j in range(n)]
        back = back if into == "s->d" else []
        for minus, factor, x in terms:
            if x in state or factor in state:  # known later than q itself
                lines, back = [*lines, *(f"   {target}[{k}] = {x};" for x in back)], []
            sign = "-" if minus != subtracts else ""
            part = by_state if x in state or factor in state else "part"
            by = f"{sign}{part} * {writer.operand(factor)}" if factor >= 0 else f"{sign}{part}"
            lines.append(f"   {target}[{k}] = FMA({by}, {writer.operand(x)}, {target}[{k}]);")
        lines += [f"   {target}[{k}] = {x};" for x in back]
    return "\n".join([*lines, "   return beyond;", "}", ""])


def signed_terms(graph: Graph, x: int, minus: bool = False) -> list[tuple[bool, int]]:
    """The terms of a sum, each with a flag that is true if the term is subtracted."""
    node = graph.nodes[x]
    if node.kind in ("+", "-"):
        a, b = node.arguments
        return signed_terms(graph, a, minus) + signed_terms(graph, b, minus != (node.kind == "-"))
    if node.kind == "negative":
        return signed_terms(graph, node.arguments[0], not minus)
    return [] if graph.is_number(x, 0.0) else [(minus, x)]


def _factors(graph: Graph, x: int, state: set[int], given: Container[int]) -> tuple[int, int]:
    """Split a product into the factor that depends less on the state, and the rest; -1 if the term is no product."""
    node = graph.nodes[x]
    if node.kind != "*" or x in given:
        return -1, x
    a, b = sorted(node.arguments, key=lambda y: y in state)
    return a, b


def above(graph: Graph, nodes: set[int]) -> set[int]:
    """These nodes and all nodes that depend on them."""
    found = set(nodes)
    for x, node in enumerate(graph.nodes):
        if any(a in found for a in node.arguments):
            found.add(x)
    return found


def coordinates(graph: Graph) -> set[int]:
    """The leaves that are q or p."""
    return {x for x, node in enumerate(graph.nodes) if node.kind == "leaf" and node.value[0] in "qp"}


def _constants(derivatives: Derivatives) -> dict[int, str]:
    """Constants of a path, and where a lane finds them."""
    return {x: f"c[{k} * n]" for k, x in enumerate(derivatives.constants())}


def _load(leaf: str) -> str:
    """The C code of a leaf of a lane; the weight of H is the same for every lane and step."""
    if leaf == "w0":
        return "h"
    return f"w[{leaf[1:]} * n]" if leaf[0] == "w" else f"s->{leaf[0]}[{leaf[1:]}]"


def elimination(name: str, n: int) -> str:
    """A function that solves n equations, without loops, since compilers would not unroll loops inside the loop over
    lanes."""
    lines = [
        f"/* m^{{-1}} r in place of r, {n} unknowns, without pivots: near the identity none are needed; elsewhere what",
        " * comes out is no solution, does not converge, and the step is left to the library. */",
        f"LANE void {name}(double *m, double *r) {{",
    ]
    for k in range(n):
        lines.append(f"   const double i{k} = 1 / m[{k * n + k}];")
        for i in range(k + 1, n):
            lines.append(f"   const double f{i}_{k} = m[{i * n + k}] * i{k};")
            lines += [f"   m[{i * n + j}] = FMA(-f{i}_{k}, m[{k * n + j}], m[{i * n + j}]);" for j in range(k + 1, n)]
            lines.append(f"   r[{i}] = FMA(-f{i}_{k}, r[{k}], r[{i}]);")
        lines.append(f"   r[{k}] *= i{k};")
        lines += [f"   m[{k * n + j}] *= i{k};" for j in range(k + 1, n)]
    for k in range(n - 1, 0, -1):
        lines += [f"   r[{i}] = FMA(-m[{i * n + k}], r[{k}], r[{i}]);" for i in range(k)]
    return "\n".join([*lines, "}", ""])
