# SPDX-License-Identifier: BSD-3-Clause
"""Files that runs have written, as objects with the arrays, tables and figures of the runs."""

from __future__ import annotations

import csv
import functools
import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InvalidArgumentError, MissingOperationError, SceneError, SymsdeError
from ..native import files
from ..native.checks import counted
from ..show.values import Values, numbered
from . import groups
from .observers import observer_results
from .report import Report, read_report
from .saved import MomentTables, PathTables

KINDS = ("mean", "var", "se_mean")


class _Loaded:
    """The content of a file besides its tables."""

    _file: Path
    _attributes: dict[str, str]
    _OLD: tuple[str, ...] = ()  #: attributes that files of older versions lack
    _NOT_IN_TABLES: tuple[str, ...] = ()  #: attributes that a .csv file cannot hold

    def _begin(self, file: Path, attributes: dict[str, str]) -> None:
        self._file, self._attributes, self.title = file, attributes, attributes["title"]
        if "report" in attributes:
            self.report = read_report(attributes["report"])

    def attributes(self) -> dict[str, str]:
        """Origin of the results, as text."""
        return dict(self._attributes)

    def __getattr__(self, name: str) -> Any:
        """Raise an error for an attribute that the file does not contain."""
        if name in self._NOT_IN_TABLES and self._file.suffix == ".csv":
            raise AttributeError(
                f"{self._file} is a table of times, which cannot hold {name}: save the moments as .nc or .npz, too"
            )
        if name in (*self._OLD, "report"):
            raise AttributeError(f"{self._file} does not hold {name}: an older version has written it")
        raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")


class LoadedRun(_Loaded, PathTables):
    """Saved paths of a file."""

    _OLD = ("last_q", "last_p")
    report: Report  #: how the run was computed
    last_q: np.ndarray  #: (dof, path), last good state
    last_p: np.ndarray
    q_low: np.ndarray | None = None  #: (dof, path), low parts of the last state of a compensated run
    p_low: np.ndarray | None = None
    status: np.ndarray  #: (path,), 0 = ok
    failed_step: np.ndarray  #: (path,), absolute step that failed; -1 = none

    def __init__(self, file: Path, variables: Mapping[str, np.ndarray], attributes: dict[str, str]):
        """Take the arrays of a file."""
        self._begin(file, attributes)
        self.values = Values.of(_coordinates(attributes, variables["q"].shape[1]), "energy" in variables)
        self.t, self.q, self.p, self.path = (variables[name] for name in ("t", "q", "p", "path"))
        self.status, self.failed_step = variables["status"], variables["failed_step"]
        self.has_energy, self._energy = self.values.has_energy, variables.get("energy")
        for name in {"last_q", "last_p", "q_low", "p_low"} & set(variables):
            setattr(self, name, variables[name])

    @property
    def energy(self) -> np.ndarray:
        """H, (time, path); MissingOperationError if the energy was not computed before the run was saved."""
        if self._energy is None:
            raise MissingOperationError(
                f"the file of {self.title} holds q and p, and no energies: look at run.energy before run.save, or "
                "compute them by model.value(q, p) of its model"
            )
        return self._energy

    def __repr__(self) -> str:
        """The run in one line."""
        ntime, ndof, paths = self.q.shape
        return (
            f"<saved run of {self.title}: {counted(ntime, 'time')}, {counted(ndof, 'degree of freedom')}, "
            f"{counted(paths, 'path')}>"
        )


