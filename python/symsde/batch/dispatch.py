# SPDX-License-Identifier: BSD-3-Clause
"""Compute pieces on threads of this process or on an executor, and store the shard of each piece when it is
done."""

from __future__ import annotations

import functools
import os
import pickle
import time
from collections import deque
from collections.abc import Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from typing import Protocol

from ..errors import WrongTypeError
from ..native.library import processors, unbind
from ..run.observers.observables import are_in_python
from .execute import Checkpoint, Task, compute
from .pieces import Piece
from .run_progress import Show
from .shard_file import Shard
from .stop import Stop

_LOOK = 0.2  # seconds between looks at signals and progress
_ELSEWHERE = 0.5  # seconds between checks for shards of other processes


class ShardStore(Protocol):
    """A store of shards: a folder, or memory."""

    def is_done(self, piece: Piece) -> bool:
        """Whether the shard of the piece is stored."""

    def claim(self, piece: Piece) -> bool:
        """Claim a piece; return false if another process has it."""

    def release(self, piece: Piece) -> None:
        """Release the claim."""

    def write(self, piece: Piece, shard: Shard) -> None:
        """Store a shard."""

    def set_aside(self, piece: Piece, part: Shard) -> None:
        """Store the unfinished moments of a piece that was stopped."""

    def checkpoint(self, piece: Piece) -> Checkpoint | None:
        """The checkpoint of a long piece; None if it has none."""


@dataclass(frozen=True)
class Context:
    """What the work uses: the store of the shards, the conditions of the end, and the receiver of progress."""

    shards: ShardStore
    stop: Stop
    show: Show


def dispatch(task: Task, pieces: Sequence[Piece], context: Context, executor: Executor | None = None) -> bool:
    """Compute the pieces without a shard; return whether all shards are there at the end. Pieces of other
    processes are waited for, and computed here if those processes die."""
    shards = context.shards
    todo = [piece for piece in pieces if not shards.is_done(piece)]
    if not todo:
        return True
    if executor is not None:
        here = _Many(task, executor, _workers_of(executor))
        return _Loop(todo, context, here).run()
    workers, threads = division(task, len(todo))
    with own_threads(workers) as own:
        here = _Here(task, own, (workers, threads), context)
        return _Loop(todo, context, here).run()


def own_threads(workers: int) -> ThreadPoolExecutor:
    """Threads for pieces, which are not bound to the processor of the thread that starts them."""
    return ThreadPoolExecutor(workers, initializer=unbind)


