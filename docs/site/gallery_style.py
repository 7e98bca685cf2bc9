# SPDX-License-Identifier: BSD-3-Clause
"""The look of the gallery's figures: that of all figures of the project."""

import matplotlib as mpl
from symsde.reports import look


def apply(_conf, _program):
    """Called before every program, after matplotlib has been reset."""
    mpl.rcParams.update(look.STYLE | {"figure.figsize": (6.0, 3.6), "figure.constrained_layout.use": True})
