# SPDX-License-Identifier: BSD-3-Clause
"""Sweeps: means for many values of parameters, whose paths run side by side, as many at a time as fit into memory."""

from __future__ import annotations

import dataclasses
import itertools
import json
import math
import os
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Unpack

import numpy as np

from ..errors import (
    DoubtfulRunWarning,
    IncompatibleError,
    InvalidArgumentError,
    PathsFailedWarning,
    WrongShapeError,
)
from ..model.definition import Model, require_model
from ..native import checks, files
from ..native.progress import Progress, told_by
from ..show import plot, tables
from ..show.values import Values
from .observers.observables import (
    Observable,
    are_in_python,
    check_observables,
    described,
    refuse_coordinates,
    rows_of,
)
from .report import Report
from .setup import RunOptions, Setup, make_setup
from .simulate import Run

_NUMBERS = 2**23  #: most numbers of the saved paths that are held at once
_UNIT = 256  #: if the paths of one value are divided, each part has a multiple of this number of paths
_TAKEN = {"time", "t", "dof", "path", "value", "n_ok", "energy"}  #: names that files use for dimensions and variables
KINDS = ("mean", "var", "se_mean")


@dataclasses.dataclass(frozen=True)
class Grid:
    """The values of a sweep: a product of arrays, or rows of them."""

    values: dict[str, np.ndarray]  #: name -> (value,)
    is_zip: bool

    @property
    def shape(self) -> tuple[int, ...]:
        """Lengths of the axes."""
        sizes = tuple(x.size for x in self.values.values())
        return sizes[:1] if self.is_zip else sizes

    @property
    def dims(self) -> tuple[str, ...]:
        """Names of the axes."""
        return ("value",) if self.is_zip else tuple(self.values)

    def flat(self) -> dict[str, np.ndarray]:
        """Values of every point, the last axis fastest."""
        if self.is_zip:
            return self.values
        places = np.indices(self.shape).reshape(len(self.shape), -1)
        return {name: x[i] for (name, x), i in zip(self.values.items(), places, strict=True)}


