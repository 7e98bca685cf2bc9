# SPDX-License-Identifier: BSD-3-Clause
"""A file is written in a separate folder beside its final place, which no other writer can use, and is then renamed.

Creating a folder succeeds for one writer only, even if hosts, containers, processes and threads share the place; a
process id would not be unique, since two containers may have the same. A lock shows whether the writer lives: the
system releases it when the process dies. Within one kernel, identified in the folder by its boot, this is proof.
Between machines some file systems do not share locks or have none: there a folder counts as abandoned if it was not
changed for a day, by the clock of the file system. A living writer that is judged dead gets an error that says so,
never a wrong file.
"""

from __future__ import annotations

import contextlib
import errno
import os
import shutil
import tempfile
import uuid
from collections.abc import Iterator
from pathlib import Path

try:
    import fcntl
except ImportError:  # no POSIX system
    fcntl = None

_PREFIX = ".part-"
_LOCK = "lock"
_DAY = 86400.0
_TRIES = 10  #: most attempts: another process may remove a new folder as abandoned before it is locked

_user = getattr(os, "geteuid", int)  # 0 if files have no owners


def _boot() -> str:
    """Identify the running kernel, in any container."""
    try:
        return Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii").strip()[:8]
    except OSError:
        return f"{uuid.getnode():012x}"


_OWN = f"{_PREFIX}{_boot()}-"


@contextlib.contextmanager
def beside(target: Path) -> Iterator[Path]:
    """A path of the same name on the same file system, to write and then to move; the folder is removed at the end."""
    for _ in range(_TRIES):
        folder = Path(tempfile.mkdtemp(prefix=_OWN, dir=target.parent))
        try:
            try:
                handle = os.open(folder / _LOCK, os.O_WRONLY | os.O_CREAT, 0o666)
            except FileNotFoundError:  # a sweeping process took the folder for abandoned
                continue
            with open(handle, "wb") as lock:
                if _locked(lock.fileno()) is not False and os.fstat(lock.fileno()).st_nlink:
                    yield folder / target.name
                    return
        finally:
            shutil.rmtree(folder, ignore_errors=True)
    raise BlockingIOError(errno.EAGAIN, f"locks in {target.parent} are held by somebody else each time")


def sweep(place: Path) -> None:
    """Remove folders with files of killed writers of this user."""
    with contextlib.suppress(OSError):
        with os.scandir(place) as entries:
            there = [x for x in entries if x.name.startswith(_PREFIX) and x.is_dir(follow_symlinks=False)]
        own = [Path(x.path) for x in there if x.stat(follow_symlinks=False).st_uid == _user()]
        if own:
            with tempfile.TemporaryFile(dir=place) as file:
                now = os.fstat(file.fileno()).st_mtime
            for folder in own:
                _remove_if_left(folder, now)


def _remove_if_left(folder: Path, now: float) -> None:
    with contextlib.suppress(OSError):
        is_old = now - folder.stat().st_mtime > _DAY
        try:
            handle = os.open(folder / _LOCK, os.O_RDWR)
        except FileNotFoundError:  # the writer was killed, or is about to make its lock and will make another folder
            if is_old:
                shutil.rmtree(folder, ignore_errors=True)
            elif folder.name.startswith(_OWN):
                folder.rmdir()  # fails if the lock was made meanwhile
            return
        try:
            is_free = _locked(handle)
            if (is_free and folder.name.startswith(_OWN)) or (is_free is not False and is_old):
                os.unlink(folder / _LOCK)  # goes before the release, so that a late writer sees that the folder is gone
                shutil.rmtree(folder, ignore_errors=True)
        finally:
            os.close(handle)


def _locked(handle: int) -> bool | None:
    """Whether the lock was free and is now held here; None if the file system has no locks."""
    if fcntl is None:
        return None
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return None
    return True
