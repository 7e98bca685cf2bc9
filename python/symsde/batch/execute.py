# SPDX-License-Identifier: BSD-3-Clause
"""Compute one piece by one call of the library, or, if the piece is long, by many calls with checkpoints between
them."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from ..model.definition import Model
from ..native import checks
from ..run.groups import MEANS, Groups
from ..run.moments import Moments, moments_of
from ..run.observers import requests
from ..run.observers.observables import Observable
from ..run.observers.partial_statistics import PartialStatistics
from ..run.report import Report
from ..run.setup import make_setup
from ..run.simulate import Run, simulate
from . import longer
from .pieces import Piece
from .shard_file import Shard

Tell = Callable[[int, int], bool]  # (path-steps done, total) -> whether to stop now

_PER_PATH = ("q0", "p0", "q0_low", "p0_low", "increments")
_FIRST = 2**20  # path-steps times degrees of freedom before the clock is first read
_SEGMENT = 1.0  # seconds between two points at which a long piece may end
_STEADY = ("path_steps", "normals")  # counters that depend on the paths alone; other counters depend on blocks
_PATIENCE = 5.0  # seconds that a segment may take before it ends at a wish to stop


@dataclass(frozen=True)
class Task:
    """A run whose pieces can be computed anywhere, since the object can be pickled."""

    model: Model
    options: dict[str, Any]  #: options of `simulate`
    observables: dict[str, Observable] = field(default_factory=dict)
    observers: dict[str, requests.Observer] = field(default_factory=dict)
    groups: Groups | None = None  #: groups of all paths
    keep_last: bool = False  #: whether shards of moments hold last states

    def moments(self) -> Moments:
        """Moments of all paths, not filled."""
        return Moments(make_setup(self.model, **self.options), self.observables, self.observers, self.groups)

    def groups_of(self, piece: Piece) -> Groups | None:
        """The groups of the paths of a piece."""
        skip = piece.first - self.options.get("first_path", 0)
        return None if self.groups is None else self.groups.part(slice(skip, skip + piece.paths))

    def model_of(self, piece: Piece) -> Model:
        """The model of the paths of a piece."""
        skip = piece.first - self.options.get("first_path", 0)
        return self.model._part(slice(skip, skip + piece.paths))

    def of(self, piece: Piece, threads: int | None) -> dict[str, Any]:
        """Options of `simulate` for the paths of a piece."""
        here = {**self.options, "first_path": piece.first, "paths": piece.paths, "threads": threads}
        skip = piece.first - self.options.get("first_path", 0)
        for key in _PER_PATH:
            if here.get(key) is None:
                continue
            array = np.asarray(here[key])
            per_path = array.ndim == (3 if key == "increments" else 2) and array.shape[-1] > 1
            if per_path:
                here[key] = array[..., skip : skip + piece.paths]
        return here


class Checkpoint(Protocol):
    """The store of a long piece's state."""

    seconds: float  #: seconds between two written states; more if writing takes long

    def read(self) -> Shard | None:
        """The last state; None if there is none."""

    def write(self, state: Shard) -> None:
        """Write a later state."""


def never(_done: int, _total: int) -> bool:
    """Return false: never stop."""
    return False


def compute(
    task: Task, piece: Piece, threads: int | None = None, tell: Tell = never, checkpoint: Checkpoint | None = None
) -> Shard | None:
    """Compute the shard of a piece. If the work is stopped, the result is None, or the unfinished moments with
    `stopped` among the facts. There is no warning about failed paths: the shard counts them, and the merging process
    warns."""
    if threading.current_thread() is threading.main_thread():  # warning filters are global to the process
        with checks.unwarned():
            return _compute(task, piece, threads, tell, checkpoint)
    return _compute(task, piece, threads, tell, checkpoint)


def _compute(task: Task, piece: Piece, threads: int | None, tell: Tell, checkpoint: Checkpoint | None) -> Shard | None:
    if piece.kind == "moments":
        return _moments(task, piece, threads, tell, checkpoint)
    return _paths(task, piece, threads, tell, checkpoint)


def _moments(task: Task, piece: Piece, threads: int | None, tell: Tell, checkpoint: Checkpoint | None) -> Shard | None:
    """The shard of moments: from kept last states of a shorter run if there are any, else from the start."""
    options = task.of(piece, threads)
    before = checkpoint.read() if checkpoint and task.keep_last else None
    if before is not None and longer.begins(options, task.observers, before, grouped=task.groups is not None):
        found = _longer(task, piece, options, tell, before)
        if found is not None:
            return found
    return _moments_over(task, piece, options, tell)


def taken(task: Task, piece: Piece, checkpoint: Checkpoint) -> int:
    """Number of the path-steps of a piece that need not be taken again."""
    state = checkpoint.read() if piece.kind == "paths" or task.keep_last else None
    if state is None or (
        piece.kind == "moments"
        and not longer.begins(task.options, task.observers, state, grouped=task.groups is not None)
    ):
        return 0
    return state.facts[longer.STEP] * piece.paths


