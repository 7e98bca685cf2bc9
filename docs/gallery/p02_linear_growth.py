# SPDX-License-Identifier: BSD-3-Clause
"""
The growth of a noisy oscillator
================================

The linear stochastic oscillator of the paper is :math:`dp = -q\\,dt + \\sigma\\,dW`,
:math:`dq = p\\,dt`. Its second moment grows as :math:`E(p^2+q^2) = 1 + \\sigma^2 t`. With the
midpoint rule it grows linearly for ever, with the slope :math:`\\sigma^2/(1+h^2/4)`. With
Euler-Maruyama it grows exponentially.
"""

import matplotlib.pyplot as plt
import numpy as np
import symsde as ss
from symsde.show.look import of_scheme

model, step = ss.models.linear_oscillator(sigma=1.0), 0.2
for scheme in ("midpoint", "stormer_verlet", "euler_maruyama"):
    mom = ss.moments(
        model,
        q0=1.0,
        p0=0.0,
        step=step,
        steps=500,
        save_every=5,
        paths=20_000,
        seed=1,
        scheme=scheme,
    )
    size, error = 2 * mom.mean_energy, 2 * mom.se_mean_energy
    line = "--" if scheme == "midpoint" else "-"  # it lies on stormer_verlet
    color, above = of_scheme(scheme)["color"], 3 if line == "--" else 2
    plt.plot(mom.t, size, line, label=scheme, color=color, zorder=above)
    if scheme == "midpoint":
        expected = 1 + mom.t / (1 + step**2 / 4)
        assert np.all(np.abs(size - expected)[1:] < 5 * error[1:])
    if scheme == "euler_maruyama":
        assert size[-1] > 100 * mom.t[-1]
plt.plot(mom.t, 1 + mom.t, "k:", label="exact", zorder=4)
plt.yscale("log")
plt.ylim(0.8, 1e4)
plt.xlabel("t")
plt.ylabel(r"$E(p^2+q^2)$")
plt.legend()
