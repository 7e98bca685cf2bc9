# SPDX-License-Identifier: BSD-3-Clause
"""A prepared run: checks, probes and allocations once, then any number of steps."""

from __future__ import annotations

import ctypes
import weakref
from typing import Any, Unpack

import numpy as np

from ..errors import IncompatibleError, PathsFailedWarning, WrongTypeError, from_code
from ..model.definition import Model
from ..native import abi, checks, handles
from ..native.checks import INT64, UINT64, address
from ..native.library import library
from ..native.progress import Monitor, Progress
from ..native.signals import carry, held
from ..schemes import Scheme
from .increments import increments_array, put_increments
from .options import PathOptions
from .report import Report, filled, make_report, warn_of_growth
from .setup import Setup, kind_of_setup, make_setup
from .simulate import Run
from .states.law import States

_DECIDED = dict.fromkeys(("steps", "save_every", "save_at", "increments", "progress"), "give it to the run's methods")
_OK = (abi.OK, abi.STOPPED, abi.PATHS_FAILED)


class _Owner:
    """Owns the handle of a run as long as the run or one of its arrays is alive; and a handle of its model,
    whose callbacks store their exceptions for this run only."""

    def __init__(self, model: Model, setup: Setup):
        self.model_handle = model._handles.take()
        self.pointer = ctypes.c_void_p()
        finalizer = weakref.finalize(self, _release, self.pointer, model._handles, self.model_handle)
        finalizer.atexit = False
        with held(), Monitor(False) as monitor:
            try:
                handles.call(
                    "run_new",
                    self.model_handle.pointer,
                    *setup.handles(),
                    ctypes.byref(setup.input(monitor)),
                    ctypes.byref(self.pointer),
                )
            finally:
                self.model_handle.failures.raise_stored()

    def array(self, where: int | None, kind: type, shape: tuple[int, ...]) -> np.ndarray | None:
        """The library's array at an address; the array keeps this owner alive."""
        if where is None:
            return None
        count = 1
        for extent in shape:
            count *= extent
        buffer = (kind * count).from_address(where)
        buffer.owner = self
        return np.frombuffer(buffer, kind).reshape(shape)


def _release(pointer: ctypes.c_void_p, pool: handles.Pool, model_handle: handles.Handle) -> None:
    library.symsde_run_delete(ctypes.byref(pointer))
    pool.give(model_handle)


