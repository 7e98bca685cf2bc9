# SPDX-License-Identifier: BSD-3-Clause
"""What figures show: saved paths and moments as plain arrays, from results in memory or from their files."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import InvalidArgumentError, SceneError, SymsdeError, UnknownNameError
from ...native import checks, files


@dataclass(frozen=True)
class Paths:
    """Saved paths."""

    title: str
    t: np.ndarray  #: (time,)
    q: np.ndarray  #: (time, dof, path)
    p: np.ndarray
    path: np.ndarray  #: (path,), global indices
    energies: Callable[[], np.ndarray] | None  #: gives (time, path), where the model is known

    def columns(self) -> list[str]:
        """Names of values: q_1 .., p_1 .., and the energy."""
        names = [f"{x}_{i + 1}" for x in "qp" for i in range(self.q.shape[1])]
        return [*names, *(["energy"] if self.energies else [])]

    def values(self, name: str) -> np.ndarray:
        """One value, (time, path)."""
        known(name, self.columns())
        if name == "energy":
            return self.energies()
        return (self.q if name[0] == "q" else self.p)[:, int(name[2:]) - 1]


@dataclass(frozen=True)
class Means:
    """Moments."""

    title: str
    t: np.ndarray  #: (time,)
    n_ok: np.ndarray
    tables: Mapping[str, Mapping[str, np.ndarray]]  #: mean, var, se_mean -> name -> (time,)

    def columns(self) -> list[str]:
        """Names of values."""
        return list(self.tables["mean"])


def known(name: str, names: Iterable[str]) -> None:
    """Refuse a value that there is not."""
    if name not in (names := list(names)):
        raise UnknownNameError(f"there is no value {name!r}: there are {checks.nearest(name, names)}")


def paths_of(run: Any) -> Paths:
    """Of a `Run`."""
    energies = None
    if run.model.traits.has_value:

        def energies() -> np.ndarray:
            return np.array([run.model.value(q, p, t=t) for t, q, p in zip(run.t, run.q, run.p, strict=True)])

    return Paths(f"{run.model.name} by {run.scheme.name}", run.t, run.q, run.p, run.path, energies)


def means_of(moments: Any) -> Means:
    """Of `Moments`."""
    names = moments.columns()
    tables = {kind: dict(zip(names, moments.table(kind).T, strict=True)) for kind in ("mean", "var", "se_mean")}
    setup = moments.setup
    return Means(f"{setup.model.name} by {setup.scheme.name}", moments.t, moments.n_ok, tables)


def from_file(path: Path) -> Paths | Means:
    """From a file that a run has written."""
    files.require_file(path)
    try:
        if path.suffix == ".csv":
            return _from_table(path)
        variables, attributes = _arrays(path)
        if "q" in variables:
            state = (variables[name] for name in ("time", "q", "p", "path"))
            return Paths(attributes["title"], *state, None)
        return Means(attributes["title"], variables["time"], variables["n_ok"], _columns(variables))
    except SymsdeError:
        raise
    except (KeyError, ValueError, IndexError, StopIteration) as error:
        raise SceneError(f"{path} holds neither paths nor moments of a run ({error!r}): give a file of one") from error


def _arrays(path: Path) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    if path.suffix == ".nc":
        with files.NETCDF, files.optional("xarray", "xarray").open_dataset(path) as data:
            return {str(name): data[name].to_numpy() for name in data.variables}, dict(data.attrs)
    if path.suffix != ".npz":
        raise InvalidArgumentError(f"{str(path)!r} is no file of a run: give a folder, or a .nc, .npz or .csv file")
    with np.load(path) as data:
        found = {name: data[name] for name in data.files}
    found["time"] = found.pop("t")
    return found, json.loads(str(found.pop("attributes")))


def _columns(variables: Mapping[str, np.ndarray]) -> dict[str, dict[str, np.ndarray]]:
    """Variables of a file of moments by kind and name: mean_q as q_1 .., mean_energy as energy."""
    tables: dict[str, dict[str, np.ndarray]] = {"mean": {}, "var": {}, "se_mean": {}}
    for kind, table in tables.items():
        for x in "qp":
            table |= {f"{x}_{i + 1}": row for i, row in enumerate(variables[f"{kind}_{x}"].T)}
    names = [name.removeprefix("var_") for name in variables if re.match("var_(?!q$|p$)", name)]
    names = [name for name in names if all(f"{kind}_{name}" in variables for kind in tables)]  # not of an observer
    for name in names:
        for kind, table in tables.items():
            table[name] = variables[f"{kind}_{name}"]
    return tables


def _from_table(path: Path) -> Means:
    lines = path.read_text(encoding="utf-8").splitlines()
    title = next((line.removeprefix("# title: ") for line in lines if line.startswith("# title: ")), path.stem)
    names, *rows = csv.reader(line for line in lines if not line.startswith("#"))
    columns = dict(zip(names, np.array(rows, float).T, strict=True))
    tables = {
        kind: {name.removeprefix(f"{kind} "): x for name, x in columns.items() if name.startswith(f"{kind} ")}
        for kind in ("mean", "var", "se_mean")
    }
    return Means(title, columns["t"], columns["n_ok"].astype(int), tables)
