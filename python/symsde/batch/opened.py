# SPDX-License-Identifier: BSD-3-Clause
"""ss.open_run(DIR): the contents of a run folder, finished or not, as objects."""

from __future__ import annotations

import functools
import os
from pathlib import Path
from typing import Any

from ..errors import SceneError
from ..native import files
from ..native.checks import counted
from ..run.loaded import LoadedMoments, LoadedRun, load_file
from ..run.moments import Moments
from ..run.simulate import Run
from . import growth, manifest, merged_results
from .folder import RunFolder
from .pieces import Piece
from .scene import Scene
from .scene_pieces import Batch


class OpenRun:
    """A run folder: its manifest, its scene, and the results of the shards that are finished."""

    def __init__(self, path: str | os.PathLike):
        """Open a folder; see `open_run`."""
        self.path = files.path_of("path", path)
        found = manifest.read(self.path)
        if found is None:
            raise SceneError(f"{self.path} holds no run (no {manifest.NAME}): give a folder of `symsde run`")
        manifest.require_run(found, self.path)
        #: inputs with their hash, seed, counter map, version, compiler, build
        self.manifest: dict[str, Any] = found
        sizes = manifest.sizes(found)
        self._batch = Batch.of(str(growth.scene_in(self.path, found)), str(self.path), str(found["shard_paths"]), sizes)
        manifest.require_scene(found, self._batch.scene, self.path)
        self._folder = RunFolder(Path(self.path), found, self._batch.pieces)

    @property
    def scene(self) -> Scene:
        """The scene, as `symsde.batch.scene.load` gives it."""
        return self._batch.scene

    @property
    def missing(self) -> list[str]:
        """Names of shards that do not exist yet. The list is empty if the run is complete."""
        return [piece.name for piece in self._folder.missing()]

    def _there(self, kind: str) -> list[Piece]:
        return [piece for piece in self._batch.of_kind(kind) if self._folder.is_done(piece)]

    @functools.cached_property
    def moments(self) -> Moments | None:
        """Moments of the paths whose shards exist; None without shards. `report.stopped` counts the other
        paths."""
        there = self._there("moments")
        if not there:
            return None
        missing = sum(piece.paths for piece in self._batch.of_kind("moments")) - sum(piece.paths for piece in there)
        batch = self._batch
        found = merged_results.moments_of(batch.task, batch.size, there, self._folder.read, missing=missing)
        found.scene = self.scene.text
        return found

    @functools.cached_property
    def run(self) -> Run | None:
        """The saved paths whose shards exist; None if there are none."""
        there = self._there("paths")
        if not there:
            return None
        found = merged_results.run_of(self._batch.task, there, self._folder.read)
        found.scene = self.scene.text
        return found

    def __repr__(self) -> str:
        """The folder in one line."""
        total = len(self._batch.pieces)
        return (
            f"<run of {self._batch.task.model!r} in {self.path}: {total - len(self.missing)} of "
            f"{counted(total, 'shard')}, symsde {self.manifest['version']}>"
        )


def load(path: str | os.PathLike) -> LoadedRun | LoadedMoments | OpenRun:
    """Load the saved results of a run, as an object with arrays, tables and figures.

    run = ss.load("run.nc")            # or run.npz: t, q, p, path, status, failed_step, plot, to_pandas
    moments = ss.load("moments.csv")   # or .nc, .npz: t, n_ok, mean_q, var_p, se_mean_energy, mean["name"], plot, ..
    found = ss.load("DIR")             # a run folder, as `open_run` gives it
    """
    source = files.path_of("path", path)
    if not os.path.exists(source):
        raise SceneError(f"{source} does not exist: give the folder of a run, or a .nc, .npz or .csv file of one")
    return OpenRun(source) if source.is_dir() else load_file(source)


def open_run(path: str | os.PathLike) -> OpenRun:
    """Open a folder of `symsde run SCENE.toml --out DIR`, also while the run is in progress.

        found = ss.open_run(DIR)
        found.manifest["seed"], found.missing      # which run it is, and which shards do not exist yet
        found.moments.mean_q, found.run.q          # over the shards that exist

    Damaged shards are left out, with a line in the log.
    """
    return OpenRun(path)
