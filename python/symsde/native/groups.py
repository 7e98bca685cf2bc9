# SPDX-License-Identifier: BSD-3-Clause
"""Memory that the control groups of this process leave it, for arrays of NumPy.

A batch system, a container or a service sets limits there, and who goes beyond is killed. `src/base/group_memory.c`
reads the same for what the library holds.
"""

from __future__ import annotations

import contextlib
import math
from pathlib import Path

#: of versions 1 and 2: files of the limit and of what is used, and what the kernel takes back of that
_VERSION_1 = ("memory.limit_in_bytes", "memory.usage_in_bytes", ("total_inactive_file", "total_active_file"))
_VERSION_2 = ("memory.max", "memory.current", ("inactive_file", "active_file"))
_NO_LIMIT = 1e18  #: version 1 writes 2^63 less a page where there is none


def memory(listed: Path = Path("/proc/self/cgroup"), root: Path = Path("/sys/fs/cgroup")) -> float:
    """Bytes that all groups leave, and those above them; infinity where none has a limit."""
    least = math.inf
    for line in _text(listed).splitlines():
        _, controllers, path = line.split(":", 2) if line.count(":") > 1 else ("", "-", "")
        if controllers and "memory" not in controllers.split(","):
            continue
        names = [name for name in path.split("/") if name]
        for depth in range(len(names) + 1):
            folder = root.joinpath(controllers, *names[:depth])
            least = min(least, _left_in(folder, *(_VERSION_1 if controllers else _VERSION_2)))
    return least


def _left_in(folder: Path, limit: str, used: str, given_back: tuple[str, ...]) -> float:
    """What one group leaves."""
    most = _number(_text(folder / limit), math.inf)
    if not most < _NO_LIMIT:
        return math.inf
    stat = dict(line.split() for line in _text(folder / "memory.stat").splitlines() if line.count(" ") == 1)
    kept = _number(_text(folder / used), 0.0) - sum(_number(stat.get(name, ""), 0.0) for name in given_back)
    return max(0.0, most - max(0.0, kept))


def _number(text: str, otherwise: float) -> float:
    """As "max" is none."""
    return float(text) if text.strip().isdigit() else otherwise


def _text(path: Path) -> str:
    with contextlib.suppress(OSError, UnicodeDecodeError):
        return path.read_text(encoding="utf-8")
    return ""
