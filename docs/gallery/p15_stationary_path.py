# SPDX-License-Identifier: BSD-3-Clause
"""
A path by its two ends
======================

The scheme comes from a discrete stochastic action: the path that makes the action stationary
between two given positions, on a given Brownian path, is a path of the scheme. Here the whole
path is solved for at once, not step by step. The figure shows five such paths, each on a
Brownian path of its own.
"""

import matplotlib.pyplot as plt
import numpy as np
import symsde as ss

model = ss.models.pendulum(sigma=0.3)
common = {"step": 0.05, "steps": 40, "seed": 7, "paths": 5}
found = ss.diagnose.stationary_path(model, "midpoint", q_start=0.0, q_end=1.0, **common)
for i in range(5):
    plt.plot(0.05 * np.arange(41), found.q[:, 0, i])
plt.xlabel("t")
plt.ylabel("q")

# %%
# From the initial momentum that was found, the scheme ends at the given position:

again = ss.simulate(model, q0=0.0, p0=found.p[0], scheme="midpoint", **common)
assert (found.status == 0).all()
assert np.abs(again.q[-1, 0] - 1.0).max() < 1e-9
