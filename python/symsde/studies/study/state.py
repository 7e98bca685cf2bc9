# SPDX-License-Identifier: BSD-3-Clause
"""Finished points, kept in a small file so that a study that was stopped can continue."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np

from ...answers.error_plan import Plan
from ...batch import computed
from ...native import checks, files
from ...native.build import build_info

NAME = "state.json"


class State:
    """Finished points of any study, by a key of all their inputs; without a folder they are kept in memory."""

    def __init__(self, directory: Path | None):
        """Read the points that are stored."""
        self._file = None if directory is None else directory / NAME
        self._points: dict[str, dict] = {}
        if self._file is not None and self._file.is_file():
            try:
                known = json.loads(self._file.read_text(encoding="utf-8"))
            except (ValueError, OSError):
                known = None
            known = known if isinstance(known, dict) else {}  # an unreadable file costs time, not a result
            self._points = {key: row for key, row in known.items() if isinstance(row, dict)}

    def get(self, key: str) -> dict | None:
        """The stored point of a key."""
        return self._points.get(key)

    def put(self, key: str, row: dict) -> None:
        """Store a point."""
        self._points[key] = row
        if self._file is not None:
            files.replace_text(self._file, json.dumps(self._points, indent=0))


def point_key(plan: Plan, scheme, steps: int) -> str:
    """A short text that identifies all inputs of a point."""
    q, p = (checks.state("state", x, plan.model.ndof, plan.paths)[:, :1] for x in (plan.q0, plan.p0))
    start = computed.Start(q, p, plan.options.get("t0", 0.0), plan.horizon)
    parts = {
        "computed": computed.of(plan.model, scheme, start, plan.invariants),
        "start": [np.asarray(x, dtype=float).tolist() for x in (plan.q0, plan.p0)],
        "study": [plan.horizon, plan.paths, plan.draws, plan.repeats],
        "options": plan.options,
        "reference": [plan.references[scheme.name].scheme, plan.references[scheme.name].steps],
        "build": build_info(),
    }
    text = json.dumps(parts, sort_keys=True, default=str)
    return f"{plan.name} {scheme.name} {steps} {hashlib.sha256(text.encode()).hexdigest()[:16]}"
