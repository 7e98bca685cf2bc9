# SPDX-License-Identifier: BSD-3-Clause
"""Problems that every package gets, of one degree of freedom; peers write the equations themselves (Stratonovich)."""

from __future__ import annotations

from dataclasses import dataclass

import symsde as ss

OMEGA, SIGMA1, SIGMA2 = 2.0, 0.2, 0.1


@dataclass(frozen=True)
class Problem:
    """A model of symsde and where it begins; peers write its equations themselves, by its name."""

    name: str
    model: ss.Model
    noises: int
    q0: float = 1.0
    p0: float = 0.0
    horizon: float = 4.0


PROBLEMS = (
    Problem("kubo", ss.models.kubo(a=1.0, sigma=0.3), 1),
    Problem("synchrotron", ss.models.synchrotron(OMEGA, SIGMA1, SIGMA2), 2),
    Problem("additive", ss.models.linear_oscillator(sigma=1.0), 1),
)
