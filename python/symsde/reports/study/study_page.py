# SPDX-License-Identifier: BSD-3-Clause
"""The page docs/work-precision.md: every scene of a folder, its figure, its table, and what was learned."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path

from ..pages import Page, made_by, markdown, wrapped
from . import WorkPrecision, of_data, peers, study_figure, study_words
from .learned import learned
from .left_out import HEAD, left_out
from .study_scenes import about

COMMAND = "symsde study --all examples/scenes --markdown docs/work-precision.md"
INTRODUCTION = """\
All schemes follow the same Brownian paths at all steps. The *strong error* is the root mean square distance in (q, p)
at the horizon from the exact solution. If the model has no exact solution, a better scheme with a finer step serves as
reference; the dotted line is its own error. *Run time* is the processor time of one path on one thread: the median of
{repeats} repeats after a warm-up, with quartiles as bars. The runs that are timed are other runs than those that give
the errors: they draw increments of their own step, not sums over finer steps. The set-up of a run is not counted. The
slopes leave out points on a plateau (hollow markers) and points that failed or diverged (crosses). They are slopes
over the measured steps, not asymptotic orders. In the tables, "us to 0.1" is the lowest run time of a path, in
microseconds, at which the error is at most 0.1; the fastest is bold. The column E H error gives the error of the mean
energy at the longest step that counts. The *weak error* is the largest of the errors of E q, E p (means over degrees
of freedom) and E H, with 95 % intervals. Errors with hollow markers are not significantly different from zero.
`symsde study SCENE.toml` writes every point to work-precision.csv. The panels of other packages, and their curves of
symsde, show one run of [Other packages on the same problems](peers.md). That run was made at another time, so compare
its times with each other, not with those of the tables here. Its equations are the same, but synchrotron and
linear_oscillator start from another initial state, and linear_oscillator ends at T = 4.

Measured with {made_by}, {machine}. Run times depend on the machine; errors do not.
"""


def write(file: str | os.PathLike, scenes: list[Path], studies: list[WorkPrecision]) -> None:
    """Write the page, and its figures into figures/ beside it."""
    page = Page(file, COMMAND, "Error against run time")
    repeats = studies[0].rows[0]["repeats"]
    page.add(INTRODUCTION.format(repeats=repeats, made_by=made_by(), machine=machine()), "## What was learned")
    others = _peers(Path(file).parent / "figures" / "peers.json")
    lessons = [*learned(studies), *([peers.lesson(others)] if others else [])]
    page.add("\n".join(wrapped(f"- {line}", "  ") for line in lessons))
    page.add("## What each scene left out", *_left_out(scenes))
    for scene, alone in zip(scenes, studies, strict=True):
        study = replace(alone, peers=peers.of_scene(others, alone.name))
        page.add(f"## {study.name}", about(scene))
        page.figure(f"work-precision-{study.name}", study.data(), _draw, study.name)
        page.add(_table(study), wrapped(study.words()))
        if study.peers:
            page.add(wrapped(beside(study.peers)))
    page.write()


def beside(rows: list[dict]) -> str:
    """What other packages take, as the page of theirs says it."""
    return f"[Other packages](peers.md): {peers.sentence(rows, rows[0]['problem'])}"


def _peers(file: Path) -> list[dict]:
    """Rows of other packages, where the page of theirs has been written beside this one."""
    return json.loads(file.read_text(encoding="utf-8"))["peers"] if file.is_file() else []


def _draw(path: Path, data: dict) -> None:
    study_figure.plot(of_data(data), path)


def machine() -> str:
    """Kind of processor."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else "unknown processor"


def _left_out(scenes: list[Path]) -> list[str]:
    """Counters of a path-step, by the scheme that the scene itself names."""
    rows = [left_out(scene) for scene in scenes]
    kept = max(row.bytes_kept for row in rows)
    text = (
        "The table counts operations of one step of one path. The counts are those of the report of a run of each "
        "scene with its own scheme. Traits decide what is left out, and tests check these counts. Runs for moments "
        f"keep no paths: their results take at most {kept} bytes here, for any number of paths."
    )
    return [wrapped(text), markdown(HEAD, (row.cells() for row in rows))]


def _table(study: WorkPrecision) -> str:
    """One line a scheme: slope, cost of a step, and the cheapest way to a few errors [microseconds a path]."""
    usable = [row for row in study.rows if row["status"] == "ok"]
    goals = study_words.targets(usable) if usable else []
    heads = ["scheme", "slope", "ns a step", "gradients", "Hessians", "iterations", "normals", "worst drift"]
    heads += ["E H error", "failed", *(f"us to {goal:g}" for goal in goals)]
    table = []
    found = {goal: {row["scheme"]: row for row in study_words.cheapest(usable, goal)} for goal in goals}
    for name in study.schemes:
        rows = [row for row in study.rows if row["scheme"] == name]
        fine = max(rows, key=lambda row: row["steps"])
        drifts = [row["drift"] for row in rows if row.get("drift") is not None]
        cells = [name, str(study.orders[name]), f"{1e9 * fine['seconds'] / fine['steps']:.3g}"]
        cells += [f"{fine[key]:.3g}" for key in ("gradients", "hessians", "iterations", "normals")]
        cells += [f"{max(drifts):.0e}" if drifts else "-"]
        cells += [_energy([row for row in rows if row["status"] == "ok"])]
        cells += [str(sum(row["status"] in ("failed", "diverged") for row in rows)) + f" of {len(rows)}"]
        cells += [_cheapest(found[goal], name) for goal in goals]
        table.append(cells)
    return markdown(heads, table)


def _energy(rows: list[dict]) -> str:
    """Error of E H at the longest step that counts."""
    coarse = max(rows, key=lambda row: row["h"], default={})
    if "weak_H" not in coarse:
        return "-"
    return f"{coarse['weak_H']:.1e} +- {coarse['weak_H_ci']:.0e} (h = {coarse['h']:.3g})"


def _cheapest(found: dict[str, dict], name: str) -> str:
    """Microseconds a path and the step; the fastest in bold."""
    if name not in found:
        return "-"
    row = found[name]
    text = f"{1e6 * row['seconds']:.3g} (h = {row['h']:.3g})"
    return f"**{text}**" if name == next(iter(found)) else text
