# SPDX-License-Identifier: BSD-3-Clause
"""The common look of the figures: half a page of a paper, colours that colour-blind readers tell apart."""

from contextlib import contextmanager

import matplotlib
from matplotlib.figure import Figure

WIDTH, HEIGHT, DPI = 5.5, 3.5, 200  # [in], [in], [1/in]

# Okabe and Ito, https://jfly.uni-koeln.de/color/
BLACK, BLUE, VERMILION, GREEN = "#000000", "#0072B2", "#D55E00", "#009E73"
ORANGE, SKY, PURPLE, GREY = "#E69F00", "#56B4E9", "#CC79A7", "#888888"

STYLE = {
    "font.size": 9,
    "axes.labelsize": 9,
    "axes.titlesize": 9,
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
    "axes.linewidth": 0.7,
    "axes.grid": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.linewidth": 0.4,
    "grid.color": "#DDDDDD",
    "mathtext.fontset": "dejavusans",
    "savefig.dpi": DPI,
}


@contextmanager
def figure(path, mosaic, height=HEIGHT, **options):
    """Give the axes of a mosaic by name; write the PNG at the end."""
    with matplotlib.rc_context(STYLE):
        page = Figure(figsize=(WIDTH, height), layout="constrained")
        axes = page.subplot_mosaic(mosaic, **options)
        yield axes
        if len(axes) > 1:
            for letter, axis in zip("abcdef", axes.values(), strict=False):
                axis.set_title(f"({letter})", loc="left", pad=3)
        page.savefig(path)


def slope_guide(axis, steps, level, order, label):
    """A dashed line of the given order through (steps[0], level)."""
    axis.loglog(steps, [level * (step / steps[0]) ** order for step in steps], "--", color=GREY, lw=0.9, label=label)
