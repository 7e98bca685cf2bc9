# SPDX-License-Identifier: BSD-3-Clause
"""Groups of paths: those with the same values of parameters, or with the same label, and their moments."""

from __future__ import annotations

import dataclasses
import itertools
import json
import math
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Protocol

import numpy as np

from ..errors import IncompatibleError, InvalidArgumentError, NotSavedWarning, WrongShapeError, WrongTypeError
from ..model.definition import Model
from ..native import checks, files
from ..show import plot, tables
from ..show.values import Values

KINDS = ("mean", "var", "se_mean")
MEANS = "moments of groups"  #: the name of their sums, which no observer can have
_TAKEN = {"time", "t", "dof", "path", "value", "n_ok", "energy"}  #: names that files use for dimensions and variables
_MOST = 10**7  #: groups
_SPARSE = 8  #: labels are counted in a table of this many places for each path at most, and sorted otherwise


@dataclasses.dataclass(frozen=True)
class Grid:
    """The points of a sweep, or groups of paths: a product of values, or rows of them."""

    values: dict[str, np.ndarray]  #: name -> (value,)
    is_zip: bool

    def __post_init__(self):
        """Refuse names that files need for something else."""
        for name in self.values:
            if name in _TAKEN:
                raise InvalidArgumentError(f"the parameter {name} has the name of a dimension of results: rename it")

    @property
    def shape(self) -> tuple[int, ...]:
        """Lengths of the axes."""
        sizes = tuple(x.size for x in self.values.values())
        return sizes[:1] if self.is_zip else sizes

    @property
    def dims(self) -> tuple[str, ...]:
        """Names of the axes."""
        return ("value",) if self.is_zip else tuple(self.values)

    @property
    def count(self) -> int:
        """Number of points."""
        return math.prod(self.shape)

    def points(self) -> list[dict[str, float]]:
        """The values of each point, the last axis fastest."""
        flat = {name: x.tolist() for name, x in self.flat().items()}
        return [dict(zip(flat, row, strict=True)) for row in zip(*flat.values(), strict=True)]

    def coordinates(self) -> files.Variables:
        """The values as coordinates of files."""
        return {name: (("value",) if self.is_zip else (name,), x) for name, x in self.values.items()}

    def counted(self) -> str:
        """How many values there are, for people."""
        return " x ".join(f"{checks.counted(n, 'value')} of {x}" for x, n in zip(self.dims, self.shape, strict=True))

    def curves(self, over: str | None, mean: np.ndarray, error: np.ndarray) -> tuple[str, list[tuple]]:
        """The parameter of an abscissa, by default the first, and curves of means (..) over it for figures: one for
        each value of the others, at most eight.
        """
        axes = list(self.values)
        axis = 0 if over is None else checks.choice("over", over, axes)
        x = self.values[axes[axis]]
        if self.is_zip:
            return axes[axis], [("", x, mean, error)]
        others, found = [name for name in axes if name != axes[axis]], []
        for places in itertools.islice(itertools.product(*(range(self.values[y].size) for y in others)), 8):
            label = ", ".join(f"{y} = {self.values[y][i]:g}" for y, i in zip(others, places, strict=True))
            where = (*places[:axis], slice(None), *places[axis:])
            found.append((label, x, mean[where], error[where]))
        return axes[axis], found

    def told(self) -> str:
        """The values as text for files."""
        return json.dumps({"zip": self.is_zip, "values": {name: x.tolist() for name, x in self.values.items()}})

    @classmethod
    def filed(cls, text: str) -> Grid:
        """The values from this text."""
        told = json.loads(text)
        return cls({name: np.array(x) for name, x in told["values"].items()}, told["zip"])

    def flat(self) -> dict[str, np.ndarray]:
        """Values of every point, the last axis fastest."""
        if self.is_zip:
            return self.values
        places = np.indices(self.shape).reshape(len(self.shape), -1)
        return {name: x[i] for (name, x), i in zip(self.values.items(), places, strict=True)}


@dataclasses.dataclass(frozen=True)
class Groups:
    """The group of every path of a run."""

    grid: Grid  #: the points, one for each group
    labels: np.ndarray  #: (path,), number of the point
    numbers: np.ndarray  #: (group,), ascending: the points that have paths

    @classmethod
    def of(cls, grid: Grid, labels: np.ndarray) -> Groups:
        """The groups of paths with these numbers of points."""
        labels = np.reshape(labels, -1).astype(np.int32)
        return cls(grid, labels, np.flatnonzero(np.bincount(labels, minlength=grid.count)))

    @classmethod
    def even(cls, count: int, each: int) -> Groups:
        """Groups of as many neighbouring paths each."""
        numbers = np.arange(count, dtype=np.int32)
        return cls(Grid({"group": numbers}, is_zip=False), np.repeat(numbers, each), numbers)

    def part(self, where: slice | np.ndarray) -> Groups:
        """The groups of some paths."""
        return Groups.of(self.grid, self.labels[where])

    def places(self) -> np.ndarray:
        """(path,), the place of the group of every path among the numbers."""
        if len(self.numbers) == self.grid.count:
            return self.labels
        places = np.zeros(self.grid.count, np.int32)
        places[self.numbers] = np.arange(len(self.numbers))
        return places[self.labels]


