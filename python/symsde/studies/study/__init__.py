# SPDX-License-Identifier: BSD-3-Clause
"""Error against run time: every scheme at every step on the same Brownian paths, and the cost of each point.

Errors and run times come from separate runs, since users do not need increments that are sums of finer ones.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Unpack

from ...answers.coupled_errors import References, measure
from ...answers.error_plan import OPTIONS, Plan, StudyOptions, leave_out, make_plan
from ...errors import SymsdeError
from ...model.definition import Model
from ...native import checks, files
from ...native.progress import say
from ...schemes import Scheme
from . import orders, study_figure, table
from . import study_words as words
from .state import State, point_key
from .timing import cost

STEPS = (16, 32, 64, 128, 256)


@dataclass(frozen=True)
class WorkPrecision:
    """Errors and costs of every point; `rows` are dicts with the columns of `symsde.studies.study.table.COLUMNS`."""

    name: str
    model: str
    horizon: float
    schemes: list[str]
    rows: list[dict]
    orders: dict[str, orders.Order]  #: scheme -> its order, without plateaus
    resumed: int  #: number of points that an earlier run has computed
    about: dict[str, str] = field(default_factory=dict)  #: facts that all points share, for the head of the table
    refused: dict[str, str] = field(default_factory=dict)  #: schemes without points -> why they were refused, or failed

    def words(self) -> str:
        """A text that recommends scheme and step for given errors."""
        return words.paragraph(self.rows)

    def __str__(self) -> str:
        """The table, with one line per point, and one per scheme that was refused or failed."""
        head = f"{self.name}: {self.model} to t = {self.horizon:g}, {self.rows[0]['paths'] if self.rows else 0} paths"
        names = dict.fromkeys(row["reference"] for row in self.rows)
        references = " and, for schemes of nearly its order, ".join(names)
        left_out = "".join(f"\n{name} is left out: {why}" for name, why in self.refused.items())
        return f"{head}, against {references}\n{table.terminal(self.rows, self.orders)}{left_out}"

    def data(self) -> dict:
        """The numbers of the figure, for a JSON file that `symsde.studies.study.of_data` reads."""
        return {key: getattr(self, key) for key in ("name", "model", "horizon", "schemes", "rows", "refused")}

    def save(self, directory: str | os.PathLike) -> None:
        """Write work-precision.csv, and with matplotlib also work-precision.png and .pdf."""
        with files.folder(directory) as target:
            left_out = {f"{name} is left out": why for name, why in self.refused.items()}
            table.write_csv(target / "work-precision.csv", self.rows, {**self.about, **left_out})
            self.plot(target / "work-precision.png", pdf=True)

    def plot(self, path: str | os.PathLike | None = None, *, ax=None, pdf: bool = False):
        """Draw strong and weak error against run time and step: a matplotlib figure, written if a path is given.

        pdf: write a PDF beside it. With two axes `ax`, only the strong error is drawn, into these.
        """
        return study_figure.plot(self, path, ax, pdf=pdf)


@checks.hinted(*OPTIONS)
def work_precision(
    model: Model,
    schemes: Sequence[str | Scheme] | None = None,
    *,
    q0: Any,
    p0: Any,
    steps: Sequence[int] = STEPS,
    horizon: float = 1.0,
    paths: int = 1000,
    reference: str = "auto",
    reference_steps: int | None = None,
    repeats: int = 7,
    interval: float | None = None,
    invariants: dict[str, Callable] | None = None,
    out: str | os.PathLike | None = None,
    progress: bool = False,
    name: str | None = None,
    about: Mapping[str, str] | None = None,
    **options: Unpack[StudyOptions],
) -> WorkPrecision:
    """Error against run time of several schemes at several steps, all on the same Brownian paths (refine >= 0).

    - schemes: names or Schemes; by default midpoint, symplectic_euler, stormer_verlet, gauss2 and heun, and also
      gauss_dkdkd and chin4a if the model suits them
    - steps: numbers of steps to the horizon, each the largest one divided by a power of two
    - horizon: time at which errors are measured; paths: number of paths of the error runs, at least 40
    - reference: "exact", the name of a scheme, or "auto": the exact solution if the model has one, else a better scheme
      with `reference_steps` steps (a power of two times the largest). Its own error is estimated and shown
    - repeats: timed runs of a point, at least 5, on one thread
    - interval: relative half width wanted of the strong errors; too few paths for it are refused
    - invariants: {name: f(q, p)}; by default H if every noise Hamiltonian commutes with it
    - out: directory for the table, the figure and the finished points; the same call resumes an interrupted study
    - about: names and texts for the head of the table, besides model, initial states and options
    - options: t0, seed, correction, truncation, compensated and threads (of the error runs) of `simulate`

    Bad input raises a ValueError before the first long run. Points whose paths fail are marked. Schemes that the model
    or an option does not fit are left out, as are those whose runs end in an error: `refused`, the table and the file
    tell why. If that leaves none, the first reason is raised.
    """
    progress = checks.flag("progress", progress)
    plan = make_plan(
        model, q0=q0, p0=p0, schemes=schemes, steps=steps, horizon=horizon, paths=paths, reference=reference,
        reference_steps=reference_steps, repeats=repeats, interval=interval, invariants=invariants, name=name,
        about=about, **options,
    )  # fmt: skip
    if out is None:
        return _measured(plan, None, progress)
    files.optional("matplotlib", "plot")  # refused now rather than after an hour
    with files.folder(out) as directory:
        return _measured(plan, directory, progress)


def _measured(plan: Plan, directory: Path | None, progress: bool) -> WorkPrecision:
    """Compute every point; finished points are saved, however this ends."""
    rows: list[dict] = []
    resumed = 0
    try:
        for row in points(plan, State(directory), progress):
            resumed += row.pop("resumed")
            rows.append(row)
    finally:
        result = finish(plan, rows, resumed)
        if directory is not None and rows:
            result.save(directory)
    return result


def points(plan: Plan, state: State, progress: bool):
    """Give each point as a row, as soon as it is known."""
    references = References(plan)
    total = len(plan.schemes) * len(plan.steps)
    done = 0
    first = None
    for scheme in list(plan.schemes):
        for steps in plan.steps:
            done += 1
            _tell(progress, f"{done}/{total} {plan.name}: {scheme.name}, {steps} steps")
            key = point_key(plan, scheme, steps)
            known = state.get(key)
            resumed = known is not None
            if not resumed:
                try:
                    known = {**measure(plan, scheme, steps, references), **cost(plan, scheme, steps)}
                except SymsdeError as error:
                    first = first or error
                    leave_out(plan, scheme, error)
                    break
                state.put(key, known)
            yield {**_head(plan, scheme, steps), **known, "resumed": resumed}
    _tell(progress, "")
    if first and not plan.schemes:
        raise first


def finish(plan: Plan, rows: list[dict], resumed: int) -> WorkPrecision:
    """Judge all points together."""
    rows = [row for row in rows if row["scheme"] not in plan.refused]
    for row in rows:
        row["status"] = orders.judge(row)
    front = orders.pareto(rows)
    for i, row in enumerate(rows):
        row["pareto"] = i in front
    names = [scheme.name for scheme in plan.schemes]
    known = {"name": plan.name, "model": repr(plan.model), "horizon": plan.horizon, "schemes": names, "rows": rows,
             "refused": plan.refused}  # fmt: skip
    return of_data(known, resumed, plan.about())


def of_data(data: dict, resumed: int = 0, about: Mapping[str, str] | None = None) -> WorkPrecision:
    """A study from the dict of `WorkPrecision.data()`, with orders computed from its rows."""
    rows, names = data["rows"], data["schemes"]
    fitted = {name: orders.fitted([row for row in rows if row["scheme"] == name]) for name in names}
    known = data["name"], data["model"], data["horizon"], names, rows
    return WorkPrecision(*known, fitted, resumed, dict(about or {}), dict(data.get("refused", {})))


def _head(plan: Plan, scheme: Scheme, steps: int) -> dict:
    return {
        "scene": plan.name,
        "scheme": scheme.name,
        "steps": steps,
        "h": plan.horizon / steps,
        "reference": str(plan.references[scheme.name]),
        "paths": plan.paths,
    }


def _tell(progress: bool, text: str) -> None:
    """Write one line on stderr, over the line before."""
    if progress:
        say(f"\r\033[K{text}")