def _longer(task: Task, piece: Piece, options: dict[str, Any], tell: Tell, before: Shard) -> Shard | None:
    """The shard of moments from the end of a shorter run; None if it must be computed anew."""
    already = before.facts[longer.STEP] * piece.paths
    here = longer.options_from(options, before)
    later = _moments_over(task, piece, here, lambda done, _: tell(already + done, piece.work))
    setup = make_setup(task.model_of(piece), **options)
    unequal = options.get("save_at") is not None
    if not longer.fits(before, later, unequal=unequal) or longer.may_have_grown(setup, before, later):
        return None
    whole = _moments_over(task, piece, options, lambda *_: True)  # what is known before the first step
    kinds, groups = {name: x.KIND for name, x in task.observers.items()}, task.groups_of(piece)
    if groups is None:
        return longer.joined(before, later, whole.facts, kinds, 1)
    return longer.joined(before, later, whole.facts, {**kinds, MEANS: requests.Means.KIND}, len(groups.numbers))


def _moments_over(task: Task, piece: Piece, options: dict[str, Any], tell: Tell) -> Shard:
    shown = {"observables": task.observables or None, "observers": task.observers, "groups": task.groups_of(piece)}
    found: Moments = moments_of(task.model_of(piece), progress=tell, keep_last=task.keep_last, **shown, **options)
    arrays = {name: getattr(found, name) for name in ("t", "n_ok", "m2", "failed", "failed_status", "failed_step")}
    arrays["mean"] = found.to_arrays()[0]
    facts = facts_of(found.report)
    if found.report.stopped:
        facts["stopped"] = found.report.stopped
    last = {} if found.paths_kept is None else {"status": found.paths_kept.status, **found.paths_kept.states()}
    return Shard({**arrays, **kept_arrays(found.kept), **last}, facts)


def kept_arrays(parts: dict[str, PartialStatistics]) -> dict[str, np.ndarray]:
    """Results of observers as arrays of a shard."""
    return {
        f"observed.{name}.{what}": getattr(part, what) for name, part in parts.items() for what in ("counts", "sums")
    }


def facts_of(report: Report) -> dict[str, Any]:
    """Entries of a report that do not depend on time or on the number of threads."""
    names = ("stepper", "correction", "damping", "lapack", "failed", "grown", "lanes", "lost_variance")
    facts = {name: getattr(report, name) for name in names}
    counters = {name: report.counters[name] for name in _STEADY}
    told = {name: list(getattr(report, name)) for name in ("left_out", "warnings", "functionals")}
    return {**facts, **told, "counters": counters}


_STATE = ("last_q", "last_p", "q_low", "p_low", "status", "failed_step")


