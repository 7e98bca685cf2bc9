# SPDX-License-Identifier: BSD-3-Clause
"""The one writer of figures, and their common style: one colour and marker per scheme, readable axes, files."""

from __future__ import annotations

import importlib
import os
import zlib
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InvalidArgumentError, WrongTypeError
from ..native import checks, files

ENDINGS = (".png", ".pdf", ".svg")

# Okabe and Ito, https://jfly.uni-koeln.de/color/, then Tol's muted colours, https://personal.sron.nl/~pault/
BLUE, VERMILION, GREEN, PURPLE = "#0072B2", "#D55E00", "#009E73", "#CC79A7"
ORANGE, SKY, BLACK, GREY = "#E69F00", "#56B4E9", "#000000", "#888888"
WINE, INDIGO, OLIVE, TEAL, FOREST, BROWN = "#882255", "#332288", "#999933", "#44AA99", "#117733", "#661100"
COLOURS = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY, BLACK, GREY)

#: scheme -> its colour and marker, the same in every figure
SCHEMES = {
    "midpoint": (BLUE, "o"),
    "symplectic_euler": (VERMILION, "s"),
    "symplectic_euler_adjoint": (WINE, "D"),
    "stormer_verlet": (GREEN, "^"),
    "gauss2": (PURPLE, "v"),
    "gauss3": (INDIGO, "h"),
    "lobatto3": (OLIVE, "8"),
    "heun": (ORANGE, "X"),
    "euler_maruyama": (GREY, "P"),
    "taylor15": (BLACK, "d"),
    "gauss2_strong32": (BLACK, "*"),
    "gauss2_strong32_areas": (BROWN, "*"),
    "gauss2_weak2_areas": (TEAL, "*"),
    "midpoint_areas": (SKY, "p"),
    "verlet_dz": (FOREST, ">"),
    "averaged_shift_midpoint": (TEAL, "<"),
    "drift_preserving": (BROWN, "d"),
    "exact_rotation": (OLIVE, "H"),
    "gauss_dkdkd": (FOREST, "D"),
    "verlet_kdk": (SKY, "^"),
    "chin4a": (WINE, "o"),
    "chin4a_strong2": (WINE, "s"),
}
_OTHERS = tuple((colour, marker) for marker in "1234x+|_" for colour in COLOURS)

STYLE = {
    "font.size": 9,
    "axes.labelsize": 9,
    "axes.titlesize": 9,
    "axes.linewidth": 0.7,
    "axes.grid": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": "#DDDDDD",
    "grid.linewidth": 0.4,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "legend.fontsize": 8,
    "legend.frameon": True,
    "legend.framealpha": 0.9,
    "legend.edgecolor": "none",
    "legend.borderpad": 0.25,
    "legend.handlelength": 1.8,
    "legend.labelspacing": 0.3,
    "lines.linewidth": 1.1,
    "lines.markersize": 4,
    "mathtext.fontset": "dejavusans",
    "svg.hashsalt": "symsde",
}


def of_scheme(name: str) -> dict[str, str]:
    """Colour and marker of a scheme as arguments of matplotlib; for unlisted schemes the name determines
    them."""
    colour, marker = SCHEMES.get(name) or _OTHERS[zlib.crc32(name.encode()) % len(_OTHERS)]
    return {"color": colour, "marker": marker}


@contextmanager
def drawing(
    path: Path | None, width: float, height: float, dpi: int, *, pdf: bool = False, axes: list[Any] | None = None
):
    """Give a new matplotlib figure, sizes in inches, or the figure of the caller's axes; at the end write it to the
    path.

    pdf: write a PDF beside it.

    MissingPackageError if matplotlib is missing.
    """
    matplotlib = files.optional("matplotlib", "plot")
    figures = importlib.import_module("matplotlib.figure")
    with matplotlib.rc_context(STYLE):
        page = axes[0].figure if axes else figures.Figure(figsize=(width, height), layout="constrained")
        yield page
        readable(axes or page.axes)
        if path is not None:
            write(page, path, dpi, pdf)


def write(page: Any, path: Path, dpi: int, pdf: bool) -> None:
    """A figure as a file, and on request as a PDF beside it."""
    files.replace(path, lambda part: page.savefig(part, dpi=dpi))
    if pdf:
        still = {"CreationDate": None}
        files.replace(path.with_suffix(".pdf"), lambda part: page.savefig(part, format="pdf", metadata=still))


@contextmanager
def panels(path: Path, mosaic: list, width: float, height: float, dpi: int, *, pdf: bool = False, **options):
    """Give the axes of a mosaic by name; at the end each gets a letter, if there are several."""
    with drawing(path, width, height, dpi, pdf=pdf) as page:
        axes = page.subplot_mosaic(mosaic, **options)
        yield axes
        if len(axes) > 1:
            for letter, axis in zip("abcdefgh", axes.values(), strict=False):
                axis.set_title(f"({letter})", loc="left", pad=3)


def target(path: object) -> Path | None:
    """The file of a figure, if one is given; endings of other formats are refused."""
    if path is None:
        return None
    file = files.path_of("path", path)
    if file.suffix not in ENDINGS:
        raise InvalidArgumentError(f"{os.fspath(file)!r} has no ending of a figure: give one of {', '.join(ENDINGS)}")
    return file


def axes_of(ax: object, number: int, path: object = None) -> list[Any] | None:
    """The axes that are given for so many panels, if any are."""
    if ax is None:
        return None
    if path is not None:
        raise InvalidArgumentError("path and ax are both given: give one, and save a figure of your own by its savefig")
    found = ax.ravel().tolist() if isinstance(ax, np.ndarray) else checks.items(ax) or [ax]
    for axes in found:
        if not hasattr(axes, "errorbar"):
            raise WrongTypeError(f"ax = {checks.shown(ax)} is no axes of matplotlib: give axes, or path=")
    if len(found) != number:
        there = checks.counted(number, "panel")
        raise InvalidArgumentError(f"ax holds {len(found)} axes, and the figure has {there}: give one for each")
    return found


def colour(scheme: str) -> str:
    """The colour of a scheme."""
    return of_scheme(scheme)["color"]


def slope_guide(axis, steps, level: float, order: float, label: str) -> None:
    """Draw a dashed line of an order through (steps[0], level)."""
    heights = [level * (step / steps[0]) ** order for step in steps]
    axis.loglog(steps, heights, "--", color=GREY, lw=0.9, label=label)


def readable(panels) -> None:
    """Label logarithmic axes: every decade or every few, and 1, 2, 5 if fewer than two labels would be visible."""
    ticker = importlib.import_module("matplotlib.ticker")
    for axes in panels:
        for axis, limits, most in ((axes.xaxis, axes.get_xlim(), 5), (axes.yaxis, axes.get_ylim(), 9)):
            if axis.get_scale() != "log":
                continue
            axis.set_minor_formatter(ticker.NullFormatter())
            first, last = np.log10(limits)
            if np.floor(last) - np.ceil(first) < 1:
                axis.set_major_locator(ticker.LogLocator(base=10, subs=(1, 2, 5), numticks=12))
                axis.set_major_formatter(ticker.FuncFormatter(lambda value, _: f"{value:g}"))
            else:
                axis.set_major_locator(ticker.LogLocator(base=10, numticks=most))
