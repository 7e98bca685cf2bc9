# SPDX-License-Identifier: BSD-3-Clause
"""C for whole steps of a scheme (symsde_flow in symsde.h), if they pay: few degrees of freedom, no dependence on time.

The gradient and Hessian of one lane are generated from the formulas (emit_lane); the steps are the texts flow_*.h.
"""

from __future__ import annotations

import operator
from collections.abc import Iterable
from pathlib import Path

from .derivatives import BLOCKS, Derivatives
from .emit_c import NEAR
from .emit_lane import above, coordinates, elimination, function, move, signed_terms, stores
from .graph import reachable

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


def flows(derivatives: Derivatives, *, damped: bool = False) -> list[str]:
    """The schemes whose steps are generated; damped: for momenta damped by one rate."""
    separable = _separable(derivatives)
    if not _is_small(derivatives, BLOCKS):
        return []
    schemes = [*EXPLICIT, *FURTHER[:1]] if separable or (_coupled(derivatives) and not damped) else []
    schemes += [*(_corrected(derivatives) if separable else []), "midpoint"]
    if separable and (derivatives.problem.ndof == 1 or _sweeps(derivatives)):
        schemes.append("gauss2")
    schemes += FURTHER[1:]
    return [*schemes, *(_kicks(derivatives) if separable and not derivatives.kicks else [])]


def _is_small(derivatives: Derivatives, blocks: Iterable[str]) -> bool:
    """Whether whole steps pay: few degrees of freedom, few operations in these blocks, no dependence on time."""
    if derivatives.problem.ndof > MAX_DOF or "t" in _leaves(derivatives, blocks):
        return False
    nodes = [derivatives.graph.nodes[x] for x in _needed(derivatives, blocks)]
    return 0 < sum(OF_FUNCTION if x.lane and x.kind in NEAR else 1 for x in nodes) <= MAX_OPERATIONS


def _separable(derivatives: Derivatives) -> bool:
    """Whether no q meets a p."""
    return all(derivatives.graph.is_number(x, 0.0) for x in derivatives.outputs["hqp"])


def _coupled(derivatives: Derivatives) -> bool:
    """Whether q and p meet in products of both alone: then S_qp does not depend on the state, and explicit schemes have
    one matrix to eliminate."""
    return not _separable(derivatives) and not any(x[0] in "qp" for x in _leaves(derivatives, ["hqp"]))


def same_steps(derivatives: Derivatives) -> dict[str, str]:
    """Schemes of kicks between drifts -> the scheme whose generated steps are theirs: that of one kick, but not where
    drifts are the flow of a quadratic part; those that sample products of noises, where all noises are linear."""
    linear = all(derivatives.graph.is_number(x, 0.0) for x in derivatives.noise_block(BLOCKS["hqq"]))
    return ({} if derivatives.kicks else SAME) | ({f"{x}_strong2": x for x in KICKS} if linear else {})


def source_of_kicks(derivatives: Derivatives) -> tuple[str, list[str]]:
    """C for steps of kicks between flows of a quadratic part of H, and their schemes. Flows are given as numbers, by
    the library; kicks are those of H at p = 0, less the force of the quadratic part."""
    problem = derivatives.problem
    if problem.by_path or problem.ndof > MAX_DOF or not 0 < problem.nnoise <= MAX_NOISES:
        return "", []
    rest = derivatives.at_rest()
    if not _is_small(rest, ["hq", "hqq"]):
        return "", []
    schemes = list(KICKS)
    kept = _kept(rest)
    parts = [HEAD.format(**_sizes(rest), kept=len(kept), explicit=0, coupled=0, moves=1, damped=0, split=1, mixed=1)]
    parts.append(_places(rest, kept))
    parts += [move(rest, "fall", "hq", kept, into="s->d"), move(rest, "kick", "hq", into="s->d")]
    parts += [_text("steps"), *_products(derivatives, rest), *map(_kicked, schemes)]
    return "\n".join(parts), schemes


