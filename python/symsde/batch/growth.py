# SPDX-License-Identifier: BSD-3-Clause
"""Runs that grow: more paths, more steps, more observers or other saved times in the folder of a run.

The manifest of a folder that has grown lists the runs that it grew from, by the hash in the stamps of their shards,
with what these are good for. Shards of moments stay good if there are more paths, those of saved paths also if there
are more steps, which begin at their last states, as do moments whose shards hold last states (`longer`). Nothing is
removed before its successor is written.
"""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ..errors import SceneError, SymsdeError
from ..native.checks import counted
from . import longer, manifest
from .pieces import Piece
from .scene import Scene

KEY = "grown_from"  #: entry of manifests
STAGED = ".grown-"  #: how the names of folders begin that hold scenes for a moment
_PYTHON = "inputs.python_sha256"
_OBSERVING = ("inputs.observables", "inputs.observe", "inputs.computed.functions", _PYTHON)
_KEEPS = "inputs.output.keep_last"
_CUTS = ("inputs.output.",)  #: which paths are saved: shards tell by themselves which paths they hold


def stamp_of(record: Mapping[str, Any]) -> str:
    """The hash of a run in the stamps of its shards; it does not depend on what the run grew from."""
    own = {key: x for key, x in record.items() if key != KEY}
    return hashlib.sha256(manifest.to_bytes(own)).hexdigest()


def came_from(record: Mapping[str, Any], there: Mapping[str, Any]) -> bool:
    """Whether a run grew from the run of a folder."""
    return any(x["run"] == stamp_of(there) for x in record.get(KEY, ()))


def staged(folder: Path, record: Mapping[str, Any]) -> Path:
    """Where the scene of a run that grows waits, with the files beside it, until the manifest is written."""
    return folder / f"{STAGED}{stamp_of(record)[:16]}"


def scene_in(folder: Path, record: Mapping[str, Any]) -> Path:
    """The scene of the run in a folder, also after a kill that came before it was in its place."""
    waiting = staged(folder, record) / "scene.toml"
    return waiting if waiting.exists() else folder / "scene.toml"


def record_of(
    there: dict[str, Any] | None,
    scene: Scene,
    size: int,
    folder: Path,
    *,
    asked: bool,
    more: Mapping[str, int] | None = None,
) -> dict[str, Any]:
    """The manifest of a scene in a folder: new, the same, or grown from the folder's; any other is refused.

    asked: whether the user lets the folder grow to all that the scene asks for; more: the numbers of paths and steps
    that the user gave beside the scene, to which it grows in any case.
    """
    here = manifest.of_scene(scene, size)
    if there is None or not manifest.differences(there, here):
        return here if there is None or KEY not in there else {**here, KEY: there[KEY]}
    if there["format"] != manifest.FORMAT or "run" not in there["inputs"]:
        manifest.require_same(there, here, folder)
    old, new = there["inputs"]["run"], here["inputs"]["run"]
    found = _beside(there, scene, size, old)
    if found is None or not all(key.startswith(_OBSERVING + _CUTS) for key in found) or _may_be_another(there, here):
        manifest.require_same(there, here, folder)
    for key in ("paths", "steps"):
        if new[key] < old[key]:
            raise SceneError(
                f"{folder} holds {old[key]} {key}, and a run of {new[key]} is asked for: a folder grows, and never "
                f"shrinks: give --{key} {old[key]} or more, or another folder with --out"
            )
    if not (asked or _is_said(found, old, new, more or {})):
        try:
            manifest.require_same(there, here, folder)
        except SceneError as error:
            anew = ", ".join(_anew(found, there, here))
            raise SceneError(f"{error}; or give --grow, which adds what is more: {anew}") from None
    stays = {
        "moments": not any(key.startswith(_OBSERVING) for key in found),
        "paths": True,
    }
    stays = {kind: x and _saves_on(old, new) for kind, x in stays.items()}
    before = [{**x, **{kind: x[kind] and stays[kind] for kind in stays}} for x in there.get(KEY, ())]
    return {**here, KEY: [*before, {"run": stamp_of(there), "steps": old["steps"], **stays}]}


