# SPDX-License-Identifier: BSD-3-Clause
"""Results as tables: data frames of pandas, and tables for notebooks."""

from __future__ import annotations

import html
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from ..native import checks, files, handles
from . import tables

_ROWS, _COLUMNS = 11, 6


def of_run(run: Any, long: bool = False):
    """A data frame of saved paths; the long form has a row for each degree of freedom."""
    pandas = files.optional("pandas", "xarray")
    ntime, ndof, npath = run.q.shape
    if checks.flag("long", long):
        axes = {"path": run.path, "t": run.t, "dof": np.arange(1, ndof + 1)}
        index = pandas.MultiIndex.from_product(axes.values(), names=list(axes))
        return pandas.DataFrame({x: getattr(run, x).transpose(2, 0, 1).ravel() for x in "qp"}, index=index)
    index = pandas.MultiIndex.from_product([run.path, run.t], names=["path", "t"])
    names = [*run.values.q, *run.values.p]
    values = np.concatenate([run.q, run.p], axis=1)  # (time, value, path)
    return pandas.DataFrame(values.transpose(2, 0, 1).reshape(npath * ntime, 2 * ndof), index=index, columns=names)


def of_moments(moments: Any):
    """A data frame of moments."""
    pandas = files.optional("pandas", "xarray")
    columns: dict[str, np.ndarray] = {"n_ok": moments.n_ok}
    for kind in ("mean", "var", "se_mean"):
        columns |= {f"{kind} {name}": x for name, x in zip(moments.columns(), moments.table(kind).T, strict=True)}
    return pandas.DataFrame(columns, index=pandas.Index(moments.t, name="t"))


def first_values(moments: Any, most: int) -> list[int]:
    """Indices of the values that are shown first: a coordinate, its momentum, the energy, observables."""
    ndof = moments.values.ndof
    return [0, ndof, *range(2 * ndof, len(moments.columns()))][:most]


def some_times(ntime: int, most: int = _ROWS) -> list[int]:
    """At most this many saved times, including the first and the last."""
    every = max(1, -(-(ntime - 1) // (most - 1)))
    return sorted({*range(0, ntime, every), ntime - 1})


def html_of_run(run: Any) -> str:
    """A summary of a run, and the last states of its first paths."""
    rows = []
    for i in range(min(len(run.path), _ROWS)):
        state = [f"{x:.6g}" for x in (*run.last_q[:, i][:3], *run.last_p[:, i][:3])]
        failed = f" at step {run.failed_step[i]}" if run.failed_step[i] >= 0 else ""
        rows.append([str(run.path[i]), f"{handles.status_text(int(run.status[i]))}{failed}", *state])
    names = [f"last {name}" for name in (*run.values.q[:3], *run.values.p[:3])]
    return _page(repr(run), ["path", "status", *names], rows, len(run.path) - len(rows), "paths")


def html_of_moments(moments: Any) -> str:
    """Means with standard errors at some times."""
    names, (means, errors) = moments.columns(), moments.to_arrays()
    wanted = first_values(moments, _COLUMNS)
    rows = [
        [f"{moments.t[i]:.6g}", str(moments.n_ok[i]), *(f"{means[i, j]:.6g} ± {errors[i, j]:.2g}" for j in wanted)]
        for i in some_times(len(moments.t))
    ]
    header = ["t", "paths", *(f"mean {names[j]}" for j in wanted)]
    return _page(repr(moments), header, rows, len(moments.t) - len(rows), "times")


def _page(about: str, header: Sequence[str], rows: Iterable[Sequence[str]], hidden: int, of_what: str) -> str:
    more = f"<p>and {hidden} {of_what} more</p>\n" if hidden else ""
    return f"<p>{html.escape(about)}</p>\n{tables.notebook(header, rows)}{more}"
