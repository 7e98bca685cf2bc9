# SPDX-License-Identifier: BSD-3-Clause
"""C for whole steps of a scheme (symsde_flow in symsde.h), if they pay: few degrees of freedom, no dependence on time.

The gradient and Hessian of one lane are generated from the formulas; the steps are the texts flow_*.h.
"""

from __future__ import annotations

import operator
from collections.abc import Container, Iterable
from pathlib import Path

from .derivatives import BLOCKS, Derivatives
from .emit_c import NEAR, Writer
from .graph import Graph, reachable

MAX_DOF = 4
MAX_OPERATIONS = 400  #: most operations of gradient and Hessian: above, calls take a small part of the time
OF_FUNCTION = 20  #: operations that an elementary function counts as, since it is inlined in every place
STRIP = 128  #: number of lanes whose states stay in the nearest cache
KICKS = {"gauss_dkdkd": 2, "verlet_kdk": 2, "chin4a": 4}  #: schemes -> sums of noises in a step, those of kicks and V
MAX_NOISES = 8  #: most noises of steps by kicks, whose weights are kept for a group of steps
EXPLICIT = ("symplectic_euler", "symplectic_euler_adjoint", "stormer_verlet")
FURTHER = ("lobatto2_swapped", "heun")  #: further explicit schemes
SAME = {"verlet_dkd_weak2": "lobatto2_swapped"}  #: kicks between drifts -> the scheme with the same step
CORRECTED = "_corrected"  #: suffix of the name of a corrected scheme of the Euler pair
DAMPED = ", damped"  #: end of the library's name of steps whose momenta decay
HEAD = """
/* ---- whole steps ---- */

#include <string.h>
enum {{ NOT_CONVERGED = 1, NONFINITE = 3 }}; /* of symsde.h */
#define DAMPED {damped}
#define SPLIT {split}
enum {{ GAMMA_H = 5, TURNS = 7 }}; /* their places among functionals of symsde_flow in symsde.h, which do not move */
#if DAMPED
#define FADE_IN , const fading fade
#define FADE , fade
#define FADE_OF(functionals) const fading fade = fade_of(functionals[GAMMA_H])
#elif SPLIT
#define ROW (2 * DOF)
#define FADE_IN , const quadratic D
#define FADE , D
#define FADE_OF(functionals) const quadratic D = {{functionals[TURNS], functionals[TURNS] + DRIFTS * ROW * ROW}}
typedef struct {{
   const double *flow, *stiffness; /* of each drift of a step, and S_qq */
}} quadratic;
#else
#define FADE_IN
#define FADE
#define FADE_OF(functionals)
#endif
#define DOF {dof}
#define STRIP {strip}
#define GROUP {group}
#define MAY_BE_FAR {far}

/* Of a lane; e: what forces take from the coordinates alone, whatever the weights are; d: a kick that the next drift
 * adds to p. */
#define KEPT {kept}
#define EXPLICIT {explicit} /* whether steps of explicit schemes are there */
#define COUPLED {coupled}
#define MIXED {mixed}
#define MOVES {moves} /* a gradient at zero */
#define NHAM {nham}
typedef struct {{
   double q[DOF], p[DOF], e[KEPT > 0 ? KEPT : 1];
#if SPLIT
   double d[DOF];
#endif
}} state;

/* What every step of a lane is given: its weights, of which that of H is the step h, and the parameters. */
#define LANE_IN const double *restrict w, const ptrdiff_t n, const double *restrict c, const double h FADE_IN
#define LANE_OF w, n, c, h FADE
"""