class PreparedRun:
    """Paths that advance on request; made by `prepare`. Only one thread at a time may use a run.

    q, p (and q_low, p_low of a compensated run) are the state itself, not copies: values that you write there are the
    state from which the next step begins. Steps in several calls give the same bits as in one call. A path that fails
    keeps its status, step and last good state until `reset`.
    """

    def __init__(self, setup: Setup):
        """Prepare the run of a setup; see `prepare`."""
        self._setup = setup
        self._owner = _Owner(setup.model, setup)
        self._pointer = self._owner.pointer
        self._state = handles.new(abi.State, "state")
        self._read_state()
        state, (ndof, paths) = self._state, (setup.model.ndof, setup.paths)
        make = self._owner.array
        self._q, self._p = (make(x, ctypes.c_double, (ndof, paths)) for x in (state.q, state.p))
        self._q_low, self._p_low = (make(x, ctypes.c_double, (ndof, paths)) for x in (state.q_low, state.p_low))
        self._status = make(state.status, ctypes.c_int32, (paths,))
        self._failed_step = make(state.failed_step, ctypes.c_int64, (paths,))
        self._status.flags.writeable = self._failed_step.flags.writeable = False
        self._in_python = setup.model.in_python
        self._error = abi.Error()
        self._error_address = ctypes.byref(self._error)
        self._dw: np.ndarray | None = None
        self._drive: abi.Input | None = None
        self._stopped: Run | None = None
        self._failed = 0

    q = property(lambda self: self._q, doc="(dof, path), where the paths are; write into it to move them.")
    p = property(lambda self: self._p, doc="(dof, path).")
    q_low = property(lambda self: self._q_low, doc="(dof, path), low part of q; None unless compensated.")
    p_low = property(lambda self: self._p_low, doc="(dof, path), low part of p; None unless compensated.")
    status = property(lambda self: self._status, doc="(path,), 0 = ok; `symsde.status_text` tells the others.")
    failed_step = property(lambda self: self._failed_step, doc="(path,), absolute step that failed; -1 = none.")
    model = property(lambda self: self._setup.model, doc="The model.")
    scheme = property(lambda self: self._setup.scheme, doc="The scheme.")

    @property
    def next_step(self) -> int:
        """Absolute index of the next step; for a stopped run, the index after `resume`."""
        self._read_state()
        return self._state.next_step

    @property
    def t(self) -> float:
        """Time before the next step: t0 + next_step*step."""
        self._read_state()
        return self._state.t

    @property
    def report(self) -> Report:
        """Counters and seconds of all calls, the outcome of the last call, and warnings computed for a million
        steps.
        """
        report = handles.new(abi.Report, "report")
        handles.call("run_report", self._pointer, ctypes.byref(report))
        return make_report(report)

    def step(self, dw: Any = None) -> None:
        """Take one step with the run's own noise, or with increments dw: a number, (noise,) or (noise, path)."""
        given = None if dw is None else self._one_step(dw)
        advance = self._advance_by_python if self._in_python else library.symsde_run_advance
        status = advance(self._pointer, 1, 1, given, None, self._error_address)
        if status:
            self._judge(status)

    def run(self, steps: int, save_every: int = 1, *, increments: Any = None, progress: Progress = False) -> Run:
        """Take `steps` more steps. Save the first state and the state after every `save_every` steps.

        increments: your own dW, shape (steps*2^refine, noise, path), or (steps*2^refine, noise) for all paths. Ctrl-C
        stops the run, and so does a progress function that returns True. `resume` then completes it.
        """
        setup = self._setup_of(checks.integer("steps", steps), checks.integer("save_every", save_every))
        if increments is not None:
            setup.increments = increments_array(increments)
        return self._fill(Run(setup), "run_advance", setup.options.steps, setup.options.save_every, progress=progress)

    def resume(self, *, progress: Progress = False) -> Run:
        """Complete a `run` that was stopped, and return its whole result."""
        if self._stopped is None:
            raise IncompatibleError("no call of run was stopped: there is nothing to resume")
        return self._fill(self._stopped, "run_resume", progress=progress)

    def reset(
        self,
        q0: Any = None,
        p0: Any = None,
        *,
        q0_low: Any = None,
        p0_low: Any = None,
        seed: int | None = None,
        first_path: int | None = None,
        first_step: int | None = None,
    ) -> None:
        """Start again, with all paths ok. Arguments that are not given keep their values of the last reset, or of
        `prepare`.
        """
        old = self._setup
        given = {"q0": q0, "p0": p0, "q0_low": q0_low, "p0_low": p0_low}
        chosen = {**old.start(), "q0_low": old.q0_low, "p0_low": old.p0_low}
        for name, value in given.items():
            if value is not None:
                is_law = isinstance(value, States) and name in ("q0", "p0")
                chosen[name] = value if is_law else checks.state(name, value, old.model.ndof, old.paths)
        options = abi.Options.from_buffer_copy(old.options)
        for name, value, bounds in (
            ("seed", seed, UINT64),
            ("first_path", first_path, INT64),
            ("first_step", first_step, INT64),
        ):
            if value is not None:
                setattr(options, name, checks.integer(name, value, bounds))
        kind = kind_of_setup(chosen["q0"], chosen["p0"])
        setup = kind(model=old.model, scheme=old.scheme, options=options, **chosen)
        handles.call(
            "run_reset",
            self._pointer,
            ctypes.byref(setup.input()),
            options.seed,
            options.first_path,
            options.first_step,
        )
        self._setup, self._stopped, self._failed = setup, None, 0

    def __reduce__(self) -> tuple:
        """Refuse pickling and copying."""
        raise WrongTypeError(
            "a prepared run holds memory of the library, which can be neither pickled nor copied: prepare another one "
            "from the model, or pickle what its method run returns"
        )

    def __repr__(self) -> str:
        """The run in one line."""
        return (
            f"<prepared run of {self.model!r} by {self.scheme.name}: {checks.counted(self._setup.paths, 'path')}, step "
            f"{self.next_step} "
            f"comes next>"
        )

    def _read_state(self) -> None:
        handles.call("run_state", self._pointer, ctypes.byref(self._state))

    def _one_step(self, dw: Any):
        """The increments of one step as an input of the library."""
        if self._dw is None:
            self._dw = np.empty((1, self.model.nnoise, self._setup.paths))
            self._drive = handles.new(abi.Input, "input")
            put_increments(self._drive, self._dw)
            self._drive_address = ctypes.byref(self._drive)
        self._dw[0] = checks.state("dw", dw, *self._dw.shape[1:], kept=False)
        return self._drive_address

    def _setup_of(self, steps: int, save_every: int) -> Setup:
        """The setup of this many steps from here, for a Run that can be analysed later."""
        state = self._q, self._p, self._q_low, self._p_low
        return self._setup.from_here(self.next_step, steps, save_every, state)

    def _fill(self, run: Run, name: str, *steps: int, progress: Progress) -> Run:
        """Let the library advance, and save into a Run."""
        paths = handles.new(abi.Paths, "paths")
        paths.q, paths.p = address(run.q), address(run.p)
        try:
            with Monitor(progress) as monitor:
                given = handles.new(abi.Input, "input")
                given.progress = monitor.callback
                if run.setup.increments is not None:
                    put_increments(given, run.setup.increments)
                structs = (ctypes.byref(struct) for struct in (given, paths))
                status = getattr(library, f"symsde_{name}")(self._pointer, *steps, *structs, self._error_address)
                if status in (*_OK, abi.CALLBACK_FAILED):
                    self._stopped = run if status == abi.STOPPED else None
                    self._show_state(run)
                if status:
                    self._judge(status)
            warn_of_growth(run.report.grown)
        except BaseException as stop:
            carry(stop, lambda: filled(run))
            raise
        return run

    def _show_state(self, run: Run) -> None:
        """Write the present state and report into a Run."""
        run.status, run.failed_step = self._status.copy(), self._failed_step.copy()
        run.last_q, run.last_p = self._q.copy(), self._p.copy()
        if self._q_low is not None:
            run.q_low, run.p_low = self._q_low.copy(), self._p_low.copy()
        run.report = self.report

    def _advance_by_python(self, *arguments) -> int:
        """Advance a model with Python functions: handlers of signals wait for the end of the step."""
        with held():
            status = library.symsde_run_advance(*arguments)
            if status:
                self._judge(status)
        return abi.OK

    def _judge(self, status: int) -> None:
        """Raise the exception of a callback, or the library's refusal; warn of paths that have failed in the call."""
        self._owner.model_handle.failures.raise_stored()
        if status not in _OK:
            raise from_code(status, self._error.message.decode("utf-8", "replace"))
        failed = int(np.count_nonzero((self._status != 0) & (self._status != abi.STOPPED)))
        if failed > self._failed:
            self._failed = failed
            checks.warn(
                f"{failed} of {self._status.size} paths failed: they stay where they were, see status and "
                "failed_step, until the run is reset",
                PathsFailedWarning,
            )


