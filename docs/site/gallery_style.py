# SPDX-License-Identifier: BSD-3-Clause
"""The look of the gallery's figures: that of all figures of the project."""

import matplotlib as mpl
from symsde.show import look


def apply(_conf, _program):
    """Called before every program, after matplotlib has been reset: labels can be read on a phone, too."""
    shape = {"figure.figsize": (4.6, 3.4), "savefig.dpi": 160}
    mpl.rcParams.update(look.STYLE | shape | {"figure.constrained_layout.use": True})