class LoadedMoments(_Loaded, MomentTables):
    """Moments of a file."""

    _OLD = ("m2",)
    _NOT_IN_TABLES = ("observed", "failed", "failed_status", "failed_step", "m2")
    report: Report  #: how the moments were computed
    observed: dict[str, observer_results.Observed]  #: results of the observers, by their names
    m2: np.ndarray  #: (time, value), sums of squared deviations
    failed: np.ndarray  #: global indices of the first 1000 failed paths; likewise failed_status, failed_step
    variables: dict[str, np.ndarray]  #: all arrays of the file by name, including those of observers

    def __init__(self, file: Path, tables: dict[str, dict], variables: Mapping, attributes: dict[str, str]):
        """Take the arrays of the file as kind -> name -> (time,), and its texts."""
        self._begin(file, attributes)
        self.variables = dict(variables)
        self.t, self.n_ok = variables["t"], variables["n_ok"]
        names = list(tables["mean"])
        self._tables = {kind: np.stack([table[name] for name in names], axis=1) for kind, table in tables.items()}
        ndof = sum(re.fullmatch(r"q_\d+", name) is not None for name in names)
        self.values = Values(tuple(names), len(_coordinates(attributes, ndof)) // 2)

        wanted = attributes.get("observers", "{}")
        if file.suffix != ".csv":
            self.observed = observer_results.filed(self.values, self.t, variables, wanted, self.remarks())
            for name in {"m2", "failed", "failed_status", "failed_step"} & set(variables):
                setattr(self, name, variables[name])
        elif wanted == "{}":
            self.observed = {}

    @functools.cached_property
    def by_group(self) -> groups.GroupedMoments | None:
        """Moments of each group of paths; None if the file holds none. `variables` has those of observers."""
        text = self._attributes.get("groups")
        if text is None or self._file.suffix == ".csv":
            return None
        return groups.filed(self, text, self.values, self.variables)

    def remarks(self) -> list[str]:
        """Sentences about values that the results of observers leave out."""
        return json.loads(self._attributes.get("remarks", "[]"))

    def __repr__(self) -> str:
        """The moments in one line."""
        return f"<saved moments of {self.title}: {', '.join(self.columns()[:8])} at {counted(len(self.t), 'time')}>"


def load_file(path: Path) -> LoadedRun | LoadedMoments:
    """Load a .nc, .npz or .csv file that a run has written."""
    files.require_file(path)
    try:
        if path.suffix == ".csv":
            return _from_table(path)
        variables, attributes = _arrays(path)
        if np.ndim(variables.get("mean_q")) > 2:
            _refuse_groups(path)
        if "q" in variables:
            return LoadedRun(path, variables, attributes)
        return LoadedMoments(path, _columns(variables, attributes), variables, attributes)
    except SymsdeError:
        raise
    except (KeyError, ValueError, IndexError, StopIteration) as error:
        raise SceneError(f"{path} holds neither paths nor moments of a run ({error!r}): give a file of one") from error


def _refuse_groups(path: Path) -> None:
    """Refuse a file with axes of values, which `Sweep.save` and `by_group.save` write for other programs."""
    raise SceneError(
        f"{path} holds moments of each value or group, in a form for other programs: read it by xarray, numpy or "
        "pandas, or load the moments that were saved together with their groups"
    )


def _arrays(path: Path) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    if path.suffix == ".nc":
        with files.NETCDF, files.optional("xarray", "xarray").open_dataset(path) as data:
            found = {str(name): data[name].to_numpy() for name in data.variables}
            found.setdefault("t", found.get("time"))  # files of version 0.1.0 have "time"
            return found, dict(data.attrs)
    if path.suffix != ".npz":
        raise InvalidArgumentError(f"{str(path)!r} is no file of a run: give a folder, or a .nc, .npz or .csv file")
    with np.load(path) as data:
        found = {name: data[name] for name in data.files}
    return found, json.loads(str(found.pop("attributes")))


def _coordinates(attributes: Mapping[str, str], ndof: int) -> tuple[str, ...]:
    """Names of coordinates and momenta of a file."""
    return tuple(json.loads(attributes.get("names", "[]"))) or numbered(ndof)


def _columns(variables: Mapping[str, np.ndarray], attributes: Mapping[str, str]) -> dict[str, dict[str, np.ndarray]]:
    """Variables of a file of moments by kind and name: mean_q under the names of coordinates, mean_energy as energy."""
    tables: dict[str, dict[str, np.ndarray]] = {kind: {} for kind in KINDS}
    coordinates = _coordinates(attributes, variables["mean_q"].shape[1])
    for kind, table in tables.items():
        rows = np.concatenate([variables[f"{kind}_{x}"] for x in "qp"], axis=1).T
        table |= dict(zip(coordinates, rows, strict=True))
    names = [name.removeprefix("var_") for name in variables if re.match("var_(?!q$|p$)", name)]
    names = [name for name in names if all(f"{kind}_{name}" in variables for kind in tables)]  # without observers
    for name in names:
        for kind, table in tables.items():
            table[name] = variables[f"{kind}_{name}"]
    return tables


def _from_table(path: Path) -> LoadedMoments:
    lines = path.read_text(encoding="utf-8").splitlines()
    attributes, key = {"title": path.stem}, ""
    for line in lines:
        if line.startswith("# ") and line[2:3] != " ":
            key, _, text = line[2:].partition(":")
            attributes[key] = text.strip()
        elif line.startswith("#") and key:  # a further line of a text
            attributes[key] += line[4:] + "\n"
    names, *rows = csv.reader(line for line in lines if not line.startswith("#"))
    if "n_ok" in names[2:]:
        _refuse_groups(path)
    columns = dict(zip(names, np.array(rows, float).T, strict=True))
    columns["n_ok"] = columns["n_ok"].astype(int)
    tables = {
        kind: {name.removeprefix(f"{kind} "): x for name, x in columns.items() if name.startswith(f"{kind} ")}
        for kind in KINDS
    }
    return LoadedMoments(path, tables, columns, attributes)
