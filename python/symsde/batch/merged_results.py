# SPDX-License-Identifier: BSD-3-Clause
"""Results of a run from the shards of its pieces: moments are merged on the tree, saved paths are concatenated."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from ..native import abi
from ..native.build import build_info
from ..native.handles import status_text
from ..run.moments import Moments
from ..run.observers.partial_statistics import GroupStatistics, PartialStatistics
from ..run.report import Report
from ..run.setup import make_setup
from ..run.simulate import Run
from .execute import Task
from .pieces import Piece
from .shard_file import Shard
from .tree import Node, Tree

Read = Callable[[Piece], Shard]


class MomentsInWork:
    """Moments of the pieces received so far, in any order; memory for a few pieces suffices."""

    def __init__(self, task: Task, size: int):
        """Start without pieces; size: paths of a piece."""
        self._task, self._size = task, size
        self._found = task.moments()
        self._tree = Tree(self._found.merge_kept)
        self._t: np.ndarray | None = None
        self._failed: list[np.ndarray] = []
        self._reports: list[tuple[int, dict[str, Any]]] = []

    def add(self, piece: Piece, shard: Shard) -> None:
        """Merge the moments of a piece."""
        arrays = shard.arrays
        node = Node(*(np.array(arrays[name]) for name in ("n_ok", "mean", "m2")), self._kept_of(piece, arrays))
        self._tree.insert(self._size.bit_length() - 1, piece.first // self._size, node)
        self._t = arrays["t"]
        self._failed.append(np.stack([arrays[name] for name in ("failed", "failed_status", "failed_step")]))
        self._reports.append((piece.first, dict(shard.facts)))

    def _kept_of(self, piece: Piece, arrays: Mapping[str, np.ndarray]) -> dict[str, PartialStatistics]:
        found, groups = {}, self._task.groups_of(piece)
        for name, room in self._found.kept.items():
            both = (np.array(arrays[f"observed.{name}.{what}"]) for what in ("counts", "sums"))
            if groups is None:
                found[name] = PartialStatistics(*both, room.answers)
            else:
                answers = room.answers // len(room.groups) * len(groups.numbers)
                found[name] = GroupStatistics(*both, answers, groups.numbers)
        return found

    def result(self, seconds: float = 0.0, threads: int = 1, missing: int = 0) -> Moments:
        """Moments of all paths received so far, with the bits of one run over these paths; missing paths count as
        stopped."""
        found = self._found
        root = self._tree.root()
        found.t[...] = self._t
        found.fill_from_sums(root.n_ok, root.mean, root.m2)
        found.kept = root.kept
        failed = np.concatenate(self._failed, axis=1)
        failed = failed[:, np.argsort(failed[0], kind="stable")][:, : abi.MAX_FAILED_LISTED]
        found.failed, found.failed_status, found.failed_step = failed
        found.report = merged_report((facts for _, facts in sorted(self._reports, key=first_of)), seconds, threads)
        if missing:
            told = {"stopped": missing, "status": abi.STOPPED, "outcome": status_text(abi.STOPPED)}
            found.report = dataclasses.replace(found.report, **told)
        return found


def first_of(pair: tuple[int, dict]) -> int:
    """The key by which reports are sorted."""
    return pair[0]


def moments_of(task: Task, size: int, pieces: Sequence[Piece], read: Read, **about: Any) -> Moments:
    """Moments of the pieces of a run."""
    work = MomentsInWork(task, size)
    for piece in pieces:
        work.add(piece, read(piece))
    return work.result(**about)


def run_of(task: Task, pieces: Sequence[Piece], read: Read, **about: Any) -> Run:
    """The saved paths of the pieces of a run."""
    path = np.concatenate([np.arange(piece.first, piece.first + piece.paths) for piece in pieces])
    options = {**task.options, "paths": len(path), "first_path": int(path[0])}
    for key in ("q0", "p0"):
        array = np.asarray(options[key])
        if array.ndim == 2 and array.shape[1] > 1:
            options[key] = array[:, path - task.options.get("first_path", 0)]
    run = Run(make_setup(task.model._part(path - task.options.get("first_path", 0)), **options))
    run.path = path
    at, reports = 0, []
    for piece in pieces:
        shard = read(piece)
        columns = slice(at, at + piece.paths)
        for name, values in shard.arrays.items():
            if name == "t":
                run.t[...] = values
            else:
                getattr(run, name)[..., columns] = values
        reports.append(shard.facts)
        at += piece.paths
    run.report = merged_report(reports, **about)
    return run


def merged_report(reports: Iterable[dict[str, Any]], seconds: float = 0.0, threads: int = 1) -> Report:
    """The reports of all pieces as one; the seconds are those of the last session."""
    first, *others = reports
    failed = first["failed"] + sum(facts["failed"] for facts in others)
    counters = {name: n + sum(facts["counters"][name] for facts in others) for name, n in first["counters"].items()}
    stopped, grown = (sum(facts.get(name, 0) for facts in (first, *others)) for name in ("stopped", "grown"))
    status = abi.STOPPED if stopped else abi.PATHS_FAILED if failed else abi.OK
    return Report(
        outcome=status_text(status),
        status=status,
        stepper=first["stepper"],
        correction=first["correction"],
        damping=first.get("damping", ""),
        left_out=tuple(first["left_out"]),
        warnings=tuple(dict.fromkeys(text for facts in (first, *others) for text in facts["warnings"])),
        functionals=tuple(first.get("functionals", ())),
        counters=counters,
        failed=failed,
        stopped=stopped,
        grown=grown,
        threads=threads,
        lanes=first["lanes"],
        lost_variance=first["lost_variance"],
        timings={"setup": 0.0, "run": seconds},
        lapack=" and ".join(dict.fromkeys(text for facts in (first, *others) if (text := facts.get("lapack")))),
        versions=build_info(),
    )
