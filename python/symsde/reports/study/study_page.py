# SPDX-License-Identifier: BSD-3-Clause
"""The pages docs/work-precision.md, what was learned, and work-precision-tables.md, every scene of a folder."""

from __future__ import annotations

import json
import os
from collections import Counter
from dataclasses import replace
from pathlib import Path

from ...show import look
from ..pages import Page, made_by, markdown, wrapped
from . import WorkPrecision, of_data, peers, study_figure, study_words
from .learned import learned
from .left_out import HEAD, left_out
from .study_scenes import about

COMMAND = "symsde study --all examples/scenes --markdown docs/work-precision.md"
DRAWN, FIGURE = "synchrotron", "work-precision"  #: the scene of the first picture, and its file
SHOWN = ("kubo", "synchrotron", "henon_heiles", "fpu_chain", "noncommutative_oscillator")  #: first of all
ERRORS = (0.1, 0.001)  #: of its first table
CAPTION = (
    "Error of paths over the run time of one path for the scene {name}: lower and further left is better. "
    "The table gives the fastest scheme for two errors, its step, and its run time in microseconds (us)."
)
TABLES = (
    "Figure, table and summary of each scene. [Error against run time]({page}#how-it-was-measured) says how this was "
    "measured, and what was learned. In the columns, *slope* is the slope of the strong error over the step, *normals* "
    "to *iterations* count what a step of a path needs, and *worst drift* is the largest root mean square change of "
    "the invariant."
)
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
    """Write the page, that of all scenes beside it, and its figures into figures/ there."""
    target = Path(file)
    page = Page(target, COMMAND, "Error against run time")
    appendix = Page(target.with_stem(f"{target.stem}-tables"), COMMAND, "Error against run time: every scene")
    others = _peers(target.parent / "figures" / "peers.json")
    words, table = begin(studies)
    page.add(words)
    page.figure(FIGURE, first_picture(studies), save_first, "Error against run time")
    page.add(wrapped(CAPTION.format(name=_drawn(studies).name)), table)
    lessons = [*learned(studies), *([peers.lesson(others)] if others else [])]
    page.add("## What was learned", "\n".join(wrapped(f"- {line}", "  ") for line in lessons))
    repeats = studies[0].rows[0]["repeats"]
    how = INTRODUCTION.format(repeats=repeats, made_by=made_by(), machine=machine())
    page.add("## How it was measured", how, "## Every scene")
    page.add("\n".join(f"- [{study.name}]({_place(target, study.name)})" for study in studies))
    page.write()
    appendix.add(wrapped(TABLES.format(page=target.name)))
    for scene, alone in zip(scenes, studies, strict=True):
        study = replace(alone, peers=peers.of_scene(others, alone.name))
        appendix.add(f"## {study.name}", about(scene))
        appendix.figure(f"work-precision-{study.name}", study.data(), _draw, study.name)
        appendix.add(_table(study), wrapped(study.words()))
        if study.peers:
            appendix.add(wrapped(beside(study.peers)))
    appendix.add("## What each scene left out", *_left_out(scenes))
    appendix.write()


def begin(studies: list[WorkPrecision]) -> tuple[str, str]:
    """Sentences and table of the first screen; the table has at most five scenes."""
    rows = [[study.name, *_fastest(study)] for study in _shown(studies)]
    sentences = wrapped(" ".join(_most(studies, error) for error in ERRORS))
    return sentences, markdown(["scene", *(f"paths to {error:g}" for error in ERRORS)], rows)


def _shown(studies: list[WorkPrecision]) -> list[WorkPrecision]:
    return [study for study in studies if study.name in SHOWN] or studies[: len(SHOWN)]


def _drawn(studies: list[WorkPrecision]) -> WorkPrecision:
    return next((study for study in studies if study.name == DRAWN), _shown(studies)[0])


def first_picture(studies: list[WorkPrecision]) -> dict:
    """Run times in microseconds and errors of one scene, by scheme: what `save_first` draws."""
    rows = [row for row in _drawn(studies).rows if row["status"] == "ok"]
    return {
        name: [[1e6 * row["seconds"], row["err_strong"]] for row in rows if row["scheme"] == name]
        for name in dict.fromkeys(row["scheme"] for row in rows)
    }


def save_first(path: Path, data: dict) -> None:
    """Draw error against run time, a line for each scheme."""
    with look.drawing(path, 5.2, 2.9, 160) as page:
        axes = page.subplots()
        for name, points in data.items():
            axes.loglog(*zip(*points, strict=True), label=name, **look.of_scheme(name))
        axes.set(xlabel=r"run time of a path [$\mu$s]", ylabel="error of paths (rms)")
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))


def _place(target: Path, name: str) -> str:
    return f"{target.stem}-tables.md#{name}"


def _best(study: WorkPrecision, error: float) -> dict | None:
    """The fastest point that keeps an error."""
    return next(iter(study_words.cheapest([row for row in study.rows if row["status"] == "ok"], error)), None)


def _most(studies: list[WorkPrecision], error: float) -> str:
    """Which schemes win at an error, and on how many scenes."""
    found = Counter(best["scheme"] for study in studies if (best := _best(study, error)))
    if not found:
        return f"No scheme reaches an error of {error:g}."
    (first, most), *rest = found.most_common()
    text = f"For paths to {error:g}, {first} is the fastest scheme on {most} of {len(studies)} scenes"
    if rest:
        text += ", " + study_words.listed([f"{name} on {count}" for name, count in rest])
    none = len(studies) - sum(found.values())
    return f"{text}; on {none} no scheme that was measured reaches this error." if none else f"{text}."


def _fastest(study: WorkPrecision) -> list[str]:
    found = [_best(study, error) for error in ERRORS]
    return [f"{b['scheme']}, h = {b['h']:.3g}, {1e6 * b['seconds']:.3g} us" if b else "-" for b in found]


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
        "scene with its own scheme. [Traits](words.md#trait) decide what is left out, and tests check these counts. "
        f"Runs for moments keep no paths: their results take at most {kept} bytes here, for any number of paths."
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
