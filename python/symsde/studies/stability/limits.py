# SPDX-License-Identifier: BSD-3-Clause
"""The largest stable step of a scheme, from the matrix of its step on H = (p^2 + q^2)/2 with omega = 1."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import symsde as ss

from ...answers.linear_stability import is_stable, stable_up_to, step_matrix
from ...errors import SymsdeError
from ...show import look
from ..expectations import Expectations
from .scenario import simulate

NEXT = np.linspace(1.0, 1.1, 201)[1:]  #: multiples of a limit at which growth beyond it is searched
LONG = 3.0  #: omega h at which the text gives the rotation angle of a step
SHORT = 0.1  #: omega h at which growth is given if no step is stable
KNOWN = {"midpoint": math.inf, "lobatto3": math.sqrt(8), "symplectic_euler": 2.0, "stormer_verlet": 2.0, "heun": 0.0}
FIRST = ("midpoint", "gauss2", "chin4a", "stormer_verlet", "heun")  #: schemes that the page begins with
DRAWN = np.linspace(0.05, 5.0, 100)  #: values of omega h at which the growth of these schemes is drawn
HEAD = ("schemes", "symplectic", "stable up to omega h", "what happens beyond")


@dataclass(frozen=True)
class Limit:
    """The limit of one scheme: the least unstable omega h; 0 = every step is unstable, infinite = no tested step is."""

    scheme: str
    omega_h: float
    beyond: float  #: omega h at which growth is given
    rate: float  #: log of the growth of |z| in one step at this omega h
    again: float = math.inf  #: omega h from which on steps are stable again, within 10 % of the limit

    def words(self) -> str:
        """The behaviour beyond the limit in words."""
        if self.omega_h == math.inf:
            turn = math.acos(np.trace(step_matrix(self.scheme, LONG)) / 2)
            return f"nothing blows up; at omega h = {LONG:g} a step turns by {turn:.2f} in place of {LONG:.2f}"
        again = f"; stable again from {self.again:.3g}" if self.again < math.inf else ""
        return f"n steps grow by exp({self.rate:.2g} n) at omega h = {self.beyond:.3g}{again}"


def limit(scheme: str) -> Limit:
    """Find the first unstable step of the scan, refine it, and measure the growth next to it."""
    low, high = stable_up_to(scheme)
    if low == math.inf:
        return Limit(scheme, math.inf, math.inf, 0.0)
    if low == 0:
        return Limit(scheme, 0.0, SHORT, rate(scheme, SHORT))
    near = high * NEXT
    rates = [rate(scheme, x) for x in near]
    worst = int(np.argmax(rates))
    again = next((x for x in near[worst:] if is_stable(step_matrix(scheme, x))), math.inf)
    return Limit(scheme, low, float(near[worst]), rates[worst], float(again))


def rate(scheme: str, omega_h: float) -> float:
    """Log of the growth of |z| per step, in the long run."""
    return math.log(np.abs(np.linalg.eigvals(step_matrix(scheme, omega_h))).max())


def limits(names: Iterable[str]) -> list[Limit]:
    """Limits of the schemes that suit an oscillator, the most stable first."""
    found = []
    for name in names:
        try:
            found.append(limit(name))
        except SymsdeError:
            continue  # the scheme is for other models
    return sorted(found, key=lambda one: -one.omega_h)


def table(found: list[Limit]) -> list[list[str]]:
    """The first table of the page; schemes with the same words share a row."""
    rows: dict[tuple, list[str]] = {}
    for one in found:
        upto = {0.0: "no step", math.inf: "every step"}.get(one.omega_h, f"{one.omega_h:.4g}")
        symplectic = "yes" if ss.schemes.get(one.scheme).info.symplectic else "no"
        rows.setdefault((symplectic, upto, one.words()), []).append(f"`{one.scheme}`")
    return [[", ".join(names), *words] for words, names in rows.items()]


def growth() -> dict:
    """Log of the growth of |z| per step at every drawn omega_h, by scheme."""
    found = {name: [round(rate(name, x), 6) + 0.0 for x in DRAWN] for name in FIRST}
    return {"omega_h": DRAWN.tolist(), "growth": found}


def save(path: Path, data: dict) -> None:
    """Draw the data of `growth`."""
    with look.drawing(path, 5.2, 2.9, 160) as page:
        axes = page.subplots()
        for name, rates in data["growth"].items():
            axes.plot(data["omega_h"], rates, label=name, markevery=6, **look.of_scheme(name))
        axes.set(xlabel=r"$\omega h$", ylabel="log of the growth in a step", ylim=(-0.05, 1.5))
        axes.legend()


def stability_limits(quick: bool) -> Expectations:
    """Runs on both sides of every limit agree with the matrix of a step."""
    result = Expectations("stability_limits", "Stability limits of all schemes, on both sides")
    result.curves = {"limits": limits(KNOWN if quick else ss.schemes.names())}
    for one in result.curves["limits"]:
        if one.scheme in KNOWN:
            result.same(one.scheme, "limit of omega h", f"{one.omega_h:.4f}", f"{KNOWN[one.scheme]:.4f}", "by hand")
        if one.omega_h > 0:
            x = min(0.99 * one.omega_h, 100.0)
            result.at_most(f"{one.scheme}, {x:.4g}", "largest |z| in 10^4 steps", sizes(one.scheme, x).max(), 100)
        if one.omega_h < math.inf:
            size = sizes(one.scheme, one.beyond, steps=min(10**4, int(300 / one.rate)))
            half = len(size) // 2
            found = math.log(size[-1] / size[half]) / (len(size) - 1 - half)
            result.near(f"{one.scheme}, {one.beyond:.4g}", "log of the growth a step", found, one.rate, 0.02 * one.rate)
    return result


def sizes(scheme: str, omega_h: float, steps: int = 10**4) -> np.ndarray:
    """|z| along a run from (1, 0)."""
    run = simulate(ss.models.linear_oscillator(sigma=0.0), scheme=scheme, q0=1.0, p0=0.0, step=omega_h, steps=steps)
    return np.hypot(run.q[:, 0, 0], run.p[:, 0, 0])
