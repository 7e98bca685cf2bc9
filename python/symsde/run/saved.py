# SPDX-License-Identifier: BSD-3-Clause
"""What saved paths and moments offer as plain arrays, in memory or from a file: names, tables, figures."""

from __future__ import annotations

import importlib
from collections.abc import Iterable, Sequence

import numpy as np

from ..errors import MissingOperationError
from ..native import checks
from . import tabular


def no_energy(title: str) -> MissingOperationError:
    """The error of energies that are not known."""
    return MissingOperationError(
        f"there are no energies of {title}: its model has no function value(t, w, q, p), which gives H; give it one, "
        "as symsde.Model(value=..), and run again, or compute H from q and p"
    )


class PathTables:
    """Saved paths."""

    title: str  #: model and scheme
    t: np.ndarray  #: (time,), t0 included
    q: np.ndarray  #: (time, dof, path)
    p: np.ndarray
    path: np.ndarray  #: (path,), global indices
    has_energy: bool  #: whether H is known
    energy: np.ndarray  #: (time, path) of H; a MissingOperationError where it is not known

    @checks.hinted()
    def plot(self, path=None, *, ax=None, what: str = "", of: Sequence[str] | None = None, most: int = 50):
        """Draw a matplotlib figure, written if a path is given, or draw into `ax`, one axes for each panel.

        - what: "paths" (values over time), "phase" (p_i over q_i), "energy" or "map" (q_i and p_i of one path in
          colours, over time and i). The default is "map" for eight degrees of freedom and more, else "paths"
        - of: names of values, such as ["q_2"]; of a map, "q" or "p"
        - most: the largest number of paths that are drawn
        """
        return importlib.import_module("symsde.reports.plot").run(self, (path, ax), what, of, most)

    def to_pandas(self, *, long: bool = False):
        """A pandas.DataFrame, one row for each path and time, indexed by both, with columns q_1 .., p_1 .. .

        With long=True there is one row for each path, time and degree of freedom, indexed by path, t and dof, with
        columns q and p.
        """
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
        self._energies = {kind: table[:, 2 * ndof] for kind, table in self._tables.items() if has_energy}
        for kind, table in self._tables.items():
            setattr(self, f"{kind}_q", table[:, :ndof])
            setattr(self, f"{kind}_p", table[:, ndof : 2 * ndof])
            setattr(self, kind, {name: table[:, i] for i, name in enumerate(self._columns) if i >= first})

    def _energy(self, kind: str) -> np.ndarray:
        """Its column of a table."""
        if not self._energies:
            raise no_energy(self.title)
        return self._energies[kind]

    mean_energy = property(lambda self: self._energy("mean"), doc="(time,) of H, where it is known.")
    var_energy = property(lambda self: self._energy("var"), doc="(time,) of H, where it is known.")
    se_mean_energy = property(lambda self: self._energy("se_mean"), doc="(time,) of H, where it is known.")

    def columns(self) -> list[str]:
        """Names of the values, in their order: q_1 .. q_n, p_1 .. p_n, energy, observables."""
        return list(self._columns)

    def table(self, kind: str) -> np.ndarray:
        """The table of one kind, "mean", "var" or "se_mean": (time, value), the values in the order of `columns`."""
        return self._tables[kind]

    def to_arrays(self) -> tuple[np.ndarray, np.ndarray]:
        """Means and their standard errors, each (time, value), the values in the order of `columns`."""
        return self._tables["mean"], self._tables["se_mean"]

    @checks.hinted()
    def plot(self, path=None, *, ax=None, what: str = "moments", of: Sequence[str] | None = None):
        """Draw means with two bands: two standard errors, and the standard deviation.

        A matplotlib figure is written if a path is given; or draw into `ax`, one axes for each panel. what: "moments",
        "energy" or "map" (means of q_i and p_i in colours, over time and i, for chains). of: names of values, as in
        `columns`; of a map, "q" or "p".
        """
        return importlib.import_module("symsde.reports.plot").moments(self, (path, ax), what, of)

    def to_pandas(self):
        """A pandas.DataFrame with one row for each time and the columns of the .csv table."""
        return tabular.of_moments(self)
