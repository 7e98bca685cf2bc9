# SPDX-License-Identifier: BSD-3-Clause
"""Laws of initial states by name, as scenes give them."""

from __future__ import annotations

import inspect
from pathlib import Path
from typing import Any

from ...errors import InvalidArgumentError
from ...native import checks
from .affine import normal, uniform
from .beam import canonical, matched
from .formula import formula
from .law import States
from .table import table

LAWS = {x.__name__: x for x in (normal, uniform, matched, canonical, formula, table)}


def tables_of(run: dict[str, Any]) -> list[dict[str, Any]]:
    """The laws of a table [run] that name a file."""
    found = [run.get(key) for key in ("initial", "q0", "p0")]
    return [x for x in found if isinstance(x, dict) and x.get("law") == "table" and isinstance(x.get("rows"), str)]


def from_table(given: dict[str, Any], folder: Path) -> States:
    """The law of a table {law = "normal", ..}; files are beside the scene."""
    known = ", ".join(LAWS)
    if not isinstance(given.get("law"), str):
        raise InvalidArgumentError(
            f"{checks.shown(given)} lacks law, the name of a law of initial states: there are {known}"
        )
    make = LAWS[list(LAWS)[checks.choice("law", given["law"], list(LAWS))]]
    rest = {key: x for key, x in given.items() if key != "law"}
    arguments = inspect.signature(make).parameters
    for key in rest:
        if key not in arguments:
            raise InvalidArgumentError(f"{key!r} is no key of law = {given['law']!r}: there are "
                                       f"{checks.nearest(key, arguments)}")  # fmt: skip
    for key, x in arguments.items():
        if x.default is inspect.Parameter.empty and key not in rest:
            raise InvalidArgumentError(f"law = {given['law']!r} lacks {key}")
    if make is formula and isinstance(rest["variables"], dict):
        rest["variables"] = {
            name: from_table(x, folder) if isinstance(x, dict) else x for name, x in rest["variables"].items()
        }
    if make is table and isinstance(rest["rows"], str):
        rest["rows"] = folder / rest["rows"]
    return make(**rest)
