# SPDX-License-Identifier: BSD-3-Clause
"""C for covectors over several steps of kicks and drifts (symsde_pull in symsde.h), of models whose further positions
are parameters (`wide.py`).

Lanes go by strips, whose covectors stay in the nearest cache through all steps. A kick writes new covectors beside the
old ones, from which far lanes are computed again.
"""

from __future__ import annotations

from .derivatives import Derivatives
from .emit_c import Writer

MOST_ROWS = 16  #: most positions
BODY = """
/* lanes of a strip; rows; states that are read ahead */
enum {{ PULLED = 32, MOVING = {moving}, ROWS = {rows}, BEFORE = {before} }};

/* u - S_qq c at one state of some lanes; w0 is the weight of H. */
INLINE pull_kick(const ptrdiff_t n, const int lanes, const double t, const double w0, const double a, const double b,
                 const double *restrict ended, const double *restrict begun, const double *restrict q,
                 const double *restrict theta, const double *restrict u, const double *restrict v, OUT next,
                 const double *restrict c, const int far) {{
   int64_t beyond = 0;
{head}#pragma GCC ivdep
   for (int i = 0; i < lanes; i++) {{
{inside}
{stores}
   }}
   return beyond;
}}

INLINE pull_strip(const ptrdiff_t n, const int lanes, const int nstep, const int noises, const double t,
                  const double h, const double *part, const double *restrict dw, const double *restrict q,
                  const double *restrict theta, double *restrict u, double *restrict v, const double *restrict c) {{
   double rows[2][ROWS * PULLED], moving[MOVING * PULLED];
   int now = 0;
   for (int k = 0; k < ROWS; k++)
      for (int i = 0; i < lanes; i++)
         rows[0][k * PULLED + i] = u[k * n + i];
   for (int k = 0; k < MOVING; k++)
      for (int i = 0; i < lanes; i++)
         moving[k * PULLED + i] = v[k * n + i];
   for (int s = nstep; s >= 0; s--) {{
      const double a = s > 0 ? part[1] : 0, b = s < nstep ? part[0] : 0;
      const double *const ended = dw + (s > 0 ? s - 1 : s) * noises * n;
      const double *const begun = dw + (s < nstep ? s : s - 1) * noises * n;
      const double *const at = q + s * MOVING * n;
      if (s > BEFORE)
         for (int i = 0; i < lanes; i += 8) {{
            for (int k = 0; k < MOVING; k++)
               __builtin_prefetch(at + (k - BEFORE * MOVING) * n + i);
            for (int k = 0; k < noises; k++)
               __builtin_prefetch(ended + (k - BEFORE * noises) * n + i);
         }}
      double *const old = rows[now], *const next = rows[1 - now];
      const double w0 = (a + b) * h;
      if (pull_kick(n, lanes, t + s * h, w0, a, b, ended, begun, at, theta, old, moving, next, c, 0) < 0)
         pull_kick(n, lanes, t + s * h, w0, a, b, ended, begun, at, theta, old, moving, next, c, 1);
      now = 1 - now;
      if (s == 0)
         break;
      for (int k = 0; k < MOVING; k++)
#pragma GCC ivdep
         for (int i = 0; i < lanes; i++)
            moving[k * PULLED + i] = FMA(h, next[k * PULLED + i], moving[k * PULLED + i]);
   }}
   for (int k = 0; k < ROWS; k++)
      for (int i = 0; i < lanes; i++)
         u[k * n + i] = rows[now][k * PULLED + i];
   for (int k = 0; k < MOVING; k++)
      for (int i = 0; i < lanes; i++)
         v[k * n + i] = moving[k * PULLED + i];
   return 0;
}}

int formula_pull(int nlane, int ndof, int nham, int nmoving, int nstep, double t, double h, const double *part,
                 const double *dw, const double *q, const double *theta, double *u, double *c, void *user);
int formula_pull(int nlane, int ndof, int nham, int nmoving, int nstep, double t, double h, const double *part,
                 const double *dw, const double *q, const double *theta, double *u, double *c, void *user) {{
   (void)ndof, (void)nmoving;
   const double *const parameters = PARAMETERS(user);
   for (int i = 0; i < nlane; i += PULLED)
      if (nlane - i >= PULLED) /* a number that the compiler knows */
         pull_strip(nlane, PULLED, nstep, nham - 1, t, h, part, dw + i, q + i, theta + i, u + i, c + i, parameters);
      else
         pull_strip(nlane, nlane - i, nstep, nham - 1, t, h, part, dw + i, q + i, theta + i, u + i, c + i, parameters);
   return 0;
}}
"""


def source(made: Derivatives, moving: int | None) -> str:
    """The function of a model of which the first positions move; empty if these are not known, or where it would be
    no gain."""
    n, graph = made.problem.ndof, made.graph
    separable = all(graph.is_number(x, 0.0) for x in made.outputs["hqp"])
    if moving is None or n > MOST_ROWS or made.constants() or not separable:
        return ""
    vectors = [graph.leaf(f"vq{j}", True) for j in range(moving)]
    columns = [made.outputs["hqq"][j * n : (j + 1) * n] for j in range(moving)]
    products = [graph.dot((columns[j][i], vectors[j]) for j in range(moving)) for i in range(n)]

    def load(name: str) -> str:
        letter = name.rstrip("0123456789")
        k = int(name[len(letter) :])
        if letter == "w":
            row = f"{k - 1} * n + i"
            return "w0" if k == 0 else f"a * ended[{row}] + b * begun[{row}]"
        if letter == "q":
            return f"q[{k} * n + i]" if k < moving else f"theta[{k - moving} * n + i]"
        return f"v[{k} * PULLED + i]"

    writer = Writer(graph, load)
    before, inside, _ = writer.lines(products)
    inside = [line for line in inside if line.strip() != "const double w0 = w0;"]
    stores = [
        f"      next[{k} * PULLED + i] = u[{k} * PULLED + i] - {writer.operand(x)};" for k, x in enumerate(products)
    ]
    head = "".join(f"{line}\n" for line in before)
    return BODY.format(moving=moving, rows=n, before=4, head=head, inside="\n".join(inside), stores="\n".join(stores))
