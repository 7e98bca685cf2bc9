# SPDX-License-Identifier: BSD-3-Clause
"""A clock for tests of what is counted as cost: no test depends on how fast a machine is."""

import numpy as np


class Clock:
    """Seconds, of which each look at f takes one, or each path of a look."""

    def __init__(self, *, by_paths: bool = False):
        self.now = 0.0
        self.by_paths = by_paths

    def __call__(self) -> float:
        return self.now

    def f(self, q: np.ndarray, p: np.ndarray) -> np.ndarray:
        """q_1 squared."""
        self.now += q.shape[-1] if self.by_paths else 1.0
        return q[..., 0, :] ** 2
