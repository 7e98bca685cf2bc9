# SPDX-License-Identifier: BSD-3-Clause
"""What figures show: saved paths and moments as plain arrays."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from ...errors import UnknownNameError
from ...native import checks
from ...run.saved import MomentTables, PathTables


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


def paths_of(found: PathTables) -> Paths:
    """Of saved paths."""
    energies = (lambda: found.energy) if found.has_energy else None
    return Paths(found.title, found.t, found.q, found.p, found.path, energies)


def means_of(found: MomentTables) -> Means:
    """Of moments."""
    names = found.columns()
    tables = {kind: dict(zip(names, found.table(kind).T, strict=True)) for kind in ("mean", "var", "se_mean")}
    return Means(found.title, found.t, found.n_ok, tables)
