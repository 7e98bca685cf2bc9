# SPDX-License-Identifier: BSD-3-Clause
"""Tables, figures and summaries of docs/work-precision.md and, for every scene, of docs/work-precision-tables.md."""

from __future__ import annotations

import os
from collections import Counter
from pathlib import Path

from ...show import look
from ...show.tables import markdown
from ..pages import Page, machine, made_by, wrapped
from . import WorkPrecision, of_data, study_figure, study_words
from .study_scenes import about

COMMAND = "symsde study --all examples/scenes --markdown docs/work-precision.md"
DRAWN = "synchrotron"  #: scene of the first figure
SHOWN = ("kubo", "synchrotron", "henon_heiles", "fpu_chain", "noncommutative_oscillator")  #: scenes that come first
ERRORS = (0.1, 0.001)  #: errors of the first table
MEASURED = (
    "Run times are medians of {repeats} repeats, measured with {made_by}, {machine}. Run times depend on the machine; "
    "errors do not."
)


def write(file: str | os.PathLike, scenes: list[Path], studies: list[WorkPrecision]) -> None:
    """Write the parts of the page and of the page of all scenes beside it, and their figures into figures/ there."""
    target = Path(file)
    page, appendix = Page(target, COMMAND), Page(target.with_stem(f"{target.stem}-tables"), COMMAND)
    words, table = begin(studies)
    title = "Error against run time"
    page.put("first", words, page.figure("work-precision", first_picture(studies), save_first, title), table)
    repeats = studies[0].rows[0]["repeats"]
    page.put("measured", wrapped(MEASURED.format(repeats=repeats, made_by=made_by(), machine=machine())))
    page.put("scenes", "\n".join(f"- [{x.name}]({target.stem}-tables.md#{x.name})" for x in studies))
    parts = []
    for scene, study in zip(scenes, studies, strict=True):
        figure = appendix.figure(f"work-precision-{study.name}", study.data(), _draw, study.name)
        parts += [f"## {study.name}", about(scene), figure, *results(study)]
    appendix.put("scenes", *parts)
    page.write()
    appendix.write()


def results(study: WorkPrecision) -> tuple[str, str]:
    """Table and summary of a study."""
    return _table(study), wrapped(study.words())


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


def _best(study: WorkPrecision, error: float) -> dict | None:
    """The fastest point with at most this error."""
    return next(iter(study_words.cheapest([row for row in study.rows if row["status"] == "ok"], error)), None)


def _most(studies: list[WorkPrecision], error: float) -> str:
    """Which schemes are fastest at an error, and on how many scenes."""
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


def _draw(path: Path, data: dict) -> None:
    study_figure.plot(of_data(data), path)


def _table(study: WorkPrecision) -> str:
    """One line per scheme: slope, cost of a step, and the cheapest points for a few errors [microseconds per path]."""
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
    table += [[name, f"left out: {why}", *[""] * (len(heads) - 2)] for name, why in study.refused.items()]
    return markdown(heads, table)


def _energy(rows: list[dict]) -> str:
    """Error of E H at the longest step that counts."""
    coarse = max(rows, key=lambda row: row["h"], default={})
    if "weak_H" not in coarse:
        return "-"
    return f"{coarse['weak_H']:.1e} +- {coarse['weak_H_ci']:.0e} (h = {coarse['h']:.3g})"


def _cheapest(found: dict[str, dict], name: str) -> str:
    """Microseconds per path and the step; the fastest in bold."""
    if name not in found:
        return "-"
    row = found[name]
    text = f"{1e6 * row['seconds']:.3g} (h = {row['h']:.3g})"
    return f"**{text}**" if name == next(iter(found)) else text
