# SPDX-License-Identifier: BSD-3-Clause
"""Find and load libsymsde, once."""

from __future__ import annotations

import ctypes
import os
import sys
from pathlib import Path

from . import _abi, _cpu
from .errors import LibraryNotFoundError

_NAME = "libsymsde.dylib" if sys.platform == "darwin" else "libsymsde.so"


def package() -> Path:
    """The folder of this package."""
    return Path(__file__).resolve().parent


def candidates() -> list[Path]:
    """Where the library is looked for: SYMSDE_LIBRARY alone if set, the package's variants, the build tree."""
    chosen = os.environ.get("SYMSDE_LIBRARY")
    if chosen:
        return [Path(chosen)]
    here = package()
    places = [folder / _NAME for folder in _cpu.folders(here)]
    return places if os.environ.get("SYMSDE_CPU") else [*places, here.parents[1] / "build" / "native" / _NAME]


def found() -> Path | None:
    """The first of the candidates that is there."""
    return next((path for path in candidates() if path.is_file()), None)


def load() -> ctypes.CDLL:
    """Load the library and declare its functions; LibraryNotFoundError says where it was looked for."""
    path = found()
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
        _abi.declare(library)
    except AttributeError as error:
        raise LibraryNotFoundError(
            f"{path} is of another version than this package ({error}): build it again"
        ) from error
    return library


library = load()
