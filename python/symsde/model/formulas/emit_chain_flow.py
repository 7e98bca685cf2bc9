# SPDX-License-Identifier: BSD-3-Clause
"""C for whole steps of a chain by kicks between drifts (symsde_flow in symsde.h), if its rows couple neighbours only.

The force of a row and its derivatives are generated from the formulas; the steps are the text flow_chain.h.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ...native.files import optional
from .chain import Chain
from .derivatives import Derivatives
from .emit_c import NEAR, Writer
from .emit_rows import has_rows, together
from .graph import reachable
from .named_formulas import Problem

MOST_SITES = 2048  #: most sites of a chain whose states stay near, by five arrays of a strip on the stack
TABLEAUX = ("symplectic_euler", "symplectic_euler_adjoint", "stormer_verlet")
KICKS = ("verlet_kdk", "gauss_dkdkd", "chin4a")
DRAWN = tuple(f"{scheme}_strong2" for scheme in KICKS)  #: the same with J, for one noise at each site or constant noise
ARGUMENTS = "const double *v, const double x, const double y{more}, const double *restrict c"
RESULTS = "double *own, double *handed, const int far, int64_t *beyond"


def flows(chain: Chain) -> list[str]:
    """The schemes of which whole steps are used."""
    if chain.n > MOST_SITES:
        return []
    return [x for x in _schemes(chain) if chain.part is None or x in TABLEAUX]  # drifts between kicks are other ones


def _schemes(chain: Chain) -> list[str]:
    """The schemes whose steps are generated, whatever the number of sites. Noises with second derivatives have to touch
    one site each, for kicks with products of their gradients, and for those with J be one at each site and no other
    noise."""
    if not has_rows(chain) or not chain.nnoise or chain.kinked:
        return []
    terms, made = together(chain, chain.densities)
    if any(made.graph.nodes[x].value == "t" for x in _needed(made) if made.graph.nodes[x].kind == "leaf"):
        return []
    bent = [h for term, h in zip(terms, made.hamiltonians, strict=True) if not term.weight.is_drift and not term.family]
    q = [made.symbol[x] for x in ("q0", "q1")]
    local = not any(h.diff(x, y) != 0 for h in bent for x in q for y in q)
    if not local:
        return [*TABLEAUX, "gauss_dkdkd"]
    own = [term.family for term in terms if not term.weight.is_drift] == [True]
    return [*TABLEAUX, *KICKS, *(DRAWN if own or not _bend(terms, made) else ())]


def source(chain: Chain) -> str:
    """C functions of these schemes, to follow those of rows; empty if no scheme has steps."""
    schemes = _schemes(chain)
    if not schemes:
        return ""
    terms, made = together(chain, chain.densities)
    bend = _bend(terms, made)
    closed = chain.ends != "free"
    parts = [
        f"enum {{ TERMS = {len(terms)}, VALUES = {len(chain.parameters)} }};",
        f"#define CLOSED {int(closed)}",
        f"#define RING {int(chain.ends == 'periodic')}",
        f"#define MEAN {int(bend is not None)}",
        f"#define MAY_BE_FAR {int(any(_is_near(x) for x in (made, bend) if x))}",
        "LANE ptrdiff_t column(const int term, const ptrdiff_t row, const ptrdiff_t sites) {",
        *(f"   if (term == {j})\n      return {t.weight}{' + row' if t.family else ''};" for j, t in enumerate(terms)),
        "   return 0;\n}",
        *_functions("row", made),
    ]
    if not closed:
        parts += _functions("last", _alone(chain, terms))
    else:
        parts += ["#define last_force row_force", "#define last_product row_product"]
    if bend:
        head = "double row_bend(const double x, const double *restrict c, const int far, int64_t *beyond)"
        parts.append(_function(head, bend, [("", bend.outputs["hq"][0])], "return"))
    parts.append(Path(__file__).with_name("flow_chain.h").read_text(encoding="utf-8"))
    parts += [f"CHAIN_FLOW({x}, {x.removesuffix('_strong2')}, {int(x in DRAWN)})" for x in schemes]
    return "\n".join([*parts, ""])


def _needed(made: Derivatives) -> list[int]:
    return reachable(made.graph, [x for block in ("hq", "hqq") for x in made.outputs[block]])


def _is_near(made: Derivatives) -> bool:
    return any(made.graph.nodes[x].lane and made.graph.nodes[x].kind in NEAR for x in _needed(made))


def _alone(chain: Chain, terms: list[Any]) -> Derivatives:
    """The densities of a last row with nothing behind it, with the terms of all rows."""
    found, made = together(chain, [d for d in chain.densities if len(d.offsets) == 1])
    zero = optional("sympy", "sympy").Integer(0)
    known = dict(zip(found, made.problem.hamiltonians, strict=True))
    return Derivatives(Problem(tuple(known.get(x, zero) for x in terms), (), chain.texts, 2, chain.parameters))


def _bend(terms: list[Any], made: Derivatives) -> Derivatives | None:
    """Half of the sum of H_k,q^2 over noises with a second derivative, whose gradient is the sum of H_k,qq H_k,q."""
    sympy = optional("sympy", "sympy")
    q = sympy.Symbol("q0", real=True)
    slopes = [
        sympy.diff(h, q)
        for term, h in zip(terms, made.problem.hamiltonians, strict=True)
        if not term.weight.is_drift and term.family
    ]
    total = sum((x**2 for x in slopes if sympy.diff(x, q) != 0), sympy.Integer(0)) / 2
    return Derivatives(Problem((total,), (), made.problem.texts, 2, made.problem.parameters)) if total != 0 else None


def _functions(name: str, made: Derivatives) -> list[str]:
    """What a row receives and hands on: forces, and products of second derivatives with (s, r)."""
    graph = made.graph
    force, (here, beside, _, there) = made.outputs["hq"], made.outputs["hqq"]
    s, r = (graph.leaf(x, True) for x in ("s", "r"))
    pairs = ([(here, s), (beside, r)], [(beside, s), (there, r)])
    product = [*map(graph.dot, pairs)]
    found = []
    for what, more, nodes in (("force", "", force), ("product", ", const double s, const double r", product)):
        head = f"void {name}_{what}({ARGUMENTS.format(more=more)}, {RESULTS})"
        found.append(_function(head, made, list(zip(("*own", "*handed"), nodes, strict=True)), "store"))
    return found


def _function(head: str, made: Derivatives, outputs: list[tuple[str, int]], how: str) -> str:
    """A function of one row of one lane that stores these nodes, or returns the only one."""

    def load(name: str) -> str:
        if name[0] == "w":
            return f"v[{name[1:]}]" if how == "store" else "1"
        return {"q0": "x", "q1": "y"}.get(name, name)

    writer = _Writer(made.graph, load)
    before, inside, _ = writer.lines([x for _, x in outputs])
    lines = [f"LANE {head} {{", *before, *(line[3:].replace("&beyond", "beyond") for line in inside)]
    lines += [f"   {f'{target} = ' if how == 'store' else 'return '}{writer.operand(x)};" for target, x in outputs]
    return "\n".join([*lines, "}", ""])


class _Writer(Writer):
    """Operations in C, with the vector of products as arguments of the function."""

    def statement(self, x: int, done: set[int]) -> list[str]:
        """The definition of a node; arguments of the function are there."""
        node = self.graph.nodes[x]
        return [] if node.kind == "leaf" and node.value in ("s", "r") else super().statement(x, done)
