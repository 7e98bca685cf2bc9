# SPDX-License-Identifier: BSD-3-Clause
"""The question: a model, an initial state, a horizon, and a function f of the final state, callable or formula."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...errors import IncompatibleError, InvalidArgumentError, WrongShapeError, WrongTypeError
from ...model.definition import Model, require_model
from ...model.formulas.formula_observables import FormulaObservables
from ...native import checks
from ...run.moments import try_out
from ...run.options import EndOptions
from ...run.report import Report
from ...run.setup import make_setup
from ...run.simulate import Run, simulate
from ...run.states.law import States
from ...run.step import increments
from ...schemes import Scheme

Function = Callable[[np.ndarray, np.ndarray], np.ndarray]
_READ_ONLY = "read-only"  #: words of NumPy's message about arrays that must not be changed
_TRIED = 5  #: number of points at which f is tried first; a run hardly ever has this number of paths
OPTIONS = tuple(EndOptions.__annotations__)  #: names of the options that are passed on to `simulate`
_DECIDED = dict.fromkeys(("step", "steps", "paths", "save_every"), "it is found for the tolerance")
_GONE = 1e100  #: paths beyond this size count as failed, whatever value f has there
#: shorter calls (in seconds) run on one thread: waiting for threads would cost more than they gain
_WORTH = 3e-3
_NUMBERS = 2**17  #: numbers of the saved states of one call of `simulate` that fit into a cache
_DRAWN = 2**20  #: most numbers of increments that are held at a time


@dataclass(frozen=True)
class Problem:
    """A checked question: `run` computes its paths, and `values` evaluates f on them."""

    model: Model
    target: Target
    q0: np.ndarray  #: (dof, 1); of states that are drawn, the first
    p0: np.ndarray
    horizon: float
    seed: int
    options: dict[str, Any] = field(default_factory=dict)  #: options of `simulate`
    laws: dict[str, States] = field(default_factory=dict)  #: the laws of q0, p0 that are drawn
    #: facts about the motion that do not depend on seed or threads, computed once
    known: dict[str, float] = field(default_factory=dict)

    @property
    def chunk(self) -> int:
        """Number of paths that one call of `simulate` computes: their states fit into a cache."""
        return max(256, _NUMBERS // (4 * self.model.ndof) // 256 * 256)

    def chunk_of(self, steps: int) -> int:
        """Number of paths of a call of `simulate`, if the increments of all their steps are held in memory too."""
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
        step = self.horizon / steps
        begin = time.process_time()
        found = self._simulate(scheme, step=step, steps=steps, **options)
        if options.get("threads") == 1:
            self.known[unit] = min(self.known.get(unit, math.inf), (time.process_time() - begin) / work)
        return found

    def on_one_thread(self) -> Problem:
        """The same question on one thread: short runs do not gain from threads, and their times are steadier."""
        return dataclasses.replace(self, options={**self.options, "threads": 1})

    def try_out(self, scheme: str | Scheme) -> Report:
        """Set up a run without steps and return its report; a scheme or option that does not fit raises a
        SymsdeError.
        """
        options = {key: value for key, value in self.options.items() if key != "threads"}
        return self._simulate(scheme, step=self.horizon, steps=0, **options).report

    def start(self, scheme: str | Scheme, steps: int, taken: int, **more: Any) -> Run:
        """Compute the first `taken` steps of this many steps to the horizon, on one thread."""
        options = {**self.options, "threads": 1, "seed": self.seed, **more}
        return self._simulate(scheme, step=self.horizon / steps, steps=taken, **options)

    def _simulate(self, scheme: str | Scheme, **options: Any) -> Run:
        """Run `simulate` with these options and without warnings: callers count and judge the failures."""
        with checks.unwarned():
            start = {"q0": self.q0, "p0": self.p0, **self.laws}
            return simulate(self.model, scheme=scheme, **start, **options)

    def values(self, run: Run) -> tuple[np.ndarray, np.ndarray]:
        """f at the end of every path (path,), and which paths are ok (path,): paths that did not fail nor go beyond
        1e100.
        """
        ok = run.status == 0
        for state in (run.q[-1], run.p[-1]):
            ok &= (np.abs(state) < _GONE).all(axis=0)
        with np.errstate(all="ignore"):  # paths that failed may overflow in f; other values are checked below
            values = self.target(run.q[-1], run.p[-1])
        require_numbers(self.target, values, ok, run)
        return values, ok


def make_problem(
    model: Model, f: Function | str, *, q0: Any, p0: Any, horizon: float, seed: int = 0, **options: Any
) -> Problem:
    """Check all arguments and make their problem; a refusal is a sentence that says what to give."""
    require_model(model)
    require_one_value(model)
    checks.not_given("a question with a horizon", options, _DECIDED)
    for key in options:
        if key not in OPTIONS:
            raise checks.no_option(key, OPTIONS)
    horizon = checks.finite("horizon", horizon)
    if horizon <= 0:
        raise InvalidArgumentError(f"horizon = {horizon:g} is not allowed: give a time above 0, counted from t0")
    seed = checks.integer("seed", seed, checks.UINT64)
    laws = {name: x for name, x in (("q0", q0), ("p0", p0)) if isinstance(x, States)}
    begin = {"t0": options.get("t0", 0.0), "step": horizon, "steps": 0}
    first = make_setup(model, q0=q0, p0=p0, seed=seed, **begin).first_state()
    states = dict(zip(("q0", "p0"), first, strict=True))
    for name, state in states.items():
        if not np.isfinite(state).all():
            raise InvalidArgumentError(f"{name} is not finite: give finite numbers")
    given = {key: checks.fixed(value) for key, value in options.items()}
    t = checks.finite("t0", options.get("t0", 0.0)) + horizon
    problem = Problem(model, Target(f, model, t), states["q0"], states["p0"], horizon, seed, given, laws)
    problem.target.try_at(problem.q0, problem.p0)
    tried = {} if model.traits.has_gradient else {"scheme": "gauss_dkdkd"}
    try_out(model, {"f": problem.target}, q0=problem.q0, p0=problem.p0, t0=t, step=horizon / 1024, **tried)
    return problem


def require_one_value(model: Model) -> None:
    """Refuse a model whose parameters have values by path: an answer finds the number of paths itself."""
    names = [name for name, x in model.parameters.items() if isinstance(x, np.ndarray) and x.size > 1]
    if names:
        asked = repr(names[0] if len(names) == 1 else names)
        raise IncompatibleError(
            f"model {model.name} has an array of values of {', '.join(names)}, and an answer is for one: give numbers, "
            f"by model.with_parameters, or groups={asked} to `expect` for an answer to each value"
        )


class Target:
    """f in the form that is called: with q, p of shape (dof, path), it returns (path,) real numbers."""

    def __init__(self, f: Function | str, model: Model, t: float):
        """Take a callable f(q, p), or a formula in the names of observables, at the time t."""
        self._made = f, model, t
        self.is_truth = False  #: whether f returns truth values
        self.name = f if isinstance(f, str) else getattr(f, "__name__", "f")
        self._function = _of_formula(f, model, t) if isinstance(f, str) else f
        if not callable(self._function):
            raise WrongTypeError(
                f"f = {checks.shown(f)} is not allowed: give a function f(q, p) of arrays (dof, path), or a formula "
                "as text, such as 'q**2'"
            )

    def __reduce__(self) -> tuple:
        """Let pickle make the target again from its arguments."""
        return Target, self._made

    def __call__(self, q: np.ndarray, p: np.ndarray) -> np.ndarray:
        """Values of f (path,) at q and p (dof, path); a WrongShapeError says which other shape f returned."""
        values = self._of_states(q, p)
        paths = q.shape[1]
        array = np.asarray(values)
        if array.shape != (paths,):
            raise WrongShapeError(
                f"f returned shape {array.shape} for {paths} paths: q and p have shape {q.shape}, (dof, path), and f "
                f"must return one number a path, shape ({paths},), as in lambda q, p: q[0]**2"
            )
        if array.dtype.kind not in "biuf":
            raise WrongTypeError(f"f returned {array.dtype} values: give real numbers, or truth values")
        self.is_truth = array.dtype.kind == "b"
        return array.astype(np.float64, copy=False)

    def try_at(self, q0: np.ndarray, p0: np.ndarray) -> None:
        """Refuse an f that does not work at the initial state q0, p0 (dof, 1), before any path is computed."""
        self(checks.full(q0, _TRIED), checks.full(p0, _TRIED))

    def _of_states(self, q: np.ndarray, p: np.ndarray) -> Any:
        """The return value of the function, of whatever type. The function may not write to q and p (dof, path)."""
        try:
            return self._function(_not_to_write(q), _not_to_write(p))
        except ValueError as refused:
            if _READ_ONLY not in str(refused):
                raise
            raise InvalidArgumentError(
                f"f = {self.name} changes q or p in place, but these are the states of the run: give an f that makes "
                "arrays of its own, as by q = q.copy()"
            ) from refused


def _not_to_write(state: np.ndarray) -> np.ndarray:
    """A read-only view of the state (dof, path): an f that writes to it raises an error."""
    view = state.view()
    view.flags.writeable = False
    return view


def require_numbers(target: Target, values: np.ndarray, ok: np.ndarray, run) -> None:
    """Refuse values (path,) that are not finite on paths that are ok (path,), and show the state of one of them."""
    bad = ok & ~np.isfinite(values)
    if not bad.any():
        return
    i = int(np.flatnonzero(bad)[0])
    q, p = (np.array2string(x[-1, :, i], precision=6, threshold=6) for x in (run.q, run.p))
    raise InvalidArgumentError(
        f"f = {target.name} is {values[i]} on {int(bad.sum())} of {len(values)} paths, as at q = {q}, p = {p}: "
        "its mean does not exist as a number; give an f that is finite wherever paths go"
    )


def _of_formula(text: str, model: Model, t: float) -> Function:
    """The formula at time t as a function f(q, p) of NumPy arrays, in the names of observables."""
    read = FormulaObservables(model, {"f": text}, compiles=False)
    return lambda q, p: read(t, q, p)[0]
