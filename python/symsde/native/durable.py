# SPDX-License-Identifier: BSD-3-Clause
"""Files that are there whole, and still there after a crash of the machine, or not at all."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

from ..errors import NotWrittenError
from . import parts


def write(target: Path, content: bytes, *, keep: bool = True, mode: int | None = None) -> bool:
    """Write beside the target, fsync, put it in its place, fsync the folder; False where another was there first.

    keep: what is there already stays, so that of two writers none overwrites the other. mode: who may do what with the
    file, else as the process has it.
    """
    try:
        with parts.beside(target) as part:
            with part.open("wb") as file:
                file.write(content)
                file.flush()
                if mode is not None:
                    os.fchmod(file.fileno(), mode)
                os.fsync(file.fileno())
            placed = _link(part, target) if keep else _replace(part, target)
            _sync_folder(target.parent)
            return placed
    except OSError as error:
        raise NotWrittenError(f"{target} cannot be written: {error.strerror or error}") from error


def _link(part: Path, target: Path) -> bool:
    """Give a file its final name, unless a file of this name exists."""
    try:
        os.link(part, target)
    except FileExistsError:
        return False
    except OSError:  # no hard links here: the two would write the same bytes
        if target.exists():
            return False
        os.replace(part, target)
    return True


def _replace(part: Path, target: Path) -> bool:
    os.replace(part, target)
    return True


def _sync_folder(folder: Path) -> None:
    """Make names durable; file systems that cannot sync folders are left alone."""
    with contextlib.suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
