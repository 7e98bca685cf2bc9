# SPDX-License-Identifier: BSD-3-Clause
"""The figures of the paper's experiments: half a page wide, in the common look."""

from contextlib import contextmanager

from .. import look

WIDTH, HEIGHT, DPI = 5.5, 3.5, 200  # [in], [in], [1/in]
STYLE = {"legend.frameon": True, "legend.framealpha": 0.9, "legend.edgecolor": "none", "legend.borderpad": 0.25,
         "lines.linewidth": 1.1}  # fmt: skip


def colour(scheme):
    """That of a scheme, the same in every figure."""
    return look.of_scheme(scheme)["color"]


@contextmanager
def figure(path, mosaic, height=HEIGHT, pdf=True, **options):
    """Give the axes of a mosaic by name; write the PNG, and a PDF beside it unless pdf is False, at the end."""
    with look.drawing(path, WIDTH, height, DPI, pdf=pdf, style=STYLE) as page:
        axes = page.subplot_mosaic(mosaic, **options)
        yield axes
        if len(axes) > 1:
            for letter, axis in zip("abcdef", axes.values(), strict=False):
                axis.set_title(f"({letter})", loc="left", pad=3)


def slope_guide(axis, steps, level, order, label):
    """A dashed line of the given order through (steps[0], level)."""
    heights = [level * (step / steps[0]) ** order for step in steps]
    axis.loglog(steps, heights, "--", color=look.GREY, lw=0.9, label=label)
