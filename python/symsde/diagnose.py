# SPDX-License-Identifier: BSD-3-Clause
"""Examine schemes and runs: symplecticity, discrete action, Euler-Lagrange equations, stationary paths."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from typing import Any

import numpy as np

from .errors import IncompatibleError, WrongShapeError, WrongTypeError
from .model.definition import Model
from .model.formulas.wide import wide_model
from .native import abi, checks
from .native.checks import address
from .native.progress import Monitor
from .run.bath_law import BathLaw, bath_law
from .run.exact_moments import ExactMoments, exact_moments
from .run.gradient import part_of
from .run.increments import increments_array, unchanged
from .run.options import make_options
from .run.setup import Setup, make_setup
from .run.simulate import Run
from .run.step import increments_at, of_options
from .run.tangent import take_vectors
from .schemes import Scheme, as_scheme

__all__ = [
    "BathLaw",
    "ExactMoments",
    "StationaryPath",
    "action",
    "bath_law",
    "driving_increments",
    "euler_lagrange_residual",
    "exact",
    "exact_moments",
    "exact_of",
    "stationary_path",
    "symplecticity",
]


def symplecticity(
    model: Model,
    scheme: str | Scheme = "midpoint",
    *,
    q: Any = 1.0,
    p: Any = 0.5,
    step: float = 0.1,
    dw: Any = None,
    seed: int = 0,
    t: float = 0.0,
    by: str = "differences",
    **options: Any,
) -> np.ndarray:
    """max |M^T J M - J|, where M is the tangent map of one step with frozen increments, at each point: (point,).

    q, p: a number, (dof,) or (dof, point); dw: (noise,) or (noise, point), by default increments of `seed`. The result
    is zero up to rounding for symplectic schemes.

    by: "differences" of eighth order, over 1/32, of the steps that a run takes, which find what its code does; or
    "tangent", the exact derivative of the step from the Hessian of the model (`tangent`), also where forces change
    within 1/32 or where paths fail nearby. It takes the step's equations as solved, and schemes as `tangent` does; and
    parameters that go by path, one for each point.

    Of a model damped by one rate it is the distance from exp(-gamma h) J. Of a model with forces it says what the force
    does to the form in a step, and is no defect of the scheme: to first order h (F_q^T - F_q) and -h F_p J, where F_q
    and F_p are derivatives of F. Forces that are gradients of a potential in q leave it zero.
    """
    chosen_by = checks.choice("by", by, ["differences", "tangent"])
    decided = {"steps": "it makes one", "paths": "the points are those of q, p and dw", "t0": "give t"}
    checks.not_given("symplecticity", options, decided)
    points = checks.columns(q=q, p=p, **({} if dw is None else {"dw": dw}))
    if chosen_by:
        given = {"q0": q, "p0": p, "step": step, "seed": seed, "t0": t, "scheme": scheme, "paths": points, **options}
        return _by_tangent(model, dw, given)
    chosen = make_options(model, step=step, steps=1, paths=points, seed=seed, t0=t, **options)
    q, p = (checks.points(name, x, model.ndof, points) for name, x in (("q", q), ("p", p)))
    chosen_scheme = as_scheme(scheme)
    drive = of_options(model, chosen, chosen_scheme)[0] if dw is None else increments_at(model, dw, points)
    defect = np.empty(points)
    arrays = (address(x) for x in (q, p, drive, defect))
    _call("symplecticity", model, chosen_scheme, chosen, points, *arrays)
    return defect


def _by_tangent(model: Model, dw: Any, given: dict[str, Any]) -> np.ndarray:
    """max |M^T J M - c J| with the exact derivative M of one step, c = exp(-gamma h)."""
    drive = None if dw is None else increments_at(model, dw, given["paths"])[np.newaxis]
    setup = make_setup(model, steps=1, increments=drive, **given)
    if len(set(model.damping)) > 1:
        raise IncompatibleError(
            f"model {model.name} is damped by rates that are not equal, and a step keeps no form up to one factor: "
            "give one rate"
        )
    n = model.ndof
    wide, positions = wide_model(model, [], thirds=setup.kicks)
    start = np.concatenate((np.eye(2 * n), np.zeros((len(positions), 2 * n))))
    found = take_vectors(setup, (wide, positions), start, progress=False)
    J = np.block([[np.zeros((n, n)), np.eye(n)], [-np.eye(n), np.zeros((n, n))]])
    m = found.v[: 2 * n].transpose(2, 0, 1)  # the transpose of M at each point
    factor = np.exp(-model.damping[0] * setup.options.step) if model.damping else 1.0
    return abs(m @ J @ m.transpose(0, 2, 1) - factor * J).max(axis=(1, 2))


def action(run: Run) -> np.ndarray:
    """Discrete action [WHSB] (49) of each step of a run with save_every = 1: (step, path).

    Of a model with forces it is that of its Hamiltonians: the work of forces belongs to a variation, [WHSB] (12), and
    no value of the action holds it; `euler_lagrange_residual` does.
    """
    setup = _setup_of(run)
    values = np.empty((setup.options.steps, setup.paths))
    _examine("discrete_action", run, values)
    return values


def euler_lagrange_residual(run: Run) -> np.ndarray:
    """Largest residuals over the steps of a run with save_every = 1, zero up to rounding: (4, path).

    The four are the discrete Euler-Lagrange equations in q, [WHSB] (47), and p, [WHSB] (48), and the Legendre
    transforms at the left end, [WHSB] (53)-(54), and at the right end of a step, [WHSB] (57)-(58).
    """
    values = np.empty((4, _setup_of(run).paths))
    _examine("euler_lagrange_residual", run, values)
    return values


@dataclass(frozen=True)
class StationaryPath:
    """Paths between two positions along which the discrete action is stationary; NaN where status is not 0."""

    t: np.ndarray  #: (time,)
    q: np.ndarray  #: (time, dof, path)
    p: np.ndarray  #: (time, dof, path)
    status: np.ndarray  #: (path,): 0 = found; 1 = not converged, 2 = singular: the end points are conjugate


def stationary_path(
    model: Model,
    scheme: str | Scheme = "midpoint",
    *,
    q_start: Any,
    q_end: Any,
    increments: Any = None,
    guess_q: Any = None,
    guess_p: Any = None,
    **options: Any,
) -> StationaryPath:
    """The stochastic Hamilton principle: the path from q_start to q_end that makes the discrete action stationary.

    The result is the path that the scheme itself takes from (q_start, p[0]), [WHSB] Theorem 2.3 and (46)-(48). The
    increments are those of a run with these `options` of `simulate` (step, steps, paths, seed, ...), or given ones,
    (step, noise) or (step, noise, path). q_start, q_end: a number, (dof,) or (dof, path). guess_q, guess_p: (time, dof,
    path), where the iteration begins, by default a straight line. The path is found if the time is below the time of
    the first conjugate point (pi for an oscillator of unit frequency).
    """
    chosen = make_options(model, **options)
    shape = (chosen.steps + 1, model.ndof, chosen.paths)
    checks.room((2, *shape), "the paths (q and p; time, dof, path)")
    given = (("q_start", q_start), ("q_end", q_end))
    ends = [checks.points(name, x, model.ndof, chosen.paths) for name, x in given]
    dw = _prescribed(increments, (chosen.steps * 2 ** max(0, chosen.refine), model.nnoise, chosen.paths))
    guesses = [_guess(name, x, shape) for name, x in (("guess_q", guess_q), ("guess_p", guess_p))]
    q, p, status = np.empty(shape), np.empty(shape), np.zeros(chosen.paths, dtype=np.int32)
    scheme = as_scheme(scheme)
    arrays = (address(x) for x in (*ends, dw, *guesses, q, p, status))
    _call("stationary_path", model, scheme, chosen, *arrays, allow=(abi.PATHS_FAILED,))
    t = chosen.t0 + (chosen.first_step + np.arange(chosen.steps + 1)) * chosen.step
    return StationaryPath(t, q, p, status)


def _prescribed(increments: object, shape: tuple[int, int, int]) -> np.ndarray | None:
    """Given increments, with one column for each path."""
    if increments is None:
        return None
    array = increments_array(increments)
    if array.shape[:2] != shape[:2] or array.shape[2] not in {1, shape[2]}:
        raise WrongShapeError(f"increments has shape {array.shape}: give {shape}, or one path for all")
    return checks.full(array, shape[2])


def _guess(name: str, value: object, shape: tuple[int, ...]) -> np.ndarray | None:
    """The initial guess of a path."""
    if value is None:
        return None
    array = np.ascontiguousarray(checks.real_array(name, value))
    if array.shape != shape:
        raise WrongShapeError(f"{name} has shape {array.shape}: give {shape} (time, dof, path)")
    return array


def exact(run: Run) -> tuple[np.ndarray, np.ndarray]:
    """Exact solution q, p on the Brownian path of a run, each (time, dof, path), for models with a known solution.

    These are kubo, linear_oscillator, additive_oscillator, and all quadratic models whose flows commute or whose noise
    is constant, also your own, closed or damped by numbers or a matrix, of up to 64 degrees of freedom. Other models
    raise MissingOperationError. The solution is driven by the same dW, dZ and K as the run. Schemes with two- or
    three-point increments, and damping_noise="path", raise IncompatibleError.
    """
    return exact_of(_setup_of(run))


def exact_of(setup: Setup) -> tuple[np.ndarray, np.ndarray]:
    """Exact solution on the Brownian path of a run that is set up; the run need not have been made."""
    if setup.saved is not None:
        return tuple(x[setup.rows] for x in exact_of(setup.whole()))
    shape = (setup.ntime, setup.model.ndof, setup.paths)
    checks.room((2, *shape), "the exact solution (q and p; time, dof, path)")
    q, p = np.empty(shape), np.empty(shape)
    if setup.increments is not None:
        unchanged(setup.increments)
    if setup.model.paths:
        for i in range(setup.paths):
            q[..., i : i + 1], p[..., i : i + 1] = exact_of(part_of(setup, slice(i, i + 1)))
        return q, p
    arrays = (ctypes.byref(setup.input()), address(q), address(p))
    _call("exact_solution", setup.model, setup.scheme, setup.options, *arrays)
    return q, p


def driving_increments(run: Run) -> np.ndarray:
    """The increments that drove a run, (step, noise, path), with prescribed increments summed and truncated as in the
    run."""
    setup = _setup_of(run)
    if setup.increments is None:
        return of_options(setup.model, setup.options, setup.scheme)
    dw = np.asarray(unchanged(setup.increments))
    for _ in range(setup.options.refine):
        dw = dw[0::2] + dw[1::2]  # summed in the order of the library's balanced tree
    if setup.options.truncation != 0:
        raise IncompatibleError(
            "the run truncated increments of your own: truncate them yourself and leave truncation out"
        )
    return checks.full(dw, setup.paths)


def _setup_of(run: object) -> Setup:
    """The setup that a run was made from."""
    if not isinstance(run, Run):
        raise WrongTypeError(f"run = {checks.shown(run)} is not a run: give the result of symsde.simulate")
    return run.setup


def _states(values: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """The states of a run, checked, since its owner may have replaced them."""
    array = np.ascontiguousarray(checks.real_array("the states of the run", values))
    if array.shape != shape:
        raise WrongShapeError(f"the states of the run have shape {array.shape}: give {shape}, as simulate did")
    return array


def _examine(name: str, run: Run, values: np.ndarray) -> None:
    """Call a diagnostic that needs every step of a run."""
    setup = _setup_of(run)
    if setup.options.save_every != 1 or setup.saved is not None:
        how = f"save_every = {setup.options.save_every}" if setup.saved is None else "save_at"
        raise IncompatibleError(f"the run has {how}: this needs every step, simulate with save_every = 1")
    if setup.model.paths:
        raise IncompatibleError(
            f"parameters of model {setup.model.name} differ from path to path, and {name} evaluates one model for all "
            "paths: give the run of one path, with its values as numbers"
        )
    shape = (setup.ntime, setup.model.ndof, setup.paths)
    arrays = (*(_states(x, shape) for x in (run.q, run.p)), driving_increments(run), values)
    _call(name, setup.model, setup.scheme, setup.options, *(address(x) for x in arrays))


def _call(name: str, model: Model, scheme: Scheme, options: abi.Options, *arguments, allow: tuple[int, ...] = ()):
    """Call a diagnostic of the library; Ctrl-C stops it as it stops a run."""
    with Monitor(progress=False) as monitor:
        chosen = abi.Options.from_buffer_copy(options)
        chosen.progress = monitor.callback
        model.call(name, scheme._handle.pointer, ctypes.byref(chosen), *arguments, allow=(*allow, abi.STOPPED))
