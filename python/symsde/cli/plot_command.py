# SPDX-License-Identifier: BSD-3-Clause
"""symsde plot DIR_OR_FILE: figures of a run folder, finished or not, or of a file of paths or moments."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from ..batch.opened import open_run
from ..errors import InvalidArgumentError, SceneError
from ..native import checks, files
from ..reports.plot import data, draw
from ..run.loaded import LoadedRun, load_file
from ..run.observers.requests import value_name

HELP = "Draw a run: paths, phase plane, energy, moments with bands, results of observers."


def arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `symsde plot`."""
    parser.add_argument("source", metavar="DIR_OR_FILE", help="folder of a run, or its .nc, .npz or .csv file")
    parser.add_argument("--what", metavar="NAME", help="draw only this figure (default: all)")
    parser.add_argument(
        "--of", metavar="VALUE", action="append", help="draw this value, such as q_2, or observer; may be repeated"
    )
    parser.add_argument("--at", metavar="I", type=int, default=-1, help="saved time of histograms (default: the last)")
    parser.add_argument("--most", metavar="N", type=int, default=draw.MOST_PATHS, help="paths drawn (%(default)s)")
    parser.add_argument("--out", metavar="FILE", help="file of one figure: .png, .pdf or .svg")


def run(options: argparse.Namespace) -> int:
    """The verb."""
    source = Path(options.source)
    if not os.path.exists(source):
        raise SceneError(f"{source} does not exist: give the folder of a run, or a file of one")
    files.optional("matplotlib", "plot")
    known = _of_folder(source, options) if source.is_dir() else _of_file(source, options)
    if not known:
        raise SceneError(f"{source} holds no shard yet: there is nothing to draw")
    chosen = _chosen(known, options)
    if options.out and len(chosen) > 1:
        raise InvalidArgumentError(f"--out is for one figure: say which by --what, one of {', '.join(chosen)}")
    for name, figure in chosen.items():
        beside = source / f"{name}.png" if source.is_dir() else source.with_name(f"{source.stem}-{name}.png")
        target = Path(options.out) if options.out else beside
        draw.finish(*figure.make(), target)
        print(f"written to {target}")
    return 0


@dataclass(frozen=True)
class Figure:
    """A figure that can be drawn."""

    make: Callable[[], tuple]  #: its panels and title
    shows: tuple[str, ...]  #: values that it can show


Figures = dict[str, Figure]


def _chosen(known: Figures, options: argparse.Namespace) -> Figures:
    """The figure that is asked for by --what, or all that show what is asked for by --of, values or observers."""
    if options.what:
        checks.choice("--what", options.what, list(known))
        known = {options.what: known[options.what]}
    every = list(dict.fromkeys(name for figure in known.values() for name in figure.shows))
    named = {name.removeprefix("observed-"): name for name in known if name.startswith("observed-")}
    for name in options.of or []:
        if name in named and name not in every:
            return {named[name]: known[named[name]]}
    wanted = [value_name(name, every) for name in options.of or []]
    for name in wanted:
        data.known(name, [*every, *named])
    options.of = wanted or None
    chosen = {name: figure for name, figure in known.items() if set(wanted) <= set(figure.shows)}
    if not chosen:
        raise InvalidArgumentError(
            f"no figure shows {' and '.join(wanted)} together: draw one after the other, or give one of --what: "
            + "; ".join(f"{name} shows {', '.join(figure.shows[:12])}" for name, figure in known.items())
        )
    return chosen


def _of_folder(folder: Path, options: argparse.Namespace) -> Figures:
    """Figures that the shards there give."""
    found = open_run(folder)
    figures: Figures = {}
    if (saved := found.run) is not None:
        figures |= _of_paths(data.paths_of(saved), options)
    if (moments := found.moments) is not None:
        figures |= _of_means(data.means_of(moments), options)
        for name, result in moments.observed.items():
            shows = tuple(result.observer.names(moments.columns()))
            figures[f"observed-{name}"] = Figure(lambda result=result: draw.of_observed(result, options.at), shows)
    return figures


def _of_file(file: Path, options: argparse.Namespace) -> Figures:
    found = load_file(file)
    if isinstance(found, LoadedRun):
        return _of_paths(data.paths_of(found), options)
    return _of_means(data.means_of(found), options)


def _of_means(found: data.Means, options: argparse.Namespace) -> Figures:
    figures = {"moments": Figure(lambda: draw.of_moments(found, "moments", options.of), tuple(found.columns()))}
    if f"q_{draw.CHAIN}" in found.columns():
        figures["moments-map"] = Figure(lambda: draw.of_moments(found, "map", options.of), ("q", "p"))
    return figures


def _of_paths(found: data.Paths, options: argparse.Namespace) -> Figures:
    columns = tuple(found.columns())
    shows = {"paths": columns, "phase": tuple(name for name in columns if name != "energy")}
    if found.q.shape[1] >= draw.CHAIN:
        shows["map"] = ("q", "p")
    if found.energies:
        shows["energy"] = ("energy",)
    return {
        what: Figure(lambda what=what: draw.of_run(found, what, options.of, options.most), names)
        for what, names in shows.items()
    }
