# SPDX-License-Identifier: BSD-3-Clause
"""Output of the command line to readers that stop reading, as in `symsde run SCENE.toml | head -1`."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterator
from typing import TextIO


class _Patient:
    """A stream that ignores the end of its reader: the work also has results in files."""

    def __init__(self, stream: TextIO):
        self._stream = stream

    def __getattr__(self, name: str):
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        """Write, unless the reader has gone."""
        with self._while_read():
            return self._stream.write(text)
        return len(text)

    def flush(self) -> None:
        """Flush the output."""
        with self._while_read():
            self._stream.flush()

    @contextlib.contextmanager
    def _while_read(self) -> Iterator[None]:
        try:
            yield
        except BrokenPipeError:
            self.forget()

    def forget(self) -> None:
        """Drop the rest of the output, so that Python does not report an error for it when it ends."""
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, self._stream.fileno())
        os.close(nowhere)


@contextlib.contextmanager
def patient_output() -> Iterator[None]:
    """Print as usual, but do not stop if the reader of standard output has gone."""
    if sys.stdout is None:  # standard output is closed
        yield
        return
    stream = _Patient(sys.stdout)
    with contextlib.redirect_stdout(stream):
        try:
            yield
        finally:
            try:
                stream.flush()
            except OSError:  # such as a full disk
                with contextlib.suppress(OSError, ValueError):
                    stream.forget()
                raise
