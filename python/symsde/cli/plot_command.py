# SPDX-License-Identifier: BSD-3-Clause
"""symsde plot DIR_OR_FILE: figures of a run folder, finished or not, or of a file of paths or moments."""

from __future__ import annotations

import argparse
import functools
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from ..batch.opened import open_run
from ..errors import InvalidArgumentError, SceneError, UnknownNameError
from ..native import checks, files
from ..run.loaded import LoadedRun, load_file
from ..run.saved import MomentTables, PathTables
from ..show.plot import data, draw

HELP = "Draw a run: paths, phase plane, energy, moments with bands, results of observers."


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `symsde plot`."""
    parser.add_argument("source", metavar="DIR_OR_FILE", help="folder of a run, or its .nc, .npz or .csv file")
    parser.add_argument("--what", metavar="NAME", help="draw only this figure (default: all)")
    parser.add_argument(
        "--of", metavar="VALUE", action="append", help="draw this value, such as q_2, or observer; may be repeated"
    )
    parser.add_argument("--at", metavar="I", type=int, default=-1, help="saved time of histograms (default: the last)")
    parser.add_argument("--most", metavar="N", type=int, default=draw.MOST_PATHS, help="paths drawn (%(default)s)")
    parser.add_argument("--out", metavar="FILE", help="file of one figure: .png, .pdf or .svg")


def run(options: argparse.Namespace) -> int:
    """Execute the verb and return the exit code."""
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
    """A figure that can be drawn from the results."""

    make: Callable[[], tuple]  #: makes the panels and the title
    shows: tuple[str, ...]  #: names of the values that the figure can show
    called: Callable[[str], str] = str  #: name of a value -> its name in `shows`

    def has(self, names: list[str]) -> bool:
        """Whether the figure can show all of these values."""
        return {self.called(name) for name in names} <= set(self.shows)


Figures = dict[str, Figure]


def _chosen(known: Figures, options: argparse.Namespace) -> Figures:
    """The figure named by --what, or all figures that show the values or observers named by --of."""
    if options.what:
        checks.choice("--what", options.what, list(known))
        known = {options.what: known[options.what]}
    every = list(dict.fromkeys(name for figure in known.values() for name in figure.shows))
    named = {name.removeprefix("observed-"): name for name in known if name.startswith("observed-")}
    for name in options.of or []:
        if name in named and name not in every:
            return {named[name]: known[named[name]]}
    wanted = options.of or []
    for name in wanted:
        if not any(figure.has([name]) for figure in known.values()):
            raise UnknownNameError(f"there is no value {name!r}: there are {checks.nearest(name, [*every, *named])}")
    chosen = {name: figure for name, figure in known.items() if figure.has(wanted)}
    if not chosen:
        raise InvalidArgumentError(
            f"no figure shows {' and '.join(wanted)} together: draw one after the other, or give one of --what: "
            + "; ".join(f"{name} shows {', '.join(figure.shows[:12])}" for name, figure in known.items())
        )
    return chosen


def _of_folder(folder: Path, options: argparse.Namespace) -> Figures:
    """Figures of the shards that exist in a folder."""
    found = open_run(folder)
    figures: Figures = {}
    if (saved := found.run) is not None:
        figures |= _of_paths(saved, options)
    if (moments := found.moments) is not None:
        figures |= _of_moments(moments, options)
    return figures


def _of_file(file: Path, options: argparse.Namespace) -> Figures:
    found = load_file(file)
    return _of_paths(found, options) if isinstance(found, LoadedRun) else _of_moments(found, options)


def _of_moments(found: MomentTables, options: argparse.Namespace) -> Figures:
    means, values = data.means_of(found), found.values
    figures = {"moments": Figure(lambda: draw.of_moments(means, "moments", options.of), values.names, values.called)}
    if values.ndof >= draw.CHAIN:
        figures["moments-map"] = Figure(lambda: draw.of_moments(means, "map", options.of), ("q", "p"))
    for name, result in getattr(found, "observed", {}).items():  # results that tables cannot hold
        make = functools.partial(draw.of_observed, result, options.at)
        figures[f"observed-{name}"] = Figure(make, result.looked_at, values.called)
    return figures


def _of_paths(found: PathTables, options: argparse.Namespace) -> Figures:
    paths, values = data.paths_of(found), found.values
    shows = {"paths": values.names, "phase": values.q + values.p}
    if options.what == "trajectory":
        shows["trajectory"] = values.names
    if values.has_energy:
        shows["energy"] = ("energy",)
    called = dict.fromkeys(shows, values.called)
    if values.ndof >= draw.CHAIN:
        shows["map"], called["map"] = ("q", "p"), str
    return {
        what: Figure(functools.partial(draw.of_run, paths, what, options.of, options.most), names, called[what])
        for what, names in shows.items()
    }
