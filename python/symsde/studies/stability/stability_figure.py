# SPDX-License-Identifier: BSD-3-Clause
"""The figure of the page: expected values as lines, measured values as points."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...show import look
from .linear import euler_factor, midpoint_factor
from .nonlinear import MOST


def save(path: Path, curves: dict) -> None:
    """Write a PNG of the scenarios that have curves, {name: curves}."""
    panels = {"energy_input": _energy, "resonances": _resonances, "quartic_steps": _iterations, "squeezing": _signs,
              "invariant_drift": _drift}  # fmt: skip
    mosaic = [["energy_input", "resonances"], ["quartic_steps", "squeezing"], ["invariant_drift"] * 2]
    with look.panels(path, mosaic, 7.5, 7.6, 115) as axes:
        for name, draw in panels.items():
            if name in curves:
                draw(axes[name], curves)


def _energy(axis, curves) -> None:
    x = np.geomspace(0.01, 1000, 400)
    for part, key, scheme, name, h, factor in (
        ("energy_input", "midpoint", "midpoint", "midpoint", x, midpoint_factor),
        ("euler_limit", "euler", "symplectic_euler", "Euler pair", x[x < 1.999], euler_factor),
    ):
        style = look.of_scheme(scheme)
        axis.plot(h, factor(h), color=style["color"], label=f"{name}, expected")
        if part in curves:
            axis.plot(curves[part]["h"], curves[part][key], ls="", mfc="none", label="observed", **style)
    axis.axvline(2, color=look.GREY, ls=":", lw=0.9, label=r"$\omega h=2$")
    axis.set(xscale="log", yscale="log", xlabel=r"$\omega h$", ylabel="energy input / exact")
    axis.legend(loc="lower left", handlelength=1.2, borderaxespad=0.1)


def _resonances(axis, curves) -> None:
    data = curves["resonances"]
    for scheme in ("stormer_verlet", "midpoint"):
        change = np.nan_to_num(np.clip(np.array(data[scheme], dtype=float), 1e-12, 1e6), nan=1e6)
        axis.plot(data["x"], change, ls="", ms=2.5, label=scheme, **look.of_scheme(scheme))
    axis.axvline(2, color=look.GREY, ls=":", lw=0.9, label=r"$\omega h=2$")
    axis.set(xscale="log", yscale="log", xlabel=r"$\omega h$ of the fast spring", ylabel="largest change of $H$")
    axis.annotate("failed, or beyond", (0.02, 0.95), xycoords="axes fraction", fontsize=7, color="#666666")
    axis.legend(loc="center right")


def _iterations(axis, curves) -> None:
    data = curves["quartic_steps"]
    for row, q0, mark in zip(data["iterations"], data["q0"], ("o-", "s--", "^-.", "v:"), strict=False):
        axis.plot(data["h"], row, mark, color=look.colour("midpoint"), label=f"$q_0$ = {q0:g}")
    axis.axhline(MOST, color=look.GREY, ls=":", lw=0.9, label=f"allowed: {MOST}")
    axis.set(xscale="log", xlabel="$h$", ylabel="Newton iterations", ylim=(0, 1.6 * MOST))
    axis.legend(loc="upper left", ncols=2)


def _signs(axis, curves) -> None:
    data = curves["squeezing"]
    axis.plot(data["bound"], data["expected"], "_", ms=16, color=look.BLACK, label="expected")
    axis.plot(data["bound"], data["wrong"], "o", color=look.colour("midpoint"), mfc="none", label="observed")
    axis.axvline(1, color=look.GREY, ls=":", lw=0.9, label="solvable below 1")
    axis.set(xlabel=r"$\sigma c \sqrt{h}/2$", ylabel="wrong signs", ylim=(-0.03, 0.55))
    axis.legend()


def _drift(axis, curves) -> None:
    data = curves["invariant_drift"]
    rules = {rule: values for rule, values in data.items() if rule != "steps"}
    styles = (("-", look.BLUE), ("--", look.BLUE), ("-", look.WINE), ("--", look.BLACK), ("-.", look.SKY))
    for (rule, values), (line, colour) in zip(rules.items(), styles, strict=False):
        axis.plot(data["steps"], np.maximum(values, 1e-17), line, color=colour, label=rule)
    steps = np.asarray(data["steps"], dtype=float)
    axis.plot(steps, 3e-17 * np.sqrt(steps), ":", color=look.GREY, label=r"$\sqrt{\mathrm{steps}}$")
    axis.set(xscale="log", yscale="log", xlabel="steps", ylabel="rms change of $p^2 + q^2$")
    axis.legend(ncols=2, loc="center left")
