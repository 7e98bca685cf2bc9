# SPDX-License-Identifier: BSD-3-Clause
"""C for one site of a density: a loop over lanes that adds to the rows of the neighbouring sites."""

from __future__ import annotations

from collections.abc import Iterable

from .chain import Density, Summand
from .derivatives import BLOCKS
from .emit_c import Writer
from .graph import reachable
from .site_reader import Shape

#: vectors that outputs depend on besides the state: for products with the Hessian, and for third derivatives
VECTORS = dict.fromkeys(("uq", "up"), ("vq", "vp")) | dict.fromkeys(("tq", "tp"), ("aq", "ap", "bq", "bp"))
GRADIENT = {"uq": "hq", "up": "hp"}  #: rows of a product -> the same rows of the gradient


def one_or_many(name: str, parameters: str, names: str) -> str:
    """A function for all sites: it loops over lanes, or over the sites of one lane, with a second pass for far
    lanes.
    """
    text = f"static __attribute__((noinline)) void of_{name}({parameters}) {{\n"
    text += f"   if (n == 1 && all_{name}(1, {names}, 0) < 0)\n      all_{name}(1, {names}, 1);\n"
    return text + f"   if (n > 1 && all_{name}(n, {names}, 0) < 0)\n      all_{name}(n, {names}, 1);\n}}\n"


def site_loop(d: Summand, shape: Shape, adds: list[tuple[str, int]], how: str = "+=") -> str:
    """One site: a loop over lanes that adds to the rows of neighbours."""
    before, inside, adds = summand(d, shape, adds)
    stores = [f"      {target} {how} {value};" for target, value in adds]
    head = ["   int64_t beyond = 0;", *before, "#pragma GCC ivdep", "   for (int i = 0; i < n; i++) {"]
    return "\n".join([*head, *inside, *stores, "   }", "   return beyond;", ""])


def summand(
    d: Summand, shape: Shape, adds: list[tuple[str, int]]
) -> tuple[list[str], list[str], list[tuple[str, str]]]:
    """Code of a summand that is equal for all lanes, and that of one lane; places and values of the
    additions."""
    given = {
        d.graph.leaf(f"c{d.numbers + k}", False): f"c[{d.numbers} + {row.component} * sites + {row.site}]"
        for k, row in enumerate(d.given)
    }
    writer = (_PairWriter if d.is_pair else Writer)(d.graph, lambda name: d.load(name, shape), given)
    before, inside, _ = writer.lines([node for _, node in adds])
    return before, inside, [(target, writer.operand(node)) for target, node in adds]


class _PairWriter(Writer):
    """Operations in C, where quotients with the same denominator are products with its reciprocal: a pair has a
    force in each direction, over the same power of the distance."""

    def lines(self, roots: Iterable[int]) -> tuple[list[str], list[str], bool]:
        """See Writer."""
        roots = list(roots)
        needed = [self.graph.nodes[x] for x in reachable(self.graph, roots, self.given) if x not in self.given]
        below = [node.arguments[1] for node in needed if node.lane and node.kind == "/"]
        self._shared = {x for x in below if below.count(x) > 1 and self.graph.nodes[x].lane}
        return super().lines(roots)

    def statement(self, x: int, done: set[int]) -> list[str]:
        """See Writer."""
        node = self.graph.nodes[x]
        if node.kind != "/" or node.arguments[1] not in self._shared:
            return super().statement(x, done)
        above, below = node.arguments
        first = [] if below in done else [f"      const double r{below} = 1.0 / {self.operand(below)};"]
        done.add(below)
        value = f"r{below}" if self.graph.is_number(above, 1.0) else f"{self.operand(above)} * r{below}"
        return [*first, f"      const double x{x} = {value};"]


def additions(d: Density, shape: Shape, output: str) -> list[tuple[str, int]]:
    """Places and values of the additions, in C."""
    rows = [shape.row(row) for row in d.rows]
    places = {0: "i", 1: "{0} * n + i", 2: f"({{1}} * {shape.count} + {{0}}) * n + i"}
    return [
        (f"{output}[{places[len(at)].format(*(rows[k] for k in at))}]", node)
        for at, node in entries(d, output)
        if not d.derivatives.graph.is_number(node, 0.0)
    ]


def entries(d: Density, output: str) -> list[tuple[tuple[int, ...], int]]:
    """The terms that one site adds to an output: places in d.rows, one for each index of the output, and the node."""
    size, made = len(d.rows), d.derivatives.outputs
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
    graph, size, made = d.derivatives.graph, len(d.rows), d.derivatives.outputs
    own, other = ("vq", "vp") if output == "uq" else ("vp", "vq")
    same = made["hqq" if output == "uq" else "hpp"]
    terms = []
    for j in range(size):
        mixed = made["hqp"][j * size + i] if output == "uq" else made["hqp"][i * size + j]
        for node, vector in ((same[j * size + i], own), (mixed, other)):
            if not graph.is_number(node, 0.0):
                terms.append(graph.multiply(node, graph.leaf(f"{vector}{j}", True)))
    return graph.sum(terms)
