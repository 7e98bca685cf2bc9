# SPDX-License-Identifier: BSD-3-Clause
"""What saved paths and moments offer as plain arrays, in memory or from a file: names, tables, figures."""

from __future__ import annotations

import importlib
from collections.abc import Iterable, Sequence

import numpy as np

from . import tabular


class PathTables:
    """Saved paths."""

    title: str  #: model and scheme
    t: np.ndarray  #: (time,), t0 included
    q: np.ndarray  #: (time, dof, path)
    p: np.ndarray
    path: np.ndarray  #: (path,), global indices
    has_energy: bool  #: whether H is known
    energy: np.ndarray | None  #: (time, path) of H; None where it is not known

    def plot(self, path=None, *, ax=None, what: str = "", of: Sequence[str] | None = None, most: int = 50):
        """A matplotlib figure, written where a path is given, or drawn into `ax`, one axes for each panel.

        what: "paths" (values along time), "phase" (p_i over q_i), "energy" or "map" (q_i and p_i of one path over time
        and i in colours); unless told, paths, or the map of eight degrees of freedom and more. of: names of values, as
        ["q_2"], of a map "q" or "p"; most: paths that are drawn.
        """
        return importlib.import_module("symsde.reports.plot").run(self, (path, ax), what, of, most)

    def to_pandas(self, *, long: bool = False):
        """A pandas.DataFrame, one row for each path and time, indexed by both: q_1 .., p_1 .. . With long=True one row
        for each degree of freedom, too, indexed by path, t and dof: q and p."""
        return tabular.of_run(self, long)


class MomentTables:
    """Means, variances and standard errors of means by the names of the values."""

    title: str  #: model and scheme
    t: np.ndarray  #: (time,)
    n_ok: np.ndarray  #: (time,), paths that count
    _tables: dict[str, np.ndarray]  #: mean, var, se_mean -> (time, value)

    def _name_columns(self, ndof: int, has_energy: bool, observables: Iterable[str]) -> None:
        """Attributes that show the columns of the tables: q, p, the energy, observables."""
        first = 2 * ndof + has_energy
        names = [f"{x}_{i + 1}" for x in "qp" for i in range(ndof)]
        self._columns = [*names, *(["energy"] if has_energy else []), *observables]
        for kind, table in self._tables.items():
            setattr(self, f"{kind}_q", table[:, :ndof])
            setattr(self, f"{kind}_p", table[:, ndof : 2 * ndof])
            setattr(self, f"{kind}_energy", table[:, 2 * ndof] if has_energy else None)
            setattr(self, kind, {name: table[:, i] for i, name in enumerate(self._columns) if i >= first})

    def columns(self) -> list[str]:
        """Names of the values, in their order: q_1 .. q_n, p_1 .. p_n, energy, observables."""
        return list(self._columns)

    def table(self, kind: str) -> np.ndarray:
        """Of a kind, mean, var or se_mean: (time, value), the values as in `columns`."""
        return self._tables[kind]

    def to_arrays(self) -> tuple[np.ndarray, np.ndarray]:
        """Means and their standard errors, each (time, value), the values as in `columns`."""
        return self._tables["mean"], self._tables["se_mean"]

    def plot(self, path=None, *, ax=None, what: str = "moments", of: Sequence[str] | None = None):
        """A matplotlib figure of means with bands of two standard errors and of the standard deviation, written where a
        path is given, or drawn into `ax`, one axes for each panel. what: "moments", "energy" or "map" (means of
        q_i and p_i over time and i in colours, for chains); of: names of values, as in `columns`, of a map "q" or "p".
        """
        return importlib.import_module("symsde.reports.plot").moments(self, (path, ax), what, of)

    def to_pandas(self):
        """A pandas.DataFrame, one row for each time, the columns of the .csv table."""
        return tabular.of_moments(self)
