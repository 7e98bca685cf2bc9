# SPDX-License-Identifier: BSD-3-Clause
"""
The correction of one-sided schemes
===================================

Symplectic Euler evaluates the noise at one end of the step. If the noise acts on q and p, it
therefore solves another equation: that of :math:`H - \\frac{1}{2}\\sum_k H_{k,p} H_{k,q}`. For
the Kubo oscillator, :math:`E\\,q` of that equation is known too, so the error left at small steps
is known: the dashed line. A correction of the Hamiltonian mends this, and the step stays
symplectic. :doc:`/method/noise` derives it.
"""

import matplotlib.pyplot as plt
import numpy as np
import symsde as ss

a, sigma = 1.0, 0.5
common = {"q0": 1.0, "p0": 0.0, "paths": 100_000, "seed": 1, "scheme": "symplectic_euler"}
model = ss.models.kubo(a=a, sigma=sigma)
steps = 0.1 / 2.0 ** np.arange(5)
errors, noise = {}, {}
for correction, marker in (("none", "s"), ("increments", "o")):
    found = []
    for n, step in zip(2 ** np.arange(5), steps, strict=True):
        run = {"step": step, "steps": 50 * n, "save_every": 5 * n, **common}
        mom = ss.moments(model, correction=correction, **run)
        exact = np.exp(-(sigma**2) * mom.t / 2) * np.cos(a * mom.t)
        found.append(np.abs(mom.mean_q[:, 0] - exact).max())
        noise[correction, step] = mom.se_mean_q.max()
    errors[correction] = np.array(found)
    plt.loglog(steps, errors[correction], marker=marker, label=f'correction="{correction}"')

turn = np.sqrt(a**2 - sigma**4 / 4)  # the other equation turns at this frequency
decay = np.exp(-(sigma**2) * mom.t / 2)
other = decay * (np.cos(turn * mom.t) - sigma**2 / (2 * turn) * np.sin(turn * mom.t))
floor = np.abs(other - exact).max()
plt.axhline(floor, color="k", linestyle="--", label="error of the other equation")
plt.axhline(2 * max(noise.values()), color="k", linestyle=":", label="two standard errors")
plt.ylim(2e-4, 0.3)
plt.xlabel("h")
plt.ylabel(r"largest error of $E\,q$ for $t\leq 5$")
plt.legend(loc="lower right")

# %%
# Without the correction, smaller steps lead to the other equation. With it, the error falls with
# the step:

assert abs(errors["none"][-1] - floor) < 0.01 < errors["none"][-1]
assert errors["increments"][-1] < 0.15 * errors["increments"][0] + 2 * max(noise.values())
