# SPDX-License-Identifier: BSD-3-Clause
"""The page docs/stability.md."""

from __future__ import annotations

from pathlib import Path

from .. import expectations, pages
from ..expectations import Expectations
from . import bifurcation, limits, long_time, stability_figure

INTRODUCTION = (
    "This page compares measurements{quick} with what was expected of symsde: {met} of {total} expectations are met. "
    "Means of random numbers are expected within {allowed:g} standard errors; one in a million is then a false alarm. "
    "Warnings are those of `report.warnings`, which are known before a run begins. Measured with {made_by}."
)
LIMITS = """\
The step of a scheme on H = (p^2 + omega^2 q^2)/2 is a matrix. "Stable up to" gives the smallest omega h at which this
matrix has an eigenvalue outside the unit circle. It is found from the library's own steps at omega h from 0.1 to
10^4. For a larger system, omega is its fastest frequency. "Every step" means that nothing grows without bound. It
does not mean that fast modes are accurate: the table says what a step makes of a rotation by 3 radians.
Multiplicative noise has other limits: see [mean-square stability](expect.md#mean-square-stability).
"""
BIFURCATIONS = (
    "The limits in the table are values of omega h, where omega is the frequency at rest. The models are the hardening"
    " spring H = p^2/2 + q^2 + q^4/2 and the pendulum H = p^2/2 - cos q, without noise. The columns of orbits give the"
    " longest step up to which, at this and every shorter step, no orbit of the spring that starts at rest at q is "
    "lost within 10^4 steps. Spurious points are fixed points of the scheme at which the equation does not rest, and "
    "cycles of two steps. They were found by Newton's iteration from 588 points with |q|, |p| <= 4 "
    "(`symsde.reports.stability.fixed_points`). The full line in the figure is the cycle q, -q of splittings: "
    "(omega h)^2 U'(q) = 4 omega^2 q. The hardening spring has it at every step below omega h = 2. There the cycle is "
    "unstable, and orbits beyond it are lost: for q = 1 at much shorter steps than linear theory says. The pendulum "
    "has it from 2 on, and it is stable up to sqrt(2 pi). midpoint has no spurious points at any step, because z' = z "
    "and z'' = z both imply that the gradient vanishes at its node. For the same reason gauss2 has no spurious fixed "
    "points, and its cycles have large amplitudes. Heun's rule has spurious fixed points from 2 on. The last column is"
    " for the noise H_1 = sigma (p^2 + q^2)/2, which keeps the pendulum at rest. It gives the omega h up to which a "
    "step near rest adds less than 1 % to E |z|^2, at sigma sqrt(h) = 0.1. `symsde.advise` tries steps up to 0.65 of "
    "the linear limit over the fastest frequency of an orbit."
)
LONG_TIME = """\
(a) The energy H of the Henon-Heiles system without noise, h = 0.1. With symplectic schemes it changes no more in the
second half of the time than in the first. With Heun's rule it is lost where the cross stands; with Euler-Maruyama it is
lost before the first point that is shown.
(b) The root mean square change of p^2 + q^2 over 32 paths of the Kubo oscillator, whose noise keeps p^2 + q^2. Schemes
that keep quadratic invariants keep it to rounding. With other symplectic schemes it wanders as the square root of time,
because each step has its own noise and so keeps another modified Hamiltonian. With schemes that are not symplectic it
grows without bound.
"""
FIGURE = """\
(a) Energy that additive noise puts into an oscillator, relative to the exact equation. At long steps the midpoint
rule takes in too little, the Euler pair too much, without bound at omega h = 2. (b) Largest change of H in 200 steps.
The midpoint rule never diverges, stormer_verlet does from omega h = 2 on. (c) Newton iterations from zero increments.
(d) Share of paths whose q has the wrong sign, over the strength of truncated noise. (e) Drift of an invariant, for
several stopping rules and ways of summation.
"""


def write(target: Path, found: list[Expectations], quick: bool) -> None:
    """Write the page and its figures."""
    page = pages.Page(target, "symsde stability --markdown docs/stability.md", "Stiff and extreme cases")
    met = expectations.count(found, True)
    total = met + expectations.count(found, False)
    facts = {"met": met, "total": total, "allowed": expectations.STANDARD_ERRORS, "made_by": pages.made_by()}
    page.add(pages.wrapped(INTRODUCTION.format(quick=" (quick sample)" if quick else "", **facts)))
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
    page.add("## Expected and measured")
    page.figure("stability", curves, stability_figure.save, "Expected and measured")
    page.add(FIGURE)
    for number, part in enumerate(found, 1):
        page.add(f"## {number}. {part.title}", expectations.section(part, "case"))
    page.write()
