# SPDX-License-Identifier: BSD-3-Clause
"""C for functions of sums over sites (`collective.py`): sums, then their weights, then loops over the sites again.

Besides its outputs a callback needs memory for a few numbers per lane; a dense Hessian, which steppers need for few
sites only, also needs the gradients of the sums.
"""

from __future__ import annotations

from . import pair_loops
from .chain import Chain
from .derivatives import Derivatives
from .emit_c import Loops
from .site_loops import additions, one_or_many

#: arrays of outputs besides the weights w: g, the derivatives of the functions with respect to the sums; r, the product
#: of the second derivatives and a vector
WEIGHTS = dict.fromkeys(("hq", "hp", "hqq", "hqp", "hpp"), ("g",)) | dict.fromkeys(("uq", "up"), ("g", "r"))
HEAD = """
/* ---- functions of sums over sites: S_0 .. are in sums[..][n] ---- */

#include <stdlib.h>
enum {{ SUMS = {sums}, OUTER = {outer}, PAIRS = {pairs}, FEW = 1024 }};
static const int pair_of[{at_least_one}][2] = {{{table}}};
#define ROWS(count) ((count) * (ptrdiff_t)nlane)

static double *find_room(const ptrdiff_t count, double *few) {{
   return count <= FEW ? few : malloc((size_t)count * sizeof(double));
}}

static void leave_room(double *room, const double *few) {{
   if (room != few)
      free(room);
}}
"""
CALLBACKS = """
/* r[a] = sum_b F_ab d[b], `rows` rows for each sum */
static void couple(const int nlane, const ptrdiff_t rows, const double *restrict curves, const double *restrict d,
                   double *restrict r) {
   memset(r, 0, (size_t)(SUMS * ROWS(rows)) * sizeof(double));
   for (int k = 0; k < PAIRS; k++)
      for (int turned = 0; turned <= (pair_of[k][0] != pair_of[k][1]); turned++) {
         const double *from = d + pair_of[k][!turned] * ROWS(rows), *curve = curves + ROWS(k);
         double *to = r + pair_of[k][turned] * ROWS(rows);
         for (ptrdiff_t row = 0; row < rows; row++)
            for (int i = 0; i < nlane; i++)
               to[ROWS(row) + i] += curve[i] * from[ROWS(row) + i];
      }
}

int formula_value(CALLBACK_IN, double *value, void *user) {
   (void)nham;
   double few[FEW], *room = find_room(ROWS(OUTER + SUMS + 1), few);
   if (room == NULL)
      return 1;
   double *x = room, *sums = x + ROWS(OUTER), *more = sums + ROWS(SUMS);
   prepare(nlane, t, w, q, p, user, ndof, x, sums);
   of_value(nlane, t, w, q, p, user, ndof, value);
   of_functions(nlane, t, x, sums, NULL, user, more);
   for (int i = 0; i < nlane; i++)
      value[i] += more[i];
   leave_room(room, few);
   return 0;
}

int formula_gradient(CALLBACK_IN, double *hq, double *hp, void *user) {
   (void)nham;
   double few[FEW], *room = find_room(ROWS(OUTER + 2 * SUMS), few);
   if (room == NULL)
      return 1;
   double *x = room, *sums = x + ROWS(OUTER), *g = sums + ROWS(SUMS);
   prepare(nlane, t, w, q, p, user, ndof, x, sums);
   of_slopes(nlane, t, x, sums, NULL, user, g);
   if (hq != NULL)
      of_hq(nlane, t, w, q, p, user, ndof, hq, g);
   if (hp != NULL)
      of_hp(nlane, t, w, q, p, user, ndof, hp, g);
   leave_room(room, few);
   return 0;
}

int formula_hessian_vector(CALLBACK_IN, const double *vq, const double *vp, double *uq, double *up, void *user) {
   (void)nham;
   double few[FEW], *room = find_room(ROWS(OUTER + 4 * SUMS + PAIRS), few);
   if (room == NULL)
      return 1;
   double *x = room, *sums = x + ROWS(OUTER), *g = sums + ROWS(SUMS), *curves = g + ROWS(SUMS);
   double *along = curves + ROWS(PAIRS), *r = along + ROWS(SUMS);
   prepare(nlane, t, w, q, p, user, ndof, x, sums);
   of_slopes(nlane, t, x, sums, NULL, user, g);
   of_curves(nlane, t, x, sums, NULL, user, curves);
   of_along(nlane, t, w, q, p, user, ndof, vq, vp, along);
   couple(nlane, 1, curves, along, r);
   if (uq != NULL)
      of_uq(nlane, t, w, q, p, user, ndof, vq, vp, uq, g, r);
   if (up != NULL)
      of_up(nlane, t, w, q, p, user, ndof, vq, vp, up, g, r);
   leave_room(room, few);
   return 0;
}
"""
#: the Hessian itself
HESSIAN = """
/* block[j][i] += sum_a x[a][i] y[a][j] */
static void add_products(const int nlane, const ptrdiff_t sites, const double *restrict x, const double *restrict y,
                         double *restrict block) {
   for (int a = 0; a < SUMS; a++)
      for (ptrdiff_t j = 0; j < sites; j++)
         for (ptrdiff_t k = 0; k < sites; k++)
            for (int i = 0; i < nlane; i++)
               block[ROWS(j * sites + k) + i] += x[ROWS(a * sites + k) + i] * y[ROWS(a * sites + j) + i];
}

int formula_hessian(CALLBACK_IN, double *hqq, double *hqp, double *hpp, void *user) {
   (void)nham;
   const ptrdiff_t sites = ndof, all = SUMS * sites;
   double few[FEW], *room = find_room(ROWS(OUTER + 3 * SUMS + PAIRS + 4 * all), few);
   if (room == NULL)
      return 1;
   double *x = room, *sums = x + ROWS(OUTER), *g = sums + ROWS(SUMS), *unit = g + ROWS(SUMS);
   double *curves = unit + ROWS(SUMS), *dq = curves + ROWS(PAIRS), *dp = dq + ROWS(all);
   double *eq = dp + ROWS(all), *ep = eq + ROWS(all);
   prepare(nlane, t, w, q, p, user, ndof, x, sums);
   of_slopes(nlane, t, x, sums, NULL, user, g);
   of_curves(nlane, t, x, sums, NULL, user, curves);
   for (int a = 0; a < SUMS; a++) {
      memset(unit, 0, (size_t)ROWS(SUMS) * sizeof(double));
      for (int i = 0; i < nlane; i++)
         unit[ROWS(a) + i] = 1;
      of_inner_hq(nlane, t, unit, q, p, user, ndof, dq + ROWS(a * sites));
      of_inner_hp(nlane, t, unit, q, p, user, ndof, dp + ROWS(a * sites));
   }
   couple(nlane, sites, curves, dq, eq);
   couple(nlane, sites, curves, dp, ep);
   if (hqq != NULL) {
      of_hqq(nlane, t, w, q, p, user, ndof, hqq, g);
      add_products(nlane, sites, dq, eq, hqq);
   }
   if (hqp != NULL) {
      of_hqp(nlane, t, w, q, p, user, ndof, hqp, g);
      add_products(nlane, sites, dq, ep, hqp);
   }
   if (hpp != NULL) {
      of_hpp(nlane, t, w, q, p, user, ndof, hpp, g);
      add_products(nlane, sites, dp, ep, hpp);
   }
   leave_room(room, few);
   return 0;
}
"""


