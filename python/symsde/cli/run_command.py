# SPDX-License-Identifier: BSD-3-Clause
"""symsde run SCENE.toml --out DIR: compute the missing shards, and the results from all shards."""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import importlib.util
import logging
import math
import shlex
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from ..batch import growth, manifest, merged_results, share
from ..batch.dispatch import Context, dispatch
from ..batch.dry import need
from ..batch.error_check import error_check
from ..batch.execute import Task, taken
from ..batch.folder import RunFolder
from ..batch.pieces import Piece
from ..batch.ranks import Ranks
from ..batch.run_progress import Show, display
from ..batch.scene_pieces import Batch, extent_of
from ..batch.share import Share
from ..batch.stop import Stop, seconds
from ..errors import InvalidArgumentError
from ..native.checks import counted
from ..run.moments import Moments
from ..run.report import of_growth
from ..show import tables, tabular

OK, INTERNAL, PATHS_FAILED, STOPPED = 0, 1, 3, 4
PARTIAL, BY_VALUE = "moments.partial.csv", "moments-by-value.csv"
log = logging.getLogger("symsde")


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `symsde run`."""
    parser.add_argument("scene", metavar="SCENE.toml")
    parser.add_argument("--out", metavar="DIR", help="folder of the run, new or to resume (default: the scene's name)")
    parser.add_argument("--shard", metavar="I/N", type=str, help="compute only part I of N parts, counted from 1")
    parser.add_argument("--shard-paths", metavar="N", help="paths of a shard, 256 times a power of two")
    parser.add_argument("--paths", metavar="N", help="paths of the run, more than in the folder to let it grow")
    parser.add_argument("--steps", metavar="N", help="steps of the run, more than in the folder to let it grow")
    parser.add_argument(
        "--grow", action="store_true", help="let the run in the folder grow to what the scene asks for beyond it"
    )
    keeps = "keep the last states of all paths in shards of moments, so that more --steps go on from there"
    parser.add_argument("--keep-last", action="store_true", help=keeps)
    limits = "stop cleanly before this time is over: 90s, 30min, 23.5h, 23:30:00 or 1-12 (days-hours)"
    parser.add_argument("--max-walltime", metavar="TIME", help=limits)
    parser.add_argument("--checkpoint", metavar="TIME", help="time between saved states of long paths (default: 10 s)")
    parser.add_argument(
        "--dry-run", action="store_true", help="print what it takes (time by a short pilot); write nothing"
    )
    parser.add_argument(
        "--error-check", action="store_true", help="run some paths at half the step, too, and print the differences"
    )
    parser.add_argument("--quiet", action="store_true", help="no progress and no table")


def run(options: argparse.Namespace) -> int:
    """Execute the verb and return the exit code."""
    part = Share() if options.shard is None else share.parse(options.shard)
    limit = None if options.max_walltime is None else seconds("max-walltime", options.max_walltime)
    between = 10.0 if options.checkpoint is None else seconds("checkpoint", options.checkpoint)
    if options.out == "":
        raise InvalidArgumentError("--out is empty: give a folder, or leave it out")
    more = {key: _count(key, x) for key in ("paths", "steps") if (x := getattr(options, key)) is not None}
    out = options.out or Path(options.scene).stem
    batch = Batch.of(options.scene, out, options.shard_paths, more, keep_last=options.keep_last)
    folder = Path(batch.out)
    there = manifest.read(folder)
    record = growth.record_of(there, batch.scene, batch.size, folder, asked=options.grow, more=more)
    if options.dry_run:
        left = _left(batch.task, RunFolder(folder, record, batch.pieces)) if there else None
        print(need(batch.task, part.of(batch.pieces), batch.size, extent_of(batch.scene).saved, folder, left=left))
        if options.error_check:
            print("not counted: --error-check, some of the paths again, at the step and at half of it")
        return OK
    ranks = Ranks.launched()
    options.quiet = options.quiet or ranks.rank > 0
    if part.n > 1 and not part.of(batch.pieces):
        return _nothing(batch, part, ranks)
    with (
        logged(options.quiet),
        Stop(limit) as stop,
        RunFolder.open_to_write(batch.out, record, batch.pieces, batch.scene) as folder,
    ):
        if there and growth.came_from(record, there) and not options.quiet:
            log.info("%s", growth.sentence(there, record, batch.pieces, _left(batch.task, folder)))
        begin = time.monotonic()
        folder.checkpoint_seconds = between
        fine = compute(batch.task, ranks.of(part.of(batch.pieces)), folder, Conditions(stop, ranks, options.quiet))
        if ranks.rank > 0 or not fine:
            return OK if fine else INTERNAL  # the rank that failed reports its error, rank 0 everything else
        missing = folder.missing()
        if missing and (stop.reason or part.n == 1):
            partial = save_partial(batch, folder)
            return _stopped(stop, options, folder, missing, partial)
        if missing:
            return _partly(options, batch, folder, missing, part)
        code = finish(batch, folder, options.quiet, time.monotonic() - begin)
        if options.error_check and not _checked(batch, folder, stop, options.quiet):
            code = _stopped(stop, options, folder, [], None)
        return code


def _left(task: Task, folder: RunFolder) -> dict[str, int]:
    """Path-steps to take of each missing piece."""
    return {x.name: x.work - taken(task, x, folder.checkpoint(x)) for x in folder.missing()}


def _count(name: str, text: str) -> int:
    """A number of paths or steps, as 2000000 or 2e6."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (1 <= value < 2**53 and value == int(value)):
        raise InvalidArgumentError(f"{name} = {text}: give a whole number above zero, as 2000000 or 2e6")
    return int(value)


