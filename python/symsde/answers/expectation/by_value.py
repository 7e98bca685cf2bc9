# SPDX-License-Identifier: BSD-3-Clause
"""Answers to one question for each value of some parameters."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import IncompatibleError, InvalidArgumentError, WrongTypeError
from ...model.definition import Model, require_model
from ...native import checks, files
from ...native.progress import Progress, told_by
from ...native.signals import carry
from ...run import provenance
from ...run.groups import Grid, groups_by_parameters
from ...show import plot, tables
from .answer import Answer
from .interval import make_tolerance
from .problem import make_problem
from .watch import Watch

_NUMBERS = ("value", "low", "high", "error", "bias", "step", "paths", "cost", "reached")
_TEXTS = ("method", "scheme")
_LEAST = 1e-3  #: seconds of max_time that every value gets, in which the least work is done


class Answers:
    """Answers to one question for each value of some parameters, as `expect` returns them with groups=.

    The shape (..) of the arrays has an axis for each parameter, or one axis `value` where some go together. Values that
    were not reached are NaN.
    """

    answers: list[Answer | None]  #: of each value, the last axis fastest; None of a value that was not reached
    parameters: dict[str, np.ndarray]  #: values of each parameter, (value,)
    dims: tuple[str, ...]  #: names of the axes
    value: np.ndarray  #: (..), E f
    low: np.ndarray  #: (..), low end of the 95 % interval; likewise high
    high: np.ndarray
    error: np.ndarray  #: (..), standard error of the value
    bias: np.ndarray  #: (..), bound of the error that the step leaves in the value
    step: np.ndarray  #: (..), step h; of multilevel methods the finest step
    paths: np.ndarray  #: (..), number of paths
    cost: np.ndarray  #: (..), seconds of processor time
    method: np.ndarray  #: (..), names of methods; likewise scheme
    scheme: np.ndarray
    reached: bool  #: whether every interval is as narrow as asked

    def __init__(self, grid: Grid, question: Mapping[str, str]):
        """Begin without answers; question: the attributes of files."""
        self._grid, self._question = grid, dict(question)
        self.parameters, self.dims = dict(grid.values), grid.dims
        self.answers = [None] * grid.count
        for name in grid.values:
            if name in (*_NUMBERS, *_TEXTS, "mean"):
                raise InvalidArgumentError(f"the parameter {name} has the name of a part of answers: rename it")

    def finish(self) -> Answers:
        """Make the arrays from the answers."""
        shape, found = self._grid.shape, [_numbers(x) for x in self.answers]
        for name in _NUMBERS:
            setattr(self, name, np.array([x[name] for x in found]).reshape(shape))
        for name in _TEXTS:
            setattr(self, name, np.array([getattr(x, name, "") for x in self.answers]).reshape(shape))
        self._reached = self.reached == 1
        self.reached = bool(self._reached.all())
        return self

    @property
    def half_width(self) -> np.ndarray:
        """(..), half widths of the intervals."""
        return (self.high - self.low) / 2

    def points(self) -> list[dict[str, float]]:
        """The values of the parameters of each answer, the last axis fastest."""
        return self._grid.points()

    @property
    def title(self) -> str:
        """The question."""
        return f"E {self._question['f']} of {self._question['model']} at t = {self._question['t']}"

    def attributes(self) -> dict[str, str]:
        """Origin of the answers as text for files."""
        notes = {json.dumps(point): x.notes for point, x in zip(self.points(), self.answers, strict=True) if x}
        told = {"notes": json.dumps({key: x for key, x in notes.items() if x})} if any(notes.values()) else {}
        return {"title": self.title, **self._question, **told, "groups": self._grid.told(), **provenance.made()}

    def _arrays(self) -> dict[str, np.ndarray]:
        """Arrays by the names of files, where `value` may be an axis."""
        found = {name: getattr(self, name) for name in (*_NUMBERS[:-1], *_TEXTS)}
        return {"mean": found.pop("value"), **found, "reached": self._reached.astype(np.int8)}

    def to_xarray(self):
        """An xarray.Dataset with a dimension for each parameter, or `value`; E f is called mean there."""
        variables = {name: (self.dims, x) for name, x in self._arrays().items()}
        return files.dataset(variables, self._grid.coordinates(), self.attributes())

    def save(self, path: str | os.PathLike) -> None:
        """Write a .nc (needs xarray and netCDF4) or .npz file, or a .csv table with a row for each value."""
        target = files.path_of("path", path)
        if target.suffix == ".csv":
            columns = self._grid.flat() | {name: x.ravel() for name, x in self._arrays().items()}
            tables.write(target, columns, self.attributes())
            return
        variables = self._grid.coordinates() | {name: (self.dims, x) for name, x in self._arrays().items()}
        files.write(target, self.to_xarray, variables, self.attributes(), also=".csv, ")

    def plot(self, path=None, *, ax=None, over: str | None = None):
        """Draw the answers over a parameter with their intervals.

        over: the parameter of the abscissa, by default the first; there is a curve for each value of the others, at
        most eight. A figure is written if a path is given; or draw into `ax`.
        """
        over, curves = self._grid.curves(over, self.value, self.half_width / 2)
        return plot.sweep(self.title, (over, self._question["f"]), curves, (path, ax))

    def __str__(self) -> str:
        """A row for each value."""
        head = [*self.parameters, "value", "half width", "method", "scheme", "h", "paths", "seconds"]
        rows = []
        for point, x in zip(self.points(), self.answers, strict=True):
            cells = [] if x is None else [
                f"{x.value:.10g}", f"{x.half_width:.2g}", x.method, x.scheme, f"{x.step:.4g}", f"{x.paths}",
                f"{x.cost:.3g}",
            ]  # fmt: skip
            rows.append([*(f"{y:.6g}" for y in point.values()), *(cells or ["not reached", *[""] * 6])])
        return "\n".join([tables.terminal(head, rows), *self._notes()])

    def _notes(self) -> list[str]:
        """Notes of the answers, each after its values."""
        pairs = zip(self.points(), self.answers, strict=True)
        return [f"{told_point(point)}: {note}" for point, x in pairs if x for note in x.notes]

    def __repr__(self) -> str:
        """One line."""
        count = sum(x is not None for x in self.answers)
        return f"<{checks.counted(count, 'answer')} to {self.title}: {self._grid.counted()}>"


def told_point(point: Mapping[str, float]) -> str:
    """Values of parameters for people."""
    return ", ".join(f"{name} = {x:.6g}" for name, x in point.items())


def _numbers(answer: Answer | None) -> dict[str, float]:
    """The numbers of an answer."""
    if answer is None:
        return dict.fromkeys(_NUMBERS, math.nan) | {"paths": 0, "reached": 0}
    found = {name: getattr(answer, name) for name in _NUMBERS if name not in ("low", "high")}
    return found | dict(zip(("low", "high"), answer.interval, strict=True))


def grid_of(model: Model, given: Any, what: str) -> Grid:
    """The values of the parameters that are named, all that differ by path."""
    require_model(model)
    several = [given] if isinstance(given, str) else checks.items(given)
    if not several or not all(isinstance(x, str) for x in several):
        raise WrongTypeError(
            f"groups = {checks.shown(given)} is not allowed: {what} finds the number of paths itself, so labels of "
            "paths mean nothing; give the name of a parameter that has an array of values, or names of some"
        )
    names = list(dict.fromkeys(several))
    for name in names:
        checks.choice("the parameter of groups", name, list(model.parameters))
    left = [name for name, x in model.parameters.items() if np.ndim(x) and np.size(x) > 1 and name not in names]
    left = [name for name in left if isinstance(model.parameters[name], np.ndarray)]
    if left:
        raise IncompatibleError(
            f"the parameter {left[0]} of model {model.name} has an array of values, too, and an answer is for one "
            f"value: name it in groups, or give it a number"
        )
    return groups_by_parameters(model, names, max(model.paths, 1)).grid


def _question(model: Model, f: Any, grid: Grid, given: Mapping[str, Any]) -> dict[str, str]:
    """The question as text for files; bad input is refused."""
    about = {key: x for key, x in given.items() if key not in ("abs", "rel", "scheme", "method")}
    problem = make_problem(model.with_parameters(**grid.points()[0]), f, **about)
    return {
        "model": model.name,
        "f": problem.target.name,
        "t": f"{problem.options.get('t0', 0.0) + problem.horizon:g}",
        "seed": str(problem.seed),
        "tolerance": str(make_tolerance(given["abs"], given["rel"])),
        "parameters": json.dumps({name: x for name, x in model.parameters.items() if not np.ndim(x)}),
    }


def answers_by_value(
    ask: Callable[..., Answer], model: Model, f: Any, grid: Grid, *,
    max_time: float | None, progress: Progress, out: str | os.PathLike | None, **given: Any,
) -> Answers:  # fmt: skip
    """Ask one question for each value; time that is left is shared by the values that are left."""
    watch, count, given = Watch(max_time, False), grid.count, checks.own(given)
    bar, tell = told_by(progress)
    stopped = False
    result = Answers(grid, _question(model, f, grid, given))

    def shown(k: int) -> Callable[[int, int], bool]:
        def show(done: int, total: int) -> bool:
            nonlocal stopped
            stopped |= bool(tell(k * total + done, count * total))
            return stopped

        return show

    folder = None if out is None else files.path_of("out", out)
    try:
        for k, point in enumerate(grid.points()):
            left = None if max_time is None else max((watch.max_time - watch.elapsed) / (count - k), _LEAST)
            mine: dict[str, Any] = {"max_time": left, "progress": shown(k) if tell else False}
            mine["out"] = None if folder is None else Path(folder, f"value-{k + 1}")
            result.answers[k] = ask(model.with_parameters(**point), f, **given, **mine)
            if stopped:
                break
    except BaseException as stop:
        partial = getattr(stop, "partial", None)
        if isinstance(partial, Answer):
            result.answers[k] = partial
        carry(stop, lambda: result.finish() if any(x is not None for x in result.answers) else None)
        raise
    finally:
        if bar:
            bar.close()
    return result.finish()
