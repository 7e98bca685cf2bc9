# SPDX-License-Identifier: BSD-3-Clause
"""A run that a package has prepared for one task."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any


@dataclass
class Prepared:
    """A run that can be repeated."""

    run: Callable[[], Any]  #: gives (2 dof, path), q before p, of the first paths; None if `error` is given instead
    paths: int
    error: float | None = None  #: error against the package's own finest run, if it draws its own paths
    seconds: float | None = None  #: seconds of a path, if measured in another way
