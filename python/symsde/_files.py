# SPDX-License-Identifier: BSD-3-Clause
"""Results as xarray datasets and as files; a file appears whole or not at all."""

from __future__ import annotations

import importlib
import json
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from types import ModuleType

import numpy as np

from .errors import InvalidArgumentError, MissingPackageError

Variables = Mapping[str, tuple[tuple[str, ...], np.ndarray]]


def optional(package: str, extra: str) -> ModuleType:
    """An optional package, or a sentence that says how to install it."""
    try:
        return importlib.import_module(package)
    except ImportError:
        raise MissingPackageError(
            f"{package} is not installed: pip install 'symsde[{extra}]', or save as .npz"
            if extra == "xarray"
            else f"{package} is not installed: pip install 'symsde[{extra}]'"
        ) from None


def dataset(variables: Variables, coordinates: Variables, attributes: Mapping[str, str]):
    """An xarray dataset; time is a plain number, not a date."""
    xarray = optional("xarray", "xarray")
    result = xarray.Dataset(dict(variables), coords=dict(coordinates), attrs=dict(attributes))
    result["time"].attrs.update(units="1", long_name="time")
    return result


def write(path: str | os.PathLike, make_dataset: Callable, variables: Variables, attributes: Mapping) -> None:
    """Write .nc (xarray and netCDF4) or .npz (NumPy alone)."""
    target = Path(path)
    if target.suffix == ".nc":
        optional("netCDF4", "xarray")
        content = make_dataset()
        replace(target, lambda file: content.to_netcdf(file, engine="netcdf4"))
    elif target.suffix == ".npz":
        arrays = {name: array for name, (_, array) in variables.items()}
        text = np.array(json.dumps(dict(attributes)))
        replace(target, lambda file: np.savez(file, **arrays, attributes=text))
    else:
        raise InvalidArgumentError(f"{str(path)!r} has no known ending: give a name that ends in .nc or .npz")


def replace(target: Path, write_to: Callable[[Path], object]) -> None:
    """Write beside the target, then put it in its place."""
    part = target.with_name(f".{target.stem}.{os.getpid()}{target.suffix}")
    try:
        write_to(part)
        os.replace(part, target)
    finally:
        part.unlink(missing_ok=True)
