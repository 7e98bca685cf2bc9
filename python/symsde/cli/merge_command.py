# SPDX-License-Identifier: BSD-3-Clause
"""symsde merge DIR... --out DIR: the shards of several folders in one folder, and the results of all."""

from __future__ import annotations

import argparse
import shlex
import time
from collections.abc import Sequence
from pathlib import Path

from ..batch import growth, manifest, share
from ..batch.folder import RunFolder
from ..batch.scene_pieces import Batch
from ..errors import SceneError
from ..native import files
from .run_command import finish, logged

HELP = "Merge folders that hold parts of one run (`symsde run --shard I/N`). The result has the bits of one run."


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `symsde merge`."""
    parser.add_argument("folders", metavar="DIR", nargs="+", help="folders with shards of the same run")
    parser.add_argument("--out", metavar="DIR", required=True, help="folder of the whole run")
    parser.add_argument("--quiet", action="store_true", help="no table")


def run(options: argparse.Namespace) -> int:
    """Execute the verb and return the exit code."""
    begin = time.monotonic()
    with logged(options.quiet):
        folders = [Path(name) for name in options.folders]
        record = _common(folders)
        sizes = manifest.sizes(record)
        keeps = manifest.keeps_last(record)
        scene = str(growth.scene_in(folders[0], manifest.read(folders[0])))
        batch = Batch.of(scene, options.out, str(record["shard_paths"]), sizes, keep_last=keeps)
        manifest.require_same(record, manifest.of_scene(batch.scene, batch.size), folders[0])
        sources = [RunFolder(folder, record, batch.pieces) for folder in folders]
        with RunFolder.open_to_write(options.out, record, batch.pieces, batch.scene) as whole:
            _gather(sources, whole)
            own = batch.scene.tables["run"]
            beyond = [f"--{key}={x}" for key, x in sizes.items() if own.get(key, 1) != x]
            _require_all(whole, beyond + (["--allow-python"] if options.allow_python else []))
            return finish(batch, whole, options.quiet, time.monotonic() - begin)


def _common(folders: Sequence[Path]) -> dict:
    """The manifest that all folders have in common."""
    records = []
    for folder in folders:
        if (record := manifest.read(folder)) is None:
            raise SceneError(f"{folder} holds no run (no {manifest.NAME}): give folders that `symsde run` has written")
        manifest.require_run(record, folder)
        records.append(record)
    for folder, record in zip(folders[1:], records[1:], strict=True):
        if found := manifest.differences(records[0], record):
            raise SceneError(
                f"{folders[0]} and {folder} hold parts of different runs: {'; '.join(found[:5])}: merge parts of one "
                "scene, made with one version and build"
            )
    before = [x for record in records for x in record.get(growth.KEY, ())]
    return records[0] | ({growth.KEY: [x for i, x in enumerate(before) if x not in before[:i]]} if before else {})


def _gather(sources: Sequence[RunFolder], whole: RunFolder) -> None:
    """Copy shards of any folder into the folder of the whole."""
    for piece in whole.missing():
        for source in sources:
            if source.is_done(piece):
                files.write_durably(whole.shard_path(piece), source.shard_path(piece).read_bytes())
                break


def _require_all(whole: RunFolder, more: Sequence[str]) -> None:
    """Refuse to merge an incomplete run: name the missing shards, and the commands that compute them, with more
    options."""
    if missing := whole.missing():
        again = shlex.join(["symsde", "run", str(whole.path / "scene.toml"), "--out", str(whole.path), *more])
        parts = [f"`--shard {part}`" for part in share.parts_of(missing, whole.pieces)]
        by_parts = f"; they are what {_listed(parts)} of `symsde run` computes" if parts else ""
        raise SceneError(
            f"{len(missing)} of {len(whole.pieces)} shards are in none of the folders: "
            f"{_listed([piece.name for piece in missing])}: `{again}` computes them and ends the run{by_parts}"
        )


def _listed(names: Sequence[str], most: int = 8) -> str:
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more