class Sweep:
    """Means, variances and standard errors of means for each value of some parameters, at each saved time.

    `mean_q`, `var_q` and `se_mean_q` have the shape (time, dof, ..), like the arrays of p; those of the energy, and
    `n_ok`, have the shape (time, ..). The dots stand for one axis for each parameter, or for a single axis with zip.
    """

    t: np.ndarray  #: (time,)
    parameters: dict[str, np.ndarray]  #: values of each parameter, (value,)
    dims: tuple[str, ...]  #: names of the axes of the values
    n_ok: np.ndarray  #: (time, ..), number of paths that count
    mean: dict[str, np.ndarray]  #: (time, ..) of each observable; likewise var, se_mean
    status: np.ndarray  #: (.., path), 0 = ok
    q: np.ndarray | None  #: (time, dof, .., path) if paths are kept
    p: np.ndarray | None
    report: Report  #: report of the first run; failed and stopped count the paths of all runs

    def __init__(self, setup: Setup, grid: Grid, paths: int, observables: Mapping[str, Observable], *, keep: bool):
        """Allocate the results."""
        self._setup, self._grid, self._observables = setup, grid, described(observables)
        refuse_coordinates(self._observables, setup.model)
        self.parameters, self.dims, self.paths = dict(grid.values), grid.dims, paths
        self.values = Values.of(setup.model.coordinates, setup.model.traits.has_value, self._observables)
        ntime, count, ndof = setup.ntime, math.prod(grid.shape), setup.model.ndof
        nvalue = len(self.values.names)
        checks.room((4, nvalue, ntime, count), "the means of a sweep (mean, variance, error; value, time, point)")
        if keep:
            checks.room((2, ntime, ndof, count, paths), "the paths of a sweep (q and p; time, dof, point, path)")
        self.t = np.full(ntime, np.nan)
        self._n = np.zeros((ntime, count), np.int64)
        self._mean, self._m2 = np.zeros((2, nvalue, ntime, count))
        self._status = np.full((count, paths), -1, np.int32)
        self._q, self._p = (np.full((ntime, ndof, count, paths), np.nan) for _ in "qp") if keep else (None, None)

    def take(self, run: Run, rows: Callable | None, groups: slice, part: slice) -> None:
        """Store the results of a run: the paths `part` of each of the values `groups`."""
        self.t = run.t
        shape = (groups.stop - groups.start, part.stop - part.start)
        self._status[groups, part] = run.status.reshape(shape)
        kept = ((self._q, run.q), (self._p, run.p))
        for mine, theirs in kept:
            if mine is not None:
                mine[:, :, groups, part] = theirs.reshape(*theirs.shape[:2], *shape)
        ok = np.isfinite(run.q).all(axis=1) & np.isfinite(run.p).all(axis=1)
        ok = ok.reshape(len(run.t), *shape)
        before, here = self._n[:, groups].copy(), ok.sum(axis=2)
        both = before + here
        self._n[:, groups] = both
        for k, column in enumerate(_columns(run, rows)):
            x = np.where(ok, column.reshape(ok.shape), 0.0)
            with np.errstate(invalid="ignore", divide="ignore"):
                mean = np.where(here > 0, x.sum(axis=2) / here, 0.0)
                m2 = (np.where(ok, x - mean[..., np.newaxis], 0.0) ** 2).sum(axis=2)
                apart = mean - self._mean[k][:, groups]
                share = np.where(both > 0, here / both, 0.0)
            self._mean[k][:, groups] += apart * share
            self._m2[k][:, groups] += m2 + apart**2 * share * before

    def finish(self) -> Sweep:
        """Make the results available as attributes by their names."""
        shape, ndof, names = self._grid.shape, self.values.ndof, self.values
        with np.errstate(invalid="ignore", divide="ignore"):
            n = self._n.astype(float)
            var = np.where(n > 1, self._m2 / (n - 1), np.nan)
            found = {"mean": np.where(n > 0, self._mean, np.nan), "var": var, "se_mean": np.sqrt(var / n)}
        self.n_ok = self._n.reshape(-1, *shape)
        self.status = self._status.reshape(*shape, self.paths)
        self.q, self.p = (x if x is None else x.reshape(*x.shape[:2], *shape, -1) for x in (self._q, self._p))
        self._tables = {kind: x.reshape(*x.shape[:2], *shape) for kind, x in found.items()}
        for kind, x in self._tables.items():
            setattr(self, f"{kind}_q", np.moveaxis(x[:ndof], 0, 1))
            setattr(self, f"{kind}_p", np.moveaxis(x[ndof : 2 * ndof], 0, 1))
            if names.has_energy:
                setattr(self, f"{kind}_energy", x[2 * ndof])
            setattr(self, kind, dict(zip(names.observables, x[2 * ndof + names.has_energy :], strict=True)))
        return self

    def table(self, kind: str) -> np.ndarray:
        """The table of one kind, "mean", "var" or "se_mean": (name, time, ..), the names in the order of `columns`."""
        return self._tables[KINDS[checks.choice("kind", kind, KINDS)]]

    def columns(self) -> list[str]:
        """Names of the values, in their order: coordinates, momenta, energy, observables."""
        return list(self.values.names)

    def attributes(self) -> dict[str, str]:
        """Origin of the sweep as text for files."""
        told = {name: x.tolist() for name, x in self.parameters.items()}
        return {**self._setup.attributes(), "sweep": json.dumps(told), "paths_of_a_value": str(self.paths)}

    def to_xarray(self):
        """An xarray.Dataset with dims time, dof and one for each parameter (value with zip), and path if kept."""
        return files.dataset(self._variables(), self._coordinates(), self.attributes())

    def save(self, path: str | os.PathLike) -> None:
        """Write a .nc (needs xarray and netCDF4) or .npz file, or a .csv table with a row for each time and value."""
        target = files.path_of("path", path)
        if target.suffix != ".csv":
            variables = {"t": (("time",), self.t), **self._variables()}
            variables |= {name: x for name, x in self._coordinates().items() if name not in ("time", "t", "dof")}
            files.write(target, self.to_xarray, variables, self.attributes(), also=".csv, ")
            return
        times, points = len(self.t), math.prod(self._grid.shape)
        columns = {"t": np.repeat(self.t, points)}
        columns |= {name: np.tile(x, times) for name, x in self._grid.flat().items()}
        columns["n_ok"] = self.n_ok.ravel()
        for kind, table in self._tables.items():
            columns |= {f"{kind} {name}": x.ravel() for name, x in zip(self.columns(), table, strict=True)}
        tables.write(target, columns, self.attributes())

    def plot(self, path=None, *, ax=None, of: str | None = None, over: str | None = None, at: int = -1):
        """Draw means over a parameter with a band of two standard errors, at one saved time.

        of: a name of `columns`, by default the first; over: the parameter of the abscissa, by default the first, whose
        mean is drawn once for each value of the others, at most eight curves; at: index of the saved time. A figure is
        written if a path is given; or draw into `ax`.
        """
        names, axes = self.columns(), list(self.parameters)
        place = 0 if of is None else checks.choice("of", self.values.called(of), names)
        axis = 0 if over is None else checks.choice("over", over, axes)
        over = axes[axis]
        mean, error = (self._tables[kind][place][at] for kind in ("mean", "se_mean"))
        x, told = self.parameters[over], f"{names[place]} at t = {self.t[at]:g}"
        if self._grid.is_zip:
            return plot.sweep(self.title, (over, told), [("", x, mean, error)], (path, ax))
        others = [name for name in axes if name != over]
        curves = []
        for places in itertools.islice(itertools.product(*(range(self.parameters[y].size) for y in others)), 8):
            label = ", ".join(f"{y} = {self.parameters[y][i]:g}" for y, i in zip(others, places, strict=True))
            where = (*places[:axis], slice(None), *places[axis:])
            curves.append((label, x, mean[where], error[where]))
        return plot.sweep(self.title, (over, told), curves, (path, ax))

    @property
    def title(self) -> str:
        """Model and scheme."""
        return f"{self._setup.model.name} by {self._setup.scheme.name}"

    def __repr__(self) -> str:
        """One line."""
        axes = " x ".join(
            f"{checks.counted(n, 'value')} of {name}" for name, n in zip(self.dims, self._grid.shape, strict=True)
        )
        return (
            f"<sweep of {self.title}: {axes}, {checks.counted(self.paths, 'path')} each, "
            f"{checks.counted(len(self.t), 'time')}, {self.report.failed} failed>"
        )

    def _coordinates(self) -> files.Variables:
        found = files.axes(self.t, self.values.ndof)
        found |= {name: (("value",) if self._grid.is_zip else (name,), x) for name, x in self.parameters.items()}
        return found

    def _variables(self) -> files.Variables:
        dims, ndof = self.dims, self.values.ndof
        found = {"n_ok": (("time", *dims), self.n_ok), "status": ((*dims, "path"), self.status)}
        for kind in KINDS:
            for letter in "qp":
                found[f"{kind}_{letter}"] = (("time", "dof", *dims), getattr(self, f"{kind}_{letter}"))
            for name, x in zip(self.columns()[2 * ndof :], self._tables[kind][2 * ndof :], strict=True):
                found[f"{kind}_{name}"] = (("time", *dims), x)
        for letter, x in (("q", self.q), ("p", self.p)):
            if x is not None:
                found[letter] = (("time", "dof", *dims, "path"), x)
        return found