class _Saved:
    """Saved points of the paths of a piece up to a step, and the state of the paths there."""

    def __init__(self) -> None:
        self.step = 0  # steps of the piece that are done
        self.facts: dict[str, Any] = {}
        self.state: dict[str, np.ndarray] = {}
        self._points: dict[str, list[np.ndarray]] = {"t": [], "q": [], "p": []}

    @classmethod
    def of(cls, shard: Shard) -> _Saved:
        """Continue from a checkpoint."""
        self = cls()
        self.facts = dict(shard.facts)
        self.step = self.facts.pop("step")
        self.state = {name: shard.arrays[name] for name in _STATE if name in shard.arrays}
        self._points = {name: [shard.arrays[name]] for name in self._points}
        return self

    def add(self, run: Run, steps: int, keeps_last: bool, *, keeps_first: bool = True) -> None:
        """Append a run from the present state; paths that failed before keep their status."""
        later = slice(1 if self.state or not keeps_first else 0, None if keeps_last else -1)
        points = {"t": run.t[later], "q": run.q[later], "p": run.p[later]}
        state = {name: getattr(run, name) for name in _STATE if getattr(run, name) is not None}
        if self.state:
            gone = self.state["status"] != 0
            points["q"][..., gone] = points["p"][..., gone] = np.nan
            for name, old in self.state.items():
                state[name][..., gone] = old[..., gone]
        for name, values in points.items():
            self._points[name].append(values)
        self.state = state
        self.step += steps

    def counted(self, first_step: int, saved: np.ndarray | None = None) -> dict[str, Any]:
        """Counters from the paths alone: normals drawn ahead would depend on where segments began."""
        failed = self.state["status"] != 0
        done = np.where(failed, self.state["failed_step"] - first_step, self.step)
        counters = {"path_steps": int(done.sum())}
        return {"failed": int(np.count_nonzero(failed)), "grown": self._grown(saved), "counters": counters}

    def _grown(self, saved: np.ndarray | None) -> int:
        """Number of paths that grew, compared with the points saved in the first tenth of the steps, because segments
        depend on the clock."""
        t = np.concatenate(self._points["t"])
        early = np.arange(len(t)) * self.step <= -(-self.step // 10) * max(1, len(t) - 1)
        if saved is not None:
            early = saved <= -(-self.step // 10)
        if not early.any():
            return 0
        grew = np.ones(self.state["status"].shape, bool)
        for x in "qp":
            before = np.abs(np.concatenate(self._points[x])[early]).max(axis=(0, 1))
            grew &= (before > 0) & (np.abs(self.state[f"last_{x}"]).max(axis=0) / 1e6 > before)
        return int(np.count_nonzero(grew & (self.state["status"] == 0)))

    def shard(self, **facts: Any) -> Shard:
        """All data as a checkpoint; at the end, as the shard."""
        for name, parts in self._points.items():
            self._points[name] = [np.concatenate(parts)]
        points = {name: parts[0] for name, parts in self._points.items()}
        return Shard({**points, **self.state}, {**self.facts, **facts})


def _paths(task: Task, piece: Piece, threads: int | None, tell: Tell, checkpoint: Checkpoint | None) -> Shard | None:
    options = task.of(piece, threads)
    saves = make_setup(task.model_of(piece), **options).saved
    options.pop("save_at", None)
    steps, every = int(options["steps"]), int(options.get("save_every", 1))
    found = checkpoint.read() if checkpoint else None
    saved = _Saved() if found is None else _Saved.of(found)
    model = task.model_of(piece)
    saved.facts = saved.facts or _facts_of_whole(model, options)
    wanted = max(1, _FIRST // (piece.paths * task.model.ndof))
    clock = _Clock(checkpoint.seconds if checkpoint else math.inf)
    while saved.step < steps or not saved.state:
        if saves is None:
            length, save, keeps_last = _segment(saved.step, steps, every, wanted)
        else:
            length, save, keeps_last = _segment_to(saved.step, steps, saves, wanted)
        before = saved.step * piece.paths
        here = _options_from(options, saved, length, save)
        run = simulate(
            model, progress=lambda done, _, b=before: tell(b + done, piece.work) and clock.has_waited(), **here
        )
        if not run.report.stopped:
            saved.add(run, length, keeps_last, keeps_first=saves is None or saves[0] == 0)
            wanted = clock.next_length(length)
        stops = bool(run.report.stopped) or tell(saved.step * piece.paths, piece.work)
        if saved.step >= steps:
            break
        if checkpoint and saved.state and (stops or clock.is_time()):
            clock.measure(lambda: checkpoint.write(saved.shard(step=saved.step)))
        if stops:
            return None
    return saved.shard(**saved.counted(options.get("first_step", 0), saves))


def _facts_of_whole(model: Model, options: dict[str, Any]) -> dict[str, Any]:
    """Entries of the report that are known before the first step of a run over all steps."""
    here = {**options, "save_every": max(1, int(options["steps"]))}
    return facts_of(simulate(model, progress=lambda *_: True, **here).report)


def _segment(step: int, steps: int, every: int, wanted: int) -> tuple[int, int, bool]:
    """Steps of the next segment, steps between its saved points, and whether its last point is a saved point of
    the run."""
    to_save = every - step % every
    if to_save == every and wanted >= every:
        return min(wanted // every * every, steps - step), every, True
    length = min(wanted, to_save, steps - step)
    return length, max(1, length), length == to_save or steps == 0


def _segment_to(step: int, steps: int, saves: np.ndarray, wanted: int) -> tuple[int, int, bool]:
    """The same of a run that is saved after these numbers of steps."""
    later = saves[saves > step]
    end = int(later[0]) if later.size else steps
    length = min(wanted, end - step)
    return length, max(1, length), step + length == end and bool(later.size or steps == 0)


def _options_from(options: dict[str, Any], saved: _Saved, length: int, save: int) -> dict[str, Any]:
    """Options of this many steps from the present state of the paths."""
    here = {**options, "steps": length, "save_every": save}
    here["first_step"] = options.get("first_step", 0) + saved.step
    if saved.state:
        here |= {"q0": saved.state["last_q"], "p0": saved.state["last_p"]}
        here |= {"q0_low": saved.state.get("q_low"), "p0_low": saved.state.get("p_low")}
    return here


class _Clock:
    """Measures how long segments take, and when a checkpoint is due. The clock never runs backwards."""

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds
        self._begin = self._last = time.monotonic()
        self._cost = 0.0

    def next_length(self, length: int) -> int:
        """Steps of the next segment, from the steps and the time of the last."""
        now = time.monotonic()
        took, self._begin = now - self._begin, now
        factor = min(8.0, max(0.25, min(_SEGMENT, self._seconds) / max(took, 1e-6)))
        return max(1, int(length * factor))

    def has_waited(self) -> bool:
        """Whether a segment takes so long that a stop should end it, if no result is lost by that."""
        return time.monotonic() - self._begin > _PATIENCE

    def is_time(self) -> bool:
        """Whether a checkpoint is due: checkpoints take at most a twentieth of the time."""
        return time.monotonic() - self._last > max(self._seconds, 20 * self._cost)

    def measure(self, write: Callable[[], None]) -> None:
        """Write a checkpoint and measure its time."""
        begin = time.monotonic()
        write()
        self._last = self._begin = time.monotonic()
        self._cost = self._last - begin
