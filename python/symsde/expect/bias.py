# SPDX-License-Identifier: BSD-3-Clause
"""What is left of the error of a step, from differences of means on the same paths at h and h/2.

E f(x_h) - E f(x_{h/2}) falls as h^a, a the weak order: so the finer of the two is off by that over 2^a - 1, and every
coarser difference tells the same of it after another factor 2^-a. What coarser steps tell is trusted less: the powers
of h beyond the first may change it by a half for every halving in between. Where differences contradict each other, as
such that change their sign, their mean may be small by chance: its error is then as large as they are apart.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence

import numpy as np

_DOUBT = 0.5  #: relative change for each halving between a difference and the step it is used for
_EXACT = 1e300  #: weight of a difference without noise
TERMS = 3  #: differences of a pilot, and powers of h that they tell
_SURE = 4.0  #: standard errors above which a difference counts as seen
_APART = 4.0  #: mean square of what differences tell around their mean, in units of their errors, that is no chance


def estimate(means: Sequence[float], errors: Sequence[float], order: float, extra: float = 0.0) -> tuple[float, float]:
    """E f - E f(x_h) of the finest step, and the standard error of this estimate.

    means, errors: of the differences fine minus coarse, from the coarsest on; extra: halvings from the finest of them
    to the step that is asked for.
    """
    scale = [2.0 ** (-order * (len(means) - 1 - i + extra)) / (2**order - 1) for i in range(len(means))]
    told = [m * s for m, s in zip(means, scale, strict=True)]
    noise = [e * s for e, s in zip(errors, scale, strict=True)]
    doubts = [_DOUBT * (len(means) - 1 - i + extra) for i in range(len(means))]
    best = told[-1]
    for _ in range(8):  # the doubt of a coarse step is a share of what is estimated
        weights = [1 / max(e**2 + (d * best) ** 2, 1 / _EXACT) for e, d in zip(noise, doubts, strict=True)]
        total = sum(weights)
        best = sum(w * x for w, x in zip(weights, told, strict=True)) / total
    apart = sum(w * (x - best) ** 2 for w, x in zip(weights, told, strict=True)) / max(len(told) - 1, 1)
    wider = apart if apart > _APART else 1.0  # (Birge 1932)
    return best, math.sqrt(wider / total) if total < _EXACT else 0.0


def left(means: Sequence[float], errors: Sequence[float], order: float, extra: float = 0.0) -> tuple[float, float]:
    """The same where the two finest of three or more are seen: by two powers of h, as far as a third changes it.

    A scheme of weak order one may have the errors of one of order two on all steps that were tried: the differences
    then fall by four, and what falls by two is hidden in how this number changes.
    """
    finest = list(zip(means, errors, strict=True))[1 - TERMS :]
    if len(means) < TERMS or any(abs(m) <= _SURE * e for m, e in finest):
        return estimate(means, errors, order, extra)
    means, errors = means[-TERMS:], errors[-TERMS:]
    two, three = (_weights(order, extra, terms) for terms in (TERMS - 1, TERMS))
    value, other = (math.fsum(w * m for w, m in zip(weights, means, strict=True)) for weights in (two, three))
    noise = math.sqrt(math.fsum((w * e) ** 2 for w, e in zip(two, errors, strict=True)))
    return value, math.hypot(noise, value - other)


@functools.lru_cache(maxsize=1024)
def _weights(order: float, extra: float, terms: int) -> tuple[float, ...]:
    """Of three differences in E f - E f(x_h), if that is made of so many powers of h, the lowest being `order`."""
    powers = order + np.arange(terms)
    rows = 2.0 ** np.outer(np.arange(TERMS)[::-1][-terms:], powers)  # of what each power adds to the finest difference
    rest = 2.0 ** (-extra * powers) / (2.0**powers - 1)
    return (0.0,) * (TERMS - terms) + tuple(np.linalg.solve(rows.T, rest))


def order_of(means: Sequence[float], errors: Sequence[float], known: float) -> float:
    """The weak order that the two finest differences show, where both are seen; else the one that is known.

    It is kept between the known order and one above it: a difference that passes through zero shows any.
    """
    seen = [abs(m) > _SURE * e for m, e in zip(means, errors, strict=True)]
    if len(means) < 2 or not (seen[-1] and seen[-2]):
        return known
    return min(max(math.log2(abs(means[-2] / means[-1])), known), known + 1)
