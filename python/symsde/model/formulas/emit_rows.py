# SPDX-License-Identifier: BSD-3-Clause
"""C for the rows of a chain H = p.p/2 + U(q) that couples neighbours only: the gradient; and if the Hessian is
tridiagonal, as it is without periodic ends, force and stiffness of a row (symsde_chain_rows in symsde.h).

All densities together are one function of a row q0 and the next row q1: its derivatives with respect to q0 belong to
the row, its derivatives with respect to q1 are passed on to the next row, so that each bond is evaluated once.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ...native.files import optional
from .chain import Chain, Density
from .derivatives import Derivatives
from .emit_c import Writer
from .named_formulas import Problem
from .site_reader import Number

#: number of lanes that the library passes at once (strip_lanes): the results for the next row stay in registers
LANES = 16
TILE = 256  #: rows of one lane computed together: values passed from row to row fit into the nearest cache
WIDE = 64  #: number of lanes of a gradient that advance together: blocks of long chains have as many
#: output of a row -> block and place in `Derivatives`
OUTPUTS = {"force": ("hq", 0), "diagonal": ("hqq", 0), "beside": ("hqq", 1)}
#: output -> block and place of the part that is added to the next row
HANDED = {"force": ("hq", 1), "diagonal": ("hqq", 3)}

BODY = """
/* Rows first .. last of some lanes: `above` is the row before them, `next` begins one row behind q. What a row hands on
 * to the next one stands in force and diagonal; stiffness is found where `stiff` says so. */
INLINE rows(const ptrdiff_t n, const int lanes, const ptrdiff_t sites, const ptrdiff_t first, const ptrdiff_t last,
            const double t, const double *restrict w, const double *restrict above, const double *restrict q,
            const double *restrict next, const double *restrict c, double *restrict hq, double *restrict hqq,
            double *restrict force, double *restrict diagonal, const int stiff, const int far) {{
   int64_t beyond = 0;
{handed}{before}   for (ptrdiff_t row = first; row <= {last}; row++) {{
      const double *restrict x = q + (row - first) * n, *restrict y = next + (row - first) * n;
      double *restrict f = hq + (row - first) * n, *restrict k = stiff ? hqq + 2 * (row - first) * n : NULL;
#pragma GCC ivdep
      for (int i = 0; i < lanes; i++) {{
{row}      }}
   }}
{alone}   return beyond;
}}

/* The same of one lane, whose rows are computed side by side. */
INLINE scalar_rows(const ptrdiff_t sites, const ptrdiff_t first, const ptrdiff_t last, const double t,
                 const double *restrict w, const double *restrict above, const double *restrict q,
                 const double *restrict next, const double *restrict c, double *restrict hq, double *restrict hqq,
                 const int stiff, const int far) {{
   enum {{ n = 1, lanes = 1 }};
   double force[TILE + 1], diagonal[TILE + 1];
   int64_t beyond = 0;
{handed}{before}   for (ptrdiff_t tile = first; tile <= {last}; tile += TILE) {{
      const ptrdiff_t left = {last} - tile + 1;
      const int some = left < TILE ? (int)left : TILE;
      const double *restrict x = q + (tile - first), *restrict y = next + (tile - first);
      double *restrict f = hq + (tile - first), *restrict k = stiff ? hqq + 2 * (tile - first) : NULL;
#pragma GCC ivdep
      for (int i = 0; i < some; i++) {{
{side}      }}
#pragma GCC ivdep
      for (int i = 0; i < some; i++) {{
         f[i] = force[i] + f[i];
         if (stiff)
            k[2 * i] = diagonal[i] + k[2 * i];
      }}
      force[0] = force[some];
      diagonal[0] = diagonal[some];
   }}
{alone}   return beyond;
}}
"""
CHAIN_ROWS = """
int formula_chain_rows(int nlane, int ndof, int nham, int first, int last, double t, const double *w, const double *q,
                       double *hq, double *hqq, void *user) {
   (void)nham;
   double force[LANES], diagonal[LANES];
   const double *const own = q + nlane, *const next = own + nlane;
   if (nlane == LANES) { /* a number that the compiler knows */
      if (rows(LANES, LANES, ndof, first, last, t, w, q, own, next, user, hq, hqq, force, diagonal, 1, 0) < 0)
         rows(LANES, LANES, ndof, first, last, t, w, q, own, next, user, hq, hqq, force, diagonal, 1, 1);
      return 0;
   }
   if (nlane == 1) {
      if (scalar_rows(ndof, first, last, t, w, q, own, next, user, hq, hqq, 1, 0) < 0)
         scalar_rows(ndof, first, last, t, w, q, own, next, user, hq, hqq, 1, 1);
      return 0;
   }
   for (int i = 0; i < nlane; i += LANES) {
      const int some = nlane - i < LANES ? nlane - i : LANES;
      if (rows(nlane, some, ndof, first, last, t, w + i, q + i, own + i, next + i, user, hq + i, hqq + i, force,
               diagonal, 1, 0) < 0)
         rows(nlane, some, ndof, first, last, t, w + i, q + i, own + i, next + i, user, hq + i, hqq + i, force,
              diagonal, 1, 1);
   }
   return 0;
}
"""
GRADIENT = """
static const double nothing[WIDE] = {{0}};

