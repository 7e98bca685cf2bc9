# SPDX-License-Identifier: BSD-3-Clause
"""Figures of results: paths, phase plane, energy, moments with bands, and results of observers.

data      the data of figures, from objects or files
draw      figures
animate   animations of an ensemble
"""

from . import animate, draw
from .data import means_of, paths_of


def run(found, where: tuple, what: str = "", of: object = None, most: int = draw.MOST_PATHS):
    """A figure of a `Run`; where: path and ax."""
    return draw.finish(*draw.of_run(paths_of(found), what, of, most), *where)


def animation(found, where: tuple, of: object, most: int, rate: float):
    """An animation of a `Run`."""
    return animate.animation(paths_of(found), where, of, most, rate)


def moments(found, where: tuple, what: str = "", of: object = None):
    """A figure of `Moments`."""
    return draw.finish(*draw.of_moments(means_of(found), what, of), *where)


def sweep(title: str, labels: tuple[str, str], curves: list[tuple], where: tuple):
    """A figure of means over a parameter; labels of the axes, and curves (label, x, mean, standard error)."""
    return draw.finish(*draw.of_sweep(title, labels, curves), *where)


def fit(title: str, t, rows: list[tuple], where: tuple):
    """A figure of fitted data; rows: (name, data, their errors, fitted, its errors)."""
    return draw.finish(*draw.of_fit(title, t, rows), *where)


def observed(found, where: tuple, at: int = -1):
    """A figure of an observer's results."""
    return draw.finish(*draw.of_observed(found, at), *where)
