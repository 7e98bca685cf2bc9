# SPDX-License-Identifier: BSD-3-Clause
"""
Phase-space density of an ensemble
==================================

A hundred thousand particles start at one place in the bucket of a synchrotron. The frequency
falls with the amplitude. So the noise first spreads the particles along the orbit into a ring,
and then slowly across orbits.
"""

import matplotlib.pyplot as plt
import numpy as np
import symsde as ss

model = ss.models.synchrotron(omega=1.0, sigma1=0.05, sigma2=0.05)
run = ss.simulate(
    model,
    q0=1.5,
    p0=0.0,
    step=0.1,
    steps=3000,
    save_every=1000,
    paths=100_000,
    seed=1,
    scheme="stormer_verlet",
)
figure, panels = plt.subplots(1, 3, sharex=True, sharey=True, figsize=(4.8, 2.4))
for panel, n in zip(panels, (1, 2, 3), strict=True):
    count, *_ = panel.hist2d(
        run.q[n, 0], run.p[n, 0], bins=120, range=[[-3, 3], [-2.5, 2.5]], cmap="magma"
    )
    panel.set_title(f"t = {run.t[n]:g}")
    panel.collections[-1].set_clim(0, 50)
    panel.set_xlabel("q")
    panel.grid(False)
panels[0].set_ylabel("p")
figure.colorbar(panels[2].collections[-1], ax=panels, label="particles in a bin", extend="max")

# %%
# No particle has failed, the ring has closed, and its energy has hardly changed:

assert (run.status == 0).all()
angle = np.arctan2(run.p[-1, 0], run.q[-1, 0])
assert np.histogram(angle, 12, range=(-np.pi, np.pi))[0].min() > 2000
energy = model.value(run.q[-1], run.p[-1])
assert abs(energy.mean() - float(model.value(1.5, 0.0)[0])) < 0.5
