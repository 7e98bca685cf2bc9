# SPDX-License-Identifier: BSD-3-Clause
"""Claims of processes on pieces: locks of one file, which the system releases when a process dies.

Locks of pieces only save work: two processes that compute the same piece write the same bytes, and the second does not
overwrite the shard. So results are right even where a file system has no locks. Beside them each process shares a lock
of the whole folder, which a run that grows has alone while it changes the manifest.
"""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

try:
    import fcntl
except ImportError:  # the system is not a POSIX system
    fcntl = None

_ALL = 2**62  # the lock of the whole folder, beyond the numbers of pieces


class Claims:
    """Claims of this process on the pieces of one folder, by their numbers."""

    def __init__(self, path: Path):
        """Use the lock file at `path`, which is created if it is missing."""
        self._handle = None if fcntl is None else os.open(path, os.O_RDWR | os.O_CREAT, 0o666)

    def take(self, number: int) -> bool:
        """Take the piece if no other process has it; return whether it is taken."""
        if self._handle is None:
            return True
        try:
            fcntl.lockf(self._handle, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, number)
        except BlockingIOError:
            return False
        except PermissionError:  # some systems raise this if another process holds the lock
            return False
        except OSError:  # this file system has no locks
            return True
        return True

    def give(self, number: int) -> None:
        """Release the piece, finished or not."""
        if self._handle is not None:
            try:
                fcntl.lockf(self._handle, fcntl.LOCK_UN, 1, number)
            except OSError:
                return

    def take_all(self) -> bool:
        """Take the whole folder until `share`, if no other process works in it; return whether it is taken."""
        return self.take(_ALL)

    def share(self) -> None:
        """Work in the folder beside others, after a process that has taken it all."""
        if self._handle is not None:
            with contextlib.suppress(OSError):  # this file system has no locks
                fcntl.lockf(self._handle, fcntl.LOCK_SH, 1, _ALL)

    def close(self) -> None:
        """Release all pieces."""
        if self._handle is not None:
            os.close(self._handle)
            self._handle = None
