# SPDX-License-Identifier: BSD-3-Clause
"""
Loss of a beam
==============

Particles of a bunch scatter until they reach the edge of the chamber at :math:`|q| = 1`, where
they are lost. The passage observer checks q after every step. If noise acts on q, it also checks
between two steps, by the law of a Brownian bridge. The paths themselves are never stored.
"""

import matplotlib.pyplot as plt
import numpy as np
import symsde as ss

model = ss.models.additive_oscillator(sigma=0.15, gamma=0.15)
common = {"q0": 0.2, "p0": 0.0, "paths": 20_000, "seed": 1}
for step, bridge, style in ((0.01, True, "k-"), (0.1, True, "C0o"), (0.1, False, "C1s")):
    steps = round(40 / step)
    found = ss.moments(
        model,
        step=step,
        steps=steps,
        save_every=steps // 20,
        **common,
        observers={"loss": ss.observe.Passage("q_1", low=-1.0, high=1.0, bridge=bridge)},
    ).observed["loss"]
    lost = found.lost
    plt.plot(
        found.t,
        100 * lost,
        style,
        markersize=4,
        label=f"h = {step:g}, {'with' if bridge else 'without'} bridge",
    )
    if step == 0.01:
        exact = lost[-1]
    else:
        error = abs(lost[-1] - exact)
        assert (error < 0.02) == bridge, (step, bridge, error)
plt.xlabel("t")
plt.ylabel("lost until t [%]")
plt.legend()

# %%
# With the bridge, steps ten times as long give the same losses; without it they miss excursions
# between two steps.

assert 0.1 < exact < 0.95 and np.all(np.diff(lost) >= 0)
