# SPDX-License-Identifier: BSD-3-Clause
"""Claims of processes on pieces: locks of one file, which the system releases when a process dies.

Locks only save work: two processes that compute the same piece write the same bytes, and the second does not overwrite
the shard. So results are right even where a file system has no locks.
"""

from __future__ import annotations

import os
from pathlib import Path

try:
    import fcntl
except ImportError:  # not POSIX
    fcntl = None


class Claims:
    """Claims of this process on the pieces of one folder, by their numbers."""

    def __init__(self, path: Path):
        """Claims through the file at `path`, which is made if it is missing."""
        self._handle = None if fcntl is None else os.open(path, os.O_RDWR | os.O_CREAT, 0o666)

    def take(self, number: int) -> bool:
        """Whether the piece is free for this process."""
        if self._handle is None:
            return True
        try:
            fcntl.lockf(self._handle, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, number)
        except BlockingIOError:
            return False
        except PermissionError:  # the error of some systems for a lock that another process holds
            return False
        except OSError:  # no locks on this file system
            return True
        return True

    def give(self, number: int) -> None:
        """Done with, or given up."""
        if self._handle is not None:
            try:
                fcntl.lockf(self._handle, fcntl.LOCK_UN, 1, number)
            except OSError:
                return

    def close(self) -> None:
        """Give everything back."""
        if self._handle is not None:
            os.close(self._handle)
            self._handle = None
