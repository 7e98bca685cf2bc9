# SPDX-License-Identifier: BSD-3-Clause
"""Decide when to end: at a signal, or when the given time is over. Pieces that are nearly done are finished first."""

from __future__ import annotations

import re
import signal
import threading
import time

from ..errors import InvalidArgumentError

_GRACE = 5.0  # seconds that pieces in work may still take after a wish to stop
_SIGNALS = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGUSR1") if hasattr(signal, name)]
_SECONDS = {"": 1.0, "s": 1.0, "min": 60.0, "h": 3600.0, "d": 86400.0}
_WITH_UNIT = re.compile(r"(\d+(?:\.\d+)?) ?(s|min|h|d|)", re.ASCII)
_OF_SLURM = re.compile(r"(\d+)-(\d+)(?::(\d+))?(?::(\d+))?|(?:(\d+):)?(\d+):(\d+)", re.ASCII)
_UNITS = (86400.0, 3600.0, 60.0, 1.0, 3600.0, 60.0, 1.0)  # seconds of the units, in the order of the groups


def seconds(name: str, text: str) -> float:
    """Seconds of a wall time: 90s, 30min, 23.5h, 1d, or as Slurm writes it, minutes:seconds, hours:minutes:seconds,
    days-hours, days-hours:minutes or days-hours:minutes:seconds. A number alone is seconds, although Slurm reads it as
    minutes, because existing scripts rely on seconds."""
    if match := _WITH_UNIT.fullmatch(text.strip()):
        return float(match[1]) * _SECONDS[match[2]]
    if match := _OF_SLURM.fullmatch(text.strip()):
        return sum(float(part or 0) * unit for part, unit in zip(match.groups(), _UNITS, strict=True))
    raise InvalidArgumentError(f"{name} = {text!r} is no time: give 90s, 30min, 23.5h, 23:30:00 or 1-12:00")


class Stop:
    """Context in which signals are wishes to stop: the first lets pieces finish, the second stops at once."""

    def __init__(self, max_walltime: float | None = None):
        """Set the seconds that the work may take."""
        self._since: float | None = None
        self._hurry = False
        self._reason = ""
        self._end = None if max_walltime is None else time.monotonic() + max_walltime
        self._previous: dict = {}

    def __enter__(self) -> Stop:
        """Handle the signals here."""
        if threading.current_thread() is threading.main_thread():
            for number in _SIGNALS:
                self._previous[number] = signal.signal(number, self._on_signal)
        return self

    def __exit__(self, *_) -> None:
        """Restore the previous handlers of signals."""
        for number, previous in self._previous.items():
            signal.signal(number, previous)
        self._previous = {}

    def _on_signal(self, number, _frame) -> None:
        self._hurry = self._since is not None
        self._wish(signal.Signals(number).name)

    def _wish(self, reason: str) -> None:
        if self._since is None:
            self._since, self._reason = time.monotonic(), reason

    def abandon(self) -> None:
        """Stop everything at once."""
        self._wish("an error")
        self._hurry = True

    @property
    def reason(self) -> str:
        """The reason to stop; empty while there is none."""
        if self._end is not None and time.monotonic() > self._end:
            self._wish("--max-walltime")
        return self._reason

    def leaves_time_for(self, took: float) -> bool:
        """Whether there is time for something that takes this many seconds."""
        if not self.reason and self._end is not None and time.monotonic() + took > self._end:
            self._wish("--max-walltime")
        return not self.reason

    def gives_up(self, done: int, total: int, begun: float) -> bool:
        """Whether to give up a piece: a stop is wanted, and the piece, which began at the given time and has made the
        given progress, is not nearly done."""
        if not self.reason:
            return False
        now = time.monotonic()
        left = (now - begun) * (total - done) / max(1, done)
        return self._hurry or now + left > max(self._since + _GRACE, self._end or 0.0)
