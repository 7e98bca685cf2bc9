# SPDX-License-Identifier: BSD-3-Clause
"""The manifest: it identifies the run in a folder, and shows whether a caller means the same run."""

from __future__ import annotations

import hashlib
import inspect
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ..errors import SceneError
from ..native import checks, files
from ..native.build import build_info
from ..run.setup import make_setup
from ..run.simulate import simulate
from ..run.states import named
from ..run.states.law import States
from . import by_path, computed, named_functions, numerics
from .pieces import is_size
from .scene import RUN_KEYS, Scene

FORMAT = 2
_READABLE = (1, FORMAT)  #: formats that are read; format 1 lacks the values that identify models and functions
NAME = "manifest.json"
_DEFAULTS = {name: parameter.default for name, parameter in inspect.signature(simulate).parameters.items()}
_NOT_OF_THE_RESULT = {"threads", "lanes"}  # options that do not change the bits of results


def of_scene(scene: Scene, shard_paths: int) -> dict[str, Any]:
    """The manifest of a scene: its inputs with the defaults filled in, seed and hash, and what computes it."""
    run = {key: scene.run.get(key, _DEFAULTS[key]) for key in RUN_KEYS if key not in _NOT_OF_THE_RESULT}
    if run["save_at"] is None:
        del run["save_at"]  # folders of older versions lack it
    output = {"moments": scene.moments, "paths": _ranges(scene.paths)}
    if scene.keep_last:  # folders of older versions lack it
        output["keep_last"] = True
    if scene.groups is not None:
        output["groups"] = list(scene.groups.grid.values)
    observed = {key: scene.tables[key] for key in ("observables", "observe") if scene.tables.get(key)}
    inputs = _plain({"model": scene.tables["model"], "run": run, "output": output, **observed})
    setup = make_setup(scene.model, **scene.run)
    start = computed.Start(*setup.first_state(), float(run["t0"]), run["step"] * run["steps"])
    functions = {name: x for name, x in scene.observables.items() if callable(x)}
    inputs["computed"] = _plain(computed.of(scene.model, setup.scheme, start, functions))
    if own := {name: hashlib.sha256(path.read_bytes()).hexdigest() for name, path in python_sources(scene)}:
        inputs["python_sha256"] = own
    found = numerics.of(scene.model, [setup.scheme], start, **scene.run)
    return of_inputs(inputs, inputs["run"]["seed"], shard_paths, found)


def of_inputs(inputs: dict[str, Any], seed: int, shard_paths: int, found: dict[str, str]) -> dict[str, Any]:
    """The manifest of these inputs and of the findings of `numerics`, in types of JSON."""
    build = build_info()
    return {
        "format": FORMAT,
        "inputs": inputs,
        "hash": _hash(inputs),
        "seed": seed,
        "shard_paths": shard_paths,
        "counter_map": build["counter map of the noise"],
        "version": build["version"],
        "compiler": build["compiler"],
        "build": build["compile options"],
        "numerics": found,
    }


def _hash(inputs: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(inputs, sort_keys=True).encode()).hexdigest()


def python_sources(scene: Scene) -> list[tuple[str, Path]]:
    """Files with functions that the scene names, each with its path relative to the scene's folder."""
    return list(named_functions.sources(Path(scene.file).parent, scene.tables))


def files_beside(scene: Scene) -> list[tuple[str, Path]]:
    """These files, and tables of states and parameters, which the folder of a run keeps as well."""
    folder = Path(scene.file).parent
    named_there = [*(x["rows"] for x in named.tables_of(scene.tables["run"])), *by_path.files_of(scene.tables["model"])]
    tables = dict.fromkeys(name for name in named_there if not Path(name).is_absolute())
    return [*python_sources(scene), *((name, folder / name) for name in tables)]


def _plain(value):
    """Write equal numbers in the same way: 1.0 and 1 are the same input."""
    if isinstance(value, States):
        return _plain(value.told())
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float) and value.is_integer() and abs(value) < 2**53:
        return int(value)
    return value


def _ranges(paths) -> list[list[int]]:
    """Ascending indices as pairs of first and count."""
    found: list[list[int]] = []
    if isinstance(paths, range):
        return [[paths.start, len(paths)]]
    for i in paths:
        if found and i == sum(found[-1]):
            found[-1][1] += 1
        else:
            found.append([i, 1])
    return found


