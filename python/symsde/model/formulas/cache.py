# SPDX-License-Identifier: BSD-3-Clause
"""The cache of compiled formulas, with checks that a loaded file was written by this user, completely.

To load a library is to execute it. So every folder and link on the path must belong to this user or to root, and
nobody else may have write permission; the file is opened once, never through a link, and read. If the checksum is
right, the bytes read are loaded from memory, through a sealed file without a name. So a change of the file after the
check does not change the code that runs.
"""

from __future__ import annotations

import ctypes
import functools
import hashlib
import itertools
import os
import stat
import tempfile
from pathlib import Path

from ...errors import NotWrittenError, SlowFormulaWarning
from ...native import checks, files

try:
    import fcntl
except ImportError:  # no POSIX system
    fcntl = None

_OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH
_OTHERS_ENTER = stat.S_IXGRP | stat.S_IXOTH
_LINKS = 40  #: most links followed on the path to a folder, as in the system

_loaded: dict[Path, ctypes.CDLL] = {}  # libraries stay loaded until the process ends
_loads = itertools.count()


def folder() -> Path:
    """SYMSDE_CACHE, or symsde below the user's cache folder; a folder for this process if neither can be used."""
    chosen = os.environ.get("SYMSDE_CACHE")
    place = Path(chosen or Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "symsde").absolute()
    try:
        for part in (*reversed(place.parents), place):
            if not part.exists():
                part.mkdir(mode=0o700, exist_ok=True)
        stranger = open_to_others(place)
        if stranger is None and os.access(place, os.W_OK):
            return place
        if stranger is not None:
            checks.warn(_sentence(place, stranger), SlowFormulaWarning)
    except OSError:
        pass
    return _own_folder()


def _sentence(place: Path, stranger: Path) -> str:
    return (
        f"compiled formulas are not kept in {place}, since others could put code there: {stranger} belongs to another "
        f"user, or others may write in it: say chmod go-w, or set SYMSDE_CACHE to a folder of your own"
    )


@functools.cache
def _own_folder() -> Path:
    holder = tempfile.TemporaryDirectory(prefix="symsde-")
    _own_folder.holder = holder  # removed when the process ends
    if (stranger := open_to_others(Path(holder.name))) is not None:
        raise NotWrittenError(f"{_sentence(Path(holder.name), stranger)}, or TMPDIR")
    return Path(holder.name)


def open_to_others(path: Path) -> Path | None:
    """The first folder or link on a path, including its end, that others own or can change; None if there is none.

    In folders like /tmp others cannot move files they do not own; below a folder that nobody else can enter, modes are
    irrelevant.
    """
    here, rest, links, is_closed = Path(path.anchor), list(path.parts[1:]), 0, False
    while True:
        found = here.lstat()
        if found.st_uid not in (0, os.geteuid()):
            return here
        if stat.S_ISLNK(found.st_mode):
            links += 1
            if links > _LINKS:
                return here
            here, rest = here.parent, [*Path(os.readlink(here)).parts, *rest]
        else:
            is_closed = is_closed or not found.st_mode & _OTHERS_ENTER
            is_like_tmp = bool(rest and found.st_mode & stat.S_ISVTX)
            if found.st_mode & _OTHERS_WRITE and not is_closed and not is_like_tmp:
                return here
        if not rest:
            return None
        name = rest.pop(0)
        is_closed = is_closed and name not in ("/", "..")
        here = here.parent if name == ".." else here / name


def keep(target: Path, content: bytes, source: str) -> None:
    """Write a library with its checksum, and its source, each completely or not at all."""
    told = f"{hashlib.sha256(content).hexdigest()}  {target.name}\n"
    for suffix, what in ((".c", source.encode()), (".sha256", told.encode()), (".so", content)):
        files.write_durably(target.with_suffix(suffix), what, keep=False, mode=0o600)


def load(target: Path) -> ctypes.CDLL | None:
    """Load a library once per process; None unless there is a complete one, written by this user on this machine."""
    if target not in _loaded:
        content, told = _read(target), _read(target.with_suffix(".sha256"))
        if content is None or told is None or told[:64] != hashlib.sha256(content).hexdigest().encode():
            return None
        try:
            _loaded[target] = _from_memory(content)
        except (AttributeError, OSError):  # no nameless files here: the folder's permissions must suffice
            try:
                _loaded[target] = ctypes.CDLL(str(target))
            except OSError:
                return None
    return _loaded[target]


def _read(path: Path) -> bytes | None:
    """The content of a file, if this user wrote it."""
    try:
        handle = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
        with open(handle, "rb") as file:
            found = os.fstat(handle)
            is_own = found.st_uid == os.geteuid() and not found.st_mode & _OTHERS_WRITE
            return file.read() if stat.S_ISREG(found.st_mode) and is_own else None
    except OSError:
        return None


def _from_memory(content: bytes) -> ctypes.CDLL:
    """Load these bytes. The loader identifies libraries by the text of the path, and file numbers are reused. So every
    path spells the folder differently; otherwise the loader could return an earlier library whose file had the same
    number."""
    handle = os.memfd_create("formula", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
    with open(handle, "wb") as file:
        file.write(content)
        file.flush()
        fcntl.fcntl(handle, fcntl.F_ADD_SEALS, fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_GROW | fcntl.F_SEAL_WRITE)
        turns = f"{next(_loads):b}".replace("0", "./").replace("1", ".//")
        return ctypes.CDLL(f"/proc/self/{turns}fd/{handle}")
