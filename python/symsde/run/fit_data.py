# SPDX-License-Identifier: BSD-3-Clause
"""Data of a fit: means or series of formulas of the state, at times of the grid of steps."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import IncompatibleError, InvalidArgumentError, WrongShapeError
from ..native import checks

_VARIANCE = re.compile(r"var\((.*)\)\Z", re.S)
_ON_GRID = 1e-6  #: most distance of a time of data from a time of steps, in steps


@dataclass(frozen=True)
class Row:
    """A name of the data: its formula, and whether its variance is meant instead of its mean."""

    name: str
    formula: str
    is_variance: bool

    def told(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Estimate (time,) from values (time, series), and the part of each series in its error (time, series): the
        estimate's variance is the sum of their squares over n (n - 1).
        """
        n = x.shape[1]
        mean = x.mean(axis=1, keepdims=True)
        if not self.is_variance:
            return mean[:, 0], x - mean
        square = (x - mean) ** 2 * (n / max(n - 1, 1))
        estimate = square.mean(axis=1)
        return estimate, square - estimate[:, np.newaxis]

    def weights(self, x: np.ndarray) -> np.ndarray:
        """Derivatives of the estimate by the values of one time: (path,)."""
        n = x.shape[0]
        return 2 * (x - x.mean()) / max(n - 1, 1) if self.is_variance else np.full(n, 1 / n)


@dataclass(frozen=True)
class Data:
    """All data as one vector, name by name; values that are missing are left out."""

    rows: tuple[Row, ...]
    t: np.ndarray  #: (time,)
    values: np.ndarray  #: (name, time), NaN where missing
    errors: np.ndarray | None  #: (name, time), standard errors; None if not known
    series: dict[int, np.ndarray]  #: place of a name -> parts of its series in the error, (time, series)

    @property
    def there(self) -> np.ndarray:
        """Which values are not missing, (name, time)."""
        return np.isfinite(self.values)

    def covariance(self, turned: np.ndarray) -> np.ndarray | None:
        """The covariance of turned times the errors of data, (row, datum): of single values from their own errors,
        which are independent; of series from the series, whose values at different times are not. None: unknown.
        """
        if self.errors is None:
            return None
        whole = np.zeros((len(turned), *self.values.shape))
        whole[:, self.there] = turned
        alone = [i for i in range(len(self.rows)) if i not in self.series]
        spread = np.einsum("aij,ij->aij", whole, np.where(self.there, self.errors, 0.0))[:, alone].reshape(
            len(turned), -1
        )
        found = spread @ spread.T
        parts = sum(whole[:, i] @ part for i, part in self.series.items())
        if self.series:
            n = parts.shape[1]
            found += parts @ parts.T / (n * (n - 1))
        return found


def read_data(given: Any, t: Any, errors: Any) -> Data:
    """The data, their times and errors, checked."""
    times = checks.real_array("t", t).copy()
    if times.ndim != 1 or not times.size or not np.isfinite(times).all() or (np.diff(times) <= 0).any():
        raise InvalidArgumentError(
            f"t = {checks.shown(t)}: give the times of the data, (time,), finite numbers in rising order"
        )
    data = checks.table("data", given)
    if not data:
        raise InvalidArgumentError('data is empty: give values by formula, as {"q": [..], "var(q)": [..]}')
    rows, values, series, known = [], [], {}, {}
    for i, (name, x) in enumerate(data.items()):
        found = _VARIANCE.match(name)
        row = Row(name, found[1] if found else name, bool(found))
        array = checks.real_array(f"data of {name}", x)
        if array.ndim not in (1, 2) or array.shape[0] != times.size:
            raise WrongShapeError(
                f"data of {name} have shape {array.shape}: give {(times.size,)}, a value for each time of t, or "
                f"({times.size}, series) with a column for each measured series"
            )
        if array.ndim == 2:
            estimate, series[i], known[i] = _of_series(row, array)
        else:
            if np.isinf(array).any() or np.isnan(array).all():
                raise InvalidArgumentError(f"data of {name} are not finite: give numbers, NaN where none was measured")
            estimate = array
        rows.append(row)
        values.append(estimate)
    if len({x.shape[1] for x in series.values()}) > 1:
        raise WrongShapeError("data have series of several numbers: give as many series of each name")
    table = np.array(values)
    return Data(tuple(rows), times, table, _errors(errors, rows, table, known), series)


def _of_series(row: Row, array: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Estimate, parts of each series, and standard errors."""
    n = array.shape[1]
    if n < 2 or not np.isfinite(array).all():
        raise InvalidArgumentError(
            f"the series of {row.name} are {'not finite' if n > 1 else 'fewer than two'}: give finite numbers, "
            "(time, series), or a single series as (time,) with its errors"
        )
    estimate, parts = row.told(array)
    return estimate, parts, np.sqrt((parts**2).sum(axis=1) / (n * (n - 1)))


def _errors(given: Any, rows: list[Row], values: np.ndarray, known: Mapping[int, np.ndarray]) -> np.ndarray | None:
    """Standard errors of all data; those of series come from the series."""
    single = [row.name for i, row in enumerate(rows) if i not in known]
    if given is None:
        if known and single:
            raise IncompatibleError(
                f"data of {single[0]} have no errors, and others are series, which have: give errors of all but series"
            )
        table = {}
    elif isinstance(given, Mapping):
        table = checks.table("errors", given)
    else:
        table = dict.fromkeys(single, given)
    for name in table:
        if name not in single:
            why = "has series, whose errors are known" if name in [r.name for r in rows] else "is no name of the data"
            raise InvalidArgumentError(f"errors holds {checks.shown(name)}, which {why}: leave it out")
    if missing := [name for name in single if name not in table]:
        if table:
            raise InvalidArgumentError(f"errors holds none of {missing[0]}: give errors of all data, or of none")
        return None
    found = np.empty(values.shape)
    for i, row in enumerate(rows):
        if i in known:
            found[i] = known[i]
            continue
        x = checks.real_array(f"errors of {row.name}", table[row.name])
        if x.shape not in ((), (values.shape[1],)):
            raise WrongShapeError(f"errors of {row.name} have shape {x.shape}: give a number, or {values.shape[1:]}")
        if not np.isfinite(x).all() or (x <= 0).any():
            raise InvalidArgumentError(f"errors of {row.name} are not all finite and positive: give standard errors")
        found[i] = x
    return found


def steps_of(t: np.ndarray, t0: float, step: float) -> np.ndarray:
    """Numbers of steps until each time."""
    before = (t - t0) / step
    near = np.rint(before)
    off = abs(before - near)
    if (off > _ON_GRID).any() or near.min() < 0 or near.max() > 2**31 or (np.diff(near) <= 0).any():
        i = int(np.argmax((off > _ON_GRID) | (near < 0) | (near > 2**31)))
        raise InvalidArgumentError(
            f"t holds {t[i]:g}, which is {before[i]:.6g} steps of {step:g} after t0 = {t0:g}: data lie at t0 and at "
            "whole steps after it; choose a step that divides the times"
        )
    return near.astype(int)