def _columns(run: Run, rows: Callable | None) -> Iterator[np.ndarray]:
    """Values of a run in the order of columns, (time, path) each."""
    for x in (run.q, run.p):
        yield from np.moveaxis(x, 1, 0)
    if run.has_energy:
        yield run.energy
    if rows is not None:
        with np.errstate(all="ignore"):
            found = [[x for _, x in rows(t, q, p)] for t, q, p in zip(run.t, run.q, run.p, strict=True)]
        yield from np.moveaxis(np.array(found), 1, 0)


@checks.hinted(*RunOptions.__annotations__)
def sweep(
    model: Model | Callable[..., Model],
    values: Mapping[str, Any],
    *,
    q0: Any,
    p0: Any,
    step: float,
    steps: int,
    paths: int = 1,
    zip: bool = False,
    same_noise: bool = False,
    keep_paths: bool = False,
    observables: dict[str, Observable] | None = None,
    progress: Progress = False,
    **options: Unpack[RunOptions],
) -> Sweep:
    """Integrate `paths` paths for each value of some parameters, and keep means by value.

        found = ss.sweep(model, {"sigma": np.linspace(0, 1, 1000)}, q0=1.0, p0=0.0, step=0.05, steps=200, paths=100)
        found.mean_q, found.se_mean_q        # (time, dof, value)

    - model: from formulas or built in, whose parameters go by path, so that all values are run side by side; or a
      function that returns the model of its arguments, as `ss.models.fpu_chain`: values are run one after the other
    - values: name -> values of a parameter, (value,) each. All combinations are run; with zip=True the first values of
      all, then the second, ..
    - paths: of each value. Value k, counted with the last parameter fastest, has the paths first_path + k*paths .. ;
      with same_noise=True every value has the noise of the first: their differences have far smaller errors
    - q0, p0: a number, (dof,), or (dof, path) for the paths of each value
    - keep_paths: keep q and p, (time, dof, .., path), too
    - observables and the other arguments are those of `moments`; increments cannot be prescribed

    A path has the bits of a run of it alone whose values are arrays of one. Failed paths are left out of means.
    A progress function that returns True ends the sweep: values that were not reached have n_ok = 0 and NaN.
    """
    bar, tell = told_by(progress)
    grid = _grid(values, checks.flag("zip", zip))
    functions = check_observables(observables)
    if bound := [name for name, x in (observables or {}).items() if hasattr(x, "of_model")]:
        raise IncompatibleError(
            f"observable {bound[0]} has the parameters of one model, and a sweep has many: take moments for each "
            "value, or give a formula"
        )
    paths = checks.integer("paths", paths, (1, 2**47))
    same_noise, keep = checks.flag("same_noise", same_noise), checks.flag("keep_paths", keep_paths)
    if options.pop("increments", None) is not None:
        raise IncompatibleError("increments are those of one run: give a seed, and same_noise=True for the same noise")
    points = grid.flat()
    count = next(iter(points.values())).size
    options |= {"q0": q0, "p0": p0, "step": step, "steps": steps, "in_python": are_in_python(functions)}
    many = isinstance(model, Model)
    if not many and not callable(model):
        require_model(model)

    def made(groups: slice, each: int) -> Model:
        here = {name: x[groups] for name, x in points.items()}
        if many:
            return model.with_parameters(**{name: np.repeat(x, each) for name, x in here.items()})
        found = model(**{name: float(x[0]) for name, x in here.items()})
        require_model(found)
        return found

    first = made(slice(0, 1), paths)
    begun = make_setup(first, paths=paths, **options)
    result = Sweep(begun, grid, paths, functions, keep=keep)
    most = max(_UNIT, _NUMBERS // (2 * begun.ntime * first.ndof) // _UNIT * _UNIT)
    done, total, doubts, report, stopped = 0, count * paths * begun.options.steps, {}, None, False
    try:
        for groups, part in _parts(count, paths, most, one_by_one=not many):
            each = part.stop - part.start
            setup = _setup(made(groups, each), options, paths, (groups, part), same_noise=same_noise)
            run = Run(setup)
            with checks.unwarned():
                run.fill((lambda now, _, b=done: tell(b + now, total)) if tell else False)
            if run.report.stopped:
                stopped = True
                break
            result.take(run, rows_of(functions, setup.model), groups, part)
            done += setup.paths * setup.options.steps
            report = report or run.report
            doubts |= dict.fromkeys(run.report.warnings)
    finally:
        if bar:
            bar.close()
    return _told(result, report or run.report, doubts, stopped=stopped)


def _told(result: Sweep, report: Report, doubts: dict[str, None], *, stopped: bool) -> Sweep:
    """The result with its report, and warnings about it."""
    failed = int(np.count_nonzero(result._status > 0))
    missing = int(np.count_nonzero(result._status < 0)) if stopped else 0
    result.report = dataclasses.replace(report, failed=failed, stopped=missing)
    if failed:
        checks.warn(
            f"{checks.counted(failed, 'path')} failed: they are left out of means; see status and n_ok",
            PathsFailedWarning,
        )
    for doubt in doubts:
        checks.warn(doubt, DoubtfulRunWarning)
    return result.finish()


def _grid(values: Mapping[str, Any], is_zip: bool) -> Grid:
    """The values as arrays (value,)."""
    given = checks.table("values", values)
    if not given:
        raise InvalidArgumentError("values is empty: give the values of a parameter, as {'sigma': [0.1, 0.2, 0.3]}")
    arrays = {}
    for name, x in given.items():
        array = np.array(np.atleast_1d(checks.real_array(f"values of {name}", x)))
        if array.ndim != 1 or not array.size:
            raise WrongShapeError(f"values of {name} have shape {array.shape}: give (value,), one number at least")
        if not np.isfinite(array).all():
            raise InvalidArgumentError(f"values of {name} are not all finite: give finite numbers")
        if checks.name_of("name of a parameter", name) in _TAKEN:
            raise InvalidArgumentError(f"the parameter {name} has the name of a dimension of results: rename it")
        arrays[name] = array
    sizes = {name: x.size for name, x in arrays.items()}
    if is_zip and len(set(sizes.values())) > 1:
        told = ", ".join(f"{size} of {name}" for name, size in sizes.items())
        raise WrongShapeError(f"zip=True takes as many values of each parameter, and there are {told}")
    return Grid(arrays, is_zip)


def _parts(count: int, paths: int, most: int, *, one_by_one: bool) -> Iterator[tuple[slice, slice]]:
    """Give the values, and the paths of each value, that are run at once: some values with all their paths, or a
    part of the paths of one value.
    """
    together = 1 if one_by_one else max(1, most // paths)
    size = min(paths, most)
    for k in range(0, count, together):
        for i in range(0, paths, size):
            yield slice(k, min(k + together, count)), slice(i, min(i + size, paths))


def _setup(
    model: Model, options: Mapping[str, Any], paths: int, where: tuple[slice, slice], *, same_noise: bool
) -> Setup:
    """The setup of the run of some values and paths."""
    groups, part = where
    n, each = groups.stop - groups.start, part.stop - part.start
    here = dict(options)
    first = checks.integer("first_path", here.pop("first_path", 0), (0, 2**47))
    here["first_path"] = first + part.start + (0 if same_noise else groups.start * paths)
    for name in ("q0", "p0", "q0_low", "p0_low"):
        array = None if here.get(name) is None else np.asarray(here[name])
        if array is not None and array.ndim == 2 and array.shape[1] > 1:
            here[name] = np.tile(array[:, part], n)
    setup = make_setup(model, paths=n * each, **here)
    if same_noise and n > 1:
        setup.options.noise_paths = each
    return setup
