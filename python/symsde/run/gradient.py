# SPDX-License-Identifier: BSD-3-Clause
"""Gradients of E f(path) by the exact discrete adjoint of every step."""

from __future__ import annotations

import ctypes
import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Unpack

import numpy as np

from ..errors import IncompatibleError, InvalidArgumentError, PathsFailedWarning, WrongShapeError, WrongTypeError
from ..model.definition import Model, require_model
from ..model.formulas.formula_observables import is_formula
from ..model.formulas.path_formula import PathFormula
from ..model.formulas.wide import Positions, parameter_names, wide_model
from ..native import abi, callbacks, checks, handles
from ..native.checks import address
from ..native.progress import Monitor, Progress
from .options import RunOptions
from .report import Report, make_report, warn_of_growth
from .setup import Setup, make_setup

_NUMBERS = 2**23  #: most numbers of states that a long run holds at once
_UNIT = 256  #: paths of a group are a multiple of this
_STATES = ("q0", "p0")


@dataclasses.dataclass(frozen=True)
class Gradient:
    """The mean of f over paths, and its derivatives.

    `values["k"]` is dE f/dk, a number; `values["q0"]` and `values["p0"]` have the shape (dof,), and a parameter with a
    number for each site has (site,). Standard errors are over paths. Each path has its own derivatives, for its own
    noise: `by_path["k"]` (path,), `by_path["q0"]` (dof, path).
    """

    value: float  #: mean of f
    value_se: float  #: standard error of `value`
    values: dict[str, Any]  #: name -> derivative of the mean
    se: dict[str, Any]  #: name -> its standard error
    by_path: dict[str, np.ndarray]  #: name -> derivatives of each path; NaN where it failed
    f: np.ndarray  #: (path,), f of each path
    status: np.ndarray  #: (path,), 0 = ok
    failed: float  #: share of paths that failed, and are left out of means
    report: Report

    def __repr__(self) -> str:
        """The derivatives with their standard errors."""
        told = ", ".join(
            f"d/d{name} = {self.values[name]:.6g} +- {self.se[name]:.2g}"
            if np.ndim(self.values[name]) == 0
            else f"d/d{name} {np.shape(self.values[name])}"
            for name in self.values
        )
        return f"<gradient of E f = {self.value:.6g} +- {self.value_se:.2g}: {told}>"


@checks.hinted(*RunOptions.__annotations__)
def gradient(
    model: Model,
    f: Any,
    wrt: str | Sequence[str] = _STATES,
    *,
    q0: Any,
    p0: Any,
    step: float,
    steps: int,
    allow_failed: bool = False,
    progress: Progress = False,
    **options: Unpack[RunOptions],
) -> Gradient:
    """The derivatives of E f(path) by parameters and by the initial state, exact for the scheme.

        found = ss.gradient(model, "q**2", ["sigma", "q0"], q0=1.0, p0=0.0, step=0.05, steps=200, paths=1000)
        found.values["sigma"], found.se["sigma"]

    - f: a formula of the state at the end, as "q**2" or "Sum(q[i]**2, i)", which may hold parameters and t. Or a pair
      of functions: f(t, q, p) -> (path,) and its derivative df(t, q, p) -> (fq, fp), where q, p, fq and fp are (time,
      dof, path) at the saved times; a third result, (parameter, path), has derivatives by parameters that f holds
      itself, in the order of wrt
    - wrt: names of parameters, "q0" and "p0", in any order. Parameters are those of formulas and of built-in models
    - save_every: steps between the saved times that f is given; by default the beginning and the end
    - allow_failed: leave failed paths out of means; otherwise a run with failed paths is refused. The remaining paths
      are a selection, and the mean of their derivatives is not the derivative of their mean
    - the other arguments are those of `simulate`; the forward run has its bits

    Every step is differentiated as the scheme takes it (no inverse steps, no differences): (u, c) = (df/dq, df/dp) is
    carried back by the transposed map of each step. A long run is cut into pieces, each of which is taken forward once
    more, with the same bits. Schemes and models without exact derivatives are refused with the reason.
    """
    require_model(model)
    names, known = names_of(wrt, model)
    if not names:
        raise InvalidArgumentError('wrt is empty: give names, as ["sigma", "q0"]')
    states = [x for x in names if x in _STATES]
    allow_failed = checks.flag("allow_failed", allow_failed)
    refuse_compensated(options)
    options.setdefault("save_every", max(1, checks.integer("steps", steps)))
    setup = make_setup(model, q0=q0, p0=p0, step=step, steps=steps, **options)
    wide, positions = wide_model(model, known, thirds=setup.kicks)
    function = _function_of(f, model, positions, positions.places(known))
    found = _Found(setup, len(positions))
    with Monitor(progress, in_python=True) as monitor:
        for part in groups_of(setup, wide.ndof):
            found.fill(part, wide, positions, function, monitor)
    return found.told(names, known, positions, states, allow_failed=allow_failed)