def groups_of(given: object, model: Model, paths: int) -> Groups | None:
    """Groups from the name of a parameter, or names of some, or (path,) labels; None for None."""
    if given is None or isinstance(given, Groups):
        return given
    several = [given] if isinstance(given, str) else checks.items(given)
    if several and all(isinstance(x, str) for x in several) and not isinstance(given, np.ndarray):
        names = list(dict.fromkeys(several))
        for name in names:
            checks.choice("the parameter of groups", name, list(model.parameters))
        return groups_by_parameters(model, names, paths)
    try:
        labels = np.asarray(given)
    except ValueError:
        raise WrongShapeError("groups are a nested sequence of unequal lengths: give (path,) whole numbers") from None
    if labels.dtype.kind not in "iub":
        raise WrongTypeError(
            f"groups = {checks.shown(given)} is not allowed: give the name of a parameter that differs by path, names "
            "of some, or (path,) whole numbers"
        )
    if labels.shape != (paths,):
        raise WrongShapeError(f"groups have shape {labels.shape}: give (path,), labels of {paths} paths")
    if (most := int(labels.max())) > np.iinfo(np.int64).max:
        raise InvalidArgumentError(f"groups hold the label {most}: give whole numbers below 2**63")
    least = int(labels.min())
    if most - least > _SPARSE * paths:
        found, places = np.unique(labels, return_inverse=True)
    else:  # a count takes a tenth of the time of a sort
        from_least = labels.astype(np.int64) - least
        there = np.bincount(from_least) > 0
        found, places = np.flatnonzero(there) + least, (np.cumsum(there) - 1)[from_least]
    return groups_of_points(Grid({"group": found.astype(np.int64)}, is_zip=False), places)


def groups_by_parameters(model: Model, names: Iterable[str], paths: int) -> Groups:
    """Groups of paths with the same values of these parameters."""
    refuse_sites(model, names)
    return groups_of_rows({name: np.broadcast_to(np.ravel(model.parameters[name]), paths) for name in names})


def refuse_sites(model: Model, names: Iterable[str]) -> None:
    """Refuse parameters with a number for each site, which has no path."""
    for name in names:
        if isinstance(model.parameters.get(name), tuple):
            raise IncompatibleError(
                f"the parameter {name} of model {model.name} has a number for each site, and the same for all paths: "
                "make a model and a run for each choice of its numbers"
            )


def groups_of_rows(values: Mapping[str, np.ndarray]) -> Groups:
    """Groups of paths with the same values: a product if every combination has paths."""
    axes, places = {}, []
    for name, x in values.items():
        axes[name], inverse = np.unique(x, return_inverse=True)
        places.append(inverse)
    shape = tuple(x.size for x in axes.values())
    if math.prod(shape) <= len(places[0]):
        flat = np.ravel_multi_index(places, shape)
        if np.unique(flat).size == math.prod(shape):
            return groups_of_points(Grid(axes, is_zip=False), flat)
    rows, inverse = np.unique(np.stack(places), axis=1, return_inverse=True)
    return groups_of_points(
        Grid({name: x[i] for (name, x), i in zip(axes.items(), rows, strict=True)}, is_zip=True), inverse
    )


def groups_of_points(grid: Grid, labels: np.ndarray) -> Groups:
    """Groups of paths with these numbers of points."""
    if grid.count > _MOST:
        raise InvalidArgumentError(f"there are {grid.count} groups: give {_MOST} at most")
    return Groups.of(grid, labels)


class Origin(Protocol):
    """A run, or its file."""

    title: str  #: model and scheme

    def attributes(self) -> dict[str, str]:
        """Origin of the results, as text."""


