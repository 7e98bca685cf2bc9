# SPDX-License-Identifier: BSD-3-Clause
"""Moments of a large ensemble on any executor of Python, with the bits of one run."""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import json
import os
import time
from collections.abc import Iterator
from concurrent.futures import Executor
from typing import Any, Unpack

import numpy as np

from ..errors import DoubtfulRunWarning, NotANumberWarning, PathsFailedWarning, SymsdeError, WrongTypeError
from ..model.definition import Model
from ..native import checks, files
from ..native.progress import Progress, told_by
from ..native.signals import carry
from ..run.moments import Moments
from ..run.observers import requests
from ..run.observers.observables import Observable, are_in_python, check_observables
from ..run.options import RunOptions
from ..run.report import warn_of_growth
from ..run.setup import Setup, make_setup
from ..run.states.law import States
from . import computed, manifest, numerics
from .dispatch import Context, dispatch
from .execute import Task
from .folder import RunFolder
from .merged_results import MomentsInWork
from .pieces import Extent, Piece, plan
from .pieces import shard_paths as paths_of_a_shard
from .run_progress import Show
from .shard_file import Shard
from .stop import Stop


class _Memory:
    """A store that merges shards into moments as they arrive, and keeps them in a folder if there is one."""

    def __init__(self, work: MomentsInWork):
        self._work = work
        self._added: set[str] = set()
        self.paths = 0
        self.folder: RunFolder | None = None

    def is_done(self, piece: Piece) -> bool:
        """Whether the shard is there; a shard of the folder is merged when it is first seen."""
        if piece.name not in self._added and self.folder is not None and self.folder.is_done(piece):
            self._add(piece, self.folder.read(piece))
        return piece.name in self._added

    def claim(self, piece: Piece) -> bool:
        """Claim a piece; true unless another process that uses this folder has it."""
        return self.folder is None or self.folder.claim(piece)

    def release(self, piece: Piece) -> None:
        """Release the piece for other processes that use this folder."""
        if self.folder is not None:
            self.folder.release(piece)

    @staticmethod
    def set_aside(_piece: Piece, _part: Shard) -> None:
        """Do nothing: moments contain whole shards only."""

    @staticmethod
    def checkpoint(_piece: Piece) -> None:
        """Return None: this store keeps no checkpoints."""
        return None

    def write(self, piece: Piece, shard: Shard) -> None:
        """Store a shard and merge it."""
        if self.folder is not None:
            self.folder.write(piece, shard)
        self._add(piece, shard)

    def _add(self, piece: Piece, shard: Shard) -> None:
        self._added.add(piece.name)
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
    out: str | os.PathLike | None = None,
    progress: Progress = False,
    **options: Unpack[RunOptions],
) -> Moments:
    """Compute the same moments as `moments`, bit for bit, in shards that an executor distributes.

    - executor: an executor of `concurrent.futures`, or an object with the same interface: a process pool,
      mpi4py.futures.MPIPoolExecutor, Dask's client.get_executor(). Each shard is one task on one thread. Model and
      observables must be picklable for other processes. By default threads of this process are used. The executor is
      not shut down.
    - shard_paths: paths of a shard, 256 times a power of two; by default some seconds of work
    - out: a folder that keeps the shards that are done. The same call goes on from there after a stop, or after a
      process of the executor died; several processes can share the folder. Another call is refused
    - progress: True, or a function f(done, total) of path-steps that may return True to stop
    - the other arguments are those of `moments`

    After a stop the moments are those of the finished shards, and `report.stopped` counts the paths that are missing.
    Ctrl-C, or a signal whose handler raises, ends the call by an exception. Its attribute `partial` holds these
    moments, or None if no shard was finished.
    """
    bar, tell = told_by(progress)
    if callable(getattr(executor, "get_executor", None)):
        raise WrongTypeError(
            f"executor = {checks.shown(executor)} is a client of Dask, whose tasks are no futures of "
            "concurrent.futures: give client.get_executor()"
        )
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
    wanted = requests.check_observers(observers)
    requests.warn_of_unsaid(wanted, beside=bool(functions))
    task = Task(model, given, functions, wanted)
    work = MomentsInWork(task, size)
    memory = _Memory(work)
    begin = time.monotonic()

    def merged(missing: int) -> Moments:
        """Moments of the finished shards, with the number of missing paths."""
        return work.result(time.monotonic() - begin, missing=missing)

    try:
        with _kept(out, task, setup, size, pieces) as folder, checks.unwarned():  # warnings follow, once
            memory.folder = folder
            found = [piece for piece in pieces if memory.is_done(piece)]
            show = Show(sum(piece.work for piece in pieces), sum(piece.work for piece in found), tell)
            done = dispatch(task, pieces, Context(memory, Stop(), show), executor)
    except BaseException as stop:
        carry(stop, lambda: merged(setup.paths - memory.paths) if memory.paths else None)
        raise
    finally:
        if bar:
            bar.close()
    if not memory.paths:
        raise SymsdeError("the ensemble was stopped before any of its shards was done: there are no moments")
    found = merged(0 if done else setup.paths - memory.paths)
    if found.report.failed:
        checks.warn(
            f"{checks.counted(found.report.failed, 'path')} failed: they are left out of moments; see failed "
            "and failed_step",
            PathsFailedWarning,
        )
    for doubt in found.report.warnings:
        if doubt != setup.repeated_noise():  # warned before
            checks.warn(doubt, DoubtfulRunWarning)
    warn_of_growth(found.report.grown)
    for doubt in found.doubts():
        checks.warn(doubt, NotANumberWarning)
    return found


@contextlib.contextmanager
def _kept(
    out: str | os.PathLike | None, task: Task, setup: Setup, size: int, pieces: list[Piece]
) -> Iterator[RunFolder | None]:
    """The folder for the shards, or None if no folder is given; a folder of another run is refused."""
    if out is None:
        yield None
        return
    start = computed.Start(*setup.first_state(), setup.options.t0, setup.options.step * setup.options.steps)
    functions = {name: x for name, x in task.observables.items() if callable(x)}
    formulas = {name: str(x) for name, x in task.observables.items() if not callable(x)}
    arrays = setup.start() | {name: getattr(setup, name) for name in ("q0_low", "p0_low", "increments")}
    inputs = {
        "ensemble": json.loads(setup.attributes()["options"]),
        "arrays": {name: _hash(x) for name, x in arrays.items() if x is not None},
        "observables": formulas,
        "observers": {name: {"kind": x.KIND, **dataclasses.asdict(x)} for name, x in task.observers.items()},
        "computed": computed.of(task.model, setup.scheme, start, functions),
    }
    inputs = json.loads(json.dumps(inputs))  # converted to the types of a manifest
    found = numerics.of(task.model, [setup.scheme], start, **task.options)
    record = manifest.of_inputs(inputs, setup.options.seed, size, found)
    with RunFolder.open_to_write(os.fspath(files.path_of("out", out)), record, pieces, None) as folder:
        yield folder


def _hash(array: np.ndarray | States) -> str:
    """The shape of an array, and a hash of its numbers; a law as text."""
    if isinstance(array, States):
        return json.dumps(array.told())
    return f"{array.shape} {hashlib.sha256(np.ascontiguousarray(array, '<f8').tobytes()).hexdigest()[:16]}"


def _extent(setup) -> Extent:
    options = setup.options
    return Extent(options.first_path, options.paths, options.steps, setup.ntime, setup.model.ndof)


def _size(setup, wanted: int | None) -> int:
    return paths_of_a_shard(_extent(setup), wanted)
