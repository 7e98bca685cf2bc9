# SPDX-License-Identifier: BSD-3-Clause
"""A clock for tests of what is counted as cost: no test depends on how fast a machine is."""

import numpy as np


class Clock:
    """Seconds, of which each look at f takes one."""

    def __init__(self):
        self.now = 0.0

    def __call__(self) -> float:
        return self.now

    def f(self, q: np.ndarray, p: np.ndarray) -> np.ndarray:
        """q_1 squared."""
        self.now += 1.0
        return q[..., 0, :] ** 2