class GroupedMoments:
    """Means, variances and standard errors of means of groups of paths, at each saved time.

    `mean_q`, `var_q` and `se_mean_q` have the shape (time, dof, ..), like the arrays of p; those of the energy, and
    `n_ok`, have the shape (time, ..). The dots stand for one axis for each parameter, or for a single axis `value` if
    some parameters go together; for labels it is `group`.
    """

    t: np.ndarray  #: (time,)
    parameters: dict[str, np.ndarray]  #: values of each parameter, (value,); of labels, by the name `group`
    dims: tuple[str, ...]  #: names of the axes of the values
    n_ok: np.ndarray  #: (time, ..), number of paths that count
    mean: dict[str, np.ndarray]  #: (time, ..) of each observable; likewise var, se_mean
    #: results of each observer, one for each group, the last axis fastest; None of a group without paths
    observed: dict[str, list]

    def __init__(self, origin: Origin, grid: Grid, values: Values, ntime: int):
        """Begin without paths; origin: the run, for title and attributes."""
        self._origin, self._grid, self.values = origin, grid, values
        self.parameters, self.dims, self.observed = dict(grid.values), grid.dims, {}
        nvalue = len(values.names)
        checks.room((4, nvalue, ntime, grid.count), "moments of groups (mean, variance, error; value, time, point)")
        self.t = np.full(ntime, np.nan)
        self._n = np.zeros((ntime, grid.count), np.int64)
        self._mean, self._m2 = np.zeros((2, nvalue, ntime, grid.count))

    def put(self, where: np.ndarray | slice, sums: np.ndarray) -> None:
        """Store the sums of some points, (point, time, 1 + 2 value): numbers of paths, means, squares of deviations."""
        nvalue = len(self.values.names)
        rows = np.moveaxis(sums, 2, 0).swapaxes(1, 2)  # (number, time, point)
        self._n[:, where] = rows[0]
        self._mean[:, :, where], self._m2[:, :, where] = rows[1 : 1 + nvalue], rows[1 + nvalue :]

    def finish(self):
        """Make the results available as attributes by their names."""
        shape = self._grid.shape
        with np.errstate(invalid="ignore", divide="ignore"):
            n = self._n.astype(float)
            var = np.where(n > 1, self._m2 / (n - 1), np.nan)
            found = {"mean": np.where(n > 0, self._mean, np.nan), "var": var, "se_mean": np.sqrt(var / n)}
        found = {kind: x.reshape(*x.shape[:2], *shape) for kind, x in found.items()}
        return self._show(self._n.reshape(-1, *shape), found)

    def _show(self, n_ok: np.ndarray, found: dict[str, np.ndarray]):
        """Set the attributes from n_ok, (time, ..), and tables, (value, time, ..)."""
        ndof, names = self.values.ndof, self.values
        self.n_ok, self._tables = n_ok, found
        for kind, x in self._tables.items():
            setattr(self, f"{kind}_q", np.moveaxis(x[:ndof], 0, 1))
            setattr(self, f"{kind}_p", np.moveaxis(x[ndof : 2 * ndof], 0, 1))
            if names.has_energy:
                setattr(self, f"{kind}_energy", x[2 * ndof])
            setattr(self, kind, dict(zip(names.observables, x[2 * ndof + names.has_energy :], strict=True)))
        return self

    def points(self) -> list[dict[str, float]]:
        """The values of each group, the last axis fastest."""
        return self._grid.points()

    def table(self, kind: str) -> np.ndarray:
        """The table of one kind, "mean", "var" or "se_mean": (name, time, ..), the names in the order of `columns`."""
        return self._tables[KINDS[checks.choice("kind", kind, KINDS)]]

    def columns(self) -> list[str]:
        """Names of the values, in their order: coordinates, momenta, energy, observables."""
        return list(self.values.names)

    def attributes(self) -> dict[str, str]:
        """Origin of the results as text for files."""
        return {**self._origin.attributes(), "groups": self._grid.told()}

    def to_xarray(self):
        """An xarray.Dataset with dims time, dof and one for each parameter (value where they go together)."""
        return files.dataset(self._variables(), self._coordinates(), self.attributes())

    def save(self, path: str | os.PathLike) -> None:
        """Write a .nc (needs xarray and netCDF4) or .npz file, or a .csv table with a row for each time and value."""
        target = files.path_of("path", path)
        if target.suffix != ".csv":
            variables = {"t": (("time",), self.t), **self._variables()}
            variables |= {name: x for name, x in self._coordinates().items() if name not in ("time", "t", "dof")}
            files.write(target, self.to_xarray, variables, self.attributes(), also=".csv, ")
            return
        if missing := self.save_table(target):
            checks.warn(
                f"{target}: a table of times and values cannot hold all results of the observers {', '.join(missing)}: "
                "save a .nc or .npz file, too",
                NotSavedWarning,
            )

    def save_table(self, target: Path) -> list[str]:
        """Write a .csv table of all results with one number for each time and value. Observers are returned that have
        further results."""
        times, points = len(self.t), self._grid.count
        columns = {"t": np.repeat(self.t, points)}
        columns |= {name: np.tile(x, times) for name, x in self._grid.flat().items()}
        columns["n_ok"] = self.n_ok.ravel()
        for kind, table in self._tables.items():
            columns |= {f"{kind} {name}": x.ravel() for name, x in zip(self.columns(), table, strict=True)}
        missing = []
        for name in self.observed:
            found = self._of_observer(name)
            fits = {key: x for key, (dims, x) in found.items() if dims == (*self.dims, "time")}
            columns |= {key: np.moveaxis(x, -1, 0).ravel() for key, x in fits.items()}
            missing += [name] if len(fits) < len(found) else []
        tables.write(target, columns, self.attributes())
        return missing

    def plot(self, path=None, *, ax=None, of: str | None = None, over: str | None = None, at: int = -1):
        """Draw means over a parameter with a band of two standard errors, at one saved time.

        of: a name of `columns`, by default the first; over: the parameter of the abscissa, by default the first, whose
        mean is drawn once for each value of the others, at most eight curves; at: index of the saved time. A figure is
        written if a path is given; or draw into `ax`.
        """
        names = self.columns()
        place = 0 if of is None else checks.choice("of", self.values.called(of), names)
        over, curves = self._grid.curves(over, *(self._tables[kind][place][at] for kind in ("mean", "se_mean")))
        return plot.sweep(self.title, (over, f"{names[place]} at t = {self.t[at]:g}"), curves, (path, ax))

    @property
    def title(self) -> str:
        """Model and scheme."""
        return self._origin.title

    def __repr__(self) -> str:
        """One line."""
        return f"<moments of groups of {self.title}: {self._grid.counted()}, {checks.counted(len(self.t), 'time')}>"

    def _coordinates(self) -> files.Variables:
        return {**files.axes(self.t, self.values.ndof), **self._grid.coordinates()}

    def _variables(self) -> files.Variables:
        dims, ndof = self.dims, self.values.ndof
        found = {"n_ok": (("time", *dims), self.n_ok)}
        for kind in KINDS:
            for letter in "qp":
                found[f"{kind}_{letter}"] = (("time", "dof", *dims), getattr(self, f"{kind}_{letter}"))
            for name, x in zip(self.columns()[2 * ndof :], self._tables[kind][2 * ndof :], strict=True):
                found[f"{kind}_{name}"] = (("time", *dims), x)
        for name in self.observed:
            found |= self._of_observer(name)
        return found

    def _of_observer(self, name: str) -> files.Variables:
        """Variables of an observer, with the axes of the groups first."""
        found: files.Variables = {}
        each = [x.variables(name) if x is not None else None for x in self.observed[name]]
        first = next((x for x in each if x is not None), {})
        for key, (axes, sample) in first.items():
            if np.asarray(sample).dtype.kind in "OU":  # names, the same in each group
                found[key] = axes, sample
                continue
            rows = _padded([None if x is None else np.asarray(x[key][1]) for x in each])
            found[key] = ((*self.dims, *axes), rows.reshape(*self._grid.shape, *rows.shape[1:]))
        return found


