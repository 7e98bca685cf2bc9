# SPDX-License-Identifier: BSD-3-Clause
"""The folder of a run: its manifest, a copy of its scene, its finished shards, and the claims on unfinished pieces.

DIR/manifest.json           identifies the run
DIR/scene.toml              copy of the scene; Python files with its functions are copied too
DIR/shards/NAME.npz         one finished shard for each piece
DIR/shards/NAME.checkpoint  state of a long unfinished piece; deleted once there is a shard
DIR/.grown-*/               the scene of a run that grows, from before its manifest is written until it is copied
DIR/.claims                 locks of the working processes
"""

from __future__ import annotations

import contextlib
import logging
import shutil
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from ..errors import SceneError
from ..native import files, parts
from . import growth, manifest, shard_file
from .claims import Claims
from .pieces import Piece
from .scene import Scene
from .shard_file import DamagedShardError, Shard

_KEPT = 2**24  # bytes of shards kept in memory until the results are computed

log = logging.getLogger("symsde")


class RunFolder:
    """A folder with the run of one manifest."""

    def __init__(self, path: Path, record: dict[str, Any], pieces: Sequence[Piece]):
        """Read an existing folder; `open_to_write` makes a new one."""
        self.path = path
        self.record = record
        self._hash = growth.stamp_of(record)
        self._before = {x["run"]: x for x in record.get(growth.KEY, ())}
        self._steps = record["inputs"].get("run", {}).get("steps")
        self.pieces = list(pieces)
        self._numbers = {piece.name: i for i, piece in enumerate(self.pieces)}
        self._verified: set[str] = set()
        self._written: dict[str, Shard] = {}  # small shards of this process, kept so that they need not be read again
        self._kept_bytes = 0
        self._claims: Claims | None = None
        self.checkpoint_seconds = 10.0
        self.parts: dict[str, Shard] = {}  #: unfinished moments of stopped pieces, by name

    @classmethod
    @contextlib.contextmanager
    def open_to_write(
        cls, path: str, record: dict[str, Any], pieces: Sequence[Piece], scene: Scene | None
    ) -> Iterator[RunFolder]:
        """Make the folder, or continue in it; a folder of another run is refused and stays as it is."""
        grows = False
        if (there := manifest.read(files.path_of("the folder of the results", path))) is not None:
            grows = growth.came_from(record, there)
            if not grows:
                manifest.require_same(there, record, Path(path))
        with files.folder(path) as target:
            if not (target / manifest.NAME).exists():
                _require_no_results(target)
            self = cls(target, record, pieces)
            self._claims = Claims(target / ".claims")
            try:
                if grows:
                    self._grow(scene)
                else:
                    self._claims.share()
                self._begin(scene)
                yield self
            finally:
                self._claims.close()

    def _grow(self, scene: Scene) -> None:
        """Write the manifest of the run that has grown, unless another process works in the folder or was first. Its
        scene is there before, in a place of its own, so that a kill leaves a manifest with its scene."""
        if self._claims.take_all() and growth.came_from(self.record, manifest.read(self.path)):
            _copy(scene, growth.staged(self.path, self.record), keep=False)
            files.write_durably(self.path / manifest.NAME, manifest.to_bytes(self.record), keep=False)
        self._claims.share()
        if manifest.differences(manifest.read(self.path), self.record):
            raise SceneError(
                f"another process works in {self.path}, or has let it grow: wait for its end, then repeat the command"
            )

    def _begin(self, scene: Scene | None) -> None:
        """Write what a folder has before its first shard, as far as it is not there."""
        target, record = self.path, self.record
        for place in (target, target / "shards"):
            parts.sweep(place)
        if scene is not None:
            # A run that grew may have a new scene, and may have been killed before that was written.
            _copy(scene, target, keep=growth.KEY not in record)
            for waiting in target.glob(f"{growth.STAGED}*"):
                shutil.rmtree(waiting, ignore_errors=True)
        if not files.write_durably(target / manifest.NAME, manifest.to_bytes(record)):
            manifest.require_same(manifest.read(target), record, target)
        (target / "shards").mkdir(exist_ok=True)

    def shard_path(self, piece: Piece) -> Path:
        """The path of a piece's shard."""
        return self.path / "shards" / f"{piece.name}.npz"

    def is_done(self, piece: Piece) -> bool:
        """Whether there is an undamaged shard; each is checked once, and a damaged one is moved away with a message."""
        if piece.name in self._verified:
            return True
        path = self.shard_path(piece)
        if not path.exists() or (self._before and self._is_outgrown(piece)):
            return False
        try:
            self.read(piece)
        except DamagedShardError as error:
            if self._claims is None:  # the folder is open for reading only
                log.warning("%s; it is left out", error)
                return False
            aside = path.with_suffix(".damaged")
            log.warning("%s; it is computed anew, what was there is kept as %s", error, aside.name)
            with contextlib.suppress(FileNotFoundError):  # another process moved it first
                path.rename(aside)
            return False
        self._verified.add(piece.name)
        if self._claims is not None:
            self._drop_checkpoint(piece)  # a process killed after writing the shard may have left the checkpoint
        return True

    def missing(self) -> list[Piece]:
        """Pieces without a shard."""
        return [piece for piece in self.pieces if not self.is_done(piece)]

    def read(self, piece: Piece) -> Shard:
        """Read the shard of a piece, and check that it belongs to this run."""
        if (own := self._written.get(piece.name)) is not None:
            return own
        path = self.shard_path(piece)
        shard = shard_file.read(path)
        if not self._is_of(shard, piece) or not self._is_good(shard, piece):
            raise DamagedShardError(f"{path} is damaged: it is the shard of another run or piece")
        return shard

    def _is_of(self, shard: Shard, piece: Piece) -> bool:
        """Whether a shard holds these paths of this run, or of a run that this one grew from."""
        expected = self.stamp(piece)
        run = shard.facts.get("run")
        own = all(shard.facts.get(key) == value for key, value in expected.items() if key != "run")
        return own and (run == self._hash or run in self._before)

    def _is_good(self, shard: Shard, piece: Piece) -> bool:
        """Whether a shard of these paths is as this run would compute it."""
        if shard.facts["run"] == self._hash:
            return True
        before = self._before[shard.facts["run"]]
        return before[piece.kind] and before["steps"] == self._steps

    def _is_outgrown(self, piece: Piece) -> bool:
        """Whether the shard is one of an earlier run that this one cannot take as it is; then it is moved away."""
        path = self.shard_path(piece)
        try:
            shard = shard_file.read(path)
        except DamagedShardError:
            return False
        except FileNotFoundError:  # another process moved it
            return True
        good = self._is_of(shard, piece) and self._is_good(shard, piece)
        if good or shard.facts.get("run") not in self._before:
            return False
        if self._claims is not None:
            with contextlib.suppress(FileNotFoundError):
                path.rename(self._outgrown_path(piece))
        return True

    def start_of(self, piece: Piece, state: Shard) -> Shard | None:
        """The state that a checkpoint or an earlier shard holds, its step among the facts; None if the paths cannot go
        on from it."""
        if not self._is_of(state, piece):
            return None
        # A run that has grown may become what it was: then its own shards may have been moved away.
        own = {"steps": self._steps, piece.kind: True} if state.facts["run"] == self._hash else None
        before = own or self._before[state.facts["run"]]
        if not before[piece.kind]:
            return None
        if "step" in state.facts and own:
            return state
        told = {"step": state.facts.get("step", before["steps"])}
        return Shard(state.arrays, told if piece.kind == "paths" else {**state.facts, **told})

    def _outgrown_path(self, piece: Piece) -> Path:
        return self.path / "shards" / f"{piece.name}.outgrown"

    def stamp(self, piece: Piece) -> dict[str, Any]:
        """Facts that identify a shard."""
        return {"run": self._hash, "piece": piece.name, "kind": piece.kind, "first": piece.first, "paths": piece.paths}

    def write(self, piece: Piece, shard: Shard) -> None:
        """Store a finished shard, and delete the checkpoint of its piece."""
        stamped = Shard(shard.arrays, {**shard.facts, **self.stamp(piece)})
        shard_file.write(self.shard_path(piece), stamped)
        self._verified.add(piece.name)
        size = sum(array.nbytes for array in stamped.arrays.values())
        if self._kept_bytes + size <= _KEPT:
            self._written[piece.name] = stamped
            self._kept_bytes += size
        self._drop_checkpoint(piece)

    def _drop_checkpoint(self, piece: Piece) -> None:
        """Delete the files that a finished piece no longer needs."""
        for path in (self.checkpoint_path(piece), self._outgrown_path(piece)):
            with contextlib.suppress(FileNotFoundError):
                path.unlink()

    def set_aside(self, piece: Piece, part: Shard) -> None:
        """Store the unfinished moments of a piece that was stopped."""
        self.parts[piece.name] = part

    def checkpoint_path(self, piece: Piece) -> Path:
        """The path of a long piece's checkpoint."""
        return self.path / "shards" / f"{piece.name}.checkpoint"

    def checkpoint(self, piece: Piece) -> _Checkpoint:
        """The store of a long piece's state."""
        return _Checkpoint(self, piece)

    def claim(self, piece: Piece) -> bool:
        """Claim the piece until `release`; return false if another process works on it."""
        return self._claims.take(self._number(piece))

    def release(self, piece: Piece) -> None:
        """Release the piece for other processes."""
        self._claims.give(self._number(piece))

    def _number(self, piece: Piece) -> int:
        """The number of a piece's lock: its index among the pieces, or a hash of its name if the piece was not
        planned.
        """
        found = self._numbers.get(piece.name)
        return (1 << 32) + zlib.crc32(piece.name.encode()) if found is None else found


