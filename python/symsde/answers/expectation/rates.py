# SPDX-License-Identifier: BSD-3-Clause
"""How fast mean and variance of the levels fall and how fast their cost grows, with 95 % intervals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..expectation.tolerance import NORMAL


@dataclass(frozen=True)
class Rate:
    """A slope over the levels, in powers of two."""

    value: float  #: NaN where fewer than two levels show it
    half: float  #: half width of its 95 % interval; of the noise of the levels alone

    def __str__(self) -> str:
        """The slope and its half width, such as 1.98 +- 0.05."""
        return "not seen" if math.isnan(self.value) else f"{self.value:.2f} +- {self.half:.2f}"


UNSEEN = Rate(math.nan, math.nan)


def fall(values: Sequence[float], errors: Sequence[float]) -> Rate:
    """The slope of -log2 |value| over the level, fitted to values (level,) that exceed twice their errors (level,).

    The weights are the squared inverses of the errors of log2 |value|, of which each is at least 1e-3.
    """
    values, errors = (np.abs(np.asarray(x, dtype=float)) for x in (values, errors))
    levels = np.flatnonzero((values > 2 * errors) & (values > 0))
    if levels.size < 2:
        return UNSEEN
    logs = np.log2(values[levels])
    noise = np.maximum(errors[levels] / (values[levels] * math.log(2)), 1e-3)
    weights = noise**-2.0
    centre = np.average(levels, weights=weights)
    spread = float((weights * (levels - centre) ** 2).sum())
    slope = float((weights * (levels - centre) * logs).sum()) / spread
    return Rate(-slope, NORMAL / math.sqrt(spread))
