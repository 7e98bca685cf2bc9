# SPDX-License-Identifier: BSD-3-Clause
"""Strong and weak error against run time and against the step, on logarithmic axes."""

from __future__ import annotations

import numpy as np

from ...show import look

LOST = ("failed", "diverged")  #: status of points that are drawn as crosses at the upper edge


def plot(study, path: object = None, ax: object = None, *, pdf: bool = False):
    """Draw strong errors, and weak errors below if there are any; written if a path is given. With two axes `ax`, only
    strong errors are drawn, into these."""
    given = look.axes_of(ax, 2, path)
    rows = 2 if any(weak_error(row) for row in study.rows) else 1
    with look.drawing(look.target(path), 7.2, 1.0 + 3.2 * rows, 120, pdf=pdf, axes=given) as page:
        if given:
            draw(study, *given)
            given[0].legend()
            return page
        axes = page.subplots(rows, 2, squeeze=False, sharex="col", sharey="row")
        for panel in axes.ravel():
            panel.tick_params(labelbottom=True)
        draw(study, *axes[0])
        if rows == 2:
            draw_weak(study, *axes[1])
        lines, names = axes[0, 0].get_legend_handles_labels()
        page.legend(lines, names, loc="outside lower center", ncols=3)
    return page


def draw(study, left, right) -> None:
    """Error over run time with the Pareto front in `left`, over the step in `right`."""
    for name, rows, style in _schemes(study):
        order = study.orders[name]
        label = f"{name}, slope {order.value:.2f}" if order.points > 1 else name
        _curve(left, rows, "seconds", style, label)
        _curve(right, rows, "h", style, None)
    _front(left, study.rows)
    _floor(left, right, study.rows)
    _label(left, right, "error", "strong error (rms)")


def draw_weak(study, left, right) -> None:
    """Weak error over run time in `left`, over the step in `right`; hollow markers if 0 is within its interval."""
    for _, rows, style in _schemes(study):
        known = [(row, *found) for row in rows if row["status"] not in LOST and (found := weak_error(row))]
        for axis, x in ((left, "seconds"), (right, "h")):
            points = np.array([[row[x], error, half] for row, error, half in known if x in row]).reshape(-1, 3)
            xs, errors, halves = points.T
            told = errors > halves
            bars = [np.where(told, halves, 0.0), halves]
            axis.errorbar(xs, errors, yerr=bars, capsize=2, elinewidth=0.7, **style)
            axis.plot(xs[~told], errors[~told], ls="", marker=style["marker"], ms=style["markersize"], mfc="white",
                      mec=style["color"], zorder=5)  # fmt: skip
    _label(left, right, "weak error", "weak error, the largest of E q, E p, E H")


def _label(left, right, error: str, ylabel: str) -> None:
    """Axes and titles of errors over run time and over the step."""
    left.set(xscale="log", yscale="log", xlabel="run time of a path [s]", ylabel=ylabel)
    right.set(xscale="log", yscale="log", xlabel="step $h$")
    left.set_title(f"{error} against run time", loc="left", fontsize=9)
    right.set_title(f"{error} against step", loc="left", fontsize=9)


def weak_error(row: dict) -> tuple[float, float] | None:
    """The largest error of E q, E p and E H with its half width; None if no such error can be drawn."""
    found = [(abs(row[f"weak_{name}"]), row[f"weak_{name}_ci"]) for name in "qpH" if f"weak_{name}" in row]
    error, half = max(found, default=(0.0, 0.0))
    return (error, half) if 0 < error < np.inf else None


def _schemes(study):
    """Name, rows and style of each scheme: the first markers are largest, so that curves on top of each other are
    visible.
    """
    for i, name in enumerate(study.schemes):
        size = 7.5 - 4 * i / len(study.schemes)
        rows = [row for row in study.rows if row["scheme"] == name]
        yield name, rows, {**look.of_scheme(name), "markersize": size}


def _curve(axis, rows, x, style, label) -> None:
    """Draw a scheme: filled markers count, hollow ones are on a plateau, crosses failed."""
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
    """Draw the staircase of the best points."""
    best = sorted((row["seconds"], row["err_strong"]) for row in rows if row.get("pareto"))
    if best:
        axis.step(*zip(*best, strict=True), where="post", color="#BBBBBB", lw=5, alpha=0.5, zorder=0, label="best")


def _floor(left, right, rows) -> None:
    """Draw the errors of the references themselves; errors not well above them are meaningless."""
    floors = {row["ref_error"]: row["reference"] for row in rows if row["ref_error"]}
    for floor, reference in floors.items():
        for axis in (left, right):
            axis.axhline(floor, ls=":", color=look.GREY, lw=0.9)
        right.annotate(f"error of the reference, {reference}", (0.01, floor), xycoords=("axes fraction", "data"),
                       fontsize=7, xytext=(0, 2), textcoords="offset points", color="#666666")  # fmt: skip