def _beside(there: Mapping[str, Any], scene: Scene, size: int, old: Mapping[str, Any]) -> list[str] | None:
    """The entries, beside paths, steps and saved times, in which a scene differs from the run of a folder; None if the
    scene cannot be of the old size, as with parameters that go by path."""
    sizes = {key: old[key] for key in ("paths", "steps", "save_every")} | {"save_at": old.get("save_at")}
    smaller = dataclasses.replace(scene, run={**scene.run, **sizes})
    try:
        same = manifest.of_scene(smaller, size)
    except SymsdeError:
        return None
    return manifest.keys_of_differences(there, same)


def _may_be_another(there: Mapping[str, Any], here: Mapping[str, Any]) -> bool:
    """Whether a Python file has changed that the model may use; files of one of the runs alone are of observables."""
    old, new = (record["inputs"].get("python_sha256", {}) for record in (there, here))
    return "python" in here["inputs"]["model"] and any(old[name] != new[name] for name in old if name in new)


def _is_said(found: Sequence[str], old: Mapping[str, Any], new: Mapping[str, Any], more: Mapping[str, int]) -> bool:
    """Whether a folder grows by nothing else than the numbers that the user gave, and by the paths that are saved of
    them; or keeps last states from now on, which computes nothing anew."""
    sizes = [key for key in ("paths", "steps") if old[key] != new[key]]
    if _saves(old) != _saves(new) or not all(key in more for key in sizes):
        return False
    return all(key == _KEEPS or (more and key.startswith(_CUTS)) for key in found)


def _saves(run: Mapping[str, Any]) -> tuple:
    """Which times of a run are saved."""
    return run["save_every"], run.get("save_at")


def _saves_on(old: Mapping[str, Any], new: Mapping[str, Any]) -> bool:
    """Whether a run saves what an earlier one saved, and beyond that only times after its end."""
    if _saves(old) == _saves(new):
        return True
    first, then = old.get("save_at"), new.get("save_at")
    if first is None or then is None or then[: len(first)] != first:
        return False
    steps = [(t - new["t0"]) / new["step"] - new["first_step"] for t in then[len(first) :]]
    return all(round(n) > old["steps"] for n in steps)


def _joins(record: Mapping[str, Any]) -> bool:
    """Whether the moments of a run go on from their last states."""
    inputs = record["inputs"]
    kinds = [table.get("kind", "") for table in inputs.get("observe", ())]
    unequal = "save_at" in inputs["run"] and "groups" in inputs["output"]
    return manifest.keeps_last(record) and not unequal and longer.join(kinds)


def _anew(found: Sequence[str], there: Mapping[str, Any], here: Mapping[str, Any]) -> list[str]:
    """What is kept, and what is computed anew, in words."""
    old, new = there["inputs"]["run"], here["inputs"]["run"]
    anew = not _saves_on(old, new)
    observes, longer_now = any(key.startswith(_OBSERVING) for key in found), old["steps"] != new["steps"]
    has_moments, has_paths = (here["inputs"]["output"][kind] for kind in ("moments", "paths"))
    told = []
    if has_moments and (observes or anew or (longer_now and not _joins(there))):
        told.append("moments of all paths are computed anew")
    elif has_moments and longer_now:
        told.append("moments go on from the last states of their shards, those with failed paths are computed anew")
    elif has_moments and manifest.keeps_last(here) and not manifest.keeps_last(there):
        told.append("shards of moments that are there are kept as they are, without last states")
    if has_paths and anew:
        told.append("saved paths are computed anew")
    elif has_paths and longer_now:
        told.append("saved paths go on from their last states")
    if old["paths"] != new["paths"] and not told:
        told.append("shards of the paths that are there are kept")
    return told or ["saved paths that are there are kept"]


def sentence(
    there: Mapping[str, Any], record: Mapping[str, Any], pieces: Sequence[Piece], left: Mapping[str, int]
) -> str:
    """What a folder that grows keeps, before the work begins. left: path-steps to take of each missing piece."""
    old, new = there["inputs"]["run"], record["inputs"]["run"]
    found = manifest.keys_of_differences(there, record)
    sizes = [f"from {old[key]} to {counted(new[key], key[:-1])}" for key in ("paths", "steps") if old[key] != new[key]]
    kept = f"{len(pieces) - len(left)} of {counted(len(pieces), 'shard')} are there"
    return (
        f"the run in the folder grows {' and '.join(sizes) or 'by what it observes and saves'}: "
        f"{', '.join(_anew(found, there, record))}; {kept}, the others take about {sum(left.values()):.3g} path-steps"
    )
