# SPDX-License-Identifier: BSD-3-Clause
"""Find what the last bits of a run depend on beyond its inputs: the rounding of products and sums, and LAPACK."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable
from typing import Any

from ..model.definition import Model
from ..native import checks
from ..native.build import build_info
from ..run.simulate import simulate
from ..schemes import Scheme
from .computed import Start

_OF_A_STEP = {"step", "correction", "general", "compensated", "fixed_point"}  # options that steppers are chosen by


def of(model: Model, schemes: Iterable[Scheme], start: Start, **options: Any) -> dict[str, str]:
    """`arithmetic`, and `lapack` if LAPACK solves the systems of a step of the model by one of the schemes.
    options: options of the run; only those that determine the stepper matter.
    """
    options = {key: options[key] for key in _OF_A_STEP & options.keys()}
    named = (_lapack_of(model, scheme, start, options) for scheme in schemes)
    lapack = next(filter(None, named), "")
    return {"arithmetic": build_info()["arithmetic"], **({"lapack": lapack} if lapack else {})}


def _lapack_of(model: Model, scheme: Scheme, start: Start, options: dict[str, Any]) -> str:
    """The LAPACK in the report of one step of one path. If the step fails, no LAPACK is named: the run reports
    the error."""
    one = {"q0": start.q[:, 0], "p0": start.p[:, 0], "t0": start.t, "paths": 1, "steps": 1, "threads": 1}
    with contextlib.suppress(Exception), checks.unwarned():
        return simulate(model._part(slice(1)), scheme=scheme, **{**options, **one}).report.lapack
    return ""