def flows(made: Derivatives, *, damped: bool = False) -> list[str]:
    """The schemes whose steps are generated; damped: for momenta damped by one rate."""
    separable = _separable(made)
    nodes = [made.graph.nodes[x] for x in _needed(made, BLOCKS)] if made.problem.ndof <= MAX_DOF else []
    few = 0 < sum(OF_FUNCTION if x.lane and x.what in NEAR else 1 for x in nodes) <= MAX_OPERATIONS
    if not few or "t" in _leaves(made, BLOCKS):
        return []
    schemes = [*EXPLICIT, *FURTHER[:1]] if separable or (_coupled(made) and not damped) else []
    schemes += [*(_corrected(made) if separable else []), "midpoint"]
    if separable and (made.problem.ndof == 1 or _sweeps(made)):
        schemes.append("gauss2")
    schemes += FURTHER[1:]
    return [*schemes, *(_kicks(made) if separable and not made.kicks else [])]


def _separable(made: Derivatives) -> bool:
    """Whether no q meets a p."""
    return all(made.graph.is_number(x, 0.0) for x in made.outputs["hqp"])


def _coupled(made: Derivatives) -> bool:
    """Whether q and p meet in products of both alone: then S_qp does not depend on the state, and explicit schemes have
    one matrix to eliminate."""
    return not _separable(made) and not any(x[0] in "qp" for x in _leaves(made, ["hqp"]))


def same_steps(made: Derivatives) -> dict[str, str]:
    """Schemes of kicks between drifts -> the scheme whose generated steps are theirs: that of one kick, but not where
    drifts are the flow of a quadratic part; those that sample products of noises, where all noises are linear."""
    linear = all(made.graph.is_number(x, 0.0) for x in made.noise_block(BLOCKS["hqq"]))
    return ({} if made.kicks else SAME) | ({f"{x}_strong2": x for x in KICKS} if linear else {})


def source_of_kicks(made: Derivatives) -> tuple[str, list[str]]:
    """C for steps of kicks between flows of a quadratic part of H, and their schemes. Flows are given as numbers, by
    the library; kicks are those of H at p = 0, less the force of the quadratic part."""
    problem = made.problem
    if problem.by_path or problem.ndof > MAX_DOF or not 0 < problem.nnoise <= MAX_NOISES:
        return "", []
    rest = made.at_rest()
    blocks = ["hq", "hqq"]
    nodes = [rest.graph.nodes[x] for x in _needed(rest, blocks)]
    few = 0 < sum(OF_FUNCTION if x.lane and x.what in NEAR else 1 for x in nodes) <= MAX_OPERATIONS
    if not few or "t" in _leaves(rest, blocks):
        return "", []
    schemes = list(KICKS)
    kept = _kept(rest)
    parts = [HEAD.format(**_sizes(rest), kept=len(kept), explicit=0, coupled=0, moves=1, damped=0, split=1, mixed=1)]
    parts.append(_places(rest, kept))
    parts += [_moves(rest, *how, into="s->d") for how in (("fall", "hq", kept), ("kick", "hq"))]
    parts += [_text("steps"), *_products(made, rest), *map(_kicked, schemes)]
    return "\n".join(parts), schemes


def _sizes(made: Derivatives) -> dict[str, int]:
    """Numbers of HEAD that depend on the formulas alone."""
    needed = _needed(made, BLOCKS)
    far = any(made.graph.nodes[x].what in NEAR and made.graph.nodes[x].lane for x in needed)
    group = 1 if len(needed) > 160 or far else 8
    return {
        "dof": made.problem.ndof,
        "strip": STRIP,
        "group": group,
        "far": int(far),
        "nham": made.problem.nnoise + 1,
    }


def _kicked(scheme: str) -> str:
    """The function of whole steps of a scheme of kicks."""
    return (_step_sizes(scheme) + _text("closed") + _text("kicked")).replace("STEP", scheme)