def source(chain: Chain, *, hessians: bool) -> str:
    """The callbacks, after the loops of emit_sites; hessians: whether there are Hessians beside products with them."""
    outer = chain.outer
    made, pairs = outer.derivatives, outer.pairs
    count = made.problem.ndof
    table = ", ".join(f"{{{a}, {b}}}" for a, b in pairs) or "{0, 0}"
    head = HEAD.format(
        sums=count, outer=len(outer.numbers), pairs=len(pairs), at_least_one=max(1, len(pairs)), table=table
    )
    parts = [head, _added_up(chain, "sums", "SUMS"), _added_up(chain, "along", "SUMS", "vq", "vp")]
    parts += [_added_up(chain, f"inner_{x}", chain.shape.count) for x in ("hq", "hp") if hessians]
    callbacks = CALLBACKS + (HESSIAN if hessians else "")
    callbacks = callbacks.replace("user, ndof", f"user, {chain.shape.sites}")
    return "\n".join([*parts, _functions(made, pairs), _prepare(outer.numbers), callbacks])


def _added_up(chain: Chain, name: str, rows: str, *vectors: str) -> str:
    """Add up all densities of sums, or their gradients, over the sites, with a second pass for far lanes."""
    given = "".join(f", const double *restrict {x}" for x in vectors)
    parameters = f"IN, const ptrdiff_t sites{given}, OUT {name}"
    names = ", ".join(["t, w, q, p, c, sites", *vectors, name])
    text, loops = "", ""
    for k, d in enumerate(chain.densities):
        if not d.inner:
            continue
        slope = name.removeprefix("inner_")
        if name != slope:  # weighted, as in the gradient
            there, function = additions(d, chain.shape, slope), f"{slope}_{k}"
        else:
            node, function = _value if name == "sums" else _along, f"{name}_{k}"
            nodes = [(a, node(d.derivatives, j)) for j, a in enumerate(d.inner)]
            there = [
                (f"{name}[{a} * (ptrdiff_t)n + i]", x) for a, x in nodes if not d.derivatives.graph.is_number(x, 0.0)
            ]
            if there:
                own = parameters, ["sites", *vectors, name]
                text += pair_loops.function(d, chain.shape, function, there, given=own)
        if there:
            loops += pair_loops.call(d, function, names, name != slope and d.is_own)
    zero = f"   memset({name}, 0, (size_t)({rows} * (ptrdiff_t)n) * sizeof(double));\n"
    text += f"INLINE all_{name}({parameters}, const int far) {{\n   int64_t beyond = 0;\n{zero}{loops}"
    text += "   return beyond;\n}\n\n"
    return text + one_or_many(name, parameters, names)


