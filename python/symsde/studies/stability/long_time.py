# SPDX-License-Identifier: BSD-3-Clause
"""Energy over a long time: symplectic schemes beside Heun's rule and Euler-Maruyama."""

from __future__ import annotations

import importlib
from pathlib import Path

import numpy as np

import symsde as ss

from ...show import look
from ..expectations import Expectations
from .rounding import drifts, slope
from .scenario import simulate

SCHEMES = ("midpoint", "stormer_verlet", "symplectic_euler", "gauss2", "heun", "euler_maruyama")
CONTRASTS = ("heun", "euler_maruyama")
STEP, SAVED, PATHS, SEED = 0.1, 1000, 32, 25
SIGMA = 0.1


def long_time(quick: bool) -> Expectations:
    """H of Henon and Heiles without noise to t = 10^5, p^2 + q^2 of Kubo's oscillator with noise to t = 10^4."""
    result = Expectations("long_time", f"Energy over a long time, h = {STEP:g}")
    many, fewer = (2 * 10**4, 10**4) if quick else (10**6, 10**5)
    result.curves = {"t": STEP * many / SAVED * np.arange(1, SAVED + 1),
                     "kubo_t": STEP * fewer / SAVED * np.arange(1, SAVED + 1)}  # fmt: skip
    for scheme in SCHEMES:
        change = result.curves[scheme] = energy_change(scheme, many)
        name = f"Henon-Heiles, {scheme}"
        if scheme in CONTRASTS:
            lost = np.flatnonzero(~(change < 0.5))
            result.at_most(name, "time at which half of H is lost", first(result.curves["t"], lost), STEP * many)
        else:
            early, late = change[: SAVED // 2].max(), change[SAVED // 2 :].max()
            result.at_most(name, "largest change of H, second half over first", late / early, 1.5)
            result.at_most(name, "largest change of H", max(early, late), 0.2)
        change = result.curves[f"kubo_{scheme}"] = kubo_change(scheme, fewer)
        _kubo(result, scheme, change)
    return result


def _kubo(result: Expectations, scheme: str, change: np.ndarray) -> None:
    """Judge the change: conserved, wandering like the square root of time, or growing exponentially."""
    name = f"Kubo, {scheme}"
    if scheme in CONTRASTS:
        early, late = change[[SAVED // 10, -1]]
        result.at_least(name, "rms change of p^2 + q^2 after a tenth of the time", early, 0.02)
        result.expect(name, "its growth from then to the end", f"{late / early:.3g}", ">= 10", late >= 10 * early)
    elif ss.schemes.get(scheme).info.keeps_quadratic:
        result.at_most(name, "rms change of p^2 + q^2", change[-1], 1e-12)
    else:
        result.between(name, "change as t^k, a random walk: k", slope(result.curves["kubo_t"], change), 0.3, 0.7)


def first(t: np.ndarray, where: np.ndarray) -> float:
    """Time of the first of these indices, infinite if there is none."""
    return float(t[where[0]]) if where.size else np.inf


def energy_change(scheme: str, steps: int) -> np.ndarray:
    """|H/H_0 - 1| at the saved times, NaN if the path has failed."""
    model = ss.models.henon_heiles(sigma1=0.0, sigma2=0.0)
    run = simulate(
        model, q0=[0.1, 0.2], p0=[0.3, 0.1], scheme=scheme, step=STEP, steps=steps, save_every=steps // SAVED
    )
    with np.errstate(over="ignore", invalid="ignore"):
        energy = model.value(run.q[:, :, 0].T.copy(), run.p[:, :, 0].T.copy())
        return np.abs(energy[1:] / energy[0] - 1)


def kubo_change(scheme: str, steps: int) -> np.ndarray:
    """Change of p^2 + q^2, rms over the paths, at the saved times."""
    run = simulate(ss.models.kubo(a=1.0, sigma=SIGMA), q0=1.0, p0=0.0, scheme=scheme, step=STEP, steps=steps,
                   paths=PATHS, seed=SEED, save_every=steps // SAVED)  # fmt: skip
    with np.errstate(over="ignore", invalid="ignore"):
        return drifts(run)


def save(path: Path, curves: dict) -> None:
    """Draw both; points beyond the edge are left out, and a cross marks the end of a curve that leaves the axes.

    One panel is above the other, so that labels are readable at the width of a phone.
    """
    with look.panels(path, [["energy"], ["kubo"]], 4.6, 5.6, 160) as axes:
        for scheme in SCHEMES:
            for axis, time, key in ((axes["energy"], "t", scheme), (axes["kubo"], "kubo_t", f"kubo_{scheme}")):
                t, change = np.array(curves[time], dtype=float), np.array(curves[key], dtype=float)
                seen = change < 1e3
                dashed = "--" if scheme == "gauss2" else "-"  # gauss2's curve covers midpoint's in (b)
                t, change = t[seen], np.maximum(change[seen], 1e-17)
                axis.plot(t, change, ls=dashed, color=look.colour(scheme), label=scheme)
                if 0 < seen.sum() < len(seen):
                    axis.plot(t[-1], change[-1], "X", ms=7, color=look.colour(scheme))
        axes["energy"].set(xscale="log", yscale="log", xlabel="$t$", ylabel="$|H/H_0-1|$", ylim=(1e-12, 1e3))
        axes["kubo"].set(xscale="log", yscale="log", xlabel="$t$", ylabel="rms change of $p^2+q^2$", ylim=(1e-17, 1e3))
        line = importlib.import_module("matplotlib.lines").Line2D
        cross = line([], [], ls="", marker="X", ms=7, color=look.BLACK, label="lost from here on")
        drawn, names = axes["kubo"].get_legend_handles_labels()
        page = axes["kubo"].figure
        page.legend([*drawn, cross], [*names, cross.get_label()], loc="outside lower center", ncols=3)
