# SPDX-License-Identifier: BSD-3-Clause
"""The page docs/stability.md."""

from __future__ import annotations

from pathlib import Path

from .. import expectations, pages
from ..expectations import Expectations
from . import bifurcation, figure, limits, long_time

INTRODUCTION = (
    "What was expected of symsde{quick}, and what was measured: {met} of {total} expectations are met. Means of random "
    "numbers are expected within {allowed:g} of their standard errors, of which one in a million is a false alarm. "
    "Warnings are those of `report.warnings`, known before a run begins. Measured with {made_by}."
)
LIMITS = """\
The step of a scheme on H = (p^2 + omega^2 q^2)/2 is a matrix. "Stable up to" is the first omega h at which it has an
eigenvalue outside the unit circle, found from the library's own steps at omega h from 0.1 to 10^4; in a larger system
omega is its fastest frequency. "Every step" means that nothing blows up, not that fast modes are followed: the table
says what a step makes of a turn by 3 radians. Multiplicative noise has limits of its own: see
[mean-square stability](expect.md#mean-square-stability).
"""
BIFURCATIONS = (
    "omega h, omega at rest, of the hardening spring H = p^2/2 + q^2 + q^4/2 and the pendulum H = p^2/2 - cos q, "
    "without noise. Orbits: of the spring, 10^4 steps from q at rest stay, for this and every shorter step. Points of "
    "its own: fixed points at which the equation does not rest, and cycles of two steps, found by Newton's iteration "
    "from 588 points of |q|, |p| <= 4 (`symsde.stability.fixed_points`); circles are cycles, full where they are "
    "stable. The lines are where kicks and drifts have the cycle q, -q: (omega h)^2 U'(q) = 4 omega^2 q. A spring "
    "that hardens has it at every step below 2, unstable, and orbits beyond it are lost: at q = 1 long before linear "
    "theory says so. A pendulum has it from 2 on, stable up to sqrt(2 pi). midpoint has none at any step: z' = z and "
    "z'' = z both say that the gradient vanishes at its node; of gauss2 the same is true of fixed points, and its "
    "cycles come with large amplitudes. Heun's rule has fixed points of its own from 2 on. Second moments: H_1 = "
    "sigma (p^2 + q^2)/2 keeps the pendulum at rest; near it a step adds less than 1 % to E |z|^2, at sigma sqrt(h) = "
    "0.1. What `symsde.advise` tries stays at 0.65 of the linear limit over the fastest frequency of an orbit."
)
LONG_TIME = """\
(a) H of Henon and Heiles without noise, h = 0.1: symplectic schemes change it by no more in the second half of the time
than in the first; Heun's rule loses it, Euler-Maruyama before the first point. (b) p^2 + q^2 of Kubo's oscillator,
which its noise does not change, rms over 32 paths: schemes that keep quadratic invariants keep it to rounding; other
symplectic schemes let it wander as the square root of time, since each step, with a noise of its own, keeps another
modified Hamiltonian; schemes that are not symplectic let it grow without bound.
"""
FIGURE = """\
(a) Energy that additive noise puts into an oscillator, relative to the equation: the midpoint rule takes in too little
at long steps, the Euler pair too much, without bound at omega h = 2. (b) Largest change of H at 200 steps: the midpoint
rule never blows up, stormer_verlet does from 2 on. (c) Newton iterations from zero increments. (d) Share of paths whose
q has the wrong sign, by the strength of truncated noise. (e) Drift of an invariant by stopping rule and summation.
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
        page.figure("fixed-points", kept, bifurcation.save, "Points of the step that the equation has not")
        page.add(pages.wrapped(BIFURCATIONS))
    if "long_time" in curves:
        page.add("## Energy over a long time")
        page.figure("long-time", curves.pop("long_time"), long_time.save, "Energy over a long time")
        page.add(LONG_TIME)
    page.add("## Expected and measured")
    page.figure("stability", curves, figure.save, "Expected and measured")
    page.add(FIGURE)
    for number, part in enumerate(found, 1):
        page.add(f"## {number}. {part.title}", expectations.section(part, "case"))
    page.write()
