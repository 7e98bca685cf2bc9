# SPDX-License-Identifier: BSD-3-Clause
"""The bias of a step, estimated from differences of means on the same paths at h and h/2.

E f(x_h) - E f(x_{h/2}) falls as h^a, where a is the weak order. So the bias at h/2 is this difference divided by 2^a -
1, and each coarser difference predicts the same bias after another factor 2^-a. Predictions of coarser steps have less
weight: higher powers of h may change a prediction by half of the largest prediction for every halving in between, even
if differences cancel. If predictions contradict each other, for example by their signs, their mean may be small by
chance; its error is then as large as their scatter.

When is a power of h reliable? Suppose a step h makes a phase wrong by x = c h^a T, where a is now the order without
noise. A mean then changes by A (cos(phi + x) - cos(phi)). If x is small, this change falls as h^a; otherwise it may be
any number up to 2 A, varies irregularly from step to step, and differences cancel. Noisy means alone do not show which
case holds. The paths show it: |E f(x_h) - E f(x_2h)| <= D = (E (f(x_h) - f(x_2h))^2)^(1/2), a mean of squares, in which
nothing cancels. Paths with a phase difference of (2^a - 1) x have about D^2 = 2 (1 - cos((2^a - 1) x)) Var f. If D^2 is
at most 1/8 of the variance, x is small (a tenth for a = 2), and each halving multiplies x by 2^-a. Levels are then
settled. The effect of x^2 on the means may still hide the effect of x: d/(2^a - 1), where d = E f(x_h) - E f(x_2h), has
the error 2^(a-1) x^2 A, which for A^2 = Var f is D^2/sqrt(Var f) 2^(a-1)/(2^a - 1)^2. This error is added if the
differences are too noisy to separate two powers of h from three.

Levels are also settled if three successive differences are significant, have one sign and fall as the order predicts,
which arbitrary differences seldom do. If levels are not settled, no power of h is used: the bias of a step is taken as
the change of the last halving, or half of the change before it, and the bias of finer steps is not taken smaller.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Sequence

import numpy as np

_DOUBT = 0.5  #: relative change assumed for each halving between a difference and the step it is used for
_EXACT = 1e300  #: weight of a difference without noise
CLOSE = 1 / 8  #: the mean square change of f at the last halving is small up to this share of the variance of f
_JUMP = 1.75  #: a jump of f changes f by so many standard deviations: two if f is 0 or 1 with even chances
_NEARLY = 0.5  #: powers of h by which differences may fall more slowly than the order says
TERMS = 3  #: number of differences of a pilot, and of the powers of h that they determine
_SURE = 4.0  #: standard errors above which a difference counts as seen
#: predictions of the differences disagree if their mean square scatter, in units of their errors, is larger
_APART = 4.0


def estimate(means: Sequence[float], errors: Sequence[float], order: float, extra: float = 0.0) -> tuple[float, float]:
    """E f - E f(x_h) of the finest step, and the standard error of this estimate.

    means, errors: of the differences fine minus coarse, from the coarsest on; extra: halvings from the finest level
    to the step whose bias is wanted.
    """
    scale = [2.0 ** (-order * (len(means) - 1 - i + extra)) / (2**order - 1) for i in range(len(means))]
    told = [m * s for m, s in zip(means, scale, strict=True)]
    noise = [e * s for e, s in zip(errors, scale, strict=True)]
    doubts = [_DOUBT * (len(means) - 1 - i + extra) for i in range(len(means))]
    most = max(map(abs, told))
    weights = [1 / max(e**2 + (d * most) ** 2, 1 / _EXACT) for e, d in zip(noise, doubts, strict=True)]
    total = sum(weights)
    best = sum(w * x for w, x in zip(weights, told, strict=True)) / total
    apart = sum(w * (x - best) ** 2 for w, x in zip(weights, told, strict=True)) / max(len(told) - 1, 1)
    wider = apart if apart > _APART else 1.0  # factor of Birge (1932)
    return best, math.sqrt(wider / total) if total < _EXACT else 0.0


def left(
    means: Sequence[float], errors: Sequence[float], order: float, extra: float = 0.0, *,
    settled: bool = True, second: float = 0.0,
) -> tuple[float, float]:  # fmt: skip
    """The same estimate and its error, if the levels may not be settled.

    second: error of the finest step that second powers of phases may hide. If the differences of three levels are seen,
    the estimate fits two powers of h to the two finest, and its error includes how far a third power changes it. A
    scheme of weak order one may have the errors of order two at all steps that were tried: its differences then fall by
    a factor of four per halving, and the part of the error that falls by a factor of two shows only in this change.
    """
    finest = list(zip(means, errors, strict=True))[1 - TERMS :]
    if not settled:
        return max([means[-1], *(x / 2 for x in means[-2:-1])], key=abs), errors[-1]
    if len(means) < TERMS or any(abs(m) <= _SURE * e for m, e in finest):
        value, error = estimate(means, errors, order, extra)
        return value, math.hypot(error, second * 2.0 ** (-order * extra))
    means, errors = means[-TERMS:], errors[-TERMS:]
    two, three = (_weights(order, extra, terms) for terms in (TERMS - 1, TERMS))
    value, other = (math.fsum(w * m for w, m in zip(weights, means, strict=True)) for weights in (two, three))
    noise = math.sqrt(math.fsum((w * e) ** 2 for w, e in zip(two, errors, strict=True)))
    return value, math.hypot(noise, value - other)


def settled(square: float, variance: float, means: Sequence[float], errors: Sequence[float], order: float) -> bool:
    """Whether powers of h are reliable: the mean square of the finest change is small beside the variance of f; or
    the last three differences are seen, have one sign, and fall as the order says."""
    if square <= CLOSE * variance:
        return True
    last = list(zip(means, errors, strict=True))[-TERMS:]
    seen = len(last) == TERMS and all(math.fabs(m) > _SURE * e for m, e in last)
    return seen and all(0 < y / x < 2.0 ** (_NEARLY - order) for (x, _), (y, _) in itertools.pairwise(last))


def second_powers(square: float, variance: float, order: float, size: float) -> float:
    """Error that second powers of phases may hide, from the mean square of the finest change of f.

    size: size of the largest changes. If f jumps, `size` is near two standard deviations of f. Then f changes on few
    paths, whose number is proportional to the error of the paths, and nothing is hidden: the result is 0.
    """
    if variance <= 0 or size > _JUMP * math.sqrt(variance):
        return 0.0
    return 2 ** (order - 1) / (2**order - 1) ** 2 * square / math.sqrt(variance)


@functools.lru_cache(maxsize=1024)
def _weights(order: float, extra: float, terms: int) -> tuple[float, ...]:
    """Weights of the last three differences in E f - E f(x_h), a sum of `terms` powers of h from `order` on."""
    powers = order + np.arange(terms)
    rows = 2.0 ** np.outer(np.arange(TERMS)[::-1][-terms:], powers)  # powers of h, relative to the finest difference
    rest = 2.0 ** (-extra * powers) / (2.0**powers - 1)
    return (0.0,) * (TERMS - terms) + tuple(np.linalg.solve(rows.T, rest))


def order_of(means: Sequence[float], errors: Sequence[float], known: float) -> float:
    """The weak order that the two finest differences show, if both are significant; else the known order.

    It is clipped to between the known order and one above it, since a difference near zero could show any order.
    """
    seen = [abs(m) > _SURE * e for m, e in zip(means, errors, strict=True)]
    if len(means) < 2 or not (seen[-1] and seen[-2]):
        return known
    return min(max(math.log2(abs(means[-2] / means[-1])), known), known + 1)
