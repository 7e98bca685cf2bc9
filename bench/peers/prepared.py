# SPDX-License-Identifier: BSD-3-Clause
"""The run that a package prepares for one task."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any


@dataclass
class Prepared:
    """A run that can be repeated."""

    run: Callable[[], Any]  #: gives (2 dof, path), q above p, of the first paths; None where `error` is told instead
    paths: int
    error: float | None = None  #: error beside the package's own finest run, if it draws its own paths
    seconds: float | None = None  #: seconds of a path, if it was timed by other means
