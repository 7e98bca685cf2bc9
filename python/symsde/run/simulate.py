# SPDX-License-Identifier: BSD-3-Clause
"""Integrate paths and keep them."""

from __future__ import annotations

import ctypes
import functools
import os
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..errors import IncompatibleError
from ..model.definition import Model
from ..native import abi, checks, files, handles
from ..native.checks import address, addresses, counted
from ..native.progress import Monitor, Progress
from ..native.signals import carry
from ..schemes import Scheme
from ..show import tabular
from ..show.values import Values
from . import bath_temperature
from .report import Reported, filled
from .saved import PathTables, no_energy
from .setup import Setup, setup_of

_INT32, _INT64 = np.dtype(np.int32), np.dtype(np.int64)
_PATHS_SIZE = handles.new(abi.Paths, "paths").struct_size
_REPORT_SIZE = handles.new(abi.Report, "report").struct_size


_HELD, _KEPT = 2**14, 2**25  # bytes that glibc's allocator always has in one piece, and that it keeps for the next run


def _two_of(shape: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Allocate q and p, in one piece of memory if its size is between _HELD and _KEPT: of two pieces the allocator
    would return one to the system, and new pages would take longer than the steps of the next run."""
    size = checks.room((2, *shape), "the saved paths (q and p; time, dof, path)")
    if not _HELD < size <= _KEPT:
        return np.empty(shape), np.empty(shape)
    q, p = np.empty((2, *shape))
    return q, p


class Run(PathTables, Reported):
    """Saved paths: the arrays that the library filled, without a copy. Values after a failure are NaN."""

    q: np.ndarray  #: (time, dof, path)
    p: np.ndarray  #: (time, dof, path)
    status: np.ndarray  #: (path,), 0 = ok; `symsde.status_text` explains other values
    failed_step: np.ndarray  #: (path,), absolute step that failed; -1 = none
    last_q: np.ndarray  #: (dof, path), last good state
    last_p: np.ndarray
    q_low: np.ndarray | None  #: (dof, path), low parts of the last state of a compensated run
    p_low: np.ndarray | None

    def __init__(self, setup: Setup):
        """Allocate the paths; `fill` computes them."""
        self.setup = setup
        ntime, ndof, paths = setup.ntime, setup.model.traits.ndof, setup.options.paths
        saved, last = (ntime, ndof, paths), (ndof, paths)
        self.q, self.p = _two_of(saved)
        self.status = np.empty(paths, _INT32)
        self.failed_step = np.empty(paths, _INT64)
        self.last_q, self.last_p = np.empty(last), np.empty(last)
        self.q_low = self.p_low = None
        if setup.options.compensated:
            self.q_low, self.p_low = np.empty(last), np.empty(last)

    def fill(self, progress: Progress, before: Run | None = None) -> None:
        """Let the library integrate; before: the run that this run extends, or None."""
        if self.setup.saved is not None:
            self._fill_some(progress)
            return
        arrays = (self.q, self.p, self.status, self.failed_step, self.last_q, self.last_p)
        low = () if self.q_low is None else (self.q_low, self.p_low)
        paths = abi.Paths(_PATHS_SIZE, None, *addresses(arrays + low))  # the remaining pointers are NULL, as is t
        report = abi.Report(_REPORT_SIZE)
        setup = self.setup
        with Monitor(progress, in_python=setup.model.in_python) as monitor:
            given = setup.input(monitor)
            try:
                setup.model.call(
                    "simulate",
                    *setup.handles(),
                    ctypes.byref(given),
                    ctypes.byref(paths),
                    ctypes.byref(report),
                    allow=(abi.STOPPED, abi.PATHS_FAILED),
                )
            finally:
                if before is not None and before.status.any() and report.threads:
                    self._keep_failures(before, report)
                self._keep_report(report)
            self._warn_of_failures()

    def _fill_some(self, progress: Progress) -> None:
        """Let the library save more often than wanted, at equal distances, and keep what is wanted."""
        whole, rows = Run(self.setup.whole()), self.setup.rows
        try:
            whole.fill(progress)
        finally:
            if filled(whole):
                self.__dict__.update({**whole.__dict__, "setup": self.setup, "q": whole.q[rows], "p": whole.p[rows]})

    def _temperature(self) -> str:
        """Of the last states of all paths that came to the end."""
        whole = self.status == 0
        return bath_temperature.of_states(
            self.setup.model, self.last_q[:, whole], self.last_p[:, whole], float(self.t[-1])
        )

    @checks.hinted()
    def extend(self, steps: int, *, save_every: int | None = None, progress: Progress = False) -> Run:
        """Take `steps` more steps: a Run from the last state, whose end has the same bits as one long run.

        Model, scheme, step, seed and options are those of this run; save_every too, unless given; after
        save_at the end alone is saved. The first saved state
        is the last one of this run. Paths that failed stay failed. A run with prescribed increments, or one that was
        stopped before its end, is refused with an IncompatibleError.
        """
        here = self.setup.options
        if self.setup.increments is not None:
            raise IncompatibleError(
                "this run was driven by prescribed increments, and there are none for more steps: call simulate with "
                f"q0=run.last_q, p0=run.last_p, first_step={here.first_step + here.steps} and the next increments"
            )
        if (self.status == abi.STOPPED).any():
            raise IncompatibleError(
                "this run was stopped before its end, so its paths are not at one time: call simulate with the "
                "arguments of this run to compute it whole, then extend that"
            )
        steps = checks.integer("steps", steps)
        every = here.save_every if self.setup.saved is None else max(1, steps)
        if save_every is not None:
            every = checks.integer("save_every", save_every)
        state = self.last_q, self.last_p, self.q_low, self.p_low
        run = Run(self.setup.from_here(here.first_step + here.steps, steps, every, state))
        try:
            run.fill(progress, self)
        except BaseException as stop:
            carry(stop, lambda: filled(run))
            raise
        return run

    def _keep_failures(self, before: Run, report: abi.Report) -> None:
        """Keep the status of paths that failed before."""
        gone = before.status != 0
        self.q[:, :, gone] = self.p[:, :, gone] = np.nan
        for name in ("status", "failed_step", "last_q", "last_p", "q_low", "p_low"):
            if (kept := getattr(before, name)) is not None:
                getattr(self, name)[..., gone] = kept[..., gone]
        report.failed = int(np.count_nonzero((self.status != 0) & (self.status != abi.STOPPED)))
        report.stopped = int(np.count_nonzero(self.status == abi.STOPPED))
        if report.failed and not report.status:
            report.status = abi.PATHS_FAILED

    @functools.cached_property
    def t(self) -> np.ndarray:
        """(time,), t0 included."""
        here = self.setup
        t = np.empty(
            here.options.steps // here.options.save_every + 1
        )  # made on first use: it takes a third of the time of one path with q and p
        handles.call("saved_times", ctypes.byref(here.options), address(t))
        return t if here.saved is None else t[here.rows]

    def __getstate__(self) -> dict[str, Any]:
        """The state for pickle and copies: includes the times, which another library may round differently."""
        return {**self.__dict__, "t": self.t}

    @property
    def values(self) -> Values:
        """Names of coordinates, momenta and the energy."""
        return Values.of(self.model.coordinates, self.has_energy)

    @functools.cached_property
    def path(self) -> np.ndarray:
        """(path,), global indices."""
        first = self.setup.options.first_path
        return np.arange(first, first + self.setup.paths)

    @property
    def model(self) -> Model:
        """The model of this run."""
        return self.setup.model

    @property
    def scheme(self) -> Scheme:
        """The scheme of this run."""
        return self.setup.scheme

    @property
    def has_energy(self) -> bool:
        """Whether the model has a value function, so that H is known."""
        return self.model.traits.has_value

    @functools.cached_property
    def energy(self) -> np.ndarray:
        """H, (time, path), computed when it is first read; a MissingOperationError without a value function."""
        if not self.has_energy:
            raise no_energy(self.title)
        return np.array([self.model.value(q, p, t=t) for t, q, p in zip(self.t, self.q, self.p, strict=True)])

    def _variables(self) -> files.Variables:
        return {
            "q": (("time", "dof", "path"), self.q),
            "p": (("time", "dof", "path"), self.p),
            "status": (("path",), self.status),
            "failed_step": (("path",), self.failed_step),
            **{name: (("dof", "path"), getattr(self, name)) for name in ("last_q", "last_p")},
            **{name: (("dof", "path"), getattr(self, name)) for name in ("q_low", "p_low") if self.q_low is not None},
            **({"energy": (("time", "path"), self.energy)} if "energy" in self.__dict__ and self.has_energy else {}),
        }

    def attributes(self) -> dict[str, str]:
        """Origin of the run as text for files; its paths may come from several runs."""
        counted = {"paths_asked": str(len(self.status)), "paths_ok": str(int((self.status == 0).sum()))}
        return {**super().attributes(), **counted}

    def _repr_html_(self) -> str:
        """Show the run in notebooks."""
        return tabular.html_of_run(self)

    def to_xarray(self):
        """An xarray.Dataset with dims time, dof, path; t is another name of time, path is the global index."""
        coordinates = {**files.axes(self.t, self.q.shape[1]), "path": (("path",), self.path)}
        return files.dataset(self._variables(), coordinates, self.attributes())

    def save(self, path: str | os.PathLike) -> None:
        """Write a .nc (needs xarray and netCDF4) or .npz file, from which `symsde.load` restores the run.

        It contains the energy if `run.energy` was read before.
        """
        variables = {"t": (("time",), self.t), "path": (("path",), self.path), **self._variables()}
        files.write(files.path_of("path", path), self.to_xarray, variables, self.attributes())

    def __repr__(self) -> str:
        """The run in one line."""
        ntime, ndof, paths = self.q.shape
        return (
            f"<run of {self.model!r} by {self.scheme.name}: {counted(ntime, 'time')} from {self.t[0]:g} to "
            f"{self.t[-1]:g}, {counted(ndof, 'degree of freedom')}, {counted(paths, 'path')}, {self.report.outcome}>"
        )


@checks.hinted()
def simulate(
    model: Model,
    *,
    q0: Any,
    p0: Any,
    step: float,
    steps: int,
    t0: float = 0.0,
    scheme: str | Scheme = "midpoint",
    paths: int = 1,
    seed: int = 0,
    save_every: int = 1,
    save_at: Any = None,
    increments: Any = None,
    refine: int = 0,
    first_path: int = 0,
    first_step: int = 0,
    correction: str = "auto",
    truncation: tuple[float, float] | None = None,
    areas: str = "path",
    area_time: float | None = None,
    damping_noise: str = "law",
    common_noise: int | Sequence[int] = (),
    compensated: bool = False,
    threads: int | None = None,
    progress: Progress = False,
    general: bool = False,
    fixed_point: int = 0,
    max_iter: int = 100,
    lanes: int | None = None,
    q0_low: Any = None,
    p0_low: Any = None,
) -> Run:
    """Integrate paths and save them every `save_every` steps. All quantities are dimensionless.

    Path i depends on (seed, i, model, initial state, t0, scheme, step, refine, options) and on the build alone.
    Threads, lanes and the number of paths change no bit of it.

    - q0, p0: initial state, a number, (dof,) for all paths, (dof, path), or a law of `symsde.states`
    - step: h, may be negative; steps: their number, a multiple of save_every; t0: time of step 0
    - save_at: times to save in the place of every save_every-th, (time,), each t0 + n*step, in the order of the run. In
      between all multiples of their largest common divisor are held
    - scheme: a name (`symsde.schemes.names()`) or a Scheme
    - paths, first_path: global indices first_path .. first_path + paths - 1
    - seed: 0 .. 2^64 - 1
    - increments: your own dW, (steps*2^refine, noise, path), or (steps*2^refine, noise) for all paths; for schemes that
      use them, dZ of all noises as further columns, then K, and with damping_noise="path" E, the integral of
      exp(-gamma (t_n + step - s)) dW(s) over each row. Any order of memory will do: dw.transpose(1, 2, 0) of an array
      (path, row, noise). Large arrays are not copied: leave them as they are while the run is analysed
    - refine: l > 0 drives a step by the sum of 2^l draws; l < 0 halves increments -l times by the Brownian bridge. With
      l < 0 schemes share a path only if they use the same functionals of it (`report.functionals`); with l >= 0 all do
    - first_step: absolute index n of the first step, which chooses its noise; its time is t0 + n*step. With q0, p0 =
      last_q, last_p and t0 of an earlier run of n steps, it continues that run, as `run.extend(steps)` does
    - correction: of one-sided schemes, "auto", "none", "mean" or "increments"
    - truncation: (order, time scale) of truncated increments
    - areas: how Levy areas are drawn: "path", from the Brownian path, or "law", which has the right law at bounded cost
    - area_time: time scale of areas from the path, area_time/(12 step) sub-increments a step; by default derived from
      the model
    - damping_noise: of schemes of kicks between linear damped drifts, the noise that these get: its law from dW and dZ
      ("law2"), or from dW, dZ and K ("law3"), by default "law", the one whose functionals the scheme draws; "path",
      that of the path itself, so that steps of any length agree, with one rate; or "polynomial", weights as without
      damping. Without one rate the law is that of constant noises
    - common_noise: numbers k, 1 to 64, of noises that all paths share: every path gets the W_k of path 0, with
      its functionals. All other noises are independent between paths. Standard errors of moments are then those given
      the common noises
    - compensated: compensated summation of the state; q0_low, p0_low, (dof, path), resume such a run
    - threads: by default SYMSDE_NUM_THREADS, else the choice of OpenMP; one for Python functions and in forked
      processes
    - progress: True shows a bar; a function f(done, total) may return True to stop the run
    - general: use the general stepper; fixed_point: number of fixed-point iterations in place of Newton's;
      max_iter: most Newton iterations in a step; lanes: size of a block, never changes a result

    Bad input raises a ValueError (`symsde.errors`) that says what is allowed; nothing is computed. Ctrl-C stops the run
    and raises KeyboardInterrupt. Its attribute `partial` is the Run until then, with NaN at times that were not
    reached, or None before the run began. An exception raised by the handler of another signal has `partial` too. Paths
    that fail are NaN from then on, and a PathsFailedWarning says how many failed.
    """
    given = locals()  # all arguments, by name
    del given["progress"]
    run = None
    try:
        run = Run(setup_of(given))
        run.setup.warn_of_repeated_noise()
        run.fill(progress)
    except BaseException as stop:
        carry(stop, lambda: filled(run))
        raise
    return run
