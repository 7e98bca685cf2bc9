# SPDX-License-Identifier: BSD-3-Clause
"""
Synchrotron oscillations
========================

This is the paper's third experiment: particles in the bucket of an accelerating field with noise
in its phase and amplitude. The figure shows one path in the phase plane, by a symplectic scheme
and by Euler-Maruyama, with the same noise.
"""

import matplotlib.pyplot as plt
import numpy as np
import symsde as ss
from symsde.show.look import of_scheme

model = ss.models.synchrotron(omega=2.0, sigma1=0.1, sigma2=0.05)
figure, panels = plt.subplots(1, 2, sharex=True, sharey=True)
worst = {}
for panel, scheme in zip(panels, ("symplectic_euler", "euler_maruyama"), strict=True):
    run = ss.simulate(model, q0=1.0, p0=0.0, step=0.02, steps=5000, seed=200, scheme=scheme)
    energy = np.array([model.value(q, p)[0] for q, p in zip(run.q, run.p, strict=True)])
    worst[scheme] = np.abs(energy - energy[0]).max()
    panel.plot(run.q[:, 0, 0], run.p[:, 0, 0], ".", markersize=1, color=of_scheme(scheme)["color"])
    panel.set_title(scheme)
    panel.set_xlabel("q")
panels[0].set_ylabel("p")
panels[0].set_xlim(-4, 4)
panels[0].set_ylim(-6, 6)

# %%
# The symplectic path stays in the bucket; the other one gains energy until it leaves it.

edge = 4.0 - (-4.0 * np.cos(1.0))  # energy of the unstable point over that of the start
assert worst["symplectic_euler"] < edge < worst["euler_maruyama"]
