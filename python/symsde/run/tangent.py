# SPDX-License-Identifier: BSD-3-Clause
"""Tangent maps of paths, and Lyapunov exponents, by the exact derivative of every step."""

from __future__ import annotations

import ctypes
import dataclasses
from collections.abc import Sequence
from typing import Any, Unpack

import numpy as np

from ..errors import IncompatibleError, InvalidArgumentError, PathsFailedWarning
from ..model.definition import Model, require_model
from ..model.formulas.wide import Positions, wide_model
from ..native import abi, checks, handles
from ..native.checks import address
from ..native.progress import Monitor, Progress
from .gradient import groups_of, mean_of, names_of, part_of, refuse_compensated, values_of
from .options import RunOptions
from .report import Report, make_report
from .setup import Setup, make_setup

_TURN = 8  #: steps between two decompositions v = Q R


@dataclasses.dataclass(frozen=True)
class Tangent:
    """Derivatives of the state at the end of each path; NaN where it failed."""

    matrix: np.ndarray  #: (2 dof, 2 dof, path), d x_i(T)/d x_j(0) with x = (q_1 .. q_n, p_1 .. p_n)
    by: dict[str, np.ndarray]  #: parameter -> d x_i(T)/d theta, (2 dof, path); (site, 2 dof, path) of sites
    q: np.ndarray  #: (dof, path), the state at the end, with the bits of `simulate`
    p: np.ndarray
    status: np.ndarray  #: (path,), 0 = ok
    report: Report

    def defect(self, factor: float = 1.0) -> np.ndarray:
        """max |M^T J M - factor J|/(1 + |M|^2) of each path, (path,): zero to rounding where steps are symplectic.

        factor: exp(-gamma T) with one rate gamma of damping over the time T.
        """
        n = len(self.q)
        J = np.block([[np.zeros((n, n)), np.eye(n)], [-np.eye(n), np.zeros((n, n))]])
        m = np.moveaxis(self.matrix, 2, 0)
        off = abs(m.transpose(0, 2, 1) @ J @ m - factor * J).max(axis=(1, 2))
        return off / (1 + (m**2).sum(axis=(1, 2)))

    def __repr__(self) -> str:
        """Numbers of degrees of freedom and of paths, and names of parameters."""
        n, paths = self.q.shape
        names = "".join(f", by {name}" for name in self.by)
        return f"<tangent maps of {checks.counted(n, 'degree of freedom')}, {checks.counted(paths, 'path')}{names}>"


@dataclasses.dataclass(frozen=True)
class Lyapunov:
    """Lyapunov exponents, the largest first: means over paths of (1/T) log of the growth until T."""

    exponents: np.ndarray  #: (count,)
    se: np.ndarray  #: (count,), standard errors over paths
    by_path: np.ndarray  #: (count, path); NaN where a path failed
    status: np.ndarray  #: (path,), 0 = ok
    failed: float  #: share of paths that failed, and are left out of means
    report: Report

    def __repr__(self) -> str:
        """Exponents with their errors."""
        told = ", ".join(f"{x:.4g} +- {e:.2g}" for x, e in zip(self.exponents[:4], self.se[:4], strict=True))
        return f"<Lyapunov exponents {told}{', ..' if len(self.exponents) > 4 else ''}>"


@checks.hinted(*RunOptions.__annotations__)
def tangent(
    model: Model,
    wrt: str | Sequence[str] = (),
    *,
    q0: Any,
    p0: Any,
    step: float,
    steps: int,
    progress: Progress = False,
    **options: Unpack[RunOptions],
) -> Tangent:
    """The tangent map of each path: derivatives of its end by its beginning, and by parameters.

        found = ss.tangent(model, ["sigma"], q0=1.0, p0=0.0, step=0.05, steps=200, paths=100)
        found.matrix, found.by["sigma"]      # (2 dof, 2 dof, path), (2 dof, path)

    It is the product of the exact derivatives of all steps, with the noise of the run: no differences. For symplectic
    schemes it is symplectic to rounding, M^T J M = J; with one rate gamma of damping M^T J M = exp(-gamma T) J.

    - wrt: names of parameters, of formulas and of built-in models
    - the other arguments are those of `simulate`, but for save_every: the end alone is kept

    Schemes and models without exact derivatives are refused as in `gradient`.
    """
    require_model(model)
    names, known = names_of(wrt, model)
    if states := [x for x in names if x not in known and x in ("q0", "p0")]:
        raise InvalidArgumentError(f"wrt holds {states[0]}: derivatives by q0 and p0 are always there, as matrix")
    setup = _setup(model, options, q0=q0, p0=p0, step=step, steps=steps)
    wide, positions = wide_model(model, known, thirds=setup.kicks)
    n = model.ndof
    start = np.concatenate((np.eye(2 * n), np.zeros((len(positions), 2 * n))))
    found = take_vectors(setup, (wide, positions), start, progress=progress)
    matrix, rows = found.v[: 2 * n], found.v[2 * n :]
    return Tangent(
        matrix=np.ascontiguousarray(np.moveaxis(matrix, 0, 1)),
        by={name: rows[positions.at(name)] for name in known},
        q=found.q,
        p=found.p,
        status=found.status,
        report=make_report(found.report),
    )


