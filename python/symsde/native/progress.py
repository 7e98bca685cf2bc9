# SPDX-License-Identifier: BSD-3-Clause
"""Progress of a run, and its stop by a progress function or by the handler of a signal."""

from __future__ import annotations

import contextlib
import importlib
import os
import sys
import threading
from collections.abc import Callable

from ..errors import DoubtfulRunWarning, WrongTypeError
from . import abi, checks, signals

Progress = bool | Callable[[int, int], object]

_WIDTH = 40  #: columns of the words beside a percentage
_after_fork = threading.Event()
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork.set)


def threads_of(threads: int | None, in_python: bool) -> int:
    """Threads of a run: the given number; by default one for Python callbacks, else 0, the choice of the library.

    After a fork it is always one, since OpenMP would hang.
    """
    chosen = 0 if threads is None else checks.integer("threads", threads, (1, 1024))
    if _after_fork.is_set() or (threads is None and in_python):
        return 1
    return chosen


class _AtWork(threading.local):
    """The monitors of the runs that are active in this thread, the innermost last: a callback may start another run."""

    def __init__(self) -> None:
        self.monitors: list[Monitor] = []


_at_work = _AtWork()


def _ask_innermost(done: int, total: int, _user) -> int:
    return _at_work.monitors[-1].ask(done, total)


def _warn_innermost(text: bytes, _user) -> int:
    return _at_work.monitors[-1].warn(text.decode("utf-8", "replace"))


class Monitor:
    """Context of one run; the library calls `callback` between chunks, in the thread of the run."""

    #: one C function for all runs: making one takes a considerable part of a short run
    callback = abi.Progress(_ask_innermost)
    warning = abi.Warn(_warn_innermost)  #: called before the first step if there are warnings

    def __init__(self, progress: Progress, *, in_python: bool = True):
        """Check the progress function. Python functions called by a run may set handlers of signals."""
        self._bar, self._tell = told_by(progress)
        self._in_python = in_python or self._tell is not None
        self._signals = signals.held()
        self._error: BaseException | None = None

    def __enter__(self) -> Monitor:
        """Take over signals and open the progress bar."""
        self._signals.__enter__()
        _at_work.monitors.append(self)
        return self

    def __exit__(self, kind, error, traceback) -> None:
        """Restore signals and close the progress bar."""
        _at_work.monitors.pop()
        try:
            if self._bar is not None:
                self._bar.close()
            if self._error is not None:
                raise self._error
        finally:
            self._signals.__exit__()

    def ask(self, done: int, total: int) -> int:
        """Report progress, and call the handlers of signals that arrived; a nonzero result stops the run."""
        if self._error is not None:
            return 1
        try:
            wants_stop = self._tell is not None and bool(self._tell(done, total))
            self._signals.handle(are_new=self._in_python)
        except BaseException as error:  # raised at the end of the run
            self._error = error
            return 1
        return int(wants_stop)

    def warn(self, text: str) -> int:
        """Warn of doubtful choices before the run begins; a nonzero result refuses the run, if warnings are errors."""
        try:
            for sentence in text.splitlines():
                checks.warn(sentence, DoubtfulRunWarning)
        except BaseException as error:  # raised at the end of the run
            self._error = error
            return 1
        return 0


def told_by(progress: Progress) -> tuple[_Bar | None, Callable[[int, int], object] | None]:
    """The progress bar and the progress function; WrongTypeError for other objects."""
    if progress is False:
        return None, None
    if progress is not True and not callable(progress):
        raise WrongTypeError(
            f"progress = {checks.shown(progress)} is not allowed: give True, False, or a function f(done, total) "
            "that returns True to stop"
        )
    bar = _Bar() if progress is True else None
    return bar, bar or progress


def say(text: str) -> None:
    """Write to stderr if possible: no run fails because its progress cannot be shown."""
    if sys.stderr is not None:
        with contextlib.suppress(OSError, ValueError):  # a pipe without a reader, or a closed file
            sys.stderr.write(text)
            sys.stderr.flush()


class _Bar:
    """A bar by tqdm if it is installed, else a line on stderr."""

    def __init__(self, found: int = 0) -> None:
        self._bar = None
        self._shown, self._found = -1, found

    def __call__(self, done: int, total: int) -> None:
        if self._bar is None:
            self._bar = self._tqdm(total)
        if self._bar:
            self._bar.update(done - self._bar.n)
        elif (percent := 100 * done // max(1, total)) > self._shown:
            self._shown = percent
            say(f"\r{percent:3d} %")

    def say(self, text: str) -> None:
        """Show in words what is computed at present."""
        if self._bar:
            self._bar.set_description(text)
        elif self._shown >= 0:
            say(f"\r{self._shown:3d} % {text:{_WIDTH}}")

    def _tqdm(self, total: int):
        if sys.stderr is None or sys.stderr.closed:
            return False
        try:
            tqdm = importlib.import_module("tqdm.auto")
        except ImportError:
            return False
        return tqdm.tqdm(total=total, initial=self._found, unit="step", unit_scale=True, leave=False)

    def close(self) -> None:
        """End the line of the bar."""
        if self._bar:
            self._bar.close()
        elif self._shown >= 0:
            say(f"\r{'':{_WIDTH + 6}}\r")
