# SPDX-License-Identifier: BSD-3-Clause
"""Signals for tests, sent when the library reaches a given point: no test waits for a number of seconds."""

import os
import signal
import sys
import threading
from contextlib import contextmanager

import pytest
from symsde.native.progress import Monitor


class Sender:
    """A thread that sends this process a signal while the main thread is in the library.

    The switch interval of Python's threads is made long here, so another thread runs only while the main thread waits
    or is in the library. The signal thus comes while no line of Python runs, and its handler is called when the library
    calls Python next, or at the end of the call.
    """

    def __init__(self, number: int, at: int):
        """Send the signal after call number `at` of `told`, counted from 1."""
        self.number, self.at = number, at
        self.calls = 0
        self._go = threading.Event()
        self._thread = threading.Thread(target=self._send)

    def _send(self) -> None:
        self._go.wait()
        if self.calls >= self.at:
            os.kill(os.getpid(), self.number)

    def told(self, *_) -> bool:
        """Count a call; as a progress function, never stop."""
        self.calls += 1
        if self.calls == self.at:
            self._go.set()
        return False

    def __enter__(self) -> "Sender":
        self._interval = sys.getswitchinterval()
        sys.setswitchinterval(1e3)
        self._thread.start()
        return self

    def __exit__(self, *_) -> None:
        self._go.set()
        self._thread.join()
        sys.setswitchinterval(self._interval)


@contextmanager
def sent(number: int, at: int = 1):
    """A sender whose `told` is called whenever the library asks whether to go on, in any call."""
    with pytest.MonkeyPatch.context() as patch, Sender(number, at) as sender:
        ask = Monitor.ask

        def told(self, done, total):
            stop = ask(self, done, total)
            sender.told()
            return stop

        patch.setattr(Monitor, "ask", told)
        yield sender


@contextmanager
def handled(number: int, handler):
    """A context in which this handler serves the signal."""
    before = signal.signal(number, handler)
    try:
        yield
        assert signal.getsignal(number) is handler
    finally:
        signal.signal(number, before)


class HandledError(Exception):
    """The exception that `raises` raises."""


def raises(number, frame):
    """A handler that raises."""
    raise HandledError(number)
