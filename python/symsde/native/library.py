# SPDX-License-Identifier: BSD-3-Clause
"""Find and load libsymsde, once."""

from __future__ import annotations

import ctypes
import os
import sys
from pathlib import Path

from ..errors import LibraryNotFoundError, SymsdeError
from . import abi, cpu

_NAME = "libsymsde.dylib" if sys.platform == "darwin" else "libsymsde.so"


def package() -> Path:
    """The folder of this package."""
    return Path(__file__).resolve().parents[1]


def candidates() -> list[Path]:
    """Paths of the library, in the order of search: SYMSDE_LIBRARY alone if set, the package's variants, the
    build tree."""
    chosen = os.environ.get("SYMSDE_LIBRARY")
    if chosen:
        return [Path(chosen)]
    here = package()
    places = [folder / _NAME for folder in cpu.folders(here)]
    return places if os.environ.get("SYMSDE_CPU") else [*places, here.parents[1] / "build" / "native" / _NAME]


def found() -> Path | None:
    """The first of the candidates that exists."""
    return next((path for path in candidates() if path.is_file()), None)


def load() -> ctypes.CDLL:
    """Load the library and declare its functions; LibraryNotFoundError lists the paths tried."""
    chosen, path = os.environ.get("SYMSDE_LIBRARY"), found()
    if path is None and chosen:
        raise LibraryNotFoundError(
            f"SYMSDE_LIBRARY = {chosen!r} is not a file: give the path of libsymsde.so (./bootstrap build makes one), "
            "or unset it"
        )
    if path is None and (levels := cpu.alone(package())):
        raise LibraryNotFoundError(
            f"this package was compiled for processors of the level {', '.join(levels)}, and {_asked()}: "
            "install it again on this machine, or for every level by pip install . -C cmake.define.SYMSDE_VARIANTS=ON"
        )
    if path is None:
        places = ", ".join(str(path) for path in candidates())
        raise LibraryNotFoundError(
            f"the compiled library of symsde is not at {places}: build it with ./bootstrap build, "
            "or set SYMSDE_LIBRARY to the path of libsymsde.so"
        )
    try:
        library = ctypes.CDLL(str(path))
    except OSError as error:
        raise LibraryNotFoundError(
            f"{path} cannot be loaded ({error}): build it again on this machine with ./bootstrap build"
        ) from error
    try:
        abi.declare(library)
    except AttributeError as error:
        raise LibraryNotFoundError(
            f"{path} is of another version than this package ({error}): build it again by ./bootstrap build"
            f"{', or unset SYMSDE_LIBRARY' if chosen else ''}"
        ) from error
    return library


def _asked() -> str:
    """Describe which level was wanted, and by which setting."""
    chosen = os.environ.get("SYMSDE_CPU")
    return f"SYMSDE_CPU asks for {chosen}" if chosen else f"this one has the level {cpu.levels()[0]} at most"


def _is_command() -> bool:
    """Whether this package is imported for its command: `symsde VERB`, or python -m symsde (argv[0] is then -m)."""
    return bool(sys.argv) and (sys.argv[0] == "-m" or Path(sys.argv[0]).name == "symsde")


def _affinity() -> set[int]:
    """Numbers of the processors that the operating system allows this thread."""
    return os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else set(range(os.cpu_count() or 1))


def processors() -> set[int]:
    """Numbers of the processors that this process may use. With OMP_PROC_BIND or OMP_PLACES OpenMP binds the
    thread that loads it to one processor, which threads of Python started later would share."""
    now = _affinity()
    return _before if now == _bound else now


def unbind() -> None:
    """Let the calling thread use all processors()."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, processors())


_before = _affinity()
try:
    library = load()
except SymsdeError as error:
    if not _is_command():
        raise
    print(f"symsde: {error}", file=sys.stderr)  # the command exits as for other bad input
    sys.exit(2)
_bound = _affinity()
