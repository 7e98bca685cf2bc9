# SPDX-License-Identifier: BSD-3-Clause
"""Spurious fixed points of the map of a step, and the largest step at which orbits of given sizes stay bounded.

In an even potential, schemes of kicks and drifts have the cycle q, -q if (omega h)^2 U'(q) = 4 omega^2 q, because they
satisfy q_{n+1} - 2 q_n + q_{n-1} = -h^2 U'(q_n). The cycle's multipliers are the squares of the multipliers of one step
with U''(q).
"""

from __future__ import annotations

import importlib
import math
from functools import partial
from pathlib import Path

import numpy as np

import symsde as ss

from ...answers.linear_stability import stable_up_to
from ...answers.mean_square import mean_square
from ...show import look
from ..expectations import Expectations
from .one_step_map import FixedPoint, fixed_points
from .scenario import simulate
from .systems import double_well

SCHEMES = ("midpoint", "gauss2", "gauss3", "stormer_verlet", "symplectic_euler", "gauss_dkdkd", "chin4a", "heun")
DRAWN = ("stormer_verlet", "midpoint", "gauss2", "heun")
SCAN = np.round(np.linspace(0.4, 3.4, 31), 10)  #: values of omega h
SIZES = (0.1, 1.0, 3.0)  #: values of q, at rest, at which orbits begin
ORBIT = 10**4  #: number of steps of an orbit
FAR = 10.0  #: |q| beyond which an orbit counts as lost
ROOM = 0.65  #: longest step of `advise` over the linear limit, both with the fastest frequency of an orbit
#: explicit schemes that `advise` tries
KICKED = ("stormer_verlet", "symplectic_euler", "verlet_dz", "gauss_dkdkd", "chin4a")
ORBITS = (0.1, 0.5, 1.0, 2.0, 3.0, 10.0)  #: values of q, at rest, at which orbits begin
NOISE = 0.1  #: sigma sqrt(h), in units of omega
HEAD = (
    *("scheme", "linear theory"),
    *(f"orbits from q = {size:g}" for size in SIZES),
    *("spurious points: spring", "pendulum", "second moments at rest"),
)


def pendulum() -> tuple[ss.Model, float]:
    """H = p^2/2 - cos q, and omega."""
    return ss.models.pendulum(sigma=0.0), 1.0


def hardening() -> tuple[ss.Model, float]:
    """H = p^2/2 + q^2 + q^4/2, and omega: a chain of one mass."""
    return ss.models.fpu_chain(n=1, beta=1.0, sigma=0.0), math.sqrt(2.0)


MODELS = {"hardening spring": hardening, "pendulum": pendulum}


def cycle_of_kicks(name: str, omega_h: float) -> float:
    """q > 0 of the cycle q, -q of Verlet; NaN if there is none."""
    if name == "hardening spring":
        return math.sqrt(4 / omega_h**2 - 1) if omega_h < 2 else math.nan
    if omega_h <= 2:
        return math.nan
    low, high = 1e-9, math.pi  # sin q/q falls from 1 to 0
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if math.sin(middle) / middle > 4 / omega_h**2 else (low, middle)
    return low


def trace_of_cycle(name: str, omega_h: float) -> float:
    """Trace of the matrix of the cycle, the square of ((0, 1), (-1, s)), s = 2 - h^2 U''(q): stable if |s| < 2."""
    q = cycle_of_kicks(name, omega_h)
    curvature = 1 + 3 * q**2 if name == "hardening spring" else math.cos(q)
    return (2 - omega_h**2 * curvature) ** 2 - 2


def others(name: str, scheme: str, omega_h: float) -> list[FixedPoint]:
    """Spurious fixed points, and cycles of two."""
    model, omega = MODELS[name]()
    found = [fixed_points(model, scheme, step=omega_h / omega, period=period) for period in (1, 2)]
    return [point for points in found for point in points if point.spurious]


def appears(name: str, scheme: str, scan: dict[float, list[FixedPoint]]) -> float:
    """The least omega h of the scan with spurious points or cycles, to a hundredth; infinite if there are none."""
    high = next((x for x, points in scan.items() if points), math.inf)
    low = max((x for x in scan if x < high), default=0.0)
    while high < math.inf and high - low > 0.01 and low > 0:
        middle = (low + high) / 2
        low, high = (low, middle) if others(name, scheme, middle) else (middle, high)
    return high