def _value(made: Derivatives, j: int) -> int:
    """The node of the density of a sum."""
    return made.node(j)


def _along(made: Derivatives, j: int) -> int:
    """The node of the gradient of a sum's density times v."""
    graph = made.graph
    terms = []
    for letter in "qp":
        for i, x in enumerate(made.problem.coordinates(letter)):
            slope = made.node(j, x)
            if not graph.is_number(slope, 0.0):
                terms.append(graph.multiply(slope, graph.leaf(f"v{letter}{i}", True)))
    return graph.sum(terms)


def _functions(made: Derivatives, pairs: list[tuple[int, int]]) -> str:
    """The functions of sums with their derivatives: loops over lanes."""
    count, outputs = made.problem.ndof, made.outputs
    loops = Loops(
        made.graph,
        {
            "functions": outputs["value"],
            "slopes": outputs["hq"],
            "curves": [outputs["hqq"][b * count + a] for a, b in pairs],
        },
    )
    names = [(x,) for x in loops.outputs]
    return "\n".join([*(loops.far(x) for x in names), *(loops.function(x) for x in names)])


def _prepare(numbers) -> str:
    """Code for the weights of Hamiltonians that contain a function, one after the other, and for the sums."""
    copies = "".join(
        f"   memcpy(x + {k} * (ptrdiff_t)n, w + {number} * (ptrdiff_t)n, (size_t)n * sizeof(double));\n"
        for k, number in enumerate(numbers)
    )
    head = "static void prepare(IN, const ptrdiff_t sites, OUT x, OUT sums) {\n"
    return f"{head}{copies}   of_sums(n, t, w, q, p, c, sites, sums);\n}}\n"
