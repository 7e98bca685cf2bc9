# SPDX-License-Identifier: BSD-3-Clause
"""Error against run time and against the step, on logarithmic axes."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from .. import look

LOST = ("failed", "diverged")  #: crosses at the upper edge


def save(path: Path, study, *, pdf: bool = False) -> None:
    """Write a PNG, on request a PDF too."""
    with look.drawing(path, 9.0, 4.6, 120, pdf=pdf) as page:
        left, right = page.subplots(1, 2, sharey=True)
        draw(study, left, right)
        page.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=4)


def draw(study, left, right) -> None:
    """Error over run time with the Pareto front in `left`, over the step in `right`."""
    for i, name in enumerate(study.schemes):
        rows = [row for row in study.rows if row["scheme"] == name]
        # the first are drawn largest, so that curves on top of each other all show
        size = 7.5 - 4 * i / len(study.schemes)
        style = {**look.of_scheme(name), "markersize": size}
        order = study.orders[name]
        label = f"{name}, slope {order.value:.2f}" if order.points > 1 else name
        _curve(left, rows, "seconds", style, label)
        _curve(right, rows, "h", style, None)
    _front(left, study.rows)
    _floor(left, right, study.rows)
    left.set(xscale="log", yscale="log", xlabel="run time of a path [s]", ylabel="strong error (rms)")
    right.set(xscale="log", yscale="log", xlabel="step $h$")
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
    """The errors of the references themselves; what is not well above them counts for nothing."""
    floors = {row["ref_error"]: row["reference"] for row in rows if row["ref_error"]}
    for floor, reference in floors.items():
        for axis in (left, right):
            axis.axhline(floor, ls=":", color=look.GREY, lw=0.9)
        right.annotate(f"error of the reference, {reference}", (0.01, floor), xycoords=("axes fraction", "data"),
                       fontsize=7, xytext=(0, 2), textcoords="offset points", color="#666666")  # fmt: skip
