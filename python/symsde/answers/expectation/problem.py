# SPDX-License-Identifier: BSD-3-Clause
"""What an expectation is asked of: a model, where it begins, when it ends, and a function of where it is then."""

from __future__ import annotations

import dataclasses
import math
import time
import warnings
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...errors import OF_RUNS, InvalidArgumentError
from ...model.definition import Model, require_model
from ...native import checks
from ...run.moments import try_out
from ...run.report import Report
from ...run.setup import EndOptions, Lent
from ...run.simulate import Run, simulate
from ...run.step import increments
from ...schemes import Scheme
from .target import Function, Target, require_numbers

OPTIONS = tuple(EndOptions.__annotations__)  #: of `simulate`
_DECIDED = dict.fromkeys(("step", "steps", "paths", "save_every"), "it is found for the tolerance")
_GONE = 1e100  #: states beyond this have left, whatever f makes of them
_WORTH = 3e-3  #: seconds of a call, below which threads that wait for each other cost more than they give
_NUMBERS = 2**17  #: of the saved states of one call of `simulate`: what a cache holds
_DRAWN = 2**20  #: numbers of the increments that are held at a time


@dataclass(frozen=True)
class Problem:
    """A checked question; paths of it are computed by `run`, and f on them by `values`."""

    model: Model
    target: Target
    q0: np.ndarray  #: (dof, 1)
    p0: np.ndarray
    horizon: float
    seed: int
    options: dict[str, Any] = field(default_factory=dict)  #: of `simulate`
    known: dict[str, float] = field(default_factory=dict)  #: of the motion, whatever seed and threads: found once

    @property
    def chunk(self) -> int:
        """Number of paths that one call of `simulate` computes: their states fit into a cache."""
        return max(256, _NUMBERS // (4 * self.model.ndof) // 256 * 256)

    def chunk_of(self, steps: int) -> int:
        """The same if the increments of all steps of these paths are held in memory."""
        return max(8, min(self.chunk, _DRAWN // (steps * max(1, self.model.nnoise))))

    def increments(self, scheme: Scheme, steps: int, first: int, count: int) -> np.ndarray:
        """The increments dW (step, noise, path) that drive `count` paths from the index `first` on."""
        return increments(
            self.model, step=self.horizon / steps, steps=steps, paths=count, first_path=first, seed=self.seed,
            truncation=self.options.get("truncation"), scheme=scheme,
        )  # fmt: skip

    def run(self, scheme: str | Scheme, steps: int, **more: Any) -> Run:
        """Compute paths to the horizon and keep their last state. `more` are arguments of `simulate`, such as paths."""
        options = {"save_every": steps, "seed": self.seed, **self.options, **more}
        work, unit = steps * more.get("paths", 1), f"seconds of a step of {getattr(scheme, 'name', scheme)}"
        if self.options.get("threads") is None and work * self.known.get(unit, 0.0) < _WORTH:
            options["threads"] = 1
        if "increments" in more:
            options["increments"] = more["increments"].view(Lent)
        step = self.horizon / steps
        begin = time.process_time()
        with warnings.catch_warnings():
            for said in OF_RUNS:  # counted, and judged by who asked
                warnings.simplefilter("ignore", said)
            found = simulate(self.model, q0=self.q0, p0=self.p0, scheme=scheme, step=step, steps=steps, **options)
        if options.get("threads") == 1:
            self.known[unit] = min(self.known.get(unit, math.inf), (time.process_time() - begin) / work)
        return found

    def on_one_thread(self) -> Problem:
        """The same question on one thread: for short runs it does not pay to wake threads, and times are steadier."""
        return dataclasses.replace(self, options={**self.options, "threads": 1})

    def try_out(self, scheme: str | Scheme) -> Report:
        """Set up a run of no step and return its report; a scheme or option that does not fit raises a SymsdeError."""
        options = {key: value for key, value in self.options.items() if key != "threads"}
        return simulate(self.model, q0=self.q0, p0=self.p0, scheme=scheme, step=self.horizon, steps=0, **options).report

    def values(self, run: Run) -> tuple[np.ndarray, np.ndarray]:
        """f at the end of every path (path,), and which paths are ok (path,): did not fail, nor leave beyond 1e100."""
        ok = run.status == 0
        for state in (run.q[-1], run.p[-1]):
            ok &= (np.abs(state) < _GONE).all(axis=0)
        with np.errstate(all="ignore"):  # of paths that failed; the others are looked at
            values = self.target(run.q[-1], run.p[-1])
        require_numbers(self.target, values, ok, run)
        return values, ok


def make_problem(
    model: Model, f: Function | str, *, q0: Any, p0: Any, horizon: float, seed: int = 0, **options: Any
) -> Problem:
    """The problem of these arguments, after all of them were checked; a refusal says in a sentence what to give."""
    require_model(model)
    checks.not_given("a question with a horizon", options, _DECIDED)
    for key in options:
        if key not in OPTIONS:
            raise checks.no_option(key, OPTIONS)
    horizon = checks.finite("horizon", horizon)
    if horizon <= 0:
        raise InvalidArgumentError(f"horizon = {horizon:g} is not allowed: give a time above 0, counted from t0")
    states = {name: checks.state(name, value, model.ndof, 1) for name, value in (("q0", q0), ("p0", p0))}
    for name, state in states.items():
        if not np.isfinite(state).all():
            raise InvalidArgumentError(f"{name} is not finite: give finite numbers")
    seed = checks.integer("seed", seed, checks.UINT64)
    given = {key: checks.fixed(value) for key, value in options.items()}
    t = checks.finite("t0", options.get("t0", 0.0)) + horizon
    problem = Problem(model, Target(f, model, t), states["q0"], states["p0"], horizon, seed, given)
    problem.target.try_at(problem.q0, problem.p0)
    try_out(model, {"f": problem.target}, q0=problem.q0, p0=problem.p0, t0=t, step=horizon / 1024)
    return problem
