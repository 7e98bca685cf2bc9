# SPDX-License-Identifier: BSD-3-Clause
"""What the last bits of a run depend on beyond its inputs: how a product and a sum are rounded, whose LAPACK solves."""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Iterable
from typing import Any

from ..errors import OF_RUNS
from ..model.definition import Model
from ..native.build import build_info
from ..run.simulate import simulate
from ..schemes import Scheme
from .computed import Start

_OF_A_STEP = {"step", "correction", "general", "compensated", "fixed_point"}  # options that steppers are chosen by


def of(model: Model, schemes: Iterable[Scheme], start: Start, **options: Any) -> dict[str, str]:
    """`arithmetic`, and `lapack` where a step of the model by one of the schemes has a system that LAPACK solves.

    options: those of the run, of which those count that steppers are chosen by.
    """
    options = {key: options[key] for key in _OF_A_STEP & options.keys()}
    named = (_lapack_of(model, scheme, start, options) for scheme in schemes)
    lapack = next(filter(None, named), "")
    return {"arithmetic": build_info()["arithmetic"], **({"lapack": lapack} if lapack else {})}


def _lapack_of(model: Model, scheme: Scheme, start: Start, options: dict[str, Any]) -> str:
    """As the report of one step of one path has it. Where this fails the run says why, and names no LAPACK."""
    one = {"q0": start.q[:, 0], "p0": start.p[:, 0], "t0": start.t, "paths": 1, "steps": 1, "threads": 1}
    with contextlib.suppress(Exception), warnings.catch_warnings():
        for said in OF_RUNS:
            warnings.simplefilter("ignore", said)
        return simulate(model, scheme=scheme, **{**options, **one}).report.lapack
    return ""
