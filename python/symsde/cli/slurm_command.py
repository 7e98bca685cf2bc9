# SPDX-License-Identifier: BSD-3-Clause
"""`symsde slurm`: scripts for the job array of a scene, for the job that merges its parts, and for their
environment.
"""

from __future__ import annotations

import argparse
import os
import re
import shlex
import sys
from pathlib import Path

from ..batch import manifest
from ..batch.scene_pieces import Batch
from ..batch.stop import seconds
from ..errors import InvalidArgumentError, SceneError
from ..native import checks, files
from ..native.checks import counted

HELP = "Write the scripts of a job array for Slurm: parts of a scene, their merge, their environment."
PARTS, MERGE, ENVIRONMENT, SUBMIT = "parts.sbatch", "merge.sbatch", "environment.sh", "submit.sh"
_MOST = 10000  #: most parts of an array
_DEFAULT = 32  #: default number of parts, if there are as many shards


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument("scene", metavar="SCENE.toml")
    parser.add_argument("--out", metavar="DIR", help="folder of scripts and results (default: slurm-SCENE)")
    parser.add_argument("--parts", metavar="N", type=int, help=f"tasks of the array (default: {_DEFAULT} at most)")
    parser.add_argument("--time", metavar="TIME", default="1h", help="of a task: 90s, 30min, 1-12:00 (%(default)s)")
    parser.add_argument("--cpus", metavar="N", type=int, default=1, help="processors of a task (%(default)s)")


def run(options: argparse.Namespace) -> int:
    """Execute the verb and return the exit code."""
    out = options.out or f"slurm-{Path(options.scene).stem}"
    place, parts, size = _plan(options, out)
    cpus = checks.integer("--cpus", options.cpus, (1, 1024))
    trusted = " --allow-python" if options.allow_python else ""
    scene = shlex.quote(str(Path(options.scene).resolve()))
    head = _head(place, seconds("--time", options.time))
    array = head(f"--array=1-{parts}", f"--cpus-per-task={cpus}", "--signal=B:TERM@120", "--requeue")
    work = f'"$PYTHON" -m symsde run {scene} --shard "$SLURM_ARRAY_TASK_ID/{parts}" --shard-paths {size}'
    texts = {
        PARTS: f'{array}exec {work} --out "part-$SLURM_ARRAY_TASK_ID" --quiet{trusted}\n',
        MERGE: f'{head()}exec "$PYTHON" -m symsde merge part-* --out whole{trusted}\n',
        ENVIRONMENT: _environment(),
        SUBMIT: f"#!/bin/sh\n# Submits both jobs; the merge waits for the whole array.\ncd {shlex.quote(str(place))}\n"
        f'array=$(sbatch --parsable {PARTS}) && sbatch --dependency="afterany:${{array%%;*}}" {MERGE}\n',
    }
    with files.folder(out) as folder:
        for name, text in texts.items():
            if name != ENVIRONMENT or not (folder / name).exists():  # it may hold lines of the user
                files.replace_text(folder / name, text)
    print(f"{counted(parts, 'part')} of at least {size} paths a shard; written to {out}: {', '.join(texts)}")
    print(f"look through {ENVIRONMENT}, then `sh {shlex.quote(f'{out}/{SUBMIT}')}`; the results come to {out}/whole")
    return 0


def _plan(options: argparse.Namespace, out: str) -> tuple[Path, int, int]:
    """The folder, the number of parts, and paths of a shard: shards are made smaller if there are fewer shards than
    parts."""
    place = files.path_of("--out", out).resolve()
    batch = Batch.of(options.scene, str(place))
    if not batch.pieces:
        raise SceneError(f"{options.scene} asks for neither moments nor paths: there is nothing to compute")
    if "\n" in str(place) or "\n" in str(Path(options.scene).resolve()):
        raise InvalidArgumentError("the names of scene and folder must not hold a line break: scripts are lines")
    if there := next((name for name in (manifest.NAME, "part-1", "whole") if (place / name).exists()), None):
        raise SceneError(f"{out} holds {there}, so a run was begun there: give another folder with --out")
    if options.parts is None:
        return place, min(len(batch.pieces), _DEFAULT), batch.size
    wanted = checks.integer("--parts", options.parts, (1, _MOST))
    if wanted <= len(batch.pieces):
        return place, wanted, batch.size
    size, count = batch.finer(wanted) or (batch.size, len(batch.pieces))
    if count < wanted:
        raise InvalidArgumentError(
            f"--parts = {wanted} are more than the {counted(count, 'shard')} that the run can be cut into: give "
            f"{count} at most"
        )
    return place, wanted, size


def _head(place: Path, limit: float):
    """The first lines of a script: shell, Slurm options, folder, environment."""
    minutes = max(1, -int(-limit // 60))
    day, rest = divmod(minutes, 1440)
    time = f"{day}-{rest // 60:02d}:{rest % 60:02d}:00"
    name = re.sub(r"[^A-Za-z0-9._-]", "_", place.name)

    def lines(*more: str) -> str:
        told = (f"--job-name={name}", f"--time={time}", *more)
        asked = "".join(f"#SBATCH {option}\n" for option in told)
        return f"#!/bin/sh\n{asked}cd {shlex.quote(str(place))} || exit 5\n. ./{ENVIRONMENT}\n"

    return lines


def _environment() -> str:
    """The lines that select the current Python, package folders outside of it, and as many threads as Slurm
    grants."""
    lines = ["# Read by all jobs: modules to load, variables to set."]
    lines.append(f"PYTHON={shlex.quote(sys.executable)}")
    for name in ("PYTHONPATH", "SYMSDE_LIBRARY", "SYMSDE_CPU"):
        if value := os.environ.get(name):
            lines.append(f"export {name}={shlex.quote(value)}")
    lines.append('export SYMSDE_NUM_THREADS="${SLURM_CPUS_PER_TASK:-1}"')
    return "\n".join([*lines, ""])
