# SPDX-License-Identifier: BSD-3-Clause
"""C for all summands of a density: sites one by one, or pairs of sites i < j in loops over all pairs and over lanes.

Pairs come in the order of i and then of j, whatever the number of lanes. Many lanes go by strips, whose rows stay in
the nearest caches. Of one lane the sites j are computed side by side; what belongs to site i is added afterwards, one
pair after the other, so that bits are those of many lanes.
"""

from __future__ import annotations

from .chain import Summand
from .site_loops import site_loop, summand
from .site_reader import Shape

HEAD = "enum { STRIP = 8, TILE_OF_PAIRS = 128 }; /* lanes, and sites of one lane, that are computed together */\n"
BODY = """INLINE {name}_pairs({parameters}, const int lanes, const int far) {{
   int64_t beyond = 0;
   for (ptrdiff_t site = {first}; site <= {last}; site++)
      for (ptrdiff_t other = site + 1; other < sites; other++) {{
{before}
#pragma GCC ivdep
         for (int i = 0; i < lanes; i++) {{
{inside}
{stores}
         }}
      }}
   return beyond;
}}

INLINE {name}_alone({parameters}, const int far) {{
   enum {{ i = 0 }};
   int64_t beyond = 0;
   double part[{kept} * TILE_OF_PAIRS];
   for (ptrdiff_t site = {first}; site <= {last}; site++)
      for (ptrdiff_t tile = site + 1; tile < sites; tile += TILE_OF_PAIRS) {{
         const int some = sites - tile < TILE_OF_PAIRS ? (int)(sites - tile) : TILE_OF_PAIRS;
#pragma GCC ivdep
         for (int k = 0; k < some; k++) {{
            const ptrdiff_t other = tile + k;
{before}
{inside}
{apart}
         }}
         for (int k = 0; k < some; k++) {{
{added}
         }}
      }}
   return beyond;
}}

INLINE {name}({parameters}, const int far) {{
   if (n == 1)
      return {name}_alone(1, {names}, far);
   int64_t beyond = 0;
   for (int lane = 0; lane < n; lane += STRIP)
      if (n - lane >= STRIP) /* a number that the compiler knows */
         beyond |= {name}_pairs(n, {moved}, STRIP, far);
      else
         beyond |= {name}_pairs(n, {moved}, n - lane, far);
   return beyond;
}}

"""


def function(
    d: Summand, shape: Shape, name: str, adds: list[tuple[str, int]], *, given: tuple[str, list[str]], how: str = "+="
) -> str:
    """The function of one site of a density, or of all its pairs. adds: places and nodes of the additions; given:
    declarations of arguments, and the names of those behind the state and the parameters."""
    parameters, names = given
    if not d.is_pair:
        body = site_loop(d, shape, adds, how)
        return f"INLINE {name}({parameters}, const ptrdiff_t site, const int far) {{\n{body}}}\n\n"
    before, inside, found = summand(d, shape, adds)
    own = [(target, value) for target, value in found if "other" not in target]
    apart = [f"{target} += {value};" for target, value in found if "other" in target]
    apart += [f"part[{j} * TILE_OF_PAIRS + k] = {value};" for j, (_, value) in enumerate(own)]
    names = ["t", "w", "q", "p", "c", *names]

    def lines(texts: list[str]) -> str:
        return "\n".join(f"            {x.strip()}" for x in texts)

    return BODY.format(
        name=name,
        parameters=parameters,
        first=d.first,
        last=d.last,
        names=", ".join(names),
        moved=", ".join(x if x in ("t", "c", "sites") else f"{x} + lane" for x in names),
        before=lines(before),
        inside=lines(inside),
        stores=lines([f"{target} += {value};" for target, value in found]),
        apart=lines(apart),
        kept=max(1, len(own)),
        added=lines([f"{target} += part[{j} * TILE_OF_PAIRS + k];" for j, (target, _) in enumerate(own)]),
    )


def call(d: Summand, name: str, names: str, own: bool = False) -> str:
    """Calls of such a function for all sites, or for all pairs; `own` means that each site writes only to its own
    rows, so that sites are independent."""
    if d.is_pair:
        return f"   beyond |= {name}(n, {names}, far);\n"
    apart = "#pragma GCC ivdep\n" if own else ""
    loop = f"{apart}   for (ptrdiff_t site = {d.first}; site <= {d.last}; site++)\n"
    return f"{loop}      beyond |= {name}(n, {names}, site, far);\n"
