# SPDX-License-Identifier: BSD-3-Clause
"""Initial states from the rows of a table: an array, a .npy file, or a .csv file."""

from __future__ import annotations

import csv
import hashlib
import os
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import IncompatibleError, InvalidArgumentError, WrongShapeError
from ...model.definition import Model
from ...native import checks, files
from .law import UNIFORM, States, drawn

_STREAM = 2  #: of the numbers that choose rows


class Table(States):
    """Rows of a table; see `table`."""

    def __init__(self, rows: Any, seed: int | None, *, draws: bool):
        """Read the rows and keep a copy."""
        super().__init__(seed)
        self._names, self._rows = read_table(rows)
        self._draws = checks.flag("drawn", draws)
        if self._rows.ndim != 2 or not self._rows.size:
            raise WrongShapeError(f"the table of initial states has shape {self._rows.shape}: give (path, column)")
        if not np.isfinite(self._rows).all():
            raise InvalidArgumentError(
                "the table of initial states holds a number that is not finite: give finite numbers"
            )
        if seed is not None and not self._draws:
            raise InvalidArgumentError(
                "seed of states.table goes with drawn=True: path i has row i, which no seed changes"
            )

    def told(self) -> dict[str, Any]:
        """See `States`."""
        digest = hashlib.sha256(np.ascontiguousarray(self._rows, "<f8").tobytes()).hexdigest()
        names = {} if self._names is None else {"columns": list(self._names)}
        return {
            "law": "table",
            "rows": len(self._rows),
            **names,
            "sha256": digest,
            "drawn": self._draws,
            **self._seed(),
        }

    def _draw(self, model: Model, t: float, seed: int, where: tuple[int, int], letters: str) -> tuple:
        first, paths = where
        many = len(self._rows)
        if self._draws:
            u = drawn(UNIFORM, seed, where, np.full(2, 0.5), np.full((2, 1), 0.5), stream=_STREAM)[0][0]
            chosen = np.minimum((u * many).astype(np.int64), many - 1)
        elif first + paths > many:
            raise IncompatibleError(
                f"the table of initial states has {checks.counted(many, 'row')}, for the paths 0 .. {many - 1}, and "
                f"the run has paths up to {first + paths - 1}: give a longer table, fewer paths, or drawn=True"
            )
        else:
            chosen = slice(first, first + paths)
        places = _places(self._names, self._rows.shape[1], model, letters)
        return tuple(np.ascontiguousarray(self._rows[chosen][:, places[x]].T) if x in letters else None for x in "qp")


def _places(names: tuple[str, ...] | None, columns: int, model: Model, letters: str) -> dict[str, list[int]]:
    """The columns of q and of p: by name, or in their order if there are no names."""
    n = model.ndof
    own = model.coordinates
    if names is None:
        if columns == 2 * n:
            return {"q": list(range(n)), "p": list(range(n, 2 * n))}
        if columns == n and len(letters) == 1:
            return {letters: list(range(n))}
        raise WrongShapeError(
            f"the table of initial states has {checks.counted(columns, 'column')} without names: give {2 * n}, q_1 .. "
            f"and then p_1 .., or {n} for q0 or p0 alone"
        )
    found = {}
    for k, letter in enumerate("qp"):
        if letter not in letters:
            continue
        found[letter] = []
        for i in range(n):
            known = [own[k * n + i], f"{letter}_{i + 1}", f"{letter}{i + 1}", *([letter] if n == 1 else [])]
            place = [names.index(x) for x in known if x in names]
            if not place:
                raise InvalidArgumentError(
                    f"the table of initial states has no column {known[0]}: its columns are {', '.join(names[:8])}"
                )
            found[letter].append(place[0])
    return found


def read_table(given: Any) -> tuple[tuple[str, ...] | None, np.ndarray]:
    """Names of the columns, or None, and rows (path, column)."""
    if not isinstance(given, str | os.PathLike):
        return None, np.array(checks.real_array("rows", given))
    path = Path(files.path_of("rows", given))
    try:
        files.require_file(str(path))
        if path.suffix == ".npy":
            return None, np.array(checks.real_array(str(path), np.load(path, allow_pickle=False)))
        if path.suffix == ".csv":
            return _of_csv(path)
    except OSError as error:
        raise InvalidArgumentError(f"{path} cannot be read: {error.strerror}") from error
    except (ValueError, EOFError) as error:
        if isinstance(error, InvalidArgumentError):
            raise
        raise InvalidArgumentError(f"{path} is no table of numbers: {error}") from error
    raise InvalidArgumentError(f"{path}: give a .csv or a .npy file, or an array (path, column)")


def _of_csv(path: Path) -> tuple[tuple[str, ...] | None, np.ndarray]:
    """Rows of numbers separated by commas; the first row may have names, and lines that begin with # are left out."""
    with path.open(encoding="utf-8-sig", newline="") as lines:
        rows = list(csv.reader(x for x in lines if x.strip() and not x.lstrip().startswith("#")))
    if not rows:
        raise InvalidArgumentError(f"{path} has no rows: give a row of numbers for each path")
    names = None
    try:
        list(map(float, rows[0]))
    except ValueError:
        names = tuple(x.strip() for x in rows.pop(0))
    wide = {len(row) for row in rows} | ({len(names)} if names else set())
    if len(wide) > 1:
        raise WrongShapeError(f"{path} has rows of {min(wide)} and of {max(wide)} numbers: give as many in each")
    return names, np.array([[float(x) for x in row] for row in rows]).reshape(len(rows), -1)


def table(rows: Any, *, drawn: bool = False, seed: int | None = None) -> Table:
    """Initial states from a table: path i has row i, counted from 0, or with drawn=True a row drawn for it.

        found = ss.states.table("bunch.csv")          # columns q and p, or q_1, q_2, .., p_1, p_2, ..
        ss.simulate(model, q0=found, p0=found, step=0.05, steps=200, paths=1000)

    - rows: a .csv file, whose first row may have names of columns, in any order and with further columns; a .npy file
      or an array, (path, 2 dof), q_1 .. and then p_1 .., or (path, dof) for q0 or p0 alone
    - drawn: draw rows with replacement, by seed and path
    - seed: of drawn rows, 0 .. 2^64 - 1, by default the run's

    InvalidArgumentError, WrongShapeError: no table of finite numbers, or columns that are missing. IncompatibleError: a
    run with more paths than rows.
    """
    return Table(rows, seed, draws=drawn)
