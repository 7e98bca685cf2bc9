# SPDX-License-Identifier: BSD-3-Clause
"""What a package gives for a task."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any


@dataclass
class Prepared:
    """A run that can be repeated."""

    run: Callable[[], Any]  #: gives (2 dof, path), q above p, of the first paths; None where `error` is told instead
    paths: int
    error: float | None = None  #: of a package that follows paths of its own, beside its own finest run
    seconds: float | None = None  #: of a path, where it was timed by other means
