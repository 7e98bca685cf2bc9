# SPDX-License-Identifier: BSD-3-Clause
"""What figures show: saved paths and moments as plain arrays."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from ...run.saved import MomentTables, PathTables
from ...run.values import Values


@dataclass(frozen=True)
class Paths:
    """Saved paths."""

    title: str
    t: np.ndarray  #: (time,)
    q: np.ndarray  #: (time, dof, path)
    p: np.ndarray
    path: np.ndarray  #: (path,), global indices
    names: Values  #: of coordinates, momenta, and the energy where it is known
    energies: Callable[[], np.ndarray]  #: gives (time, path), where it is known

    def values(self, name: str) -> np.ndarray:
        """One value, (time, path)."""
        place, ndof = self.names.names.index(name), self.names.ndof
        if place == 2 * ndof:
            return self.energies()
        return self.q[:, place] if place < ndof else self.p[:, place - ndof]


@dataclass(frozen=True)
class Means:
    """Moments."""

    title: str
    t: np.ndarray  #: (time,)
    n_ok: np.ndarray
    names: Values
    tables: Mapping[str, Mapping[str, np.ndarray]]  #: mean, var, se_mean -> name -> (time,)


def paths_of(found: PathTables) -> Paths:
    """Of saved paths."""
    return Paths(found.title, found.t, found.q, found.p, found.path, found.values, lambda: found.energy)


def means_of(found: MomentTables) -> Means:
    """Of moments."""
    names = found.values.names
    tables = {kind: dict(zip(names, found.table(kind).T, strict=True)) for kind in ("mean", "var", "se_mean")}
    return Means(found.title, found.t, found.n_ok, found.values, tables)