def stays_up_to(scheme: str, size: float) -> float:
    """Largest omega h of a scan up to which orbits of the hardening spring from (size, 0) stay bounded at all steps."""
    model, omega = hardening()
    kept = 0.0
    for omega_h in np.round(np.arange(0.05, 3.4, 0.05), 10):
        run = simulate(model, q0=size, p0=0.0, scheme=scheme, step=omega_h / omega, steps=ORBIT, save_every=50)
        if run.status.any() or not np.abs(run.q).max() < FAR * size:
            break
        kept = float(omega_h)
    return kept


def lost(scheme: str, part: float) -> list[float]:
    """Sizes whose orbits are lost at `part` of the linear limit for their fastest frequency."""
    model, omega = hardening()
    gone = []
    for size in ORBITS:
        h = part * stable_up_to(scheme)[0] / (omega * math.sqrt(1 + 3 * size**2))
        run = simulate(model, q0=size, p0=0.0, scheme=scheme, step=h, steps=ORBIT, save_every=50)
        if run.status.any() or not np.abs(run.q).max() < FAR * size:
            gone.append(size)
    return gone


def moments_up_to(scheme: str) -> float | None:
    """Largest omega h up to which a step adds less than 1 % to second moments near the pendulum at rest, linearised to
    Kubo's oscillator with noise sigma (p^2 + q^2)/2. None if the scheme does not suit this noise."""
    kept = 0.0
    for omega_h in np.round(np.arange(0.05, 3.4, 0.05), 10):
        try:
            found = mean_square(ss.models.kubo(1.0, NOISE / math.sqrt(omega_h)), scheme, step=omega_h)
        except ss.errors.SymsdeError:
            return None
        if not found.excess <= 0.01:
            break
        kept = float(omega_h)
    return kept


def bifurcations(quick: bool) -> Expectations:
    """Test cycles of two for schemes with known cycles, and that midpoint has none; makes a table and a figure."""
    result = Expectations("bifurcations", "Fixed points and cycles of the step")
    for name, sizes in {"hardening spring": (1.2, 1.6, 1.9), "pendulum": (2.1, 2.4, 2.6)}.items():
        for omega_h in sizes:
            _cycle(result, name, omega_h)
    for name in MODELS:
        for omega_h in (1.0, 2.4):
            found = others(name, "midpoint", omega_h)
            result.same(
                f"midpoint, {name}, omega h = {omega_h:g}",
                "fixed points that the equation does not have",
                len(found),
                0,
            )
    result.same("stormer_verlet, pendulum, omega h = 1.98", "cycles of two",
                len(others("pendulum", "stormer_verlet", 1.98)), 0)  # fmt: skip
    for h, stable in ((1.40, True), (1.43, False)):
        wells = [x for x in fixed_points(double_well(), "stormer_verlet", step=h) if abs(x.q) > 0.5]
        verdict = len(wells) == 2 and all(x.stable == stable for x in wells)
        result.expect(f"stormer_verlet, double well, h = {h:g}", "both wells",
                      ", ".join("stable" if x.stable else "unstable" for x in wells),
                      f"{'stable' if stable else 'unstable'}: the limit is h = sqrt(2)", verdict)  # fmt: skip
    heun = [x.q for x in others("pendulum", "heun", 2.2) if x.q > 0]
    result.near("heun, pendulum, omega h = 2.2", "spurious fixed point, its pi - q",
                math.pi - heun[0] if heun else math.nan, cycle_of_kicks("pendulum", 2.2), 1e-6)  # fmt: skip
    for scheme in KICKED:
        case = f"{scheme}, hardening spring, {ROOM:g} of the linear limit over the fastest frequency"
        result.same(case, "orbits that are lost, from q at rest", lost(scheme, ROOM), [])
    gone = lost("symplectic_euler", 0.75)
    result.expect("symplectic_euler, hardening spring, 0.75 of it", "orbits that are lost, from q at rest",
                  ", ".join(f"{q:g}" for q in gone), "some: linear theory promises too much", bool(gone))  # fmt: skip
    if not quick:
        result.curves = _scan()
        found = result.curves["appears"]
        result.near(
            "stormer_verlet, pendulum", "cycles of two from omega h", found["pendulum"]["stormer_verlet"], 2.0, 0.02
        )
        for name in MODELS:
            result.same(name, "smallest omega h at which midpoint has such points", found[name]["midpoint"], None)
    return result