/* Rows first .. last of the gradient in q. */
INLINE rows_of_hq(const int n, const int lanes, const ptrdiff_t sites, const ptrdiff_t first, const ptrdiff_t last,
                  const double t, const double *restrict w, const double *restrict above, const double *restrict q,
                  const double *restrict next, const double *restrict c, OUT hq, const int far) {{
   double force[WIDE];
   return n == 1 ? scalar_rows(sites, first, last, t, w, above, q, next, c, hq, NULL, 0, far)
                 : rows(n, lanes, sites, first, last, t, w, above, q, next, c, hq, NULL, force, NULL, 0, far);
}}

/* The gradient in q, row after row; the last one, whose next row is none or the first, by itself. */
INLINE strip_of_hq(const int n, const int lanes, const double t, const double *restrict w, const double *restrict q,
                   const double *restrict c, const ptrdiff_t sites, OUT hq, const int far) {{
   const double *const end = q + (sites - 1) * n, *const above = sites > 1 ? end - n : {above};
   return rows_of_hq(n, lanes, sites, 0, sites - 2, t, w, {above}, q, q + n, c, hq, far) |
          rows_of_hq(n, lanes, sites, sites - 1, sites - 1, t, w, above, end, {behind}, c, hq + (sites - 1) * n, far);
}}

static __attribute__((noinline)) void of_hq(IN, const ptrdiff_t sites, OUT hq) {{
   if (n == 1) {{
      if (strip_of_hq(1, 1, t, w, q, c, sites, hq, 0) < 0)
         strip_of_hq(1, 1, t, w, q, c, sites, hq, 1);
      return;
   }}
   for (int i = 0; i < n; i += WIDE) {{
      const int some = n - i < WIDE ? n - i : WIDE;
      if (some == WIDE) {{ /* a number that the compiler knows */
         if (strip_of_hq(n, WIDE, t, w + i, q + i, c, sites, hq + i, 0) < 0)
            strip_of_hq(n, WIDE, t, w + i, q + i, c, sites, hq + i, 1);
      }} else if (strip_of_hq(n, some, t, w + i, q + i, c, sites, hq + i, 0) < 0)
         strip_of_hq(n, some, t, w + i, q + i, c, sites, hq + i, 1);
   }}
}}
"""
HANDED_FROM_ABOVE = """   if ({there}) {{
      const double *restrict x = above, *restrict y = q;
{before}      for (int i = 0; i < lanes; i++) {{
{inside}      }}
   }} else {{
      for (int i = 0; i < lanes; i++) {{
         force[i] = 0;
         if (stiff)
            diagonal[i] = 0;
      }}
   }}
"""
ALONE = """   if (last == sites - 1) {{ /* beyond the last row there is nothing */
      const ptrdiff_t row = last;
      const double *restrict x = q + (row - first) * n;
      double *restrict f = hq + (row - first) * n, *restrict k = stiff ? hqq + 2 * (row - first) * n : NULL;
{before}      for (int i = 0; i < lanes; i++) {{
{inside}      }}
   }}
