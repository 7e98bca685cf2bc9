# SPDX-License-Identifier: BSD-3-Clause
"""Python functions that scenes name as module:function; they are called only if the user allows it."""

from __future__ import annotations

import contextlib
import contextvars
import importlib
import modulefinder
import os
import sys
import traceback
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InvalidArgumentError, SceneError
from ..native import checks, library

#: whether scenes may name Python functions; set by --allow-python of the command line
ALLOWED: contextvars.ContextVar[bool] = contextvars.ContextVar("ALLOWED", default=False)


def function_of(folder: Path, text: object) -> Callable:
    """Import module:function, from the folder of the scene if the module is there."""
    parts = text.replace(":", ".").split(".") if isinstance(text, str) and text.count(":") == 1 else [""]
    if not all(part.isidentifier() for part in parts):
        raise InvalidArgumentError(f"python = {checks.shown(text)}: write module:function, a text")
    module, _, function = text.partition(":")
    if not ALLOWED.get():
        raise InvalidArgumentError(
            f"python = {text!r} would execute code: say --allow-python if you trust this scene (in Python "
            "symsde.batch.scene.PYTHON_ALLOWED.set(True))"
        )
    try:
        found = getattr(_imported(folder.resolve(), module), function, None)
    except InvalidArgumentError:
        raise
    except (Exception, SystemExit) as error:  # the file may raise any exception
        raise InvalidArgumentError(f"python = {text!r} cannot be loaded: {told(error)}") from error
    if not callable(found):
        what = f"{module} has no function of this name" if found is None else f"this is {checks.shown(found)}"
        raise InvalidArgumentError(f"python = {text!r} is no function ({what}): write module:function")
    return found


def _imported(folder: Path, module: str) -> Any:
    """Import the module; the file beside the scene has priority over a module of the same name elsewhere."""
    beside = files_of(folder, module)
    sys.path.insert(0, str(folder))
    try:
        importlib.invalidate_caches()
        found = importlib.import_module(module)
    finally:
        with contextlib.suppress(ValueError):  # the module may have changed sys.path
            sys.path.remove(str(folder))
    for name, path in beside.items():
        if (here := sys.modules.get(name)) is None:
            continue
        there = getattr(here, "__file__", None)
        if there is None or Path(there).read_bytes() != path.read_bytes():
            raise InvalidArgumentError(
                f"{path} differs from the {name} that is here already ({there or 'a part of Python'}): give it another "
                "name"
            )
    return found


def files_of(folder: Path, module: str) -> dict[str, Path]:
    """Files of a module in the scene's folder and of its imports from there; empty for a module from elsewhere."""
    folder = folder.absolute()
    path = folder.joinpath(*module.split(".")).with_suffix(".py")
    if not path.is_file():
        return {}
    finder = modulefinder.ModuleFinder(path=[str(folder)])
    with contextlib.suppress(ImportError, SyntaxError, ValueError):  # the import itself reports this error
        finder.import_hook(module)
    return {module: path} | {name: Path(x.__file__) for name, x in finder.modules.items() if x.__file__}


def sources(folder: Path, tables: Mapping[str, Any]) -> Iterator[tuple[str, Path]]:
    """Files beside a scene with functions named in it, and the files they import, with paths relative to the scene's
    folder."""
    observables = tables.get("observables", {})
    named = [tables["model"].get("python"), *(x.get("python") for x in observables.values() if isinstance(x, dict))]
    modules = dict.fromkeys(str(text).partition(":")[0] for text in named if text)
    files = {path: None for module in modules for path in files_of(folder, module).values()}
    for path in files:
        yield path.relative_to(folder.absolute()).as_posix(), path


class NamedObservable:
    """An observable that a scene names; if it raises, the message is a sentence."""

    def __init__(self, folder: str, text: str):
        """Load the function."""
        self._given = (folder, text)
        self._function = function_of(Path(folder), text)
        self.__module__, self.__qualname__ = text.split(":")

    def __call__(self, q: np.ndarray, p: np.ndarray) -> np.ndarray:
        """Evaluate the function on states (dof, lane)."""
        try:
            return self._function(q, p)
        except Exception as error:
            raise SceneError(f"python = {self._given[1]!r} failed: {told(error)}") from error

    def __reduce__(self):
        """Pickle as folder and text: the other process loads the function again, with the permission of this
        process."""
        return _again, self._given


def _again(folder: str, text: str) -> NamedObservable:
    """Load the function again in another process."""
    allowed = ALLOWED.set(True)
    try:
        return NamedObservable(folder, text)
    finally:
        ALLOWED.reset(allowed)


def told(error: BaseException) -> str:
    """Describe an exception of a user's code, with the line that raised it."""
    ours = (str(library.package()), os.path.dirname(importlib.__file__), "<frozen")
    frames = traceback.extract_tb(error.__traceback__)
    own = [x for x in frames if not x.filename.startswith(ours)]
    at = f" ({os.path.basename(own[-1].filename)}, line {own[-1].lineno})" if own else ""
    return f"{type(error).__name__}: {error}{at}"
