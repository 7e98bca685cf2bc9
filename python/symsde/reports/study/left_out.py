# SPDX-License-Identifier: BSD-3-Clause
"""What a scene does not need is not computed: counters of a path-step, from the report of a run."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...batch import scene
from ...run.moments import moments
from .timing import has_columns

PATHS, STEPS = 256, 32  #: of the counted runs
COUNTERS = ("normals", "gradients", "hessians", "hessian_vectors", "iterations", "solves", "lapack_solves")

HEAD = ("scene", "scheme", "stepper", "normals", "gradients", "Hessians", "HVP", "iterations", "solves", "LAPACK",
        "left out")  # fmt: skip


@dataclass(frozen=True)
class LeftOut:
    """Counts of a path-step of one scene by its own scheme."""

    scene: str
    scheme: str
    stepper: str
    left_out: tuple[str, ...]
    counts: dict[str, float]  #: of a path-step
    bytes_kept: int  #: results of a moments run, independent of the number of paths

    def cells(self) -> list[str]:
        """As they stand in the table."""
        counts = [f"{self.counts[name]:.4g}" for name in COUNTERS]
        return [self.scene, self.scheme, self.stepper, *counts, "; ".join(self.left_out) or "nothing"]


def left_out(file: str | os.PathLike) -> LeftOut:
    """Run a scene for 32 steps of 256 paths, keeping moments only, and read its counters."""
    chosen = scene.load(file)
    run = {**chosen.run, "paths": PATHS, "steps": STEPS, "save_every": STEPS, "threads": 1}
    run.pop("first_path", None)
    run |= {
        key: np.asarray(run[key])[:, :1] for key in ("q0", "p0") if has_columns(run[key])
    }  # the first path's for all
    found = moments(chosen.model, **run)
    report = found.report
    counts = {name: report.counters[name] / report.counters["path_steps"] for name in COUNTERS}
    kept = sum(array.nbytes for array in (found.t, found.n_ok, *found.to_arrays(), found.to_arrays()[1]))
    scheme = found.setup.scheme.name
    return LeftOut(Path(file).stem, scheme, report.stepper, report.left_out, counts, kept)
