# SPDX-License-Identifier: BSD-3-Clause
"""Does f have a variance? Without one no interval holds, however many paths there are."""

from __future__ import annotations

import numpy as np

from ..errors import NumericalError

LEAST = 256  #: values below which nothing can be told
_DOUBT = 2.0  #: standard errors of the index that decide


def tail_index(values: np.ndarray) -> tuple[float, float]:
    """Hill's estimate of a with P(|f| > x) ~ x^-a from the largest values, and its standard error."""
    size = np.sort(np.abs(values - np.median(values)))[::-1]
    count = int(np.sqrt(size.size))
    if size[count] <= 0:
        return np.inf, 0.0
    mean = float(np.log(size[:count] / size[count]).mean())
    index = 1 / mean if mean > 0 else np.inf
    return index, index / np.sqrt(count)


def require_variance(values: np.ndarray, name: str) -> None:
    """Refuse values whose largest ones fall off so slowly that their variance is infinite."""
    if values.size < LEAST:
        return
    index, error = tail_index(values)
    if index + _DOUBT * error < 2:
        raise NumericalError(
            f"f = {name} seems to have no finite variance: of {values.size} values the largest fall off as "
            f"x^-{index:.2g} (below 2), and the variance grows with the number of paths, so that no interval would "
            "hold; bound f, as by np.clip, or take another one"
        )