def _sizes(derivatives: Derivatives) -> dict[str, int]:
    """Numbers of HEAD that depend on the formulas alone."""
    needed = _needed(derivatives, BLOCKS)
    far = any(derivatives.graph.nodes[x].kind in NEAR and derivatives.graph.nodes[x].lane for x in needed)
    group = 1 if len(needed) > 160 or far else 8
    return {
        "dof": derivatives.problem.ndof,
        "strip": STRIP,
        "group": group,
        "far": int(far),
        "nham": derivatives.problem.nnoise + 1,
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


def _kicks(derivatives: Derivatives) -> list[str]:
    """The schemes of kicks between drifts: for noise in position and a constant mass. Weights of kicks do not stand
    where parameters of each path do."""
    leaves, problem = _leaves(derivatives, ["hp"]), derivatives.problem
    moved = any(leaf[0] == "w" and leaf != "w0" for leaf in leaves)
    if moved or not _glides(derivatives) or problem.by_path or not 0 < problem.nnoise <= MAX_NOISES:
        return []
    return list(KICKS)


def _products(derivatives: Derivatives, rest: Derivatives) -> list[str]:
    """Steps by kicks, and the products of gradients that they use; rest: the derivatives at p = 0."""
    bend = derivatives.bend()
    parts = [function(rest, "bow", ["hq", "hqq"]), function(derivatives, "lever", ["hpp"])]
    parts.append(stores(derivatives, "bend", "double *restrict f", [(f"f[{i}]", x) for i, x in enumerate(bend)]))
    return [*parts, f"#define BENT {int(any(not derivatives.graph.is_number(x, 0.0) for x in bend))}", _text("kicks")]


def named(scheme: str, *, damped: bool = False) -> str:
    """The name under which the library gets the steps of a scheme."""
    return scheme.replace(CORRECTED, ", corrected") + (DAMPED if damped else "")


def source(derivatives: Derivatives, *, damped: bool = False) -> str:
    """C functions of these schemes, to follow the functions of emit_c, or its preamble; empty if no scheme has steps.

    damped: steps of momenta damped by one rate.
    """
    schemes = flows(derivatives, damped=damped)
    if not schemes:
        return ""
    kept = _kept(derivatives) if "stormer_verlet" in schemes else []
    explicit = int("stormer_verlet" in schemes)
    parts = [
        HEAD.format(
            **_sizes(derivatives),
            kept=len(kept),
            split=0,
            explicit=explicit,
            coupled=int(_coupled(derivatives)),
            moves=int(_moves_at_zero(derivatives)),
            damped=int(damped),
            mixed=int(not _separable(derivatives)),
        )
    ]
    parts += [_text("fade")] if damped else []
    parts += [function(derivatives, "force", ["hq"]), function(derivatives, "velocity", ["hp"])]
    parts += [elimination("eliminate", derivatives.problem.ndof)]
    if derivatives.problem.ndof > 1:
        parts.append(elimination("eliminate_both", 2 * derivatives.problem.ndof))
    parts += _explicit(derivatives, kept, damped=damped) if explicit else []
    parts += [function(derivatives, "slopes", list(BLOCKS)), _text("steps")]
    if any(scheme.endswith(CORRECTED) for scheme in schemes):
        parts += _correction(derivatives)
    eliminated = _eliminates(derivatives)
    if eliminated:
        parts += [function(derivatives, "mobility", ["hpp"]), function(derivatives, "stiffness", ["hq", "hqq"])]
    parts.append(_text("midpoint_eliminated" if eliminated else "midpoint"))
    rotates = derivatives.problem.ndof == 1 and _is_quadratic(derivatives)
    parts += [_text("midpoint_linear")] if rotates else []
    if "gauss2" in schemes and rotates:
        parts.append(_text("gauss2_linear"))
    elif "gauss2" in schemes:
        parts.append(_text("gauss2") + (_text("gauss2_swept") if _sweeps(derivatives) else ""))
    parts += _products(derivatives, derivatives) if set(KICKS).intersection(schemes) else []
    newton = [x for x in schemes if x in ("midpoint", "gauss2") and not _is_quadratic(derivatives)]
    parts += [_text("verdict")] if newton else []
    for scheme in schemes:
        if scheme in KICKS:
            parts.append(_kicked(scheme))
            continue
        loops = _text("closed") + _text("closed_strip")
        if scheme in newton:
            swept = scheme == "gauss2" and _sweeps(derivatives)
            loops = _text("newton") + (_text("sweeps") if swept else "")
            loops += _text("strip").replace("PASS", "swept_" if swept else "")
        unknowns = derivatives.problem.ndof * (4 if scheme == "gauss2" else 1 if eliminated else 2)
        loops = loops.replace("STEP_UNKNOWNS", str(unknowns))
        sizes = _step_sizes(scheme, linear=rotates and scheme in ("midpoint", "gauss2"))
        parts.append((sizes + loops + _text("call")).replace("STEP", scheme))
    return "\n".join(parts)


def _explicit(derivatives: Derivatives, kept: list[int], *, damped: bool) -> list[str]:
    """The parts of explicit steps; where q and p meet, kicks and drifts as increments, too, and S_qp."""
    parts = [
        _places(derivatives, kept),
        move(derivatives, "fall", "hq", kept),
        move(derivatives, "kick", "hq"),
        move(derivatives, "drift", "hp"),
    ]
    if _coupled(derivatives):
        parts += [function(derivatives, "coupling", ["hqp"])]
        increments = (("kick_by", "hq", ()), ("fall_by", "hq", kept), ("drift_by", "hp", ()))
        parts += [move(derivatives, *one, into="d") for one in increments]
    if damped:
        parts += [move(derivatives, "fall_bound", "hq", kept, only="bound")]
        parts += [move(derivatives, f"kick_{terms}", "hq", only=terms) for terms in ("free", "bound")]
        parts += [f"#define FREE_KICKS {int(_kicks_freely(derivatives))} /* whether kick_free has terms */"]
        parts += [move(derivatives, "glide", "hp", by_state="shrunk")] if _glides(derivatives) else []
    glides = int(_glides(derivatives))
    return [*parts, f"#define GLIDES {glides} /* a drift by momenta that decay is one of shrunk momenta */"]


def _text(name: str) -> str:
    return Path(__file__).with_name(f"flow_{name}.h").read_text(encoding="utf-8")


def _needed(derivatives: Derivatives, blocks: Iterable[str]) -> list[int]:
    """The nodes of blocks that a step computes, without constants of a path."""
    given = set(derivatives.constants())
    found = reachable(derivatives.graph, [x for block in blocks for x in derivatives.outputs[block]], given)
    return [x for x in found if x not in given]


def _leaves(derivatives: Derivatives, blocks: Iterable[str]) -> set[str]:
    return _of_nodes(derivatives, [x for block in blocks for x in derivatives.outputs[block]])


def _of_nodes(derivatives: Derivatives, roots: Iterable[int]) -> set[str]:
    """The leaves that nodes depend on."""
    nodes = (derivatives.graph.nodes[x] for x in reachable(derivatives.graph, roots))
    return {node.value for node in nodes if node.kind == "leaf"}


def _is_quadratic(derivatives: Derivatives) -> bool:
    """Whether no second derivative depends on the state, for any values of the parameters."""
    return not any(x[0] in "qp" for x in _leaves(derivatives, ("hqq", "hqp", "hpp")))


def _corrected(derivatives: Derivatives) -> list[str]:
    """The schemes of the corrected Euler pair with closed steps: the slope of the noises must be linear in the implicit
    end point. Empty if F_p.F_q has no gradient, as for noise in q or p alone, and for additive noise."""
    n = derivatives.problem.ndof
    noise = {block: derivatives.noise_block(variables) for block, variables in BLOCKS.items()}
    there = {block: [not derivatives.graph.is_number(x, 0.0) for x in nodes] for block, nodes in noise.items()}
    products = (("hqq", "hp"), ("hpp", "hq"))
    if not any(there[a][i] and there[b][i % n] for a, b in products for i in range(n * n)):
        return []
    pair = (("hpp", "symplectic_euler"), ("hqq", "symplectic_euler_adjoint"))
    return [
        x + CORRECTED for block, x in pair if not any(leaf[0] in "qp" for leaf in _of_nodes(derivatives, noise[block]))
    ]


def _correction(derivatives: Derivatives) -> list[str]:
    """Steps of the corrected Euler pair, and the terms of the noises that they use."""
    noise = {block: derivatives.noise_block(variables) for block, variables in BLOCKS.items()}
    slopes = (("noise_force", ("hq", "hqq")), ("noise_velocity", ("hp", "hpp")))
    parts = []
    for name, blocks in slopes:
        targets = ", ".join(f"double *restrict {block}" for block in blocks)
        outputs = [(f"{block}[{k}]", x) for block in blocks for k, x in enumerate(noise[block])]
        parts.append(stores(derivatives, name, targets, outputs))
    pushed = _at_zero(derivatives, [*noise["hq"], *noise["hp"]])
    return [*parts, f"#define PUSHED {int(pushed)} /* slopes of the noises at zero */", _text("corrected")]


def _moves_at_zero(derivatives: Derivatives) -> bool:
    """Whether the gradient may be nonzero at the origin; used for quadratic Hamiltonians."""
    return _at_zero(derivatives, [x for block in ("hq", "hp") for x in derivatives.outputs[block]])


def _at_zero(derivatives: Derivatives, nodes: Iterable[int]) -> bool:
    """Whether some of these nodes may be nonzero at the origin."""
    graph = derivatives.graph
    rules = {"+": all, "-": all, "negative": all, "*": any, "/": operator.itemgetter(0)}
    zero: set[int] = set()
    for x, node in enumerate(graph.nodes):
        found = node.kind in rules and rules[node.kind]([a in zero for a in node.arguments])
        if found or graph.is_number(x, 0.0) or (node.kind == "leaf" and node.value[0] in "qp"):
            zero.add(x)
    return not zero.issuperset(nodes)


def _eliminates(derivatives: Derivatives) -> bool:
    """Whether midpoint eliminates the momenta: separable, velocities linear in p, and not quadratic."""
    return (
        _separable(derivatives)
        and not _is_quadratic(derivatives)
        and not any(x[0] in "qp" for x in _leaves(derivatives, ["hpp"]))
    )


def _sweeps(derivatives: Derivatives) -> bool:
    """Whether two stages are solved by sweeps if steps are mild: for one degree of freedom Newton's iteration, which
    evaluates fewer forces and has two unknowns, is faster."""
    return derivatives.problem.ndof > 1 and _eliminates(derivatives)


def _kept(derivatives: Derivatives) -> list[int]:
    """The largest parts of the force that depend on coordinates and on no weights or momenta, except leaves: their
    values after a step of Stormer-Verlet serve at the beginning of the next step."""
    graph, roots = derivatives.graph, set(derivatives.outputs["hq"])
    needed = _needed(derivatives, ["hq"])
    weighted: set[int] = set()
    for x in needed:
        node = graph.nodes[x]
        if (node.kind == "leaf" and node.value[0] in "wp") or any(a in weighted for a in node.arguments):
            weighted.add(x)
    takers = {a for x in needed if x in weighted for a in graph.nodes[x].arguments} | roots
    return [x for x in needed if x in takers - weighted and graph.nodes[x].lane and graph.nodes[x].kind != "leaf"]


def _places(derivatives: Derivatives, kept: list[int]) -> str:
    """Code that stores the kept parts of the force of one lane."""
    return stores(derivatives, "places", "double *restrict e", [(f"e[{k}]", x) for k, x in enumerate(kept)])


def _glides(derivatives: Derivatives) -> bool:
    """Whether each term of the velocity is linear in p and without a constant, or does not depend on the state."""
    terms = [x for node in derivatives.outputs["hp"] for _, x in signed_terms(derivatives.graph, node)]
    moved = [x for x in terms if any(leaf[0] in "qp" for leaf in _of_nodes(derivatives, [x]))]
    return not _at_zero(derivatives, moved) and not any(x[0] in "qp" for x in _leaves(derivatives, ["hpp"]))


def _kicks_freely(derivatives: Derivatives) -> bool:
    """Whether the force has terms that do not depend on the state."""
    state = above(derivatives.graph, coordinates(derivatives.graph))
    return any(x not in state for node in derivatives.outputs["hq"] for _, x in signed_terms(derivatives.graph, node))
