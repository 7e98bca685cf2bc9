# SPDX-License-Identifier: BSD-3-Clause
"""Animations of an ensemble: the points of many paths in a plane of two values, frame by frame over saved times."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import InvalidArgumentError
from ...native import checks, files
from ...native.checks import counted
from .. import look
from .data import Paths
from .draw import pair_of, take_names_as_they_are, which_paths, whole

_SIZE, _MARGIN = (5.0, 4.2), 0.05  # size in inches; share of the extent that stays empty on each side


def animation(data: Paths, where: tuple[object, object], of: object, most: int, rate: float) -> Any:
    """A FuncAnimation with a frame for each saved time, written as a .gif if a path is given, or drawn into axes of
    the caller."""
    path, ax = where
    target = _file(path)
    files.optional("matplotlib", "plot")
    shown = which_paths(data, most)
    pair = pair_of(data.names, data.names.chosen("of", of) or (data.names.q[0], data.names.p[0]))
    if not checks.finite("rate", rate) > 0:
        raise InvalidArgumentError(f"rate = {rate}: give a positive number of frames a second")
    x, y = (data.values(name)[:, shown] for name in pair)
    given = look.axes_of(ax, 1, path)
    with look.drawing(None, *_SIZE, 100, axes=given) as page:
        axes = given[0] if given else page.add_subplot()
        (points,) = axes.plot([], [], color=look.BLUE, marker=".", linestyle="", alpha=0.6)
        axes.set(xlabel=pair[0], ylabel=pair[1], xlim=_extent(x), ylim=_extent(y))
        title = axes.set_title("", fontsize=9)
        take_names_as_they_are([], [axes])

        def draw(frame: int) -> tuple:
            points.set_data(x[frame], y[frame])
            title.set_text(whole(f"{data.title}, {counted(len(shown), 'path')}, t = {data.t[frame]:g}", _SIZE[0]))
            return points, title

        draw(0)
        made = importlib.import_module("matplotlib.animation")
        found = made.FuncAnimation(page, draw, frames=len(data.t), interval=1000 / rate, blit=False)
        if target is not None:
            files.replace(target, lambda part: found.save(part, writer=made.PillowWriter(fps=rate)))
    return found


def _file(path: object) -> Path | None:
    """The file of an animation, if one is given."""
    if path is None:
        return None
    target = files.path_of("path", path)
    if target.suffix != ".gif":
        raise InvalidArgumentError(
            f"{str(target)!r} has no ending of an animation: give .gif, or write what is returned by its own save"
        )
    files.optional("PIL", "plot")
    return target


def _extent(values: np.ndarray) -> tuple[float, float]:
    """Limits that contain all points of all times."""
    low, high = np.nanmin(values), np.nanmax(values)
    margin = _MARGIN * (high - low) or _MARGIN * abs(low) or 1.0
    return low - margin, high + margin