def to_bytes(manifest: dict[str, Any]) -> bytes:
    """The bytes of the file."""
    return (json.dumps(manifest, indent=1, sort_keys=True) + "\n").encode()


def read(folder: Path) -> dict[str, Any] | None:
    """The manifest of a folder; None if it has none."""
    path = folder / NAME
    try:
        content = files.content(path)
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        raise SceneError(f"{path} cannot be read: {error.strerror}: give another folder") from None
    try:
        found = json.loads(content)
        made = found["format"]
        is_one = made not in _READABLE or (_hash(found["inputs"]) == found["hash"] and is_size(found["shard_paths"]))
    except (ValueError, KeyError, TypeError):
        is_one = False
    if not is_one:
        raise SceneError(f"{path} is no manifest of a run: give another folder, or remove this one")
    if made not in _READABLE:
        raise SceneError(f"{path} has format {made}, this symsde knows {FORMAT}: use the version that made it")
    return found


def differences(one: dict[str, Any], other: dict[str, Any]) -> list[str]:
    """The entries that differ, by name, with both values."""
    left, right = dict(_flat(one)), dict(_flat(other))
    return [
        f"{key.removeprefix('inputs.')} = {_shown(left.get(key))} there, {_shown(right.get(key))} here"
        for key in keys_of_differences(one, other)
    ]


def keys_of_differences(one: dict[str, Any], other: dict[str, Any]) -> list[str]:
    """The names of the entries that differ; what a run grew from does not make it another."""
    left, right = dict(_flat(one)), dict(_flat(other))
    keys = [*left, *(key for key in right if key not in left)]
    return [key for key in keys if key not in ("hash", "grown_from") and left.get(key) != right.get(key)]


def _shown(value: object) -> str:
    return "nothing" if value is None else checks.shown(value)


def _flat(manifest: dict[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in manifest.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{before}{key}.")
        else:
            yield before + key, value


def sizes(record: dict[str, Any]) -> dict[str, int]:
    """Paths and steps of a run, which its folder may have beyond those of its scene."""
    run = record["inputs"]["run"]
    return {key: run[key] for key in ("paths", "steps") if key in run}


def keeps_last(record: dict[str, Any] | None) -> bool:
    """Whether shards of moments of a run hold last states."""
    return bool(record and record["inputs"].get("output", {}).get("keep_last"))


def require_run(there: dict[str, Any], folder: Path) -> None:
    """Refuse the folder of an expectation or of an ensemble if a run's folder is needed."""
    if "ensemble" in there["inputs"]:
        raise SceneError(
            f"{folder} holds the shards of an ensemble: the call of `symsde.ensemble` that made it resumes it; give a "
            "folder that `symsde run` has written"
        )
    if "expect" in there["inputs"]:
        how = f"`symsde expect SCENE.toml --out {folder}` resumes it; its answer is answer.json"
        if "mlmc" in there["inputs"]:
            how = "the call of `symsde.mlmc` that made it resumes it"
        raise SceneError(f"{folder} holds an expectation: {how}; give a folder that `symsde run` has written")


def require_same(there: dict[str, Any], here: dict[str, Any], folder: Path) -> None:
    """Refuse the folder of another run, and name the differences."""
    if there["format"] != FORMAT:
        raise SceneError(
            f"{folder} was begun by a version of symsde that did not record how a run is computed, so its "
            "shards may not fit new ones: read it by symsde.open_run, or continue with that version; for this one give "
            "another folder with --out"
        )
    if found := differences(there, here):
        raise SceneError(
            f"{folder} holds another run: {'; '.join(found[:5])}{'; ...' if len(found) > 5 else ''}: "
            "give another folder with --out, or remove that one"
        )


def require_scene(there: dict[str, Any], scene: Scene, folder: Path) -> None:
    """Refuse to read shards with another scene; inputs that an older version did not record are ignored."""
    here = dict(_flat(of_scene(scene, there["shard_paths"])["inputs"]))
    for key, value in _flat(there["inputs"]):
        if here.get(key) != value:
            raise SceneError(
                f"{folder}/scene.toml is not the scene of the shards: {key} = {_shown(value)} there, "
                f"{_shown(here.get(key))} in the file: put back what was changed"
            )
