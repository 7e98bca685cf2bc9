# SPDX-License-Identifier: BSD-3-Clause
"""The pages docs/stability.md and, with every expectation, docs/stability-tables.md."""

from __future__ import annotations

from pathlib import Path

from .. import expectations, pages
from ..expectations import Expectations
from . import bifurcation, limits, long_time, stability_figure

FIRST = (
    "A scheme is stable as long as the step h times the fastest frequency omega of the system stays below its limit: 2 "
    "for stormer_verlet, 3.46 for chin4a, no limit for midpoint and the Gauss schemes. Stable is not accurate: a step "
    "beyond omega h = 1 does not resolve the motion. Heun's and Euler-Maruyama's rules grow at every step, so that the "
    "question is only how long a run may be."
)
CAPTION = (
    "Growth of an oscillator in a step, for five schemes. Below its limit a symplectic scheme does not grow at all "
    "(rounding is drawn as zero); beyond it, each step multiplies the state by a factor."
)
NEXT = (
    "The next sections have the limits of all schemes, of orbits of large amplitude, and the energy over long times. "
    "[Expected and measured](stability-tables.md) holds all {total} checks."
)
INTRODUCTION = (
    "This page compares measurements{quick} with what was expected of symsde: {met} of {total} expectations are met. "
    "A mean of random numbers is as expected if it is within {allowed:g} standard errors; one correct mean in a "
    "million then fails. Warnings are those of `report.warnings`, which are known before a run begins. Measured "
    "with {made_by}."
)
LIMITS = """\
The step of a scheme on H = (p^2 + omega^2 q^2)/2 is a matrix. "Stable up to" gives the smallest omega h at which this
matrix has an eigenvalue outside the unit circle. It is found from the library's own steps at omega h from 0.1 to
10^4. For a larger system, omega is its fastest frequency. "Every step" means that nothing grows without bound. It
does not mean that fast modes are accurate: at omega h = 3 the exact solution turns by 3 radians in a step, and the
table gives the angle by which the scheme turns. Multiplicative noise has other limits: see
[mean-square stability](expect.md#mean-square-stability).
"""
BIFURCATIONS = (
    "The limits in the table are values of omega h, where omega is the frequency at rest. The models are the "
    "hardening spring H = p^2/2 + q^2 + q^4/2 and the pendulum H = p^2/2 - cos q, without noise. The columns of "
    "orbits are for the spring, which starts at rest at this q. They give the longest step such that no orbit is lost "
    "within 10^4 steps, at this step and at every shorter one. Spurious points are fixed points of the scheme that "
    "are no equilibria of the equation, and cycles of two steps. They were found by Newton's iteration from 588 "
    "points with |q|, |p| <= 4 (`symsde.reports.stability.fixed_points`). The full line in the figure is the cycle q, "
    "-q that splittings have, with (omega h)^2 U'(q) = 4 omega^2 q. The hardening spring has this cycle at every step "
    "below omega h = 2. There the cycle is unstable, and orbits of larger amplitude are lost. For q = 1 they are lost "
    "at much shorter steps than linear theory says. The pendulum has the cycle from omega h = 2 on; it is stable up "
    "to omega h = sqrt(2 pi). midpoint has no spurious points at any step, because z' = z and z'' = z both imply that "
    "the gradient vanishes at its node. For the same reason gauss2 has no spurious fixed points, and its cycles have "
    "large amplitudes. Heun's rule has spurious fixed points from omega h = 2 on. The last column is for the pendulum "
    "with the noise H_1 = sigma (p^2 + q^2)/2, under which a pendulum at rest stays at rest. At sigma sqrt(h) = 0.1 "
    "it gives the omega h up to which a step near rest adds less than 1 % to E |z|^2. `symsde.advise` tries steps up "
    "to 0.65 times the linear limit divided by the fastest frequency of an orbit."
)
LONG_TIME = """\
(a) The energy H of the Henon-Heiles system without noise, h = 0.1. With symplectic schemes it changes no more in the
second half of the time than in the first. With Heun's rule the energy is lost after the time of the cross: the path
fails, or the change exceeds the range of the figure. With Euler-Maruyama it is lost before the first saved time.
(b) The root mean square change of p^2 + q^2 over 32 paths of the Kubo oscillator, whose noise keeps p^2 + q^2. Schemes
that keep quadratic invariants keep it to rounding. With other symplectic schemes the change grows as the square root
of time, like a random walk: each step has its own noise, and so its own modified Hamiltonian. With schemes that are not
symplectic it grows without bound.
"""
FIGURE = """\
(a) Energy that additive noise puts into an oscillator, divided by that of the exact equation. At long steps it is too
small for the midpoint rule and too large for the Euler pair, for which it is unbounded at omega h = 2. (b) Largest
change of H in 200 steps. The midpoint rule never diverges, stormer_verlet does from omega h = 2 on. (c) Number of
Newton iterations, which begin with increments of zero. (d) Share of paths whose q has the wrong sign, over the strength
of truncated noise. (e) Drift of an invariant, for several stopping rules and ways of summation.
"""


def write(target: Path, found: list[Expectations], quick: bool) -> None:
    """Write the page, the one of all checks beside it, and their figures."""
    command = "symsde stability --markdown docs/stability.md"
    page = pages.Page(target, command, "Stiff and extreme cases")
    appendix = pages.Page(target.with_stem(f"{target.stem}-tables"), command, "Stiff and extreme cases: every check")
    met = expectations.count(found, True)
    total = met + expectations.count(found, False)
    facts = {"met": met, "total": total, "allowed": expectations.STANDARD_ERRORS, "made_by": pages.made_by()}
    appendix.add(pages.wrapped(INTRODUCTION.format(quick=" (quick sample)" if quick else "", **facts)))
    page.add(pages.wrapped(FIRST))
    page.figure("step-limits", limits.growth(), limits.save, "Growth of an oscillator in a step")
    page.add(pages.wrapped(CAPTION), pages.markdown(limits.HEAD, limits.table(limits.limits(limits.FIRST))))
    page.add(pages.wrapped(NEXT.format(total=total)))
    curves = {part.name: part.curves for part in found if part.curves}
    if "stability_limits" in curves:
        rows = limits.table(curves.pop("stability_limits")["limits"])
        page.add("## How long a step may be", pages.markdown(limits.HEAD, rows), LIMITS)
    if "bifurcations" in curves:
        kept = curves.pop("bifurcations")
        page.add("## Orbits of some size, fixed points and cycles")
        page.add(pages.markdown(bifurcation.HEAD, bifurcation.table(kept)))
        page.figure(
            "fixed-points", kept, bifurcation.save, "Fixed points and cycles of a step that the equation does not have"
        )
        page.add(pages.wrapped(BIFURCATIONS))
    if "long_time" in curves:
        page.add("## Energy over a long time")
        page.figure("long-time", curves.pop("long_time"), long_time.save, "Energy over a long time")
        page.add(LONG_TIME)
    appendix.add("## In pictures")
    appendix.figure("stability", curves, stability_figure.save, "Expected and measured")
    appendix.add(FIGURE)
    for number, part in enumerate(found, 1):
        appendix.add(f"## {number}. {part.title}", expectations.section(part, "case"))
    page.write()
    appendix.write()
