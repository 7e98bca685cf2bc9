# SPDX-License-Identifier: BSD-3-Clause
"""Studies of scenes: the table [study] next to [model] and [run]."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from ...answers.error_plan import OPTIONS, make_plan
from ...batch import scene
from ...errors import NotWrittenError, SceneError, SymsdeError
from . import STEPS, WorkPrecision, work_precision
from .timing import has_columns


def study(file: str | os.PathLike, **given: Any) -> WorkPrecision:
    """Study of a scene; arguments of `work_precision` that are given replace those of [study]."""
    return _named(file, work_precision, given)


def check(file: str | os.PathLike, **given: Any) -> None:
    """Refuse whatever `study` would refuse, without a long run."""
    _named(file, make_plan, {key: value for key, value in given.items() if key not in ("out", "progress")})


def _named(file, function, given: dict):
    """Call with the arguments of a scene; refusals name the scene."""
    chosen = scene.load(file)
    run = chosen.run
    asked = chosen.study | {key: value for key, value in given.items() if value is not None}
    arguments = {"schemes": None, "steps": STEPS, **scene.for_schemes(chosen, "study", OPTIONS, asked.get("horizon"))}
    paths = run.get("paths", 1)
    arguments |= {"paths": paths if has_columns(run["q0"], run["p0"]) else max(1000, paths), "name": Path(file).stem}
    arguments |= {"about": {"scene_text": chosen.text}}
    try:
        return function(chosen.model, **{**arguments, **asked})
    except NotWrittenError:
        raise
    except SymsdeError as error:
        raise SceneError(f"{file}: [study]: {error}") from error


def about(file: str | os.PathLike) -> str:
    """The comment at the beginning of a scene; indented lines keep their line breaks."""
    lines = []
    for line in Path(file).read_text(encoding="utf-8").splitlines():
        if not line.startswith("#"):
            break
        lines.append(line[2:].replace("   ", "    ", 1) if line.startswith("#    ") else line[2:])
    return "\n".join(lines) + "\n"
