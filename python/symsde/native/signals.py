# SPDX-License-Identifier: BSD-3-Clause
"""Handlers of signals while the library may call Python.

A handler's exception could be raised at the beginning of a callback of the library: it would be lost, and the
results of the callback not set. So during such calls each handler of Python is replaced by one that only notes the
signal. The handlers of noted signals are called when the library calls its monitor, and at the end of the call. If
they return, the work continues; if they raise an exception, the call raises it. If a signal arrives a second time
before its note was handled, as in a user's function that hangs, it is handled immediately.
"""

from __future__ import annotations

import _signal as signal  # the module signal wraps it in enums, which would take half the time of a short run
import contextlib
import itertools
import os
import threading
from collections.abc import Callable, Sequence
from types import FrameType

from ..errors import SymsdeError

_OURS = os.path.join(os.path.dirname(os.path.dirname(__file__)), "")


class Held:
    """Context in which signals wait; nested contexts are one. Used in the main thread only, where handlers
    run."""

    def __init__(self, numbers: Sequence[int]) -> None:
        """Start without noted signals."""
        self._numbers = numbers
        self._depth = 0
        self._handlers: dict[int, Callable] = {}
        self._notes: list[tuple[Callable, int, FrameType | None]] = []
        self._leave = self._leave_note  # kept as one object, so that it can be recognised
        self._seen = ([], [])  # handlers at the last check, and those of them that are Python functions

    def __enter__(self) -> Held:
        """Take over the handlers of signals."""
        self._take()
        self._depth += 1
        return self

    def __exit__(self, *_) -> None:
        """Restore the handlers of signals."""
        if self._depth == 1:
            try:
                self._give_back()
            finally:
                self._depth = 0
                self._call()
        else:
            self._depth -= 1

    def handle(self, *, are_new: bool) -> None:
        """Call the handlers of all signals that arrived; take over handlers that these handlers, or other code, have
        set.
        """
        if are_new or self._notes:
            try:
                self._call()
            finally:
                self._take()

    def _call(self) -> None:
        if not self._notes:
            return
        handler, number, frame = self._notes[0]
        try:
            handler(number, frame)
        finally:
            del self._notes[0]  # removed only now: until then a second signal is handled immediately
            self._call()

    def _leave_note(self, number: int, frame: FrameType | None) -> None:
        handler = self._handlers[number]
        waits = any(number == other for _, other, _ in self._notes)
        if waits and frame is not None and not frame.f_code.co_filename.startswith(_OURS):
            handler(number, frame)
        else:
            self._notes.append((handler, number, frame))

    def _take(self) -> None:
        """Take over handlers that are not replaced yet."""
        found = list(map(signal.getsignal, self._numbers))
        if found != self._seen[0]:  # done rarely: checking all handlers takes part of the time of a short run
            self._seen = found, list(itertools.compress(self._numbers, map(callable, found)))
        try:
            for number in self._seen[1]:
                handler = signal.getsignal(number)
                if handler is not self._leave:
                    self._handlers[number] = handler
                    signal.signal(number, self._leave)
        except BaseException:  # an exception of a handler that is not taken over yet
            if not self._depth:
                self._give_back()
            raise

    def _give_back(self) -> None:
        """Restore the handlers that nobody has replaced meanwhile."""
        try:
            while self._handlers:
                number, handler = next(iter(self._handlers.items()))
                if signal.getsignal(number) is self._leave:
                    signal.signal(number, handler)
                del self._handlers[number]
        except BaseException:  # an exception of a handler that is already restored
            self._give_back()
            raise


#: the context of the main thread, and that of other threads, in which Python calls no handler
_held, _not_ours = Held(range(1, signal.NSIG)), Held(())


def held() -> Held:
    """Context for a call in which the library may call Python."""
    return _held if threading.current_thread() is threading.main_thread() else _not_ours


def carry(stop: BaseException, partial: Callable[[], object]) -> None:
    """Attach `partial`, the result so far or None, to the exception that ends a call. A refusal
    has no result: its sentence says what to change.
    """
    if isinstance(stop, SymsdeError):
        return
    with contextlib.suppress(Exception):  # classes with slots have no such attribute
        stop.partial = None
        stop.partial = partial()
