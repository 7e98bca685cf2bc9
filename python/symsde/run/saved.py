# SPDX-License-Identifier: BSD-3-Clause
"""Saved paths and moments as plain arrays, in memory or from a file: names, tables, figures."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..errors import MissingOperationError
from ..native import checks
from ..show import plot, tabular
from ..show.values import Values


def no_energy(title: str) -> MissingOperationError:
    """The error for energies of a model without a value function."""
    return MissingOperationError(
        f"there are no energies of {title}: its model has no function value(t, w, q, p), which gives H; give it one, "
        "as symsde.Model(value=..), and run again, or compute H from q and p"
    )


class PathTables:
    """Saved paths, from memory or a file."""

    title: str  #: model and scheme
    values: Values  #: names of coordinates, momenta and the energy
    t: np.ndarray  #: (time,), t0 included
    q: np.ndarray  #: (time, dof, path)
    p: np.ndarray
    path: np.ndarray  #: (path,), global indices
    has_energy: bool  #: whether H is known
    energy: np.ndarray  #: energy H (time, path); raises MissingOperationError if H is not known

    @checks.hinted()
    def plot(self, path=None, *, ax=None, what: str = "", of: str | Sequence[str] | None = None, most: int = 50):
        """Draw a matplotlib figure, written if a path is given, or draw into `ax`, one axes for each panel.

        - what: "paths" (values over time), "phase" (p_i over q_i), "trajectory" (one value over another, such as y
          over x), "energy" or "map" (q_i and p_i of one path in colours, over time and i). The default is "map" for
          eight degrees of freedom and more, else "paths"
        - of: a name or names of values, as in `columns`; of a trajectory two, by default the first two coordinates; of
          a map "q" or "p". Without it all coordinates and momenta are drawn, of a chain the first
        - most: the largest number of paths that are drawn
        """
        return plot.run(self, (path, ax), what, of, most)

    def animate(self, path=None, *, ax=None, of: Sequence[str] | None = None, most: int = 1000, rate: float = 20.0):
        """Make a matplotlib FuncAnimation of the paths as points in a plane, with a frame for each saved time.

        - path: a .gif file, written by pillow; or draw into `ax`, one axes. In a notebook, show the result of its
          `to_jshtml`
        - of: the two values of the plane, as in `columns`; by default the first coordinate and its momentum
        - most: the largest number of paths that are drawn; rate: frames a second
        """
        return plot.animation(self, (path, ax), of, most, rate)

    def columns(self) -> list[str]:
        """Names of the values, in their order: coordinates, momenta, and the energy if it is known.

        Coordinates have the model's own names, such as x and px, or else q_1 .. q_n and p_1 .. p_n.
        """
        return list(self.values.names)

    def to_pandas(self, *, long: bool = False):
        """A pandas.DataFrame, one row for each path and time, indexed by both, with a column for each coordinate.

        With long=True there is one row for each path, time and degree of freedom, indexed by path, t and dof, with
        columns q and p.
        """
        return tabular.of_run(self, long)


class MomentTables:
    """Means, variances and standard errors of means by the names of the values."""

    title: str  #: model and scheme
    t: np.ndarray  #: (time,)
    values: Values  #: names of the values
    n_ok: np.ndarray  #: (time,), number of paths that are ok up to each time
    _tables: dict[str, np.ndarray]  #: mean, var, se_mean -> (time, value)

    def _column(self, kind: str, first: int, last: int) -> np.ndarray:
        """Some columns of a table, (time, value)."""
        return self._tables[kind][:, first:last]

    def _energy(self, kind: str) -> np.ndarray:
        """The column of the energy in a table."""
        if not self.values.has_energy:
            raise no_energy(self.title)
        return self._tables[kind][:, 2 * self.values.ndof]

    def _of_observables(self, kind: str) -> dict[str, np.ndarray]:
        """The columns of the observables in a table."""
        names, table = self.values.names, self._tables[kind]
        first = 2 * self.values.ndof + self.values.has_energy
        return {name: table[:, first + i] for i, name in enumerate(names[first:])}

    mean_q = property(lambda self: self._column("mean", 0, self.values.ndof), doc="(time, dof).")
    mean_p = property(lambda self: self._column("mean", self.values.ndof, 2 * self.values.ndof), doc="(time, dof).")
    mean_energy = property(lambda self: self._energy("mean"), doc="(time,) of H, where it is known.")
    mean = property(lambda self: self._of_observables("mean"), doc="(time,) of each observable, by name.")
    var_q = property(lambda self: self._column("var", 0, self.values.ndof), doc="(time, dof).")
    var_p = property(lambda self: self._column("var", self.values.ndof, 2 * self.values.ndof), doc="(time, dof).")
    var_energy = property(lambda self: self._energy("var"), doc="(time,) of H, where it is known.")
    var = property(lambda self: self._of_observables("var"), doc="(time,) of each observable, by name.")
    se_mean_q = property(lambda self: self._column("se_mean", 0, self.values.ndof), doc="(time, dof).")
    se_mean_p = property(
        lambda self: self._column("se_mean", self.values.ndof, 2 * self.values.ndof), doc="(time, dof)."
    )
    se_mean_energy = property(lambda self: self._energy("se_mean"), doc="(time,) of H, where it is known.")
    se_mean = property(lambda self: self._of_observables("se_mean"), doc="(time,) of each observable, by name.")

    def columns(self) -> list[str]:
        """Names of the values, in their order: coordinates, momenta, energy, observables.

        Coordinates have the model's own names, such as x and px, or else q_1 .. q_n and p_1 .. p_n.
        """
        return list(self.values.names)

    def table(self, kind: str) -> np.ndarray:
        """The table of one kind, "mean", "var" or "se_mean": (time, value), the values in the order of `columns`."""
        return self._tables[kind]

    def to_arrays(self) -> tuple[np.ndarray, np.ndarray]:
        """Means and their standard errors, each (time, value), the values in the order of `columns`."""
        return self._tables["mean"], self._tables["se_mean"]

    def doubts(self) -> list[str]:
        """Sentences about values that were not finite on a path that is ok; their means are not finite either."""
        found, finite = [], np.isfinite(self._tables["mean"])
        if finite.all():
            return found
        times, values = np.nonzero(~finite & (self.n_ok > 0)[:, np.newaxis])
        for value in np.unique(values):
            bad = times[values == value]
            found.append(
                f"{self.columns()[value]} is not a finite number for some paths at {bad.size} of {len(self.t)} saved "
                f"times, first at t = {self.t[bad[0]]:g}: its means there are not finite either"
            )
        return found

    @checks.hinted()
    def plot(self, path=None, *, ax=None, what: str = "", of: str | Sequence[str] | None = None):
        """Draw means with two bands: two standard errors, and the standard deviation.

        A matplotlib figure is written if a path is given; or draw into `ax`, one axes for each panel. what: "moments",
        "energy" or "map" (means of q_i and p_i in colours, over time and i); the default is "map" for eight degrees of
        freedom and more, else "moments". of: a name or names of values, as in `columns`; of a map, "q" or "p". Without
        it all values are drawn, of a chain the first coordinate and momentum.
        """
        return plot.moments(self, (path, ax), what, of)

    def to_pandas(self):
        """A pandas.DataFrame with one row for each time and the columns of the .csv table."""
        return tabular.of_moments(self)