def _checked(batch: Batch, folder: RunFolder, stop: Stop, quiet: bool) -> bool:
    """Write and show the error check, unless it is stopped."""
    scene = batch.scene
    found = error_check(batch.task, extent_of(scene), scene=scene.text, tell=lambda *_: bool(stop.reason))
    if found is None:
        return False
    found.save(folder.path / "error-check.csv")
    if not quiet:
        print(found)
    return True


@dataclass(frozen=True)
class Conditions:
    """Conditions of the work: ranks, time limit, and verbosity."""

    stop: Stop
    ranks: Ranks
    quiet: bool


def compute(task: Task, mine: list[Piece], folder: RunFolder, conditions: Conditions) -> bool:
    """Compute the missing shards of some pieces; return whether all went well, here and on the other ranks."""
    done = sum(piece.work for piece in mine if folder.is_done(piece))
    shown = display(conditions.quiet, done)
    failure: Exception | None = None
    try:
        show = Show(sum(piece.work for piece in mine), done, shown)
        dispatch(task, mine, Context(folder, conditions.stop, show))
    except Exception as error:
        failure = error
    finally:
        if shown:
            shown.close()
    return conditions.ranks.agree(failure)


def save_partial(batch: Batch, folder: RunFolder) -> Path | None:
    """Save moments of a run that was stopped before any shard was done, at each time over the paths that got there.
    None if there are shards: a user can open them, and merging thousands would take too long at a stop."""
    pieces = batch.of_kind("moments")
    stopped = [piece for piece in pieces if piece.name in folder.parts]
    if not stopped or any(folder.is_done(piece) for piece in pieces):
        return None
    moments = merged_results.moments_of(batch.task, batch.size, stopped, lambda piece: folder.parts[piece.name])
    others = sum(piece.paths for piece in pieces) - sum(piece.paths for piece in stopped)
    moments.report = dataclasses.replace(moments.report, stopped=moments.report.stopped + others)
    moments.scene = batch.scene.text
    moments.save_table(folder.path / PARTIAL)
    return folder.path / PARTIAL


def finish(batch: Batch, folder: RunFolder, quiet: bool, took: float) -> int:
    """Compute, write and show the results."""
    report, failed, doubts, remarks = None, 0, [], []
    if pieces := batch.of_kind("moments"):
        moments = merged_results.moments_of(batch.task, batch.size, pieces, folder.read, seconds=took)
        moments.scene = batch.scene.text
        moments.save_table(folder.path / "moments.csv")
        (folder.path / PARTIAL).unlink(missing_ok=True)
        if moments.observers or moments.groups:
            moments.save(folder.path / ("moments.nc" if has_netcdf() else "moments.npz"))
        if moments.by_group is not None:
            moments.by_group.save_table(folder.path / BY_VALUE)
        report, failed, doubts = moments.report, moments.report.failed, moments.doubts()
        remarks = [] if quiet else moments.remarks()
        if not quiet:
            print_moments(moments)
    if pieces := batch.of_kind("paths"):
        saved = merged_results.run_of(batch.task, pieces, folder.read, seconds=took)
        saved.scene = batch.scene.text
        saved.save(folder.path / ("run.nc" if has_netcdf() else "run.npz"))
        report, failed = report or saved.report, max(failed, int((saved.status != 0).sum()))
    if not quiet:
        print(f"{report or ''}\nwritten to {folder.path}".lstrip())
    if failed:
        print(f"symsde: {counted(failed, 'path')} failed; moments are over the others", file=sys.stderr)
    known = (*report.warnings, of_growth(report.grown), batch.scene.unsaid) if report else ()
    for sentence in filter(None, (*known, *doubts, *remarks)):
        print(f"symsde: {sentence}", file=sys.stderr)
    return PATHS_FAILED if failed or doubts else OK


