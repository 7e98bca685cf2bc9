# SPDX-License-Identifier: BSD-3-Clause
"""Estimate a run before it begins: steps, files, memory, disk, and time by a short pilot run."""

from __future__ import annotations

import math
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from ..native.checks import counted
from ..run.moments import moments
from ..run.setup import make_setup
from ..show import tables
from .dispatch import division
from .execute import Task
from .pieces import Piece

_PILOT = 0.3  # seconds of the pilot run
_FILE, _FILES = 2500, 15000  # bytes of a shard, and of results and manifest, besides their numbers
_BASE = 6e7  # bytes of an interpreter with NumPy and the library
_PILOT_PATHS = 2048


@dataclass(frozen=True)
class Need:
    """The estimated needs of a run."""

    path_steps: int
    shards: int
    shard_paths: int
    workers: int
    memory: float  #: rough number of bytes of memory of this process
    disk: float  #: number of bytes on disk
    seconds: float  #: seconds on the threads of this process
    there: int = 0  #: number of shards that the folder holds already
    free: float = math.inf  #: number of free bytes in the folder of the results; infinite if it is not known

    def __str__(self) -> str:
        """The estimate, with a line for each item."""
        lines = {
            "path-steps": f"{self.path_steps:.4g}",
            "shards": f"{self.shards}, of {counted(self.shard_paths, 'path')} at most"
            + (f", beside {self.there} that the folder holds" if self.there else ""),
            "memory": f"about {_bytes(self.memory)}",
            "disk": f"about {_bytes(self.disk)}{self._of_what_is_free()}",
            "time": f"about {_time(self.seconds)} here, {counted(self.workers, 'shard')} at a time",
        }
        return tables.facts(lines.items())

    def _of_what_is_free(self) -> str:
        if self.free == math.inf:
            return ""
        if self.disk <= self.free:
            return f", {_bytes(self.free)} are free"
        return f", but {_bytes(self.free)} are free: save fewer paths or less often (save_every), or give another --out"


def _free(folder: Path) -> float:
    """Free bytes where a folder is or will be, if the system reports them."""
    there = next((place for place in (folder, *folder.parents) if place.exists()), None)
    try:
        return math.inf if there is None else float(shutil.disk_usage(there).free)
    except OSError:
        return math.inf


def need(
    task: Task,
    pieces: list[Piece],
    shard_paths: int,
    saved: int,
    out: Path | None = None,
    *,
    left: Mapping[str, int] | None = None,
) -> Need:
    """Memory and disk of the pieces that are to be computed. saved: number of saved times; out: folder of the results;
    left: path-steps to take of each piece that it lacks, by default of all."""
    whole = len(pieces)
    if left is not None:
        pieces = [piece for piece in pieces if piece.name in left]
    ndof = task.model.ndof
    each = 2 * (2 * ndof + task.model.traits.has_value) + 2
    numbers = saved * each + _observed(task)
    of_moments = [piece for piece in pieces if piece.kind == "moments"]
    paths = sum(piece.paths for piece in pieces if piece.kind == "paths")
    largest = max((piece.paths for piece in pieces if piece.kind == "paths"), default=0)
    workers, threads = division(task, max(1, len(pieces)))
    levels = len(of_moments).bit_length() + 3 * workers + 4 if of_moments else 0
    steps = sum(piece.work if left is None else left[piece.name] for piece in pieces)
    setup = make_setup(task.model, **task.options)
    between = setup.whole().ntime if setup.saved is not None and of_moments else 0
    return Need(
        path_steps=steps,
        shards=len(pieces),
        there=whole - len(pieces),
        shard_paths=shard_paths,
        workers=workers,
        memory=_BASE
        + 8.0 * (numbers * levels + 4 * workers * between * each)
        + 3.0 * workers * _last(task) * max((piece.paths for piece in of_moments), default=0)
        + 16.0 * saved * ndof * (2 * paths + 3 * workers * largest),
        disk=_FILES
        + len(pieces) * _FILE
        + 8.0 * numbers * (len(of_moments) + 8)
        + 32.0 * saved * ndof * paths
        + _last(task) * sum(piece.paths for piece in of_moments),
        seconds=steps / (_rate(task, pieces[0]) * workers * (threads or 1)) if steps else 0.0,
        free=math.inf if out is None else _free(out.absolute()),
    )


def _observed(task: Task) -> int:
    """Numbers that observers keep for a piece."""
    rooms = task.moments().kept.values()
    return sum(room.counts.size + room.sums.size for room in rooms)


def _last(task: Task) -> int:
    """Bytes of the last state and the status of a path, if shards of moments hold them."""
    return (4 + 16 * task.model.ndof * (2 if task.options.get("compensated") else 1)) if task.keep_last else 0


def _rate(task: Task, piece: Piece) -> float:
    """Path-steps per second on one thread, measured on some paths with ever more steps, until a run is long enough."""
    few = Piece(piece.name, piece.kind, piece.first // 256 * 256, min(piece.paths, _PILOT_PATHS), 0)
    options = task.of(few, 1)
    observers = {name: x for name, x in task.observers.items() if x.KIND != "autocorrelation"}  # others use all times
    shown = {"observables": task.observables or None, "observers": observers}
    steps, most = 1, int(options["steps"])
    setup = make_setup(task.model_of(few), **options)
    every = most + 1 if setup.saved is None else setup.options.save_every  # moments are collected so often
    while True:
        here = {**options, "steps": steps, "save_every": steps if steps % every else every, "save_at": None}
        took = moments(task.model_of(few), **shown, **here).report.timings["run"]
        if took > _PILOT or steps == most:
            return few.paths * steps / max(took, 1e-6)
        steps = min(most, steps * max(2, min(16, int(_PILOT / max(took, 1e-6)))))
        steps -= steps % every if steps > every else 0


def _bytes(count: float) -> str:
    for unit in ("bytes", "kB", "MB", "GB"):
        if count < 1000:
            return f"{count:.3g} {unit}"
        count /= 1000
    return f"{count:.3g} TB"


def _time(seconds: float) -> str:
    for unit, size in (("days", 86400), ("hours", 3600), ("minutes", 60)):
        if seconds > 2 * size:
            return f"{seconds / size:.1f} {unit}"
    return f"{seconds:.2g} seconds"
