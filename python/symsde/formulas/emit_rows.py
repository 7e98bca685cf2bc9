# SPDX-License-Identifier: BSD-3-Clause
"""C for the rows of a chain H = p.p/2 + U(q) whose Hessian is tridiagonal (symsde_chain_rows in symsde.h).

All densities together are one function of a row q0 and the next one q1: its derivatives by q0 are the row's, those by
q1 are handed on to the next row, so that what ties two sites is evaluated once.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from .._files import optional
from .derivatives import Derivatives
from .emit_c import Writer
from .problem import Problem
from .sites import Chain, Density, Number

LANES = 16  #: that the library asks for at once, strip_lanes: what a row hands on stays in registers
OUTPUTS = {"force": ("hq", 0), "diagonal": ("hqq", 0), "beside": ("hqq", 1)}  #: of a row; places in `Derivatives`
HANDED = {"force": ("hq", 1), "diagonal": ("hqq", 3)}  #: what the next row adds to its own

BODY = """
INLINE rows(const ptrdiff_t n, const int lanes, const ptrdiff_t sites, const ptrdiff_t first, const ptrdiff_t last,
            const double t, const double *restrict w, const double *restrict q, const double *restrict c,
            double *restrict hq, double *restrict hqq, const int far) {{
   int64_t beyond = 0;
   double force[LANES], diagonal[LANES]; /* what the row before adds */
{handed}{before}   for (ptrdiff_t row = first; row <= {last}; row++) {{
      const double *restrict x = q + (row - first + 1) * n, *restrict y = x + n;
      double *restrict f = hq + (row - first) * n, *restrict k = hqq + 2 * (row - first) * n;
#pragma GCC ivdep
      for (int i = 0; i < lanes; i++) {{
{row}      }}
   }}
{alone}   return beyond;
}}

int formula_chain_rows(int nlane, int ndof, int nham, int first, int last, double t, const double *w, const double *q,
                       double *hq, double *hqq, void *user) {{
   (void)nham;
   if (nlane == LANES) {{ /* a number that the compiler knows */
      if (rows(LANES, LANES, ndof, first, last, t, w, q, user, hq, hqq, 0) < 0)
         rows(LANES, LANES, ndof, first, last, t, w, q, user, hq, hqq, 1);
      return 0;
   }}
   for (int i = 0; i < nlane; i += LANES) {{
      const int some = nlane - i < LANES ? nlane - i : LANES;
      if (rows(nlane, some, ndof, first, last, t, w + i, q + i, user, hq + i, hqq + i, 0) < 0)
         rows(nlane, some, ndof, first, last, t, w + i, q + i, user, hq + i, hqq + i, 1);
   }}
   return 0;
}}
"""
HANDED_FROM_ABOVE = """   if ({there}) {{
      const double *restrict x = q, *restrict y = q + n;
{before}      for (int i = 0; i < lanes; i++) {{
{inside}      }}
   }} else {{
      for (int i = 0; i < lanes; i++)
         force[i] = diagonal[i] = 0;
   }}
"""
ALONE = """   if (last == sites - 1) {{ /* beyond the last row there is nothing */
      const ptrdiff_t row = last;
      const double *restrict x = q + (row - first + 1) * n;
      double *restrict f = hq + (row - first) * n, *restrict k = hqq + 2 * (row - first) * n;
{before}      for (int i = 0; i < lanes; i++) {{
{inside}      }}
   }}
"""


@dataclass(frozen=True)
class _Term:
    """Hamiltonians that stand in a row: one, or one for each site."""

    weight: Number
    family: bool


def source(chain: Chain) -> str:
    """The functions; empty where the chain is none with rows."""
    if not has_rows(chain):
        return ""
    closed = chain.ends == "fixed"  # densities that reach beyond the ends count
    terms, whole = _together(chain, chain.densities)
    parts = {
        "handed": _handed_from_above(whole, terms, closed),
        "last": "last" if closed else "(last == sites - 1 ? last - 1 : last)",
        "alone": "",
    }
    before, inside = _loop(whole, terms, OUTPUTS, "f[i] = force[i] + {force};", "k[i] = diagonal[i] + {diagonal};")
    parts |= {"before": before, "row": inside + _lines(whole, "k[n + i] = {beside};", OUTPUTS) + _hand_on(whole)}
    if not closed:
        terms, single = _together(chain, [d for d in chain.densities if len(d.offsets) == 1])
        stores = ("f[i] = force[i] + {force};", "k[i] = diagonal[i] + {diagonal};")
        before, inside = _loop(single, terms, {x: OUTPUTS[x] for x in ("force", "diagonal")}, *stores)
        parts["alone"] = ALONE.format(before=before, inside=inside + "         k[n + i] = 0;\n")
    return f"#define LANES {LANES}" + BODY.format(**parts)


def has_rows(chain: Chain) -> bool:
    """Whether this is a chain as the library wants for rows, with densities that stand in every row alike."""
    traits = chain.traits
    if not (traits["bandwidth"] == 1 and traits["identity_mass"] and (traits["position_noise"] or traits["additive"])):
        return False
    return all(_is_plain(d, chain.ends) for d in chain.densities)


def _is_plain(d: Density, ends: str) -> bool:
    if d.is_rest:
        return True
    if d.family:
        return d.offsets == (0,)
    return ends == "fixed" or (d.offsets[0] <= 0 <= d.offsets[-1])


def _together(chain: Chain, densities: Any) -> tuple[list[_Term], Derivatives]:
    """All densities of a row in one problem of two coordinates; what is left of some at the ends follows from zeros."""
    zero = optional("sympy", "sympy").Integer(0)
    sums: dict[_Term, Any] = {}
    for d in densities:
        if not d.is_rest:
            term = _Term(d.weight, d.family)
            sums[term] = sums.get(term, zero) + d.derivatives.problem.hamiltonians[0]
    problem = Problem(tuple(sums.values()), (), chain.texts, 2, chain.parameters)
    return list(sums), Derivatives(problem)


def _loop(made: Derivatives, terms: list[_Term], outputs: dict[str, Any], *stores: str) -> tuple[str, str]:
    """What is the same for all lanes, and the loop over lanes up to these stores."""

    def load(name: str) -> str:
        if name[0] == "w":
            term = terms[int(name[1:])]
            return f"w[{f'({term.weight} + row)' if term.family else term.weight} * n + i]"
        return {"q0": "x[i]", "q1": "y[i]"}[name]

    roots = [made.outputs[block][at] for block, at in outputs.values()]
    if outputs is OUTPUTS:
        roots += [made.outputs[block][at] for block, at in HANDED.values()]
    before, inside, _ = Writer(made.graph, load).lines(roots)
    text = "".join(f"   {line}\n" for line in inside) + "".join(_lines(made, x, outputs) for x in stores)
    return "".join(f"{line}\n" for line in before), text


def _lines(made: Derivatives, store: str, outputs: dict[str, Any]) -> str:
    """A store of outputs by their names."""
    writer = Writer(made.graph, str)
    values = {name: writer.operand(made.outputs[block][at]) for name, (block, at) in outputs.items()}
    return f"         {store.format(**values)}\n"


def _hand_on(made: Derivatives) -> str:
    return "".join(_lines(made, f"{x}[i] = {{{x}}};", HANDED) for x in HANDED)


def _handed_from_above(made: Derivatives, terms: list[_Term], closed: bool) -> str:
    """What the row before the first adds to it."""
    before, inside = _loop(made, terms, HANDED, *(f"{x}[i] = {{{x}}};" for x in HANDED))
    return HANDED_FROM_ABOVE.format(there="1" if closed else "first > 0", before=before, inside=inside)
