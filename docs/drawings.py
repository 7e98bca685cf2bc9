# SPDX-License-Identifier: BSD-3-Clause
"""The questions of which-scheme.md, a step with its nodes, and curves that the code of pages computes."""

from __future__ import annotations

import contextlib
import io
import os
import re
import tempfile
from pathlib import Path

import numpy as np
from symsde.show import look


def save_questions(path: Path, data: dict) -> None:
    """Questions from top to bottom, to the right of each the scheme where the answer is yes."""
    count = len(data["questions"])
    with look.drawing(path, 5.0, 0.72 * count, 160) as page:
        axes = page.subplots()
        axes.set(xlim=(0, 10), ylim=(-count + 0.45, 0.55))
        axes.axis("off")
        for i, (question, name) in enumerate(data["questions"]):
            y = -i * data["step"]
            if question:
                _box(axes, 2.6, y, question, look.SKY)
                _arrow(axes, (2.6, y), (6.2, y), "yes")
                following = bool(data["questions"][i + 1][0])
                _arrow(axes, (2.6, y - 0.2), (2.6, y - data["step"] + (0.3 if following else 0.0)), "no")
            else:
                _arrow(axes, (2.6, y), (6.2, y), "")
            _box(axes, 8.1, y, name, look.GREEN, size=8)


def save_step(path: Path, data: dict) -> None:
    """One step in time: the Brownian path and the chord that its increment is, q_d with its control points, the nodes
    with weights, at which momenta stand."""
    t = np.array(data["time"])
    with look.drawing(path, 5.2, 4.0, 160) as page:
        upper, lower = page.subplots(2, 1, sharex=True, height_ratios=(1, 1.5))
        upper.plot(t, data["noise"], color=look.GREY, lw=0.8)
        upper.plot((0, 1), (data["noise"][0], data["noise"][-1]), color=look.VERMILION)
        upper.set(ylabel="noise")
        upper.annotate("$W$", (t[45], data["noise"][45]), (0, 6), textcoords="offset points", color=look.GREY)
        upper.annotate("$dW$", (0.5, (data["noise"][0] + data["noise"][-1]) / 2), (0, 8), textcoords="offset points",
                       color=look.VERMILION)  # fmt: skip
        lower.plot(t, data["position"], color=look.BLUE)
        lower.plot(data["control"]["at"], data["control"]["position"], "o", color=look.BLUE, ms=6, ls="none")
        for at, weight, q, name, shift, ha in zip(
            data["nodes"],
            data["weights"],
            data["at_nodes"],
            "12",
            ((6, -16), (-6, -30)),
            ("left", "right"),
            strict=True,
        ):
            for axes in (upper, lower):
                axes.axvline(at, color=look.GREEN, lw=0.9, ls="--")
            lower.plot(at, q, "s", color=look.GREEN, ms=6)
            lower.annotate(f"$P_{name}$, $\\alpha_{name} = {weight:.3g}$", (at, q), shift, textcoords="offset points",
                           color=look.GREEN, ha=ha)  # fmt: skip
        ends = data["control"]["position"]
        lower.annotate("$q_n$, $p_n$", (0, ends[0]), (10, -3), textcoords="offset points")
        lower.annotate("$q_{n+1}$, $p_{n+1}$", (1, ends[-1]), (0, -18), textcoords="offset points", ha="right")
        lower.annotate("$q_d$", (0.3, np.interp(0.3, t, data["position"])), (-14, 6), textcoords="offset points",
                       color=look.BLUE)  # fmt: skip
        lower.set(ylabel="position", xlim=(-0.05, 1.05))
        for axes in (upper, lower):
            axes.set_yticks([])
        ticks = [0.0, *data["nodes"], 1.0]
        lower.set_xticks(ticks, ["$t_n$", "$t_n + c_1 h$", "$t_n + c_2 h$", "$t_n + h$"])


