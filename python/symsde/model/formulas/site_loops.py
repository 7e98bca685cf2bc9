# SPDX-License-Identifier: BSD-3-Clause
"""C for one site of a density: a loop over lanes that adds to the rows of the neighbouring sites."""

from __future__ import annotations

from .derivatives import BLOCKS
from .emit_c import Writer
from .sites import Density

#: vectors that outputs depend on besides the state: for products with the Hessian, and for third derivatives
VECTORS = dict.fromkeys(("uq", "up"), ("vq", "vp")) | dict.fromkeys(("tq", "tp"), ("aq", "ap", "bq", "bp"))
GRADIENT = {"uq": "hq", "up": "hp"}  #: rows of a product -> the same rows of the gradient


def over_sites(d: Density, call: str, own: bool = False) -> str:
    """A call for every site of a density; `own` means that each site writes only to its own row, so that sites are
    independent."""
    apart = "#pragma GCC ivdep\n" if own else ""
    return f"{apart}   for (ptrdiff_t site = {d.first}; site <= {d.last}; site++)\n      beyond |= {call};\n"


def one_or_many(name: str, parameters: str, names: str) -> str:
    """A function for all sites: it loops over lanes, or over the sites of one lane, with a second pass for far
    lanes.
    """
    text = f"static __attribute__((noinline)) void of_{name}({parameters}) {{\n"
    text += f"   if (n == 1 && all_{name}(1, {names}, 0) < 0)\n      all_{name}(1, {names}, 1);\n"
    return text + f"   if (n > 1 && all_{name}(n, {names}, 0) < 0)\n      all_{name}(n, {names}, 1);\n}}\n"


def site_loop(d: Density, adds: list[tuple[str, int]], how: str = "+=") -> str:
    """One site: a loop over lanes that adds to the rows of neighbours; empty if there is nothing to add."""
    graph = d.derivatives.graph
    adds = [(target, node) for target, node in adds if not graph.is_number(node, 0.0)]
    if not adds:
        return ""

    def load(name: str) -> str:
        letter = name.rstrip("0123456789")
        if letter == "w":
            row = d.inner[int(name[1:])] if d.inner else f"({d.weight}{' + site' if d.family else ''})"
            return f"w[{row} * (ptrdiff_t)n + i]"
        return f"{letter}[ROW({d.offsets[int(name[len(letter) :])]}) * n + i]"

    writer = Writer(graph, load)
    before, inside, _ = writer.lines([node for _, node in adds])
    stores = [f"      {target} {how} {writer.operand(node)};" for target, node in adds]
    head = ["   int64_t beyond = 0;", *before, "#pragma GCC ivdep", "   for (int i = 0; i < n; i++) {"]
    return "\n".join([*head, *inside, *stores, "   }", "   return beyond;", ""])


def additions(d: Density, output: str) -> list[tuple[str, int]]:
    """Places and values of the additions, in C."""
    rows = [f"ROW({o})" for o in d.offsets]
    places = {0: "i", 1: "{0} * n + i", 2: "({1} * sites + {0}) * n + i"}
    return [(f"{output}[{places[len(at)].format(*(rows[k] for k in at))}]", node) for at, node in entries(d, output)]


def entries(d: Density, output: str) -> list[tuple[tuple[int, ...], int]]:
    """The terms that one site adds to an output: places in d.offsets, one for each index of the output, and the
    node."""
    size, made = len(d.offsets), d.derivatives.outputs
    if output == "value":
        return [((), made["value"][0])]
    if output in ("hq", "hp"):
        return [((i,), node) for i, node in enumerate(made[output])]
    if output in BLOCKS:
        return [((i, j), made[output][j * size + i]) for j in range(size) for i in range(size)]
    if output in ("tq", "tp"):
        third = d.derivatives.third()
        return [((i,), node) for i, node in enumerate(third[output])] if third else []
    return [((i,), _product(d, output, i)) for i in range(size)]


def _product(d: Density, output: str, i: int) -> int:
    """Row i of the Hessian times (vq, vp)."""
    graph, size, made = d.derivatives.graph, len(d.offsets), d.derivatives.outputs
    own, other = ("vq", "vp") if output == "uq" else ("vp", "vq")
    same = made["hqq" if output == "uq" else "hpp"]
    terms = []
    for j in range(size):
        mixed = made["hqp"][j * size + i] if output == "uq" else made["hqp"][i * size + j]
        for node, vector in ((same[j * size + i], own), (mixed, other)):
            if not graph.is_number(node, 0.0):
                terms.append(graph.multiply(node, graph.leaf(f"{vector}{j}", True)))
    return graph.sum(terms)