def _step_sizes(scheme: str, *, linear: bool = False) -> str:
    """What the texts of a scheme's steps read of it."""
    kept = "KEPT" if scheme in ("stormer_verlet", "verlet_kdk") else "0"
    sizes = f"\n#define STEP_KEPT {kept}\n#define STEP_ROWS (2 * DOF + STEP_KEPT)\n"
    sizes += f"#define STEP_WIDTH {KICKS.get(scheme, 1)}\n"
    sizes += f"#undef DRIFTS\n#define DRIFTS {4 if scheme == 'chin4a' else 3} /* one for each kick, and one more */\n"
    sizes += f"#define STEP_GROUP {'(GROUP < 2 ? GROUP : 2)' if scheme in ('chin4a', 'heun') else 'GROUP'}\n"
    sizes += f"#define STEP_WEIGH {'weigh_three' if scheme == 'chin4a' else 'weigh_two'}\n"
    sizes += f"#define STEP_lose(s) {'lose(fade.half, s)' if scheme == 'midpoint' else ''}\n"
    return sizes + f"#define STEP_LINEAR {int(linear)}\n"


def _kicks(made: Derivatives) -> list[str]:
    """The schemes of kicks between drifts: for noise in position and a constant mass. Weights of kicks do not stand
    where parameters of each path do."""
    leaves, problem = _leaves(made, ["hp"]), made.problem
    moved = any(leaf[0] == "w" and leaf != "w0" for leaf in leaves)
    if moved or not _glides(made) or problem.by_path or not 0 < problem.nnoise <= MAX_NOISES:
        return []
    return list(KICKS)


def _products(made: Derivatives, rest: Derivatives) -> list[str]:
    """Steps by kicks, and the products of gradients that they use; rest: the derivatives at p = 0."""
    bend = made.bend()
    parts = [_function(rest, "bow", ["hq", "hqq"]), _function(made, "lever", ["hpp"])]
    parts.append(_lines(made, "bend", "double *restrict f", [(f"f[{i}]", x) for i, x in enumerate(bend)]))
    return [*parts, f"#define BENT {int(any(not made.graph.is_number(x, 0.0) for x in bend))}", _text("kicks")]


def named(scheme: str, *, damped: bool = False) -> str:
    """The name under which the library gets the steps of a scheme."""
    return scheme.replace(CORRECTED, ", corrected") + (DAMPED if damped else "")


def source(made: Derivatives, *, damped: bool = False) -> str:
    """C functions of these schemes, to follow the functions of emit_c, or its preamble; empty if no scheme has steps.

    damped: steps of momenta damped by one rate.
    """
    schemes = flows(made, damped=damped)
    if not schemes:
        return ""
    kept = _kept(made) if "stormer_verlet" in schemes else []
    explicit = int("stormer_verlet" in schemes)
    parts = [
        HEAD.format(
            **_sizes(made),
            kept=len(kept),
            split=0,
            explicit=explicit,
            coupled=int(_coupled(made)),
            moves=int(_moves_at_zero(made)),
            damped=int(damped),
            mixed=int(not _separable(made)),
        )
    ]
    parts += [_text("fade")] if damped else []
    parts += [_function(made, "force", ["hq"]), _function(made, "velocity", ["hp"])]
    parts += [_elimination("eliminate", made.problem.ndof)]
    if made.problem.ndof > 1:
        parts.append(_elimination("eliminate_both", 2 * made.problem.ndof))
    parts += _explicit(made, kept, damped=damped) if explicit else []
    parts += [_function(made, "slopes", list(BLOCKS)), _text("steps")]
    if any(scheme.endswith(CORRECTED) for scheme in schemes):
        parts += _correction(made)
    eliminated = _eliminates(made)
    if eliminated:
        parts += [_function(made, "mobility", ["hpp"]), _function(made, "stiffness", ["hq", "hqq"])]
    parts.append(_text("midpoint_eliminated" if eliminated else "midpoint"))
    rotates = made.problem.ndof == 1 and _is_quadratic(made)
    parts += [_text("midpoint_linear")] if rotates else []
    if "gauss2" in schemes and rotates:
        parts.append(_text("gauss2_linear"))
    elif "gauss2" in schemes:
        parts.append(_text("gauss2") + (_text("gauss2_swept") if _sweeps(made) else ""))
    parts += _products(made, made) if set(KICKS).intersection(schemes) else []
    newton = [x for x in schemes if x in ("midpoint", "gauss2") and not _is_quadratic(made)]
    parts += [_text("verdict")] if newton else []
    for scheme in schemes:
        if scheme in KICKS:
            parts.append(_kicked(scheme))
            continue
        how = _text("closed") + _text("closed_strip")
        if scheme in newton:
            swept = scheme == "gauss2" and _sweeps(made)
            how = _text("newton") + (_text("sweeps") if swept else "")
            how += _text("strip").replace("PASS", "swept_" if swept else "")
        unknowns = made.problem.ndof * (4 if scheme == "gauss2" else 1 if eliminated else 2)
        how = how.replace("STEP_UNKNOWNS", str(unknowns))
        sizes = _step_sizes(scheme, linear=rotates and scheme in ("midpoint", "gauss2"))
        parts.append((sizes + how + _text("call")).replace("STEP", scheme))
    return "\n".join(parts)