def step() -> dict:
    """Data of `save_step`: one step of gauss2, two nodes, a polynomial of degree two. The noise is a sample."""
    t = np.linspace(0.0, 1.0, 101)
    noise = np.concatenate([[0.0], np.cumsum(np.random.default_rng(7).normal(size=100) / 10)])
    nodes = 0.5 + np.array([-1.0, 1.0]) / np.sqrt(12.0)
    at = np.array([0.0, 0.5, 1.0])
    control = np.array([0.0, 0.75, 0.9])
    parabola = np.polyfit(at, control, 2)
    found = {"time": t, "noise": noise, "position": np.polyval(parabola, t)}
    found |= {"nodes": nodes, "weights": np.array([0.5, 0.5]), "at_nodes": np.polyval(parabola, nodes)}
    found = {key: np.round(value, 6).tolist() for key, value in found.items()}
    return found | {"control": {"at": at.tolist(), "position": control.tolist()}}


#: page -> panels: names of its code for x, y, error and a law, which may be missing, and labels
BANDS = {
    "scan": [("sigmas", "energy", "2 * error", "", r"$\sigma$", r"$E\,H$ at $t = 10$")],
    "exit-times": [("found.t", "found.lost", "2 * found.se_lost", "", "$t$", "share that has left")],
    "beams": [
        ("alone.t", "e", "", "e[0] + 0.02**2 / 2 * alone.t", "$t$", "emittance"),
        ("lost.t", "lost.lost", "2 * lost.se_lost", "", "$t$", "share lost"),
    ],
}


def bands(page: str) -> dict:
    """Run the Python code of a page down to its picture, in a folder of its own, and take the numbers of its panels."""
    text = Path(__file__).with_name(f"{page}.md").read_text(encoding="utf-8").partition(f"](figures/{page}.png)")[0]
    names: dict = {}
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder), contextlib.redirect_stdout(io.StringIO()):
        os.environ.setdefault("MPLBACKEND", "Agg")
        for block in re.findall(r"^```python\n(.*?)^```$", text, re.M | re.S):
            exec(compile(block, page, "exec"), names)
    found = []
    for *values, xlabel, ylabel in BANDS[page]:
        numbers = [[float(f"{x:.6g}") for x in eval(code, names)] if code else [] for code in values]
        found.append(dict(zip(("x", "y", "error", "law"), numbers, strict=True)) | {"xlabel": xlabel, "ylabel": ylabel})
    return {"panels": found}


def save_bands(path: Path, data: dict) -> None:
    """Draw curves with their bands."""
    count = len(data["panels"])
    with look.drawing(path, 5.4, 2.6 if count > 1 else 3.0, 160) as page:
        for axes, panel in zip(page.subplots(1, count, squeeze=False)[0], data["panels"], strict=True):
            x, y = np.array(panel["x"]), np.array(panel["y"])
            if panel["error"]:
                error = np.array(panel["error"])
                axes.fill_between(x, y - error, y + error, alpha=0.3, color=look.BLUE, lw=0)
            if panel["law"]:
                axes.plot(x, panel["law"], "--", color=look.BLACK)
            axes.plot(x, y, ".-", color=look.BLUE)
            axes.set(xlabel=panel["xlabel"], ylabel=panel["ylabel"])


def _box(axes, x: float, y: float, text: str, colour: str, *, size: int = 9) -> None:
    axes.text(x, y, text, ha="center", va="center", size=size, zorder=5,
              bbox={"boxstyle": "round,pad=0.4", "fc": "white", "ec": colour, "lw": 1.2})  # fmt: skip


def _arrow(axes, start: tuple[float, float], end: tuple[float, float], text: str) -> None:
    line = {"arrowstyle": "->", "color": look.GREY, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", end, start, arrowprops=line, zorder=1)
    x, y = (max(start[0], end[0] - 0.9), end[1] + 0.08) if start[1] == end[1] else (start[0] + 0.08, end[1] + 0.08)
    axes.text(x, y, text, size=8, color=look.GREY)
