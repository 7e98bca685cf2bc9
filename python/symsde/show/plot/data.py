# SPDX-License-Identifier: BSD-3-Clause
"""Data of figures: saved paths and moments as plain arrays."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..values import Values

MOST = 1e300  #: largest absolute value that is drawn: limits and ticks of an axis overflow beyond it


@dataclass(frozen=True)
class Paths:
    """Saved paths."""

    title: str
    t: np.ndarray  #: (time,)
    q: np.ndarray  #: (time, dof, path)
    p: np.ndarray
    path: np.ndarray  #: (path,), global indices
    names: Values  #: names of coordinates, momenta, and the energy if it is known
    energies: Callable[[], np.ndarray]  #: gives energies (time, path) if they are known

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


def within(values: np.ndarray) -> np.ndarray:
    """The values, with NaN for values that no axis can hold; the same array if all fit."""
    too_large = np.abs(values) > MOST
    return np.where(too_large, np.nan, values) if too_large.any() else values


def paths_of(found: Any) -> Paths:
    """The data of a `PathTables`."""
    q, p = within(found.q), within(found.p)
    title = found.title if q is found.q and p is found.p else f"{found.title}, without values above {MOST:g}"
    return Paths(title, found.t, q, p, found.path, found.values, lambda: within(found.energy))


def means_of(found: Any) -> Means:
    """The data of a `MomentTables`."""
    names, kinds = found.values.names, ("mean", "var", "se_mean")
    tables = {kind: dict(zip(names, within(found.table(kind)).T, strict=True)) for kind in kinds}
    whole = all(within(found.table(kind)) is found.table(kind) for kind in kinds)
    title = found.title if whole else f"{found.title}, without values above {MOST:g}"
    return Means(title, found.t, found.n_ok, found.values, tables)
