# SPDX-License-Identifier: BSD-3-Clause
"""Where symplectic pays: what a path costs that keeps a tolerance, as the horizon grows, beside Heun's rule."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from .. import look
from ..advise.ladder import Ladder
from ..advise.wants import Invariants, Moments, Paths
from ..expect.problem import make_problem
from ..expect.stability import fewest_steps
from ..models import synchrotron
from ..schemes import as_scheme
from ..simulate import Run

SCHEMES = ("midpoint", "stormer_verlet", "gauss_dkdkd", "chin4a", "heun")
HORIZONS = (1.0, 10.0, 100.0, 1000.0)
SIGMA = (0.02, 0.01)  #: so little noise that the energy stays of one size up to the last horizon


class Energy(Moments):
    """Error of the mean energy."""

    name = "energy"
    words = "error of E H at the horizon"
    count = 1024

    def _observed(self, run: Run) -> np.ndarray:
        return self.problem.model.value(run.q[-1], run.p[-1])[np.newaxis]


#: what is kept, and the tolerance: amplitudes are 1, H begins at -2.2
WANTS = ((Paths, 0.1, "paths to 0.1"), (Energy, 0.01, "E H to 0.01"), (Invariants, 0.01, "H without noise to 1 %"))


def compute() -> dict:
    """Steps and microseconds of a path for every want, horizon and scheme; null where no affordable step keeps it."""
    rows = [
        {"want": words, "horizon": horizon, "scheme": name, **cost(kind, tolerance, horizon, name)}
        for kind, tolerance, words in WANTS
        for horizon in HORIZONS
        for name in SCHEMES
    ]
    return {"model": repr(synchrotron(2.0, *SIGMA)), "rows": rows}


def cost(kind: type, tolerance: float, horizon: float, name: str) -> dict:
    """Steps and microseconds of a path by a scheme. H is kept by a model whose noises have strength zero, as schemes
    that take more of the path than increments cannot be given these; all times are those of the noisy model."""
    noisy, quiet = (
        make_problem(synchrotron(2.0, *sigma), _nothing, q0=1.0, p0=0.0, horizon=horizon)
        for sigma in (SIGMA, (0.0, 0.0))
    )
    problem = quiet if kind is Invariants else noisy
    ladder = Ladder(problem, as_scheme(name), kind(problem), fewest=fewest_steps(problem))
    steps = ladder.climb(tolerance, math.inf)
    if steps is None:
        return {"steps": None, "microseconds": None}
    timed = Ladder(noisy, as_scheme(name), kind(noisy), fewest=1)
    return {"steps": math.ceil(steps), "microseconds": float(f"{1e6 * timed.seconds(math.ceil(steps)):.4g}")}


def save(path: Path, data: dict) -> None:
    """Draw the cost of a path by its horizon, a panel for each want."""
    wants = list(dict.fromkeys(row["want"] for row in data["rows"]))
    with look.drawing(path, 9.0, 3.2, 130) as page:
        for axes, want in zip(page.subplots(1, len(wants), sharey=True), wants, strict=True):
            for name in SCHEMES:
                points = [
                    (row["horizon"], row["microseconds"])
                    for row in data["rows"]
                    if row["want"] == want and row["scheme"] == name and row["microseconds"] is not None
                ]
                if points:
                    axes.plot(*zip(*points, strict=True), label=name, **look.of_scheme(name))
            axes.set(xscale="log", yscale="log", xlabel="horizon $T$", title=want)
        page.axes[0].set_ylabel(r"$\mu$s a path")
        page.axes[0].legend()


def _nothing(q: np.ndarray, p: np.ndarray) -> np.ndarray:
    """No function is asked for."""
    return np.zeros(q.shape[1])
