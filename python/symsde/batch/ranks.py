# SPDX-License-Identifier: BSD-3-Clause
"""Ranks of MPI that compute one run together: `mpirun -n 4 symsde run scene.toml`.

Rank i of n computes every n-th piece and writes its shards into the shared folder; rank 0 puts the results together.
Without mpi4py the processes are separate writers, which share the work by their claims.
"""

from __future__ import annotations

import importlib
import logging
import os
from collections.abc import Sequence
from typing import Any

from .pieces import Piece

log = logging.getLogger("symsde")

_SIZES = ("OMPI_COMM_WORLD_SIZE", "PMI_SIZE", "MPI_LOCALNRANKS", "PALS_SIZE")  # variables that launchers set


class Ranks:
    """The ranks of a launch; a single rank if there was no launcher."""

    def __init__(self, comm: Any = None):
        """The ranks of a communicator of mpi4py; None is a single process."""
        self._comm = comm
        self.rank = 0 if comm is None else comm.Get_rank()
        self.size = 1 if comm is None else comm.Get_size()

    @classmethod
    def launched(cls) -> Ranks:
        """The ranks of the launcher; MPI begins only if the launcher says that there are several."""
        if not any(os.environ.get(name, "1").isdigit() and int(os.environ.get(name, "1")) > 1 for name in _SIZES):
            return cls()
        try:
            mpi = importlib.import_module("mpi4py.MPI")
        except ImportError:
            log.info("mpi4py is not installed: the processes share the work through the folder")
            return cls()
        return cls(mpi.COMM_WORLD)

    def of(self, pieces: Sequence[Piece]) -> list[Piece]:
        """The pieces of this rank."""
        return list(pieces[self.rank :: self.size])

    def agree(self, error: Exception | None) -> bool:
        """Wait for all ranks; return whether none has an error. The error of this rank is raised."""
        fine = error is None if self._comm is None else all(self._comm.allgather(error is None))
        if error is not None:
            raise error
        return fine
