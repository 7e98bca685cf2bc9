# SPDX-License-Identifier: BSD-3-Clause
"""Five Stratonovich problems as equations, without symsde, for other packages.

A slope is the change of a state by the weights of one step: h times the drift plus the noise terms times their
increments. q, p are arrays whose first axis is the degree of freedom; w one of increments, noise first; xp is numpy,
jax.numpy or torch.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

SIGMA, OMEGA, SIGMA1, SIGMA2 = 0.3, 2.0, 0.2, 0.1  #: Kubo's oscillator; the synchrotron
SMALL = 0.01  #: strength of both noises of Henon-Heiles
MASSES, NOISE = 64, 0.05  #: the chain's number of masses and strength of the noise


def kubo(xp: Any, q, p, h, w):
    """H = (p^2 + q^2)/2, H_1 = 0.3 (p^2 + q^2)/2."""
    turn = h + SIGMA * w[0]
    return turn * p, -turn * q


def synchrotron(xp: Any, q, p, h, w):
    """H = p^2/2 - omega^2 cos q, H_1 = sigma1 sin q, H_2 = -sigma2 cos q."""
    return h * p, -(h * OMEGA**2 + SIGMA2 * w[1]) * xp.sin(q) - SIGMA1 * w[0] * xp.cos(q)


def additive(xp: Any, q, p, h, w):
    """H = (p^2 + q^2)/2, H_1 = -q."""
    return h * p, -h * q + w[0]


def henon_heiles(xp: Any, q, p, h, w):
    """H = (p.p + q.q)/2 + q1^2 q2 - q2^3/3, H_k = 0.01 q_k."""
    x, y = q[:1], q[1:]
    force = _joined(xp, [x + 2 * x * y, y + x * x - y * y])
    return h * p, -h * force - SMALL * w


def fpu64(xp: Any, q, p, h, w):
    """64 masses between fixed ends, springs of force r + r^3, H_k = -0.05 q_k."""
    wall = 0 * q[:1]
    r = _joined(xp, [q, wall]) - _joined(xp, [wall, q])
    pull = r + r * r * r
    return h * p, h * (pull[1:] - pull[:-1]) + NOISE * w


def _joined(xp: Any, parts: list):
    return (xp.concatenate if hasattr(xp, "concatenate") else xp.cat)(parts)


@dataclass(frozen=True)
class Problem:
    """A problem: its first state and its horizon."""

    name: str
    slope: Callable
    noises: int
    q0: tuple[float, ...] = (1.0,)
    p0: tuple[float, ...] = (0.0,)
    horizon: float = 4.0
    paths: int = 2048
    fine: int = 4096  #: steps of the reference run
    steps: tuple[int, ...] = (32, 128, 512)
    additive: bool = False  #: one noise on every momentum, of constant strength
    strength: float = 0.0  #: strength of these noises

    @property
    def dof(self) -> int:
        """Degrees of freedom."""
        return len(self.q0)


PROBLEMS = {
    x.name: x
    for x in (
        Problem("kubo", kubo, 1),
        Problem("synchrotron", synchrotron, 2),
        Problem("additive", additive, 1, additive=True, strength=1.0),
        Problem(
            "henon_heiles", henon_heiles, 2, (0.1, 0.2), (0.2, 0.0), 8.0, additive=True, strength=-SMALL,
            steps=(16, 64, 256),
        ),
        Problem(
            "fpu64", fpu64, MASSES, tuple(math.sin(math.pi * (i + 1) / (MASSES + 1)) for i in range(MASSES)),
            (0.0,) * MASSES, 8.0, paths=128, fine=1024, additive=True, strength=NOISE, steps=(16, 64, 256),
        ),
    )
}  # fmt: skip