def division(task: Task, pieces: int) -> tuple[int, int | None]:
    """Number of pieces computed at a time, and of threads for each."""
    if task.model.in_python or are_in_python(task.observables):
        return 1, task.options.get("threads")  # callbacks in Python: one thread, unless more are requested
    threads = _threads(task.options.get("threads"))
    if threads is None:
        return 1, None
    workers = min(threads, pieces)
    return workers, max(1, threads // workers)


def _threads(given: int | None) -> int | None:
    """The number of threads of this process: from the option, SYMSDE_NUM_THREADS, OMP_NUM_THREADS, or its
    processors; None if a variable has a wrong value, which the library refuses."""
    if given is not None:
        return int(given)
    for name in ("SYMSDE_NUM_THREADS", "OMP_NUM_THREADS"):
        if text := os.environ.get(name):
            return int(text) if text.isdigit() and 1 <= int(text) <= 1024 else None
    return len(processors())


def _workers_of(executor: Executor) -> int:
    """How many tasks an executor runs at a time, if known."""
    return max(1, getattr(executor, "_max_workers", None) or os.cpu_count() or 1)


class _Here:
    """Compute pieces on threads of this process; the pieces report progress and can be stopped before their end."""

    def __init__(self, task: Task, executor: Executor, division: tuple[int, int | None], context: Context):
        workers, self._threads = division
        self.window = workers + 1  # one piece more, so that no thread idles while a shard is written
        self._task, self._executor, self._context = task, executor, context

    def submit(self, piece: Piece) -> Future:
        """Start a piece."""
        return self._executor.submit(self._compute, piece)

    def _compute(self, piece: Piece) -> Shard | None:
        context = self._context
        if context.stop.reason:
            return None
        begun, found = time.monotonic(), []

        def tell(done: int, _total: int) -> bool:
            context.show.piece(piece.name, done)
            found[:] = found or [done]  # steps that were there took none of this time
            return context.stop.gives_up(done - found[0], piece.work - found[0], begun)

        return compute(self._task, piece, self._threads, tell, context.shards.checkpoint(piece))


def _result_of(future: Future) -> Shard | None:
    """The shard of a finished task; an error of pickling says which object cannot be sent to another process."""
    try:
        return future.result()
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        if "pickle" not in str(error):
            raise
        raise WrongTypeError(
            f"the executor cannot send the work to its processes ({error}): define the functions of the model and the "
            "observables at the top of a module, or give formulas"
        ) from error


class _Many:
    """Compute pieces on an executor, which may use other processes or machines: each piece is done completely or
    not at all."""

    def __init__(self, task: Task, executor: Executor, workers: int):
        self.window = 2 * workers
        self._compute = functools.partial(compute, task, threads=1)
        self._executor = executor

    def submit(self, piece: Piece) -> Future:
        """Start a piece."""
        return self._executor.submit(self._compute, piece)


class _Loop:
    """The loop over the pieces that are still to do, the pieces computed here, and the pieces of other processes."""

    def __init__(self, todo: list[Piece], context: Context, here: _Here | _Many):
        self._todo = deque(todo)
        self._elsewhere: list[Piece] = []
        self._running: dict[Future, Piece] = {}
        self._shards, self._stop, self._show, self._here = context.shards, context.stop, context.show, here
        self._took = 0.0
        self._begun: dict[str, float] = {}

    def run(self) -> bool:
        """Work until all pieces are done, or until a stop lets no more begin."""
        try:
            while self._todo or self._running or self._elsewhere:
                self._begin_some()
                if self._running:
                    self._collect(wait(self._running, timeout=_LOOK, return_when=FIRST_COMPLETED).done)
                elif not self._stop.leaves_time_for(self._took):
                    return False
                elif self._elsewhere:
                    time.sleep(_ELSEWHERE)
                    self._look_elsewhere()
                if self._show():
                    self._stop.abandon()
        except BaseException:
            self._stop.abandon()
            raise
        finally:
            self._leave()
        return True

    def _begin_some(self) -> None:
        while self._todo and len(self._running) < self._here.window and self._stop.leaves_time_for(self._took):
            piece = self._todo.popleft()
            if not self._shards.claim(piece):
                self._elsewhere.append(piece)
            elif self._shards.is_done(piece):  # another process has finished the piece meanwhile
                self._shards.release(piece)
                self._show.finish(piece.name, piece.work)
            else:
                self._begun[piece.name] = time.monotonic()
                self._running[self._here.submit(piece)] = piece

    def _collect(self, done: set[Future]) -> None:
        for future in done:
            piece = self._running.pop(future)
            try:
                shard = _result_of(future)
                if shard is None or "stopped" in shard.facts:
                    if shard is not None:
                        self._shards.set_aside(piece, shard)
                    self._todo.append(piece)
                    continue
                self._shards.write(piece, shard)
            finally:
                self._shards.release(piece)
            self._took = max(self._took, time.monotonic() - self._begun[piece.name])
            self._show.finish(piece.name, piece.work)

    def _look_elsewhere(self) -> None:
        """Check pieces of other processes: pieces with a shard are done, all others are tried again."""
        for piece in self._elsewhere:
            if self._shards.is_done(piece):
                self._show.finish(piece.name, piece.work)
            else:
                self._todo.append(piece)
        self._elsewhere = []

    def _leave(self) -> None:
        """Cancel or finish all tasks of this call."""
        for future in self._running:
            future.cancel()
        wait(self._running)
        for piece in self._running.values():
            self._shards.release(piece)