"""


@dataclass(frozen=True)
class _Term:
    """Hamiltonians with terms in a row: one, or one for each site."""

    weight: Number
    family: bool


def source(chain: Chain) -> str:
    """The C functions for rows."""
    closed = chain.ends != "free"  # with closed ends also densities that reach beyond the ends
    terms, whole = together(chain, chain.densities)
    parts = {
        "handed": _handed_from_above(whole, terms, closed),
        "last": "last" if closed else "(last == sites - 1 ? last - 1 : last)",
        "alone": "",
    }
    own = ("f[i] = force[i] + {force};", "k[i] = diagonal[i] + {diagonal};", "k[n + i] = {beside};")
    before, inside = _loop(whole, terms, OUTPUTS, own)
    parts |= {
        "before": before,
        "row": inside + _stores(whole, HANDED, ("force[i] = {force};", "diagonal[i] = {diagonal};")),
    }
    own = ("f[i] = {force};", "k[2 * i] = {diagonal};", "k[2 * i + 1] = {beside};")
    parts["side"] = _loop(whole, terms, OUTPUTS, own, weights=("w[{0}]", "w[{0} + tile + i]"))[1]
    parts["side"] += _stores(whole, HANDED, ("force[i + 1] = {force};", "diagonal[i + 1] = {diagonal};"))
    if not closed:
        terms, single = together(chain, [d for d in chain.densities if len(d.offsets) == 1])
        own = ("f[i] = force[i] + {force};", "k[i] = diagonal[i] + {diagonal};", "k[n + i] = 0;")
        before, inside = _loop(single, terms, {x: OUTPUTS[x] for x in ("force", "diagonal")}, own)
        parts["alone"] = ALONE.format(before=before, inside=inside)
    text = f"enum {{ LANES = {LANES}, TILE = {TILE}, WIDE = {WIDE} }};\n" + BODY.format(**parts)
    if chain.ends == "periodic":
        return text + GRADIENT.format(above="end", behind="q")
    return text + CHAIN_ROWS + GRADIENT.format(above="nothing", behind="nothing")


def has_rows(chain: Chain) -> bool:
    """Whether each row of the force couples neighbours only, by densities that are the same in every row."""
    traits = chain.traits
    if (
        chain.outer
        or not chain.is_line
        or not (traits["identity_mass"] and (traits["position_noise"] or traits["additive"]))
    ):
        return False
    reach = max(d.offsets[-1] - d.offsets[0] for d in chain.densities)
    near = traits["bandwidth"] == 1 or (chain.ends == "periodic" and reach == 1)
    return near and all(_is_plain(d, chain.ends) for d in chain.densities)


def _is_plain(d: Density, ends: str) -> bool:
    if d.is_rest:
        return True
    if d.family:
        return d.offsets == (0,)
    return ends != "free" or (d.offsets[0] <= 0 <= d.offsets[-1])


def together(chain: Chain, densities: Any) -> tuple[list[_Term], Derivatives]:
    """All densities of a row as one problem of two coordinates; at the ends missing coordinates are zero."""
    zero = optional("sympy", "sympy").Integer(0)
    sums: dict[_Term, Any] = {}
    for d in densities:
        if not d.is_rest:
            term = _Term(d.weight, d.family)
            sums[term] = sums.get(term, zero) + d.derivatives.problem.hamiltonians[0]
    problem = Problem(tuple(sums.values()), (), chain.texts, 2, chain.parameters)
    return list(sums), Derivatives(problem)


def _loop(
    made: Derivatives,
    terms: list[_Term],
    outputs: dict[str, Any],
    stores: tuple[str, ...],
    weights: tuple[str, str] = ("w[{0} * n + i]", "w[({0} + row) * n + i]"),
) -> tuple[str, str]:
    """Code that is equal for all lanes, and the loop over lanes with these stores; with weights of single Hamiltonians
    and of one Hamiltonian for each site."""

    def load(name: str) -> str:
        if name[0] == "w":
            term = terms[int(name[1:])]
            return weights[term.family].format(term.weight)
        return {"q0": "x[i]", "q1": "y[i]"}[name]

    roots = [made.outputs[block][at] for block, at in outputs.values()]
    if outputs is OUTPUTS:
        roots += [made.outputs[block][at] for block, at in HANDED.values()]
    before, inside, _ = Writer(made.graph, load).lines(roots)
    text = "".join(f"   {line}\n" for line in inside) + _stores(made, outputs, stores)
    return "".join(f"{line}\n" for line in before), text


def _stores(made: Derivatives, outputs: dict[str, Any], stores: tuple[str, ...]) -> str:
    """Stores of the outputs by their names: force, and stiffness if it is requested."""
    writer = Writer(made.graph, str)
    values = {name: writer.operand(made.outputs[block][at]) for name, (block, at) in outputs.items()}
    force, *stiffness = (f"{store.format(**values)}\n" for store in stores)
    wanted = "".join(f"            {store}" for store in stiffness)
    return f"         {force}         if (stiff) {{\n{wanted}         }}\n"


def _handed_from_above(made: Derivatives, terms: list[_Term], closed: bool) -> str:
    """The contribution to the first row of a call from the row above it."""
    before, inside = _loop(made, terms, HANDED, ("force[i] = {force};", "diagonal[i] = {diagonal};"))
    return HANDED_FROM_ABOVE.format(there="1" if closed else "first > 0", before=before, inside=inside)
