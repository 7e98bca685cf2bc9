# SPDX-License-Identifier: BSD-3-Clause
"""
The correction of one-sided schemes
===================================

Symplectic Euler evaluates the noise at one end of the step. So with noise in q and p it solves another equation, for
any step. A correction of the Hamiltonian mends this, and the step stays symplectic.
"""

import matplotlib.pyplot as plt
import numpy as np
import symsde as ss

model = ss.models.kubo(a=1.0, sigma=0.5)
figure, panel = plt.subplots()
gap = {}
for correction, step in (("none", 0.1), ("none", 0.0125), ("increments", 0.1)):
    mom = ss.moments(
        model,
        q0=1.0,
        p0=0.0,
        step=step,
        steps=round(5 / step),
        save_every=round(0.5 / step),
        paths=20_000,
        seed=1,
        scheme="symplectic_euler",
        correction=correction,
    )
    exact = np.exp(-(0.5**2) * mom.t / 2) * np.cos(mom.t)
    gap[correction, step] = np.abs(mom.mean_q[:, 0] - exact).max()
    panel.plot(mom.t, mom.mean_q[:, 0], "o-", markersize=3, label=f"correction {correction}, h = {step:g}")
panel.plot(mom.t, exact, "k:", label="exact")
panel.set_xlabel("t")
panel.set_ylabel("E q")
panel.legend()

# %%
# Without the correction, the error remains even at an eighth of the step:

assert gap["none", 0.0125] > 0.05
assert gap["increments", 0.1] < 0.5 * gap["none", 0.0125]
