# SPDX-License-Identifier: BSD-3-Clause
"""Files that exist completely, even after a crash of the machine, or not at all."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

from ..errors import NotWrittenError
from . import parts


def write(target: Path, content: bytes, *, keep: bool = True, mode: int | None = None) -> bool:
    """Write a file beside the target, fsync, rename, and fsync the folder; False if another file was there first.

    keep: an existing file is not replaced, so that two writers do not overwrite each other. mode: permissions of the
    file, by default those of the process.
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
    except OSError:  # there are no hard links here; both writers would write the same bytes
        if target.exists():
            return False
        os.replace(part, target)
    return True


def _replace(part: Path, target: Path) -> bool:
    os.replace(part, target)
    return True


def _sync_folder(folder: Path) -> None:
    """Make names durable; ignored on file systems that cannot sync folders."""
    with contextlib.suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
