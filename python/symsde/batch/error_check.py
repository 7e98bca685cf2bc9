# SPDX-License-Identifier: BSD-3-Clause
"""symsde run --error-check: compute the same Brownian paths at half the step, and compare the results.

At half the step the error of a scheme of strong order r is 2^-r times as large. So the difference of the two runs is
the error of the run times 1 - 2^-r: half of the error at order 1. Means are compared on the same paths, so their
differences contain little noise.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..run.observers.observables import Rows, rows_of
from ..run.simulate import Run, simulate
from ..show import tables
from .execute import Task, Tell, never
from .pieces import Extent, Piece

_PATHS, _BYTES = 4096, 2**26


@dataclass(frozen=True)
class ErrorCheck:
    """Differences, full step minus half the step, over the paths that are ok in both."""

    t: np.ndarray  #: (time,)
    n: np.ndarray  #: (time,), number of paths that are ok in both runs
    rms: np.ndarray  #: (time,), root mean square of the distance of the paths in (q, p)
    #: names of the values: coordinates, momenta, energy, observables, squares of coordinates and momenta
    names: tuple[str, ...]
    mean: np.ndarray  #: (time, value), differences of means
    se_mean: np.ndarray  #: (time, value), their standard errors
    seconds: tuple[float, float]  #: seconds of the two runs
    attributes: dict[str, str]  #: provenance of the run at the full step
    remarks: tuple[str, ...] = ()  #: sentences about results that are not compared

    def __str__(self) -> str:
        """The result in words: the last time, and the largest distance."""
        full, half = self.seconds
        most = max(self.rms[np.isfinite(self.rms)], default=np.nan)
        lines = [
            f"half the step on the same paths ({self.n[0]} of them, {full:.2g} s and {half:.2g} s):",
            f"  distance of paths, rms: {self.rms[-1]:.3g} at t = {self.t[-1]:.6g}, at most {most:.3g}",
        ]
        rows = [
            ["  mean", name, "differs by", f"{self.mean[-1, i]:.3g}", f"+- {self.se_mean[-1, i]:.2g}"]
            for i, name in enumerate(self.names)
        ]
        return "\n".join(
            [*lines, tables.aligned(rows, (0, -10, 0, 10, 0)), *(f"  {remark}" for remark in self.remarks)]
        )

    def save(self, path: Path) -> None:
        """Write a table with one row per time."""
        columns = {"t": self.t, "paths": self.n, "rms": self.rms}
        for kind in ("mean", "se_mean"):
            columns |= {f"{kind} {name}": x for name, x in zip(self.names, getattr(self, kind).T, strict=True)}
        told = {"not compared": "\n".join(self.remarks)} if self.remarks else {}
        tables.write(path, columns, {**self.attributes, **told})


def error_check(
    task: Task, extent: Extent, threads: int | None = None, scene: str = "", tell: Tell = never
) -> ErrorCheck | None:
    """Compare the first paths of a run with the same paths at half the step; None if the work was stopped. The
    attributes hold the text of the scene."""
    paths = max(2, min(extent.paths, _PATHS, _BYTES // (16 * extent.ndof * extent.saved)))
    options = task.of(Piece("", "paths", extent.first, min(paths, extent.paths), 0), threads)
    halved = {**options, "step": options["step"] / 2, "refine": options.get("refine", 0) - 1}
    halved["steps"] = 2 * options["steps"]
    if options.get("save_at") is None:
        halved["save_every"] = 2 * options.get("save_every", 1)
    halved["first_step"] = 2 * options.get("first_step", 0)
    full, full_seconds = _timed(task, options, tell)
    full.scene = scene
    half, half_seconds = _timed(task, halved, tell)
    if full.report.stopped or half.report.stopped:
        return None
    found = compare(full, half, (full_seconds, half_seconds), rows_of(task.observables, task.model))
    return dataclasses.replace(found, remarks=tuple(_not_compared(task)))


def _not_compared(task: Task) -> Iterator[str]:
    """Give a sentence on each result of a run that is not compared."""
    if task.observers:
        yield f"not compared: what [[observe]] keeps ({', '.join(task.observers)})"
    if names := [name for name, x in task.observers.items() if getattr(x, "absorb", False)]:
        yield f"paths that {', '.join(names)} would absorb go on here: the means are those without absorption"


def _timed(task: Task, options: dict, tell: Tell) -> tuple[Run, float]:
    begin = time.monotonic()
    run = simulate(task.model, progress=tell, **options)
    return run, time.monotonic() - begin


def compare(full: Run, half: Run, seconds: tuple[float, float], own: Rows | None = None) -> ErrorCheck:
    """Differences of two runs of the same paths, saved at the same times. own: gives names and values of
    observables. If a value is not finite on a path that is ok, its mean is NaN, as in the run."""
    ndof = full.q.shape[1]
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        names, values = _values(full, own)
        differences = values - _values(half, own)[1]
        ok = np.isfinite(differences[:, : 2 * ndof]).all(axis=1)
        n = ok.sum(axis=1)
        there = ok[:, np.newaxis]
        count = n[:, np.newaxis].astype(float)
        mean = np.where(there, differences, 0.0).sum(axis=2) / count
        about = np.where(there, differences - mean[:, :, np.newaxis], 0.0)
        se_mean = np.sqrt((about**2).sum(axis=2) / (count - 1) / count)
        squares = np.where(there, differences[:, : 2 * ndof], 0.0) ** 2
        rms = np.sqrt(squares.sum(axis=(1, 2)) / n)
    return ErrorCheck(full.t, n, rms, names, mean, se_mean, seconds, full.attributes())


def _values(run: Run, own: Rows | None) -> tuple[tuple[str, ...], np.ndarray]:
    """q, p, the energy if the model has one, observables, and squares: (time, value, path)."""
    ndof = run.q.shape[1]
    names = list(run.model.coordinates)
    parts = [run.q, run.p]
    if run.model.traits.has_value:
        names.append("energy")
        energies = [run.model.value(q, p, t=t) for t, q, p in zip(run.t, run.q, run.p, strict=True)]
        parts.append(np.array(energies)[:, np.newaxis, :])
    if own is not None:
        there = [dict(own(t, q, p)) for t, q, p in zip(run.t.tolist(), run.q, run.p, strict=True)]
        parts.append(np.array([list(found.values()) for found in there]))
        squares = {f"{name}^2" for name in names[: 2 * ndof]}
        names += [f"observable {name}" if name in squares else name for name in there[0]]
    names += [f"{name}^2" for name in names[: 2 * ndof]]
    return tuple(names), np.concatenate([*parts, run.q**2, run.p**2], axis=1)