@checks.hinted(*RunOptions.__annotations__)
def lyapunov(
    model: Model,
    *,
    q0: Any,
    p0: Any,
    step: float,
    steps: int,
    count: int | None = None,
    allow_failed: bool = False,
    progress: Progress = False,
    **options: Unpack[RunOptions],
) -> Lyapunov:
    """Lyapunov exponents of the scheme: rates lambda_i [1/time] at which perturbations of a path grow.

        found = ss.lyapunov(model, q0=1.0, p0=0.0, step=0.05, steps=20000, paths=100)
        found.exponents, found.se            # (2 dof,), the largest first

    Tangent vectors are taken through the exact derivative of each step and made orthonormal every eighth step, v = Q R;
    lambda_i = (1/T) sum log R_ii on each path. Means over paths have the error found.se, and a bias of order 1/T from
    the beginning, where vectors are not yet in their directions. Exponents of symplectic steps come in pairs that sum
    to zero, with one rate gamma of damping to -gamma.

    - count: how many, 1 to 2 dof, by default all
    - allow_failed: leave failed paths out of means; else a run in which some failed is refused
    - the other arguments are those of `simulate`
    """
    require_model(model)
    count = 2 * model.ndof if count is None else checks.integer("count", count, (1, 2 * model.ndof))
    allow_failed = checks.flag("allow_failed", allow_failed)
    setup = _setup(model, options, q0=q0, p0=p0, step=step, steps=steps)
    if not setup.options.steps:
        raise InvalidArgumentError("steps = 0: exponents are rates over a time, give at least one step")
    if model.paths:
        _refuse_arrays(model)
    if arrays := {name: x.item() for name, x in model.parameters.items() if isinstance(x, np.ndarray)}:
        model = model.with_parameters(**arrays)
        setup = dataclasses.replace(setup, model=model)
    wide = wide_model(model, [], thirds=setup.kicks)
    start = np.zeros((count, 2 * model.ndof))
    for k in range(count):  # p_1, q_1, p_2, q_2, ..: the first two span a plane that the flow turns
        start[k, k // 2 + (model.ndof if k % 2 == 0 else 0)] = 1
    found = take_vectors(setup, wide, start, turn=_TURN, progress=progress)
    by_path = found.logs / (abs(setup.options.step) * setup.options.steps)
    ok = found.status == 0
    share = 1 - np.count_nonzero(ok) / ok.size
    if share and (not allow_failed or not ok.any()):
        raise IncompatibleError(
            f"{share:.3g} of the paths failed ({checks.counted(int((~ok).sum()), 'path')}): take a smaller step, or "
            "allow_failed=True for the exponents of the others"
        )
    if share:
        checks.warn(f"{share:.3g} of the paths failed and are left out of the exponents", PathsFailedWarning)
    mean, error = mean_of(by_path[:, ok])
    return Lyapunov(mean, error, by_path, found.status, share, make_report(found.report))


def _refuse_arrays(model: Model) -> None:
    raise IncompatibleError(
        f"parameters of model {model.name} differ from path to path, and their mean over paths has no exponents of its "
        "own: give numbers, and a run for each value"
    )


def _setup(model: Model, options: Any, **given: Any) -> Setup:
    refuse_compensated(options)
    if "save_every" in options:
        raise InvalidArgumentError("save_every has no meaning here, as the end alone is kept: leave it out")
    return make_setup(model, save_every=max(1, checks.integer("steps", given["steps"])), **options, **given)


@dataclasses.dataclass
class _Found:
    """Arrays that the library fills."""

    v: np.ndarray  #: (vector, 2 dof, path)
    logs: np.ndarray  #: (vector, path)
    q: np.ndarray
    p: np.ndarray
    status: np.ndarray
    report: abi.Report


def take_vectors(
    setup: Setup, wide: tuple[Model, Positions], start: np.ndarray, *, turn: int = 0, progress: Progress
) -> _Found:
    """Take these vectors, (vector, 2 dof) of all paths or (vector, 2 dof, path), through all paths."""
    wide, positions = wide
    n, paths, many = setup.model.ndof, setup.paths, len(start)
    checks.room((2 * many + 1, 2 * n, paths), "tangent vectors of each path")
    behind = positions.rows - len(positions)  # vectors of rates of damping
    v = np.empty((many, 2 * n, paths))
    logs, q, p = np.empty((many, paths)), np.empty((n, paths)), np.empty((n, paths))
    status, failed_step = np.empty(paths, np.int32), np.empty(paths, np.int64)
    failed, report = 0, None
    with Monitor(progress, in_python=setup.model.in_python) as monitor:
        for part in groups_of(setup, many * n):
            size = part.stop - part.start
            here = setup if size == paths else part_of(setup, part)
            theta = values_of(setup.model, positions, part)
            own = np.zeros((many + behind, 2 * n, size))
            own[:many] = start[:, :, np.newaxis] if start.ndim == 2 else start[..., part]
            out = [np.empty((*x.shape[:-1], size), x.dtype) for x in (logs, q, p, status, failed_step)]
            out[0] = np.empty((many + behind, size))
            report, handle = handles.new(abi.Report, "report"), wide._handles.take()
            try:
                setup.model.call(
                    "path_tangent",
                    handle.pointer,
                    *here.handles(),
                    ctypes.byref(here.input(monitor)),
                    *theta.shape,
                    address(theta) if positions else None,
                    many + behind,
                    turn,
                    *map(address, (own, *out)),
                    ctypes.byref(report),
                    allow=(abi.STOPPED, abi.PATHS_FAILED),
                )
            finally:
                wide._handles.give(handle)
            own[many - len(positions) : many] = positions.gathered(own[many - len(positions) :])
            out[0] = out[0][:many]
            for mine, theirs in zip((v, logs, q, p, status, failed_step), (own[:many], *out), strict=True):
                mine[..., part] = theirs
            failed += report.failed
    report.failed = failed
    return _Found(v, logs, q, p, status, report)