def _copy(scene: Scene, target: Path, *, keep: bool) -> None:
    """Copy a scene and the files beside it into a folder."""
    wanted = [("scene.toml", Path(scene.file)), *manifest.files_beside(scene)]
    for name, source in wanted:
        (target / name).parent.mkdir(parents=True, exist_ok=True)
        parts.sweep((target / name).parent)
        files.write_durably(target / name, source.read_bytes(), keep=keep)


def _require_no_results(target: Path) -> None:
    """Refuse to overwrite results without a manifest."""
    for name in ("moments.csv", "run.nc", "run.npz", "shards"):
        if (target / name).exists():
            raise SceneError(
                f"{target} holds {name} but no {manifest.NAME}, so it is unclear of which run: give another "
                "folder with --out, or remove that one"
            )


class _Checkpoint:
    """The checkpoint of one piece."""

    def __init__(self, folder: RunFolder, piece: Piece):
        self.seconds = folder.checkpoint_seconds
        self._folder, self._piece = folder, piece
        self._path, self._stamp = folder.checkpoint_path(piece), folder.stamp(piece)

    def read(self) -> Shard | None:
        """The last checkpoint, or the end of these paths in the run that this one grew from; None if there is neither,
        or if it is damaged or of another piece."""
        places = [self._path, self._folder._outgrown_path(self._piece)]
        if self._folder._claims is None:  # open for reading only: an outgrown shard is still in its place
            places.append(self._folder.shard_path(self._piece))
        for path in places:
            try:
                state = shard_file.read(path)
            except FileNotFoundError:
                continue
            except DamagedShardError as error:
                log.warning("%s; the piece begins anew", error)
                continue
            if (found := self._folder.start_of(self._piece, state)) is not None:
                return found
        return None

    def write(self, state: Shard) -> None:
        """Replace the checkpoint by a later one, atomically, so that a complete checkpoint always exists."""
        stamped = Shard(state.arrays, {**state.facts, **self._stamp})
        files.write_durably(self._path, shard_file.to_bytes(stamped), keep=False)
