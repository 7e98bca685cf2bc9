# SPDX-License-Identifier: BSD-3-Clause
"""Where symplectic schemes pay: the cost of a path that keeps a tolerance, as the horizon grows, beside two plain
rules. The two are Heun's rule and Taylor's rule of order 1.5.
"""

from __future__ import annotations

import functools
import math
import time
from pathlib import Path

import numpy as np
from plain_rules import RULES, Plain
from symsde.answers.advice.ladder import Ladder
from symsde.answers.advice.wants import Invariants, Moments, Paths, Seen
from symsde.answers.expectation.candidates import fewest_steps
from symsde.answers.expectation.problem import make_problem
from symsde.models import kubo, synchrotron
from symsde.run.simulate import Run
from symsde.schemes import as_scheme
from symsde.show import look

SCHEMES = ("midpoint", "stormer_verlet", "gauss_dkdkd", "chin4a", "heun", "taylor15")
ON_KUBO = ("midpoint", "stormer_verlet", "gauss2", "heun", "taylor15")  #: schemes for noise that depends on p, too
HORIZONS = (1.0, 10.0, 100.0, 1000.0)
KUBO = (1.0, 0.3)  #: a and sigma of the scene
SIGMA = (0.02, 0.01)  #: noise so weak that the energy stays of one size up to the last horizon


class Energy(Moments):
    """Error of the mean energy."""

    name = "energy"
    words = "error of E H at the horizon"
    count = 1024

    def _observed(self, run: Run) -> np.ndarray:
        return self.problem.model.value(run.q[-1], run.p[-1])[np.newaxis]


class Circle(Paths):
    """Distance from the circle on which the invariant law of Kubo's oscillator is uniform."""

    name = "circle"
    words = "root mean square distance from the circle of the invariant law, at the horizon"
    count = 256

    def see(self, scheme, steps: int) -> Seen:
        """The distance from the circle, which is 0 for exact paths."""
        run = self.problem.run(scheme, steps, paths=self.count)
        size = math.sqrt(np.mean((np.hypot(run.q[-1], run.p[-1]) - 1) ** 2))
        return Seen(size, 0.0, size)


#: kind of error, tolerance, and label: amplitudes are 1, H begins at -2.2
WANTS = (
    (Paths, 0.1, "paths to 0.1"),
    (Energy, 0.01, "E H to 0.01"),
    (Invariants, 0.01, "H without noise to 1 %"),
    (Circle, 0.01, "invariant law to 0.01 (Kubo)"),
)


def compute() -> dict:
    """Steps and microseconds of a path for every tolerance, horizon and scheme; null if no affordable step keeps it."""
    rows = [
        {"want": words, "horizon": horizon, "scheme": name, **cost(kind, tolerance, horizon, name)}
        for kind, tolerance, words in WANTS
        for horizon in HORIZONS
        for name in (ON_KUBO if kind is Circle else SCHEMES)
    ]
    dearer = {"synchrotron": _dearer(False), "kubo": _dearer(True)}
    return {"model": repr(synchrotron(2.0, *SIGMA)), "taylor15 over heun": dearer, "rows": rows}


def cost(kind: type, tolerance: float, horizon: float, name: str) -> dict:
    """Steps and microseconds of a path by a scheme. Conservation of H is measured on a model with noises of strength
    zero, since schemes that use functionals cannot be given zero increments; all times are those of the noisy model.
    The time of Taylor's rule is that of Heun's rule in the library times the ratio of both in NumPy, at as many
    steps."""
    parameters = KUBO if kind is Circle else (2.0, *SIGMA)
    still = (parameters[0], *(0.0 for _ in parameters[1:]))
    noisy, quiet = (_problem(kind, values, horizon) for values in (parameters, still))
    problem = quiet if kind is Invariants else noisy
    plain = name == "taylor15"
    asked = Plain(problem, still if kind is Invariants else parameters) if plain else problem
    scheme, fewest = name if plain else as_scheme(name), fewest_steps(problem)
    ladder = Ladder(asked, scheme, kind(problem), fewest=fewest, tolerance=tolerance)
    ladder.want.problem = asked
    while ladder.climbing:
        ladder.climb(math.inf)
    if ladder.needed is None:
        return {"steps": None, "microseconds": None}
    steps = math.ceil(ladder.needed)
    timed = Ladder(noisy, as_scheme("heun" if plain else name), kind(noisy), fewest=1, tolerance=tolerance)
    seconds = timed.seconds(steps)
    seconds *= _dearer(kind is Circle) if plain else 1.0
    return {"steps": steps, "microseconds": float(f"{1e6 * seconds:.4g}")}


def _problem(kind: type, parameters: tuple[float, ...], horizon: float):
    """Kubo's oscillator or the synchrotron."""
    model = (kubo if kind is Circle else synchrotron)(*parameters)
    return make_problem(model, _nothing, q0=1.0, p0=0.0, horizon=horizon)


@functools.cache
def _dearer(circle: bool) -> float:
    """Time of a step of Taylor's rule over that of Heun's rule, both in NumPy with their draws: least of 25."""
    kind, parameters = (Circle, KUBO) if circle else (Paths, (2.0, *SIGMA))
    plain = Plain(_problem(kind, parameters, 1.0), parameters)
    least = dict.fromkeys(RULES, math.inf)
    for _ in range(25):
        for rule in RULES:
            begin = time.process_time()
            plain.run(rule, 100, paths=1024)
            least[rule] = min(least[rule], time.process_time() - begin)
    return least["taylor15"] / least["heun"]


def save(path: Path, data: dict) -> None:
    """Draw the cost of a path by its horizon, a panel for each tolerance."""
    wants = list(dict.fromkeys(row["want"] for row in data["rows"]))
    with look.drawing(path, 4.8, 5.4, 160) as page:  # labels must be readable on a phone
        panels = page.subplots((len(wants) + 1) // 2, 2, sharex=True, sharey=True)
        for axes, want in zip(panels.flat, wants, strict=True):
            for name in dict.fromkeys((*SCHEMES, *ON_KUBO)):
                points = [
                    (row["horizon"], row["microseconds"])
                    for row in data["rows"]
                    if row["want"] == want and row["scheme"] == name and row["microseconds"] is not None
                ]
                if points:
                    axes.plot(*zip(*points, strict=True), label=name, **look.of_scheme(name))
            axes.set(xscale="log", yscale="log", title=want)
        for axes in panels[-1]:
            axes.set_xlabel("horizon $T$")
        for axes in panels[:, 0]:
            axes.set_ylabel(r"$\mu$s a path")
        named = {}
        for axes in page.axes:
            named |= dict(zip(*reversed(axes.get_legend_handles_labels()), strict=True))
        page.legend(named.values(), named.keys(), loc="outside lower center", ncols=3)


def _nothing(q: np.ndarray, p: np.ndarray) -> np.ndarray:
    """A function without values, since none is needed."""
    return np.zeros(q.shape[1])
