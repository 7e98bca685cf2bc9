# SPDX-License-Identifier: BSD-3-Clause
"""
What a symplectic scheme keeps
==============================

Kubo's oscillator turns by a random angle: its exact solution keeps :math:`p^2+q^2` on every path,
and so does the midpoint rule. Symplectic schemes that keep no quadratic invariant stay near it;
the others leave it.
"""

import matplotlib.pyplot as plt
import numpy as np
import symsde as ss
from symsde.show.look import of_scheme

model = ss.models.kubo(a=1.0, sigma=0.5)
moved = {}
for scheme in ("midpoint", "stormer_verlet", "symplectic_euler", "heun", "euler_maruyama"):
    run = ss.simulate(
        model,
        q0=1.0,
        p0=0.0,
        step=0.05,
        steps=2000,
        save_every=10,
        paths=200,
        seed=1,
        scheme=scheme,
    )
    radius = (run.q**2 + run.p**2)[:, 0].mean(axis=1)
    moved[scheme] = np.abs(radius - 1).max()
    line = "--" if scheme == "midpoint" else "-"  # it lies on the others
    color, above = of_scheme(scheme)["color"], 3 if line == "--" else 2
    plt.plot(run.t, radius, line, label=scheme, color=color, zorder=above)
plt.ylim(0.0, 3.0)
plt.xlabel("t")
plt.ylabel(r"mean of $p^2+q^2$ of 200 paths")
plt.legend()

# %%
# Midpoint keeps it to rounding, Störmer-Verlet within 0.1. Heun's rule and Euler-Maruyama lose it:

assert moved["midpoint"] < 1e-12
assert moved["stormer_verlet"] < 0.1
assert min(moved["heun"], moved["euler_maruyama"]) > 0.1
