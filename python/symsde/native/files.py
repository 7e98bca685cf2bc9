# SPDX-License-Identifier: BSD-3-Clause
"""Results as xarray datasets and as files; files appear completely or not at all, folders are tested before any
work.
"""

from __future__ import annotations

import contextlib
import errno
import importlib
import json
import os
import stat
import tempfile
import threading
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from ..errors import InvalidArgumentError, MissingPackageError, NotWrittenError
from . import checks, parts

Variables = Mapping[str, tuple[tuple[str, ...], np.ndarray]]
NETCDF = threading.RLock()  #: the library of HDF5 crashes if two threads use it at once, whatever their files


def optional(package: str, extra: str) -> ModuleType:
    """Import an optional package, or raise an error that says how to install it."""
    try:
        return importlib.import_module(package)
    except ImportError:
        otherwise = ", or save as .npz" if extra == "xarray" else ""
        raise MissingPackageError(f"{package} is not installed: {_how_to_get(extra)}{otherwise}") from None


def _how_to_get(extra: str) -> str:
    """The command that installs an extra; in a source tree from the tree, since package indexes do not have it."""
    tree = Path(__file__).parents[3]
    if (tree / "pyproject.toml").exists():
        return f"pip install '.[{extra}]' in {tree}"
    return f"pip install 'symsde[{extra}]'"


def axes(t: np.ndarray, ndof: int) -> dict[str, tuple[tuple[str, ...], np.ndarray]]:
    """Coordinates of results: the dimension time, the same values as t (the name used elsewhere), and dof from 1 on."""
    return {"time": (("time",), t), "t": (("time",), t), "dof": (("dof",), np.arange(1, ndof + 1))}


def dataset(variables: Variables, coordinates: Variables, attributes: Mapping[str, str]):
    """An xarray dataset; time, if there is one, is a plain number, not a date, and t selects as time does."""
    xarray = optional("xarray", "xarray")
    result = xarray.Dataset(dict(variables), coords=dict(coordinates), attrs=dict(attributes))
    if "t" in coordinates:
        result = result.set_xindex("t")
    for name, variable in result.variables.items():
        variable.attrs["long_name"] = long_name(str(name))
        if variable.dtype.kind in "fiu":
            variable.attrs["units"] = "1"
    return result


_LONG_NAMES = {
    "q": "coordinates",
    "p": "momenta",
    "t": "time",
    "dof": "degree of freedom",
    "path": "global index of the path",
    "status": "status of the path, 0 = ok",
    "failed_step": "absolute step that failed, -1 = none",
    "n_ok": "paths that count",
    "last_q": "coordinates of the last good state",
    "last_p": "momenta of the last good state",
    "q_low": "low parts of the last coordinates, of compensated sums",
    "p_low": "low parts of the last momenta, of compensated sums",
    "m2": "sums of squared deviations of all values, in the order of columns",
    "failed": "global indices of failed paths, at most 1000",
    "failed_status": "status of these paths",
}
_KINDS = {
    "mean": "mean of",
    "var": "variance of",
    "se_mean": "standard error of the mean of",
    "se": "standard error of",
}


def long_name(name: str) -> str:
    """The description of a variable for a file."""
    for kind in sorted(_KINDS, key=len, reverse=True):
        if name.startswith(f"{kind}_"):
            rest = name.removeprefix(f"{kind}_")
            return f"{_KINDS[kind]} {_LONG_NAMES.get(rest, rest)}"
    return _LONG_NAMES.get(name, name.replace("_", " "))


def path_of(name: str, value: object) -> Path:
    """A path from a text or a path object."""
    if not isinstance(value, str | os.PathLike) or isinstance(os.fspath(value), bytes):
        raise InvalidArgumentError(
            f"{name} = {checks.shown(value)} is no path: give the name of a file or folder as a string"
        )
    try:
        if b"\0" in os.fsencode(value):
            raise ValueError
    except ValueError:
        shown = checks.shown(value)
        raise InvalidArgumentError(f"{name} = {shown} holds characters that no name of a file can have") from None
    return Path(value)


_NO_FILES = {stat.S_IFIFO: "a pipe", stat.S_IFCHR: "a device", stat.S_IFBLK: "a device", stat.S_IFSOCK: "a socket"}


