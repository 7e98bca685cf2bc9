# SPDX-License-Identifier: BSD-3-Clause
"""Values of parameters of a scene that differ from path to path: ranges, lists, and columns of CSV files."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InvalidArgumentError, SceneError, SymsdeError
from ..native import checks
from ..run.groups import Grid, Groups, groups_of_points, groups_of_rows
from ..run.states.table import read_table

_NOT_PARAMETERS = {"name", "thermostat", "damping", "allow_gain"}  #: keys of a built-in model beside its parameters


def of_table(file: str, table: dict[str, Any], run: Mapping[str, Any]) -> tuple[dict[str, Any], Groups | None]:
    """The table [model] with values for each path in the place of {from = , to = , count = }, {csv = , column = } and
    lists of parameters, and the groups of paths with the same values; None if there are none.

    Every value, or every combination of values (the last range fastest), gets the same number of paths. Lists and
    columns of CSV files go together, row by row. A list with a number for each path stays as it is.
    """
    if "python" in table:
        return table, None
    where = "[model.params]" if "H" in table else "[model]"
    values = dict(table.get("params") or {}) if "H" in table else table
    paths = run.get("paths", 1)
    lists = {key: x for key, x in values.items() if _is_list(x) and key not in _NOT_PARAMETERS and "n" not in table}
    given = {key: x for key, x in values.items() if isinstance(x, dict) and key not in _NOT_PARAMETERS}
    given |= {key: x for key, x in lists.items() if len(x) != paths}
    if not given:
        return table, _repeated(lists, paths)
    given = {key: given[key] for key in values if key in given}
    if "n" in table and "H" in table:
        key = next(iter(given))
        raise SceneError(
            f"{file}: {where}: {key} = {checks.shown(given[key])}: parameters of sums over sites are the same for all "
            "paths: give a number, or a list with one for each site, and a scene for each value; in Python "
            "symsde.sweep takes a function that makes the model"
        )
    try:
        columns = {key: np.array(x, float) for key, x in given.items() if isinstance(x, list)}
        columns |= {key: _column(file, key, x) for key, x in given.items() if "csv" in x and key not in columns}
        ranges = {key: _range(key, x) for key, x in given.items() if key not in columns}
        rows = {len(x) for x in columns.values()}
        if len(rows) > 1:
            raise InvalidArgumentError(
                f"{', '.join(columns)} have {min(rows)} and {max(rows)} values, and columns and lists go together, row "
                "by row: give as many of each"
            )
    except SymsdeError as error:
        raise SceneError(f"{file}: {where}: {error}") from error
    axes = [np.arange(x) for x in rows] + list(ranges.values())
    flat = [x.ravel() for x in np.meshgrid(*axes, indexing="ij")]
    points = {key: x[flat[0]] for key, x in columns.items()}
    points |= dict(zip(ranges, flat[len(rows) :], strict=True))
    points = {key: points[key] for key in given}
    count = flat[0].size
    if type(paths) is not int or paths < 1 or paths % count:
        raise SceneError(
            f"{file}: [run] paths = {checks.shown(paths)} is not a multiple of {count}, the number of values of "
            f"{', '.join(given)}: give {count} times the paths of one value"
        )
    made = {key: np.repeat(x, paths // count) for key, x in points.items()}
    try:
        grid = Grid(points, is_zip=True) if columns else Grid(ranges, is_zip=False)
        groups = groups_of_points(grid, np.repeat(np.arange(count), paths // count))
    except SymsdeError as error:
        raise SceneError(f"{file}: {where}: {error}") from error
    return ({**table, "params": {**values, **made}} if "H" in table else {**table, **made}), groups


def _is_list(given: object) -> bool:
    """Whether this is a list of numbers."""
    return isinstance(given, list) and bool(given) and all(type(x) in (int, float) for x in given)


def _repeated(lists: Mapping[str, list], paths: object) -> Groups | None:
    """The groups of paths with the same values in lists with a number for each path; None if no value is repeated."""
    if not lists:
        return None
    groups = groups_of_rows({key: np.array(x, float) for key, x in lists.items()})
    return groups if groups.grid.count < paths else None


def _range(key: str, given: dict[str, Any]) -> np.ndarray:
    """The values of {from = , to = , count = }."""
    if set(given) != {"from", "to", "count"}:
        raise InvalidArgumentError(
            f"{key} = {checks.shown(given)}: give a number, a list with one for each path, "
            '{from = 0.1, to = 1.0, count = 10}, or {csv = "values.csv", column = "name"}'
        )
    ends = (checks.finite(f"{end} of {key}", given[end]) for end in ("from", "to"))
    return np.linspace(*ends, checks.integer(f"count of {key}", given["count"], (1, 2**31)))


def _column(file: str, key: str, given: dict[str, Any]) -> np.ndarray:
    """The values of {csv = , column = }; without column it has the parameter's name."""
    if not set(given) <= {"csv", "column"} or not all(isinstance(x, str) for x in given.values()):
        raise InvalidArgumentError(f'{key} = {checks.shown(given)}: give {{csv = "values.csv", column = "name"}}')
    names, rows = read_table(Path(file).parent / given["csv"])
    column = given.get("column", key)
    if names is None or column not in names:
        told = f"its columns are {', '.join(names[:8])}" if names else "its first row has no names of columns"
        raise InvalidArgumentError(f"{key}: {given['csv']} has no column {column}: {told}")
    found = rows[:, names.index(column)]
    if not found.size or not np.isfinite(found).all():
        raise InvalidArgumentError(f"{key}: the column {column} of {given['csv']} is no list of finite numbers")
    return np.ascontiguousarray(found)


def files_of(model: Mapping[str, Any]) -> list[str]:
    """The files beside a scene with values of parameters."""
    tables = [*model.values(), *(model.get("params") or {}).values()] if isinstance(model, dict) else []
    return [x["csv"] for x in tables if isinstance(x, dict) and isinstance(x.get("csv"), str)]