def _explicit(made: Derivatives, kept: list[int], *, damped: bool) -> list[str]:
    """What explicit steps are made of; where q and p meet, kicks and drifts as increments, and S_qp."""
    parts = [
        _places(made, kept),
        _moves(made, "fall", "hq", kept),
        _moves(made, "kick", "hq"),
        _moves(made, "drift", "hp"),
    ]
    if _coupled(made):
        parts += [_function(made, "coupling", ["hqp"])]
        moves = (("kick_by", "hq", ()), ("fall_by", "hq", kept), ("drift_by", "hp", ()))
        parts += [_moves(made, *how, into="d") for how in moves]
    if damped:
        parts += [_moves(made, "fall_bound", "hq", kept, only="bound")]
        parts += [_moves(made, f"kick_{terms}", "hq", only=terms) for terms in ("free", "bound")]
        parts += [f"#define FREE_KICKS {int(_kicks_freely(made))} /* whether kick_free has terms */"]
        parts += [_moves(made, "glide", "hp", by_state="shrunk")] if _glides(made) else []
    glides = int(_glides(made))
    return [*parts, f"#define GLIDES {glides} /* a drift by momenta that decay is one of shrunk momenta */"]


def _elimination(name: str, n: int) -> str:
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


def _text(name: str) -> str:
    return Path(__file__).with_name(f"flow_{name}.h").read_text(encoding="utf-8")


def _needed(made: Derivatives, blocks: Iterable[str]) -> list[int]:
    """The nodes of blocks that a step computes, without constants of a path."""
    given = set(made.constants())
    found = reachable(made.graph, [x for block in blocks for x in made.outputs[block]], given)
    return [x for x in found if x not in given]


def _constants(made: Derivatives) -> dict[int, str]:
    """Constants of a path, and where a lane finds them."""
    return {x: f"c[{k} * n]" for k, x in enumerate(made.constants())}


def _leaves(made: Derivatives, blocks: Iterable[str]) -> set[str]:
    return _of_nodes(made, [x for block in blocks for x in made.outputs[block]])


def _of_nodes(made: Derivatives, roots: Iterable[int]) -> set[str]:
    """The leaves that nodes depend on."""
    nodes = (made.graph.nodes[x] for x in reachable(made.graph, roots))
    return {node.value for node in nodes if node.what == "leaf"}


def _is_quadratic(made: Derivatives) -> bool:
    """Whether no second derivative depends on the state, for any values of the parameters."""
    return not any(x[0] in "qp" for x in _leaves(made, ("hqq", "hqp", "hpp")))


def _corrected(made: Derivatives) -> list[str]:
    """The schemes of the corrected Euler pair with closed steps: the slope of the noises must be linear in the implicit
    end point. Empty if F_p.F_q has no gradient, as for noise in q or p alone, and for additive noise."""
    n, noise = made.problem.ndof, {block: made.noise_block(variables) for block, variables in BLOCKS.items()}
    there = {block: [not made.graph.is_number(x, 0.0) for x in nodes] for block, nodes in noise.items()}
    products = (("hqq", "hp"), ("hpp", "hq"))
    if not any(there[a][i] and there[b][i % n] for a, b in products for i in range(n * n)):
        return []
    pair = (("hpp", "symplectic_euler"), ("hqq", "symplectic_euler_adjoint"))
    return [x + CORRECTED for block, x in pair if not any(leaf[0] in "qp" for leaf in _of_nodes(made, noise[block]))]