def _cycle(result: Expectations, name: str, omega_h: float) -> None:
    """Test the cycle q, -q of Verlet, and its multipliers."""
    q = cycle_of_kicks(name, omega_h)
    points = [x for x in others(name, "stormer_verlet", omega_h) if x.period == 2]
    nearest = min(points, key=lambda x: abs(x.q - q), default=None)
    case = f"stormer_verlet, {name}, omega h = {omega_h:g}"
    result.near(case, "q of the cycle", nearest.q if nearest else math.nan, q, 1e-6)
    trace = sum(nearest.multipliers).real if nearest else math.nan
    result.near(case, "sum of its multipliers", trace, trace_of_cycle(name, omega_h), 1e-4 * (2 + abs(trace)))
    stable = abs(trace_of_cycle(name, omega_h)) < 2
    result.same(case, "it is stable", nearest.stable if nearest else None, stable)


def _scan() -> dict:
    """The numbers of table and figure: points, least omega h, sizes; null if there is none."""
    points, first = {}, {name: {} for name in MODELS}
    for name in MODELS:
        points[name] = {}
        for scheme in SCHEMES:
            scan = {float(x): others(name, scheme, float(x)) for x in SCAN}
            least = appears(name, scheme, scan)
            first[name][scheme] = round(least, 3) if least < math.inf else None
            if scheme in DRAWN:
                points[name][scheme] = [
                    [x, round(one.q, 6), int(one.stable), one.period] for x, found in scan.items() for one in found
                ]
    stays = {scheme: [stays_up_to(scheme, size) for size in SIZES] for scheme in SCHEMES}
    return {"points": points, "appears": first, "stays": stays, "moments": {s: moments_up_to(s) for s in SCHEMES}}


def table(curves: dict) -> list[list[str]]:
    """Rows of the page: numbers from linear theory, and numbers found."""
    last = f"{SCAN[-1]:g}"
    rows = []
    for scheme in SCHEMES:
        linear = stable_up_to(scheme)[0]
        orbits = [
            "none" if not x else f"up to {x:g}" if x < SCAN[-1] - 0.06 else "all" for x in curves["stays"][scheme]
        ]
        first = [curves["appears"][name][scheme] for name in MODELS]
        moments = curves["moments"][scheme]
        rows.append([
            f"`{scheme}`",
            {0.0: "no step", math.inf: "every step"}.get(linear, f"{linear:.4g}"),
            *orbits,
            *(f"none up to {last}" if x is None else f"from {x:.2f}" for x in first),
            "-" if moments is None else f"up to {moments:g}" if moments < SCAN[-1] - 0.06 else "all",
        ])  # fmt: skip
    return rows


def save(path: Path, curves: dict) -> None:
    """Draw q of the points against omega h: filled if they are stable; lines are cycles of schemes of kicks."""
    with look.drawing(path, 4.8, 7.4, 160) as page:
        axes = page.subplots(len(DRAWN), len(MODELS), sharex=True, sharey=True)
        for column, (name, schemes) in enumerate(curves["points"].items()):
            for axis, scheme in zip(axes[:, column], DRAWN, strict=True):
                colour = look.colour(scheme)
                for x, q, stable, period in schemes[scheme]:
                    axis.plot(x, q, ls="", marker="o" if period == 2 else "s", ms=3, color=colour,
                              mfc=colour if stable else "none")  # fmt: skip
                if scheme == "stormer_verlet":
                    line = np.linspace(SCAN[0], SCAN[-1], 400)
                    theory = np.array([cycle_of_kicks(name, float(x)) for x in line])
                    for sign in (-1, 1):
                        axis.plot(line, sign * theory, color=look.GREY, lw=0.9)
                if not schemes[scheme]:
                    axis.text(0.5, 0.6, "none", ha="center", transform=axis.transAxes)
                limit = axis.axvline(2, color=look.GREY, ls=":", lw=0.9)
                axis.set(xlim=(SCAN[0], SCAN[-1]), ylim=(-4, 4))
                if not column:
                    axis.set_ylabel(f"{scheme}\n$q$")
            axes[0, column].set_title(name)
            axes[-1, column].set_xlabel(r"$\omega h$")
        key = partial(importlib.import_module("matplotlib.lines").Line2D, [], [], ls="", ms=4, color=look.BLACK)
        keys = {"cycle of two steps, stable": key(marker="o"), "cycle of two steps, unstable": key(marker="o", mfc="w")}
        keys |= {"fixed point, unstable": key(marker="s", mfc="w"), "cycle by hand": key(ls="-", color=look.GREY)}
        keys[r"linear limit of stormer_verlet, $\omega h = 2$"] = limit
        page.legend(keys.values(), keys.keys(), loc="outside lower center", ncols=2)
