# SPDX-License-Identifier: BSD-3-Clause
"""What a run of moments keeps of each path, if it is asked for: its status, and the saved or the last states."""

from __future__ import annotations

import numpy as np

from ..native import abi, checks, handles
from .setup import Setup

_SIZE = handles.new(abi.Paths, "paths").struct_size
LAST = ("last_q", "last_p", "q_low", "p_low")  #: arrays of last states; low parts are those of compensated runs


class KeptPaths:
    """Arrays that the library fills beside moments."""

    q: np.ndarray | None = None  #: (time, dof, path); NaN from a failure on
    p: np.ndarray | None = None
    last_q: np.ndarray | None = None  #: (dof, path), last good state
    last_p: np.ndarray | None = None
    q_low: np.ndarray | None = None  #: (dof, path), low parts of this state
    p_low: np.ndarray | None = None

    def __init__(self, setup: Setup, *, saved: bool = False, last: bool = False, status: np.ndarray | None = None):
        """Allocate the saved states and the last ones where they are wanted, and the status unless there is one."""
        self._setup, self._wanted = setup, {"saved": saved, "last": last}
        ndof, paths = setup.model.ndof, setup.paths
        self.status = np.empty(paths, np.int32) if status is None else status
        if saved:
            checks.room((2, setup.ntime, ndof, paths), "the saved paths (q and p; time, dof, path)")
            self.q, self.p = (np.empty((setup.ntime, ndof, paths)) for _ in "qp")
        if last:
            checks.room((2, ndof, paths), "the last states (q and p; dof, path)")
        for name in LAST[: 4 if setup.options.compensated else 2] if last else ():
            setattr(self, name, np.empty((ndof, paths)))

    def of(self, setup: Setup) -> KeptPaths:
        """The same for another setup."""
        return KeptPaths(setup, **self._wanted, status=self.status)

    def states(self) -> dict[str, np.ndarray]:
        """The last states that are kept, by name."""
        return {name: x for name in LAST if (x := getattr(self, name)) is not None}

    def take_rows(self, whole: KeptPaths, rows: np.ndarray) -> None:
        """Take over what is kept of a run that was saved more often, at these rows alone."""
        self.__dict__.update(whole.__dict__)
        if whole.q is not None:
            self.q, self.p = whole.q[rows], whole.p[rows]

    def struct(self) -> abi.Paths:
        """The arrays in the form of the C interface; they live as long as this object."""
        arrays = self.q, self.p, self.status, None, *(getattr(self, name) for name in LAST)
        return abi.Paths(_SIZE, None, *map(checks.address, arrays))