def _correction(made: Derivatives) -> list[str]:
    """Steps of the corrected Euler pair, and the terms of the noises that they use."""
    noise = {block: made.noise_block(variables) for block, variables in BLOCKS.items()}
    slopes = (("noise_force", ("hq", "hqq")), ("noise_velocity", ("hp", "hpp")))
    parts = []
    for name, blocks in slopes:
        targets = ", ".join(f"double *restrict {block}" for block in blocks)
        outputs = [(f"{block}[{k}]", x) for block in blocks for k, x in enumerate(noise[block])]
        parts.append(_lines(made, name, targets, outputs))
    pushed = _at_zero(made, [*noise["hq"], *noise["hp"]])
    return [*parts, f"#define PUSHED {int(pushed)} /* slopes of the noises at zero */", _text("corrected")]


def _moves_at_zero(made: Derivatives) -> bool:
    """Whether the gradient may be nonzero at the origin; used for quadratic Hamiltonians."""
    return _at_zero(made, [x for block in ("hq", "hp") for x in made.outputs[block]])


def _at_zero(made: Derivatives, nodes: Iterable[int]) -> bool:
    """Whether some of these nodes may be nonzero at the origin."""
    graph = made.graph
    rules = {"+": all, "-": all, "negative": all, "*": any, "/": operator.itemgetter(0)}
    zero: set[int] = set()
    for x, node in enumerate(graph.nodes):
        found = node.what in rules and rules[node.what]([a in zero for a in node.arguments])
        if found or graph.is_number(x, 0.0) or (node.what == "leaf" and node.value[0] in "qp"):
            zero.add(x)
    return not zero.issuperset(nodes)


def _eliminates(made: Derivatives) -> bool:
    """Whether midpoint eliminates the momenta: separable, velocities linear in p, and not quadratic."""
    return _separable(made) and not _is_quadratic(made) and not any(x[0] in "qp" for x in _leaves(made, ["hpp"]))


def _sweeps(made: Derivatives) -> bool:
    """Whether two stages are solved by sweeps if steps are mild: for one degree of freedom Newton's iteration, which
    evaluates fewer forces and has two unknowns, is faster."""
    return made.problem.ndof > 1 and _eliminates(made)


def _kept(made: Derivatives) -> list[int]:
    """The largest parts of the force that depend on coordinates and on no weights or momenta, except leaves: their
    values after a step of Stormer-Verlet serve at the beginning of the next step."""
    graph, roots = made.graph, set(made.outputs["hq"])
    needed = _needed(made, ["hq"])
    weighted: set[int] = set()
    for x in needed:
        node = graph.nodes[x]
        if (node.what == "leaf" and node.value[0] in "wp") or any(a in weighted for a in node.arguments):
            weighted.add(x)
    takers = {a for x in needed if x in weighted for a in graph.nodes[x].arguments} | roots
    return [x for x in needed if x in takers - weighted and graph.nodes[x].lane and graph.nodes[x].what != "leaf"]


def _places(made: Derivatives, kept: list[int]) -> str:
    """Code that stores the kept parts of the force of one lane."""
    return _lines(made, "places", "double *restrict e", [(f"e[{k}]", x) for k, x in enumerate(kept)])


def _glides(made: Derivatives) -> bool:
    """Whether each term of the velocity is linear in p and without a constant, or does not depend on the state."""
    terms = [x for node in made.outputs["hp"] for _, x in _signed(made.graph, node)]
    moved = [x for x in terms if any(leaf[0] in "qp" for leaf in _of_nodes(made, [x]))]
    return not _at_zero(made, moved) and not any(x[0] in "qp" for x in _leaves(made, ["hpp"]))


