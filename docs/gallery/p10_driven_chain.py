# SPDX-License-Identifier: BSD-3-Clause
"""
A chain driven by noise
=======================

Each of the 64 masses of a Fermi-Pasta-Ulam chain is shaken by its own noise. The mean energy
grows by :math:`n\\sigma^2/2` in a unit of time, for any nonlinearity. The upper panel shows one
path, the lower one the ensemble.
"""

import matplotlib.pyplot as plt
import numpy as np
import symsde as ss

n, sigma = 64, 0.1
model = ss.models.fpu_chain(n=n, beta=1.0, sigma=sigma)
common = {
    "q0": 0.0,
    "p0": 0.0,
    "step": 0.1,
    "steps": 600,
    "save_every": 6,
    "seed": 1,
    "scheme": "midpoint",
}
path = ss.simulate(model, **common)
mom = ss.moments(model, paths=2000, **common)

figure, (upper, lower) = plt.subplots(2, 1, figsize=(4.6, 5.2))
picture = upper.imshow(
    path.q[:, :, 0].T, aspect="auto", origin="lower", extent=[0, path.t[-1], 1, n], cmap="RdBu"
)
upper.set_xlabel("t")
upper.set_ylabel("mass")
upper.grid(False)
figure.colorbar(picture, ax=upper, label="q")
lower.plot(mom.t, mom.mean_energy, label="midpoint, h = 0.1")
lower.plot(mom.t, n * sigma**2 / 2 * mom.t, "k:", label=r"$n\sigma^2 t/2$")
lower.set_xlabel("t")
lower.set_ylabel("mean energy")
lower.legend()

assert np.all(
    np.abs(mom.mean_energy - n * sigma**2 / 2 * mom.t)[1:]
    < 5 * mom.se_mean_energy[1:] + 2e-3 * mom.t[1:]
)