@checks.hinted(*PathOptions.__annotations__)
def prepare(
    model: Model, scheme: str | Scheme = "midpoint", *, step: float, q0: Any, p0: Any, **options: Unpack[PathOptions]
) -> PreparedRun:
    """Make a `PreparedRun`: check the input, probe the model at (q0, p0) and allocate memory, all once.

        run = ss.prepare(model, "midpoint", step=0.01, q0=1.0, p0=0.0, paths=100, seed=1)
        for _ in range(1000):
            run.step()                        # or run.step(dw), with increments of your own
            run.p[...] *= 0.999               # between steps you may change the state
        saved = run.run(500, save_every=10)   # like simulate, from the present state
        run.reset()

    q0, p0, step and the options are those of `simulate`. steps, save_every, increments and progress are given to the
    methods instead. Each call of run or step continues with the noise of the next step. first_step is needed only to
    start in the middle of another run: it is then the index of that run's next step, and t0 is that run's t0; without
    it the noise of the first steps is used again. The run keeps model and scheme alive. With `threads` above 1, waking
    the threads takes longer than one step of a few paths.
    """
    checks.not_given("prepare", options, _DECIDED)
    return PreparedRun(make_setup(model, q0=q0, p0=p0, step=step, scheme=scheme, steps=0, **options))
