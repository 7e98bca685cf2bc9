# SPDX-License-Identifier: BSD-3-Clause
"""A scene with the pieces that it is cut into."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

from ..native import files
from . import manifest, scene
from .execute import Task
from .pieces import FILES, UNIT, Extent, Piece, plan, shard_paths
from .scene import Scene


@dataclass
class Batch:
    """A scene to run in a folder."""

    scene: Scene
    task: Task
    size: int  #: number of paths of a shard
    pieces: list[Piece]
    out: str

    @classmethod
    def of(
        cls,
        file: str,
        out: str,
        wanted: str | None = None,
        more: Mapping[str, int] | None = None,
        *,
        keep_last: bool = False,
    ) -> Batch:
        """Make a batch from a scene, its folder, and the wanted number of paths of a shard; in an existing folder this
        number is fixed already. more: keys of [run] in the place of the scene's. keep_last: as in [output]; a folder
        whose shards hold last states goes on with that.
        """
        there = manifest.read(files.path_of("the folder of the results", out))
        chosen = scene.load(file, more, keep_last=keep_last or manifest.keeps_last(there))
        extent = extent_of(chosen)
        if there and wanted is None:
            size = there["shard_paths"]
        else:
            size = shard_paths(extent, int(wanted) if wanted and re.fullmatch(r"-?\d{1,30}", wanted) else wanted)
        pieces = _plan(chosen, size)
        task = Task(chosen.model, chosen.run, chosen.observables, chosen.observers, chosen.groups, chosen.keep_last)
        return cls(chosen, task, size, pieces, out)

    def of_kind(self, kind: str) -> list[Piece]:
        """The pieces of a kind, moments or paths."""
        return [piece for piece in self.pieces if piece.kind == kind]

    def finer(self, wanted: int) -> tuple[int, int] | None:
        """The paths per shard and the number of shards, with at least the wanted number of shards, or else with the
        smallest shards. None if smaller shards do not give more shards, or more than a folder should hold."""
        size, found = self.size // 2, None
        while size >= UNIT and self.scene.run.get("paths", 1) <= FILES * size:
            if (count := len(_plan(self.scene, size))) > (found[1] if found else len(self.pieces)):
                found = size, count
            if count >= wanted:
                break
            size //= 2
        return found


def _plan(chosen: Scene, size: int) -> list[Piece]:
    return plan(extent_of(chosen), size, moments=chosen.moments, saved=chosen.paths)


def extent_of(chosen: Scene) -> Extent:
    """The size of the run that a scene describes."""
    run = chosen.run
    first, paths = int(run.get("first_path", 0)), int(run.get("paths", 1))
    return Extent(first, paths, int(run["steps"]), scene.saved_times(run), chosen.model.ndof)