def _padded(rows: list[np.ndarray | None]) -> np.ndarray:
    """The rows as one array: shorter lists, and rows that are None, are filled up by NaN, or whole numbers by -1."""
    there = [x for x in rows if x is not None]
    shape = tuple(np.max([x.shape for x in there], axis=0)) if there[0].ndim else ()
    is_whole = there[0].dtype.kind in "iu"
    found = np.full((len(rows), *shape), -1 if is_whole else np.nan, np.int64 if is_whole else float)
    for i, x in enumerate(rows):
        if x is not None:
            found[i, *map(slice, x.shape)] = x
    return found


PREFIX = "group_"  #: of variables of groups in files of moments


def variables_of(found: GroupedMoments) -> files.Variables:
    """Variables of groups in a file of moments, with the values of the groups."""
    values = {name: ((found.dims[0] if len(found.dims) == 1 else name,), x) for name, x in found.parameters.items()}
    every = {f"{PREFIX}{name}": x for name, x in (values | found._variables()).items()}
    own = {"value": f"{PREFIX}value"}  # files of moments have another dimension `value`
    return {name: (tuple(own.get(dim, dim) for dim in dims), x) for name, (dims, x) in every.items()}


def filed(origin: Origin, text: str, values: Values, variables: Mapping[str, np.ndarray]) -> GroupedMoments:
    """The moments of groups from the variables of a file of moments."""
    t = variables["t"]
    found = GroupedMoments(origin, Grid.filed(text), values, len(t))
    found.t = t
    names = values.names[2 * values.ndof :]
    tables = {
        kind: np.concatenate(
            [
                *(np.moveaxis(variables[f"{PREFIX}{kind}_{x}"], 1, 0) for x in "qp"),
                *(variables[f"{PREFIX}{kind}_{name}"][np.newaxis] for name in names),
            ]
        )
        for kind in KINDS
    }
    return found._show(variables[f"{PREFIX}n_ok"], tables)
