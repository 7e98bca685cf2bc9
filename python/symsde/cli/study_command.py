# SPDX-License-Identifier: BSD-3-Clause
"""`symsde study`: one scene, or all scenes of a folder with the page of the documentation."""

from __future__ import annotations

import argparse
import importlib
import sys
from pathlib import Path

from ..errors import InvalidArgumentError, SceneError
from ..native import files as _files

HELP = "Measure error against run time of schemes on a scene; write a table, a CSV file and a figure."


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument("scene", metavar="SCENE.toml", nargs="?")
    parser.add_argument("--schemes", metavar="A,B", help="names of schemes, instead of those of [study]")
    parser.add_argument("--steps", metavar="N,M", help="numbers of steps to the horizon, instead of those of [study]")
    parser.add_argument("--paths", metavar="N", type=int, help="paths of the error runs")
    parser.add_argument("--horizon", metavar="T", type=float, help="time at which errors are measured")
    parser.add_argument("--out", metavar="DIR", help="directory of the results (default: out/study/SCENE)")
    parser.add_argument("--all", metavar="DIR", help="study every scene of a folder that has a table [study]")
    parser.add_argument("--markdown", metavar="FILE", help="with --all: write this page, and figures/ beside it")
    parser.add_argument("--quiet", action="store_true", help="no progress and no table")


def run(options: argparse.Namespace) -> int:
    """Execute the verb and return the exit code."""
    if (options.scene is None) == (options.all is None):
        raise InvalidArgumentError("give one scene, or --all with a folder of scenes")
    if options.markdown and not options.all:
        raise InvalidArgumentError("--markdown needs --all with a folder of scenes")
    scenes = importlib.import_module("symsde.studies.study.study_scenes")
    files = [Path(options.scene)] if options.scene else _folder(options.all)
    given = {
        "schemes": _split(options.schemes),
        "steps": _whole(options.steps),
        "paths": options.paths,
        "horizon": options.horizon,
        "progress": sys.stderr.isatty() and not options.quiet,
    }
    for file in files:
        scenes.check(file, **given)  # check all scenes before the first long run
    studies = []
    for file in files:
        base = Path(options.out or "out/study")
        directory = base if options.out and options.scene else base / file.stem
        studies.append(_one(scenes, file, directory, given, options.quiet))
    if options.markdown:
        importlib.import_module("symsde.studies.study.study_page").write(options.markdown, files, studies)
        print(f"written to {options.markdown}")
    return 0


def _one(scenes, file: Path, directory: Path, given: dict, quiet: bool):
    """Study a scene; after Ctrl-C print how to continue."""
    try:
        study = scenes.study(file, out=directory, **given)
    except KeyboardInterrupt:
        print(f"\nfinished points are kept in {directory}: the same command resumes from there", file=sys.stderr)
        raise
    if not quiet:
        print(f"{study}\n{study.words()}")
    resumed = f", {study.resumed} of {len(study.rows)} points from an earlier run" if study.resumed else ""
    print(f"written to {directory}: work-precision.csv, work-precision.png{resumed}\n", flush=True)
    return study


def _folder(name: str) -> list[Path]:
    """Scenes of a folder that can be studied."""
    found = sorted(Path(name).glob("*.toml"))
    chosen = [file for file in found if b"\n[study]" in _files.content(file)]
    if not chosen:
        raise SceneError(f"{name} has no scene with a table [study]")
    return chosen


def _split(text: str | None) -> list[str] | None:
    return None if text is None else [part.strip() for part in text.split(",") if part.strip()]


def _whole(text: str | None) -> list[int] | None:
    parts = _split(text)
    try:
        return None if parts is None else [int(part) for part in parts]
    except ValueError:
        raise InvalidArgumentError(f"--steps {text}: give whole numbers, as 16,32,64") from None
