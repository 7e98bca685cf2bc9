# SPDX-License-Identifier: BSD-3-Clause
"""The figure of the page: expected as lines, observed as points."""

from __future__ import annotations

import importlib
from pathlib import Path

import numpy as np

from .. import _files
from ..study.figure import COLOURS, STYLE
from .linear import euler_factor, midpoint_factor

BLUE, VERMILION, GREEN, PURPLE, ORANGE = COLOURS[:5]


def save(path: Path, found: list) -> None:
    """Write a PNG of the scenarios that have curves."""
    matplotlib = _files.optional("matplotlib", "plot")
    figures = importlib.import_module("matplotlib.figure")
    curves = {scenario.number: scenario.curves for scenario in found if scenario.curves}
    with matplotlib.rc_context(STYLE):
        page = figures.Figure(figsize=(10.0, 8.4), layout="constrained")
        axes = page.subplot_mosaic([["S08", "S10"], ["S11", "S17"], ["S20", "S20"]])
        panels = {"S08": _energy, "S10": _resonances, "S11": _iterations, "S17": _signs, "S20": _drift}
        for letter, (number, draw) in zip("abcde", panels.items(), strict=True):
            if number in curves:
                draw(axes[number], curves)
            axes[number].set_title(f"({letter})", loc="left", fontsize=9)
        _files.replace(path, lambda part: page.savefig(part, dpi=130))


def _energy(axis, curves) -> None:
    x = np.geomspace(0.01, 1000, 400)
    axis.plot(x, midpoint_factor(x), color=BLUE, label="midpoint, expected")
    axis.plot(curves["S08"]["h"], curves["S08"]["midpoint"], "o", color=BLUE, mfc="none", label="observed")
    below = x[x < 1.999]
    axis.plot(below, euler_factor(below), color=VERMILION, label="Euler pair, expected")
    if "S09" in curves:
        axis.plot(curves["S09"]["h"], curves["S09"]["euler"], "s", color=VERMILION, mfc="none", label="observed")
    axis.axvline(2, color="#888888", ls=":", lw=0.9)
    axis.set(xscale="log", yscale="log", xlabel=r"$\omega h$", ylabel="energy input / exact")
    axis.legend()


def _resonances(axis, curves) -> None:
    data = curves["S10"]
    for scheme, colour in (("stormer_verlet", VERMILION), ("midpoint", BLUE)):
        change = np.clip(data[scheme], 1e-12, 1e6)
        axis.plot(data["x"], np.where(np.isfinite(data[scheme]), change, 1e6), ".", ms=3, color=colour, label=scheme)
    axis.axvline(2, color="#888888", ls=":", lw=0.9)
    axis.set(xscale="log", yscale="log", xlabel=r"$\omega h$ of the fast spring", ylabel="largest change of $H$")
    axis.annotate("failed, or beyond", (0.02, 0.95), xycoords="axes fraction", fontsize=7, color="#666666")
    axis.legend(loc="center right")


def _iterations(axis, curves) -> None:
    data = curves["S11"]
    for row, q0, colour in zip(data["iterations"], data["q0"], COLOURS, strict=False):
        axis.plot(data["h"], row, "o-", color=colour, label=f"$q_0$ = {q0:g}")
    axis.axhline(60, color="#888888", ls=":", lw=0.9)
    axis.set(xscale="log", xlabel="$h$", ylabel="Newton iterations", ylim=(0, 65))
    axis.legend()


def _signs(axis, curves) -> None:
    data = curves["S17"]
    axis.plot(data["bound"], data["expected"], "_", ms=16, color=BLUE, label="expected")
    axis.plot(data["bound"], data["wrong"], "o", color=VERMILION, mfc="none", label="observed")
    axis.axvline(1, color="#888888", ls=":", lw=0.9)
    axis.set(xlabel=r"$\sigma c \sqrt{h}/2$", ylabel="wrong signs", ylim=(-0.03, 0.55))
    axis.legend()


def _drift(axis, curves) -> None:
    data = curves["S20"]
    for (rule, values), colour in zip([item for item in data.items() if item[0] != "steps"], COLOURS, strict=False):
        style = "--" if "compensated" in rule else "-"
        axis.plot(data["steps"], np.maximum(values, 1e-17), style, color=colour, label=rule)
    steps = np.asarray(data["steps"], dtype=float)
    axis.plot(steps, 3e-17 * np.sqrt(steps), ":", color="#888888", label=r"$\sqrt{\mathrm{steps}}$")
    axis.set(xscale="log", yscale="log", xlabel="steps", ylabel="rms change of $p^2 + q^2$")
    axis.legend(ncols=2, loc="center left")