def groups_of(setup: Setup, nwide: int) -> Iterator[slice]:
    """Groups of paths that are run at once: states between pieces and at saved times are kept for each path."""
    each = 2 * setup.model.ndof * (3 * setup.ntime + setup.options.steps // 100 + 2) + nwide
    most = max(_UNIT, _NUMBERS // each // _UNIT * _UNIT)
    for i in range(0, setup.paths, most):
        yield slice(i, min(i + most, setup.paths))


class _Found:
    """Results of each path."""

    def __init__(self, setup: Setup, nparameter: int):
        paths, ndof = setup.paths, setup.model.ndof
        checks.room((2 * ndof + nparameter + 1, paths), "derivatives of each path")
        self.setup = setup
        self.f = np.empty(paths)
        self.by_q, self.by_p = np.empty((ndof + nparameter, paths)), np.empty((ndof, paths))
        self.status, self.failed_step = np.empty(paths, np.int32), np.empty(paths, np.int64)
        self.report: abi.Report | None = None

    def fill(self, part: slice, wide: Model, positions: Positions, function: Callable, monitor: Monitor) -> None:
        """Run some of the paths."""
        whole, paths = self.setup, part.stop - part.start
        setup = whole if paths == whole.paths else part_of(whole, part)
        theta, ndof = values_of(whole.model, positions, part), whole.model.ndof
        out = [np.empty((*x.shape[:-1], paths), x.dtype) for x in self._arrays()]
        out[1] = np.empty((ndof + len(theta), paths))
        report = handles.new(abi.Report, "report")
        failures = callbacks.Failures()
        callback = _callback(function, failures, len(positions))
        try:
            wide_handle = wide._handles.take()
            try:
                setup.model.call(
                    "path_gradient",
                    wide_handle.pointer,
                    *setup.handles(),
                    ctypes.byref(setup.input(monitor)),
                    *theta.shape,
                    address(theta) if positions else None,
                    callback,
                    None,
                    *map(address, out),
                    ctypes.byref(report),
                    allow=(abi.STOPPED, abi.PATHS_FAILED, abi.CALLBACK_FAILED),
                )
            finally:
                wide._handles.give(wide_handle)
        finally:
            failures.raise_stored()
        out[1] = np.concatenate((out[1][:ndof], positions.gathered(out[1][ndof:])))
        for mine, theirs in zip(self._arrays(), out, strict=True):
            mine[..., part] = theirs
        for name in ("failed", "grown"):
            setattr(report, name, getattr(report, name) + (getattr(self.report, name) if self.report else 0))
        self.report = report

    def _arrays(self) -> tuple[np.ndarray, ...]:
        return self.f, self.by_q, self.by_p, self.status, self.failed_step

    def told(
        self, names: list[str], known: list[str], positions: Positions, states: list[str], *, allow_failed: bool
    ) -> Gradient:
        """Means over the paths that are ok."""
        ok = self.status == 0
        share = 1 - np.count_nonzero(ok) / ok.size
        if share and (not allow_failed or not ok.any()):
            raise IncompatibleError(
                f"a share of {share:.3g} of the paths failed ({checks.counted(int((~ok).sum()), 'path')}), and the "
                "gradient of the mean over others is none of E f: take a smaller step, or allow_failed=True for that "
                "of the others"
            )
        if share:
            checks.warn(
                f"a share of {share:.3g} of the paths failed and are left out of the mean and its gradient",
                PathsFailedWarning,
            )
        warn_of_growth(self.report.grown)
        ndof = self.setup.model.ndof
        rows = {"q0": self.by_q[:ndof], "p0": self.by_p}
        rows |= {name: self.by_q[ndof:][positions.at(name)] for name in known}
        by_path = {self_name: rows[self_name] for self_name in _in_order(names, known, states)}
        means = {name: mean_of(x[..., ok]) for name, x in by_path.items()}
        value, value_se = mean_of(self.f[ok])
        return Gradient(
            value=value,
            value_se=value_se,
            values={name: x for name, (x, _) in means.items()},
            se={name: x for name, (_, x) in means.items()},
            by_path=by_path,
            f=self.f,
            status=self.status,
            failed=share,
            report=make_report(self.report),
        )


def values_of(model: Model, positions: Positions, part: slice) -> np.ndarray:
    """Values of parameters for some paths, or one for all: (parameter, 1 or path). Of rates behind them nothing is
    read.
    """
    given = (model.parameters[name] for name in dict.fromkeys(positions))
    values = [np.atleast_1d(one) for x in given for one in (x if isinstance(x, tuple) else (x,))]
    rows = part.stop - part.start if any(x.size > 1 for x in values) else 1
    theta = np.zeros((positions.rows, rows))
    for row, x in zip(theta, values, strict=False):
        row[:] = x if x.size == 1 else x[part]
    return theta


def names_of(wrt: object, model: Model) -> tuple[list[str], list[str]]:
    """The names of wrt, and those among them that are parameters, as the model has them."""
    names = [wrt] if isinstance(wrt, str) else checks.items(wrt)
    if names is None:
        raise WrongTypeError(f'wrt = {checks.shown(wrt)} holds no names: give them as ["sigma", "q0"]')
    names = [checks.name_of("name in wrt", x) for x in names]
    if len(set(names)) < len(names):
        raise InvalidArgumentError(f"wrt = {checks.shown(wrt)} holds a name twice: give each once")
    return names, parameter_names(model, [x for x in names if x not in _STATES])


def refuse_compensated(options: Mapping[str, Any]) -> None:
    """Refuse compensated sums, and unequal saved times."""
    if options.get("save_at") is not None:
        raise IncompatibleError("derivatives are taken at equal distances: give save_every in the place of save_at")
    if options.get("compensated"):
        raise IncompatibleError("compensated sums have the derivatives of plain ones: leave compensated out")


def _in_order(names: list[str], known: list[str], states: list[str]) -> Iterator[str]:
    """The names of wrt, with parameters under the model's own names."""
    parameters, of_states = iter(known), iter(states)
    for name in names:
        yield next(of_states) if name in _STATES else next(parameters)


def mean_of(x: np.ndarray) -> tuple[Any, Any]:
    """Mean over paths and its standard error."""
    mean = x.mean(axis=-1)
    n = x.shape[-1]
    error = np.full_like(mean, np.nan) if n < 2 else x.std(axis=-1, ddof=1) / np.sqrt(n)
    return (float(mean), float(error)) if np.ndim(mean) == 0 else (mean, error)


def part_of(setup: Setup, part: slice) -> Setup:
    """The run of some of the paths."""
    options = abi.Options.from_buffer_copy(setup.options)
    options.first_path += part.start
    options.paths = part.stop - part.start
    rows = [x if x is None or x.shape[-1] == 1 else x[..., part] for x in (setup.q0, setup.p0, setup.increments)]
    return dataclasses.replace(
        setup,
        model=setup.model._part(part),
        options=options,
        q0=np.ascontiguousarray(rows[0]),
        p0=np.ascontiguousarray(rows[1]),
        increments=rows[2],
    )


def _function_of(f: Any, model: Model, positions: Positions, places: list[int]) -> Callable:
    """f as a function of (t, q, p, theta) that gives value, fq, fp, ftheta; places: of the parameters of wrt."""
    if is_formula(f):
        return PathFormula(model, f, positions)
    pair = checks.items(f)
    if pair is None or len(pair) != 2 or not all(map(callable, pair)):
        raise WrongTypeError(
            f"f = {checks.shown(f)} has no derivative: give a formula, as 'q**2', or a pair of functions (f, df), "
            "f(t, q, p) -> (path,) and df(t, q, p) -> (fq, fp), each (time, dof, path)"
        )
    value, derivative = pair
    checks.takes("f", value, "t", "q", "p")
    checks.takes("df", derivative, "t", "q", "p")

    def both(t, q, p):
        found = derivative(t, q, p)
        if not isinstance(found, tuple | list) or len(found) not in (2, 3):
            raise WrongTypeError("df() returned no pair: return (fq, fp), each (time, dof, path)")
        rows = [np.zeros((len(positions), q.shape[-1]))]
        if len(found) == 3:
            given = checks.real_array("df() by parameters", found[2])
            if given.shape != (len(places), q.shape[-1]):
                raise WrongShapeError(
                    f"df() by parameters has shape {given.shape}: return {(len(places), q.shape[-1])}, the paths last"
                )
            rows[0][places] = given
        return value(t, q, p), found[0], found[1], *rows

    return both


def _callback(function: Callable, failures: callbacks.Failures, nparameter: int) -> ctypes._CFuncPtr:
    """The function as a callback of the library."""

    def called(_first, nlane, ndof, ntime, _nparameter, t, *addresses):
        q, p, *targets, _user = addresses
        shape = (ntime, ndof, nlane)
        try:
            states = (callbacks.view.__wrapped__(x, shape).copy() for x in (q, p))
            results = function(callbacks.view.__wrapped__(t, (ntime,)).copy(), *states)
            shapes = ((nlane,), shape, shape, (nparameter, nlane))
            for what, value, target, of in zip(("f", "fq", "fp", "ftheta"), results, targets, shapes, strict=False):
                _store(what, value, target, of)
        except BaseException as error:  # raise_stored raises the exception later
            return failures.store(error)
        return 0

    return abi.PathFunction(called)


def _store(what: str, value: Any, target: int, shape: tuple[int, ...]) -> None:
    """Copy a result to its address."""
    array = checks.real_array(f"{what} of the path", value)
    if array.shape != shape:
        raise WrongShapeError(f"{what} has shape {array.shape}: return {shape}, the paths last")
    callbacks.view.__wrapped__(target, shape)[...] = array