def _kicks_freely(made: Derivatives) -> bool:
    """Whether the force has terms that do not depend on the state."""
    state = _above(made.graph, _coordinates(made.graph))
    return any(x not in state for node in made.outputs["hq"] for _, x in _signed(made.graph, node))


def _coordinates(graph: Graph) -> set[int]:
    """The leaves that are q or p."""
    return {x for x, node in enumerate(graph.nodes) if node.what == "leaf" and node.value[0] in "qp"}


def _moves(
    made: Derivatives,
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
    graph, target, sign = made.graph, *(("s->p", "-") if block == "hq" else ("s->q", ""))
    target, n = into or target, made.problem.ndof
    given = {**_constants(made), **{x: f"s->e[{k}]" for k, x in enumerate(kept)}}
    found = [_signed(graph, x) for x in made.outputs[block]]
    state = _above(graph, _coordinates(graph))
    late = _above(graph, set(kept))
    found = [[(minus, x) for minus, x in terms if only != ("free" if x in state else "bound")] for terms in found]
    pairs = [[(minus, *_factors(graph, x, state, given)) for minus, x in terms] for terms in found]
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
            how = "-" if minus != (sign == "-") else ""
            part = by_state if x in state or factor in state else "part"
            by = f"{how}{part} * {writer.operand(factor)}" if factor >= 0 else f"{how}{part}"
            lines.append(f"   {target}[{k}] = FMA({by}, {writer.operand(x)}, {target}[{k}]);")
        lines += [f"   {target}[{k}] = {x};" for x in back]
    return "\n".join([*lines, "   return beyond;", "}", ""])


def _signed(graph: Graph, x: int, minus: bool = False) -> list[tuple[bool, int]]:
    """The terms of a sum, each with a flag that is true if the term is subtracted."""
    node = graph.nodes[x]
    if node.what in ("+", "-"):
        a, b = node.arguments
        return _signed(graph, a, minus) + _signed(graph, b, minus != (node.what == "-"))
    if node.what == "negative":
        return _signed(graph, node.arguments[0], not minus)
    return [] if graph.is_number(x, 0.0) else [(minus, x)]


def _factors(graph: Graph, x: int, state: set[int], given: Container[int]) -> tuple[int, int]:
    """Split a product into the factor that depends less on the state, and the rest; -1 if the term is no product."""
    node = graph.nodes[x]
    if node.what != "*" or x in given:
        return -1, x
    a, b = sorted(node.arguments, key=lambda y: y in state)
    return a, b


def _above(graph: Graph, nodes: set[int]) -> set[int]:
    """These nodes and all nodes that depend on them."""
    found = set(nodes)
    for x, node in enumerate(graph.nodes):
        if any(a in found for a in node.arguments):
            found.add(x)
    return found


def _function(made: Derivatives, name: str, blocks: list[str]) -> str:
    """Blocks of derivatives of one lane."""
    outputs = [(f"{block}[{k}]", x) for block in blocks for k, x in enumerate(made.outputs[block])]
    return _lines(made, name, ", ".join(f"double *restrict {block}" for block in blocks), outputs)


def _load(leaf: str) -> str:
    """The C code of a leaf of a lane; the weight of H is the same for every lane and step."""
    if leaf == "w0":
        return "h"
    return f"w[{leaf[1:]} * n]" if leaf[0] == "w" else f"s->{leaf[0]}[{leaf[1:]}]"


def _lines(made: Derivatives, name: str, targets: str, outputs: list[tuple[str, int]]) -> str:
    """A function of one lane that stores these nodes."""
    writer = Writer(made.graph, _load, _constants(made))
    before, inside, _ = writer.lines([x for _, x in outputs])
    head = f"INLINE {name}(LANE_IN, const state *s, {targets}, const int far) {{"
    lines = [head, "   int64_t beyond = 0;", *before, *(line[3:] for line in inside)]
    lines += [f"   {target} = {writer.operand(x)};" for target, x in outputs]
    return "\n".join([*lines, "   return beyond;", "}", ""])
