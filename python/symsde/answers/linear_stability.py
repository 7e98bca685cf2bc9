# SPDX-License-Identifier: BSD-3-Clause
"""The largest stable step of a scheme on H = (p^2 + q^2)/2, in units in which omega = 1, so that h is omega h.

A step is z -> M z with z = (q, p). It is stable if no eigenvalue of M lies outside the unit circle,

    |det M| <= 1,   |tr M| <= 1 + det M,

and for a symplectic scheme, det M = 1, if |tr M| <= 2. M is computed by runs of one step. With damping the momenta
decay by the rate gamma, given as gamma/omega, and det M = exp(-gamma h) for a symplectic scheme.
"""

from __future__ import annotations

import functools
import math

import numpy as np

from ..models import linear_oscillator
from ..native import checks
from ..run.simulate import simulate

#: values of omega h to test; they are dense, since narrow windows of instability may lie between stable ones
SCAN = np.append(np.geomspace(0.1, 100, 300), (1e3, 1e4))
ROUNDING = 1e-9  #: rounding error of determinants and traces


def step_matrix(scheme: str, omega_h: float, damping: float = 0.0) -> np.ndarray:
    """The matrix M (2, 2) of a step; damping: gamma/omega."""
    start = {"q0": np.array([[1.0, 0.0]]), "p0": np.array([[0.0, 1.0]]), "paths": 2}
    with checks.unwarned():
        run = simulate(linear_oscillator(sigma=0.0).damped(damping), scheme=scheme, step=omega_h, steps=1, **start)
    return np.concatenate([run.q[-1], run.p[-1]])


def is_stable(matrix: np.ndarray) -> bool:
    """Whether no eigenvalue is outside the unit circle."""
    determinant = np.linalg.det(matrix)
    return bool(abs(determinant) <= 1 + ROUNDING and abs(np.trace(matrix)) <= 1 + determinant + ROUNDING)


@functools.cache
def stable_up_to(scheme: str, damping: float = 0.0) -> tuple[float, float]:
    """omega h below which every step is stable, and a value just above it that is not; 0 if no step is stable,
    infinite if all are. damping: gamma/omega of momenta; IncompatibleError where the scheme does not take it.
    """

    def stable(omega_h: float) -> bool:
        return is_stable(step_matrix(scheme, omega_h, damping) if damping else step_matrix(scheme, omega_h))

    low = 0.0
    for high in SCAN.tolist():
        if not stable(high):
            break
        low = high
    else:
        return math.inf, math.inf
    while low > 0 and high - low > 1e-6 * high:
        middle = (low + high) / 2
        low, high = (middle, high) if stable(middle) else (low, middle)
    return low, high
