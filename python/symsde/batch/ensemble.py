# SPDX-License-Identifier: BSD-3-Clause
"""Moments of a large ensemble on any executor of Python, with the bits of one run."""

from __future__ import annotations

import dataclasses
import time
import warnings
from concurrent.futures import Executor
from typing import Any, Unpack

from ..errors import OF_RUNS, NotANumberWarning, PathsFailedWarning, SymsdeError, WrongTypeError
from ..model.definition import Model
from ..native import abi, checks
from ..native.handles import status_text
from ..native.progress import Progress, told_by
from ..native.signals import carry
from ..run.moments import Moments
from ..run.observers import requests
from ..run.observers.observables import Observable, are_in_python, check_observables
from ..run.setup import RunOptions, make_setup
from .dispatch import Context, dispatch
from .execute import Task
from .merged_results import MomentsInWork
from .pieces import Extent, Piece, plan
from .pieces import shard_paths as paths_of_a_shard
from .shard_file import Shard
from .show import Show
from .stop import Stop


class _Memory:
    """Shards that become moments as they come."""

    def __init__(self, work: MomentsInWork):
        self._work = work
        self.paths = 0

    @staticmethod
    def is_done(_piece: Piece) -> bool:
        """None was there before."""
        return False

    @staticmethod
    def claim(_piece: Piece) -> bool:
        """All are ours."""
        return True

    @staticmethod
    def release(_piece: Piece) -> None:
        """Nobody else waits."""

    @staticmethod
    def set_aside(_piece: Piece, _part: Shard) -> None:
        """Moments are those of whole shards."""

    @staticmethod
    def checkpoint(_piece: Piece) -> None:
        """Nothing is kept of what is not done."""
        return None

    def write(self, piece: Piece, shard: Shard) -> None:
        """Merge it."""
        self._work.add(piece, shard)
        self.paths += piece.paths


@checks.hinted(*RunOptions.__annotations__)
def ensemble(
    model: Model,
    *,
    q0: Any,
    p0: Any,
    step: float,
    steps: int,
    observables: dict[str, Observable] | None = None,
    observers: dict[str, requests.Observer] | None = None,
    executor: Executor | None = None,
    shard_paths: int | None = None,
    progress: Progress = False,
    **options: Unpack[RunOptions],
) -> Moments:
    """Compute the same moments as `moments`, bit for bit, in shards that an executor distributes.

    - executor: one of `concurrent.futures`, or something with the same interface: a process pool,
      mpi4py.futures.MPIPoolExecutor, Dask's client.get_executor(). Each shard is one task on one thread. Model and
      observables must be picklable for other processes. By default threads of this process are used. The executor is
      not shut down.
    - shard_paths: paths of a shard, 256 times a power of two; by default some seconds of work
    - progress: True, or a function f(done, total) of path-steps that may return True to stop
    - the other arguments are those of `moments`

    After a stop the moments are those of the finished shards, and `report.stopped` counts the paths that are missing.
    Ctrl-C, or a signal whose handler raises, ends the call by an exception. Its attribute `partial` holds these
    moments, or None if no shard was finished.
    """
    bar, tell = told_by(progress)
    if executor is not None and not callable(getattr(executor, "submit", None)):
        raise WrongTypeError(
            f"executor = {checks.shown(executor)} takes no work: give an executor of concurrent.futures, an object "
            "with the same method submit, or None for threads of this process"
        )
    functions = check_observables(observables)
    given = checks.own({"q0": q0, "p0": p0, "step": step, "steps": steps, **options})
    setup = make_setup(model, in_python=are_in_python(functions), **given)
    setup.warn_of_repeated_noise()
    size = _size(setup, shard_paths)
    pieces = plan(_extent(setup), size, moments=True, saved=())
    task = Task(model, given, functions, requests.check_observers(observers))
    work = MomentsInWork(task, size)
    memory = _Memory(work)
    show = Show(sum(piece.work for piece in pieces), 0, tell)
    begin = time.monotonic()
    try:
        with warnings.catch_warnings():
            for said in OF_RUNS:  # once, here
                warnings.simplefilter("ignore", said)
            done = dispatch(task, pieces, Context(memory, Stop(), show), executor)
    except BaseException as stop:
        carry(stop, lambda: _found(work, setup.paths - memory.paths, begin) if memory.paths else None)
        raise
    finally:
        if bar:
            bar.close()
    if not memory.paths:
        raise SymsdeError("the ensemble was stopped before any of its shards was done: there are no moments")
    found = _found(work, 0 if done else setup.paths - memory.paths, begin)
    if found.report.failed:
        checks.warn(
            f"{checks.counted(found.report.failed, 'path')} failed: they are left out of moments; see failed "
            "and failed_step",
            PathsFailedWarning,
        )
    for doubt in found.doubts():
        checks.warn(doubt, NotANumberWarning)
    return found


def _found(work: MomentsInWork, missing: int, begin: float) -> Moments:
    """Moments of the shards that were done, and how many paths are not among them."""
    found = work.result(time.monotonic() - begin)
    if missing:
        found.report = dataclasses.replace(
            found.report, stopped=missing, status=abi.STOPPED, outcome=status_text(abi.STOPPED)
        )
    return found


def _extent(setup) -> Extent:
    options = setup.options
    return Extent(options.first_path, options.paths, options.steps, setup.ntime, setup.model.ndof)


def _size(setup, wanted: int | None) -> int:
    return paths_of_a_shard(_extent(setup), wanted)