def require_file(path: str | os.PathLike) -> None:
    """Refuse, with an OSError, a path that is no regular file before opening it: reading might never end."""
    kind = _NO_FILES.get(stat.S_IFMT(os.stat(path).st_mode))
    if kind is not None:
        raise OSError(errno.EINVAL, f"it is {kind}, give a file", str(path))


def content(path: Path) -> bytes:
    """The content of a regular file in bytes."""
    require_file(path)
    return path.read_bytes()


def write(target: Path, make_dataset: Callable, variables: Variables, attributes: Mapping, also: str = "") -> None:
    """Write .nc (xarray and netCDF4) or .npz (NumPy alone); `also`: endings that the caller writes."""
    if target.suffix == ".nc":
        optional("netCDF4", "xarray")
        content = make_dataset()
        with NETCDF:
            replace(target, lambda file: content.to_netcdf(file, engine="netcdf4"))
    elif target.suffix == ".npz":
        arrays = {name: array for name, (_, array) in variables.items()}
        text = np.array(json.dumps(dict(attributes)))
        replace(target, lambda file: np.savez(file, **arrays, attributes=text))
    else:
        raise InvalidArgumentError(f"{str(target)!r} has no known ending: give a name that ends in {also}.nc or .npz")


def replace(target: Path, write_to: Callable[[Path], object]) -> None:
    """Write to a temporary file, then rename it to the target; NotWrittenError gives the reason of a failure."""
    parts.sweep(target.parent)
    _place(target, write_to, os.replace)


def replace_text(target: Path, text: str) -> None:
    """Write a text file, completely or not at all."""
    replace(target, lambda part: part.write_text(text, encoding="utf-8"))


def write_durably(target: Path, content: bytes, *, keep: bool = True, mode: int | None = None) -> bool:
    """Write a file that exists completely, even after a crash of the machine, or not at all; False if another file was
    there first.

    keep: an existing file is not replaced, so that two writers do not overwrite each other. mode: permissions of the
    file, by default those of the process.
    """

    def put(part: Path) -> None:
        with part.open("wb") as file:
            file.write(content)
            file.flush()
            if mode is not None:
                os.fchmod(file.fileno(), mode)
            os.fsync(file.fileno())

    placed = _place(target, put, _link if keep else os.replace)
    with contextlib.suppress(OSError):  # some file systems cannot sync folders, which makes names durable
        handle = os.open(target.parent, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
    return placed is not False


def _place(target: Path, write_to: Callable[[Path], object], place: Callable[[Path, Path], Any]) -> Any:
    """Write a part beside the target and let `place` give it its name."""
    try:
        with parts.beside(target) as part:
            write_to(part)
            return place(part, target)
    except (OSError, RuntimeError) as error:  # netCDF4 raises a RuntimeError if the disk is full
        raise NotWrittenError(f"{target} cannot be written: {_reason(error)}") from error


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


@contextlib.contextmanager
def folder(path: str | os.PathLike) -> Iterator[Path]:
    """A folder for results, created if missing and tested for writing before the work; a new folder that stays empty
    is removed."""
    target = path_of("the folder of the results", path)
    made = [part for part in (target, *target.parents) if not os.path.exists(part)]  # impossible paths are no files
    try:
        try:
            target.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=target):
                pass
        except OSError as error:
            what = "it is a file, not a folder" if os.path.isfile(target) else _reason(error)
            raise NotWrittenError(
                f"nothing can be written to {target}: {what}: give another folder, or make room"
            ) from error
        yield target
    finally:
        for part in made:
            with contextlib.suppress(OSError):  # the folder is not empty
                part.rmdir()


def _reason(error: Exception) -> str:
    """The system's message, without its number and the names of temporary files."""
    return getattr(error, "strerror", None) or str(error)


def json_text(data: object, digits: int | None = 7, indent: int | None = None) -> str:
    """Data as JSON: arrays as lists, numbers with seven digits or all (None), infinity and NaN as null."""
    separators = (", ", ": ") if indent is None else None
    return json.dumps(_plain(data, digits), indent=indent, allow_nan=False, separators=separators) + "\n"


def _plain(value, digits: int | None):
    if isinstance(value, dict):
        return {str(key): _plain(item, digits) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist(), digits)
    if isinstance(value, list | tuple):
        return [_plain(item, digits) for item in value]
    if isinstance(value, float):
        rounded = value if digits is None else float(f"{value:.{digits}g}")
        return rounded if np.isfinite(value) else None
    return value