def _stopped(stop: Stop, options: argparse.Namespace, folder: RunFolder, missing: list[Piece], partial) -> int:
    done = len(folder.pieces) - len(missing)
    again = ["symsde", "run", options.scene, "--out", str(folder.path)]
    for key in ("shard", "paths", "steps"):
        if getattr(options, key) is not None:
            again += [f"--{key}", getattr(options, key)]
    again += [
        f"--{name}"
        for name in ("allow-python", "error-check", "grow", "keep-last")
        if getattr(options, name.replace("-", "_"))
    ]
    print(
        f"symsde: stopped by {stop.reason}; {done} of {len(folder.pieces)} shards are in {folder.path}: "
        f"resume with `{shlex.join(again)}`",
        file=sys.stderr,
    )
    if partial:
        print(f"symsde: {partial} holds moments of the paths as far as they have come (n_ok)", file=sys.stderr)
    return STOPPED


def _nothing(batch: Batch, part: Share, ranks: Ranks) -> int:
    """Report a part without shards; this is no error, since other parts do the work. No folder is made."""
    finer = ""
    if cut := batch.finer(part.n):
        most = "" if cut[1] >= part.n else f" and {counted(cut[1], 'part')} at most"
        finer = f", or --shard-paths {cut[0]}{most}, in all parts and in new folders"
    if ranks.rank == 0:
        print(
            f"symsde: part {part} has nothing to do: the run is cut into {counted(len(batch.pieces), 'shard')}: give "
            f"as many parts at most{finer}",
            file=sys.stderr,
        )
    return OK


def _partly(options, batch: Batch, folder: RunFolder, missing: list[Piece], part: Share) -> int:
    """Part i of n is done and other parts are not: print what to do when they are."""
    if not options.quiet:
        print(
            f"part {part} is done: {len(folder.pieces) - len(missing)} of {len(folder.pieces)} shards are in "
            f"{folder.path}; when all parts are done: `symsde merge DIR... --out DIR`"
        )
    if options.error_check:
        print(
            "symsde: a part makes no --error-check: give it to `symsde run` in the folder of `symsde merge`",
            file=sys.stderr,
        )
    failed = sum(folder.read(piece).facts["failed"] for piece in part.of(batch.pieces))
    return PATHS_FAILED if failed else OK


@contextlib.contextmanager
def logged(quiet: bool) -> Iterator[None]:
    """Send the package's log to standard error, unless the calling program has set up logging."""
    handler = logging.StreamHandler()
    handler.setFormatter(logging.Formatter("symsde: %(message)s"))
    level = log.level
    log.addHandler(handler)
    log.setLevel(logging.WARNING if quiet else logging.INFO)
    try:
        yield
    finally:
        log.removeHandler(handler)
        log.setLevel(level)


def has_netcdf() -> bool:
    """Whether NetCDF files can be written."""
    return all(importlib.util.find_spec(package) for package in ("xarray", "netCDF4"))


def print_moments(moments: Moments, rows: int = 11, columns: int = 4) -> None:
    """Print a table of at most eleven times; q_1, p_1 and the energy come first."""
    names, (means, errors) = moments.columns(), moments.to_arrays()
    wanted = tabular.first_values(moments, columns)
    lines = [["t", "paths", *(f"mean {names[j]}" for j in wanted)]]
    for i in tabular.some_times(len(moments.t), rows):
        values = (f"{means[i, j]:.5g} +- {errors[i, j]:8.2g}" for j in wanted)
        lines.append([f"{moments.t[i]:.4g}", f"{moments.n_ok[i]}", *values])
    print(tables.aligned(lines, (10, 9, *[24] * len(wanted))))
