# SPDX-License-Identifier: BSD-3-Clause
"""Progress of a run of many pieces: a bar on a terminal, else a line in the log each 10 % or minute."""

from __future__ import annotations

import logging
import sys
import time
from collections.abc import Callable

from ..native.progress import _Bar

log = logging.getLogger("symsde")

_SOON, _LATE = 5.0, 60.0  # least and most seconds between lines


class Show:
    """Sums the path-steps done over all pieces."""

    def __init__(self, total: int, done: int, tell: Callable[[int, int], object] | None):
        """Store the receiver. total, done: path-steps of all pieces; tell: called with both."""
        self._total = max(1, total)
        self._finished = done
        self._in_work: dict[str, int] = {}
        self._tell = tell

    def piece(self, name: str, done: int) -> None:
        """Note the path-steps done of an unfinished piece."""
        self._in_work[name] = done

    def finish(self, name: str, work: int) -> None:
        """Note that a piece is done, here or in another process."""
        self._in_work.pop(name, None)
        self._finished += work

    def __call__(self) -> bool:
        """Show the progress; return whether its receiver wants to stop."""
        done = min(self._total, self._finished + sum(list(self._in_work.values())))
        return bool(self._tell(done, self._total)) if self._tell else False


class Lines:
    """Writes a line to the log each 10 % or minute; none for work that is over soon."""

    def __init__(self, found: int = 0) -> None:
        """Start the clock; found: path-steps done before, which took none of its seconds."""
        self._last = self._begin = time.monotonic()
        self._tenths, self._found = 0, found

    def __call__(self, done: int, total: int) -> None:
        """Write the line if it is due."""
        now = time.monotonic()
        tenths = 10 * done // total
        waited = now - self._last
        if waited < _SOON or (tenths <= self._tenths and waited < _LATE):
            return
        self._last, self._tenths = now, tenths
        left = (now - self._begin) * (total - done) / max(1, done - self._found)
        log.info("%d %% of %.3g path-steps, about %.0f s left", 100 * done // total, total, left)

    def close(self) -> None:
        """Do nothing: a log has no end."""


def display(quiet: bool, found: int) -> _Bar | Lines | None:
    """Make the progress display on standard error; `done` path-steps were finished before this work began."""
    if quiet:
        return None
    return _Bar(found) if sys.stderr is not None and sys.stderr.isatty() else Lines(found)
