# SPDX-License-Identifier: BSD-3-Clause
"""Error against run time and against the step, on logarithmic axes."""

from __future__ import annotations

import importlib
from pathlib import Path

import numpy as np

from .. import _files

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#888888")  # Okabe and Ito
MARKERS = "osD^vP*X"
LOST = ("failed", "diverged")  #: crosses at the upper edge
STYLE = {
    "font.size": 9,
    "axes.grid": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": "#DDDDDD",
    "grid.linewidth": 0.4,
    "legend.fontsize": 8,
    "legend.frameon": False,
    "lines.linewidth": 1.0,
    "lines.markersize": 4,
}


def save(path: Path, study) -> None:
    """Write a PNG."""
    matplotlib = _files.optional("matplotlib", "plot")
    figures = importlib.import_module("matplotlib.figure")
    with matplotlib.rc_context(STYLE):
        page = figures.Figure(figsize=(9.0, 4.6), layout="constrained")
        left, right = page.subplots(1, 2, sharey=True)
        draw(study, left, right)
        page.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=4)
        _files.replace(path, lambda part: page.savefig(part, dpi=120))


def draw(study, left, right) -> None:
    """Error over run time with the Pareto front in `left`, over the step in `right`."""
    for i, name in enumerate(study.schemes):
        rows = [row for row in study.rows if row["scheme"] == name]
        # the first are drawn largest, so that curves on top of each other all show
        size = 7.5 - 4 * i / len(study.schemes)
        style = {"color": COLOURS[i % len(COLOURS)], "marker": MARKERS[i % len(MARKERS)], "markersize": size}
        order = study.orders[name]
        label = f"{name}, slope {order.value:.2f}" if order.points > 1 else name
        _curve(left, rows, "seconds", style, label)
        _curve(right, rows, "h", style, None)
    _front(left, study.rows)
    _floor(left, right, study.rows)
    left.set(xscale="log", yscale="log", xlabel="run time of a path [s]", ylabel="strong error (rms)")
    right.set(xscale="log", yscale="log", xlabel="step $h$")
    ticker = importlib.import_module("matplotlib.ticker")
    for axis in (left.xaxis, right.xaxis, left.yaxis):
        axis.set_minor_formatter(ticker.NullFormatter())
        axis.set_major_locator(ticker.LogLocator(base=10, numticks=12))
    left.set_title("error against run time", loc="left", fontsize=9)
    right.set_title("error against step", loc="left", fontsize=9)


def _curve(axis, rows, x, style, label) -> None:
    """A scheme: filled points count, hollow ones lie on a plateau, crosses failed."""
    shown = [row for row in rows if row["status"] not in LOST and x in row]
    if shown:
        xs, errors = np.array([row[x] for row in shown]), np.array([row["err_strong"] for row in shown])
        ends = np.array([[row["err_strong_low"], row["err_strong_high"]] for row in shown]).T
        spread = None
        if x == "seconds":
            spread = np.abs(np.array([[row["seconds_low"], row["seconds_high"]] for row in shown]).T - xs)
        bars = np.abs(ends - errors)
        axis.errorbar(xs, errors, yerr=bars, xerr=spread, capsize=2, elinewidth=0.7, label=label, **style)
        hollow = [row for row in shown if row["status"] != "ok"]
        points = [row[x] for row in hollow], [row["err_strong"] for row in hollow]
        axis.plot(*points, ls="", marker=style["marker"], ms=style["markersize"], mfc="white", mec=style["color"],
                  zorder=5)  # fmt: skip
    failed = [row for row in rows if row["status"] in LOST and x in row]
    # a point without any error is marked at the upper edge
    edge = axis.get_xaxis_transform()
    if failed:
        label = None if shown or label is None else f"{label} (failed)"
        axis.plot([row[x] for row in failed], [0.98] * len(failed), ls="", marker="x", ms=7, color=style["color"],
                  transform=edge, clip_on=False, label=label)  # fmt: skip


def _front(axis, rows) -> None:
    """The staircase of the best points."""
    best = sorted((row["seconds"], row["err_strong"]) for row in rows if row.get("pareto"))
    if best:
        axis.step(*zip(*best, strict=True), where="post", color="#BBBBBB", lw=5, alpha=0.5, zorder=0, label="best")


def _floor(left, right, rows) -> None:
    """The error of the reference itself."""
    floor = max((row["ref_error"] for row in rows), default=0)
    if floor:
        for axis in (left, right):
            axis.axhline(floor, ls=":", color="#888888", lw=0.9)
        right.annotate("error of the reference", (0.01, floor), xycoords=("axes fraction", "data"), fontsize=7,
                       xytext=(0, 2), textcoords="offset points", color="#666666")  # fmt: skip
