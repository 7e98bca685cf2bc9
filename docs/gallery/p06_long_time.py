# SPDX-License-Identifier: BSD-3-Clause
"""
Long times beside Heun's rule
=============================

A pendulum with little noise runs for ten thousand units of time. With symplectic schemes the
energy wanders as in the exact equation. Heun's rule has the same order, but it adds energy until
the pendulum turns over.
"""

import matplotlib.pyplot as plt
import symsde as ss
from symsde.show.look import of_scheme

model = ss.models.synchrotron(omega=1.0, sigma1=0.001, sigma2=0.0)
end = {}
for scheme in ("heun", "stormer_verlet", "midpoint"):
    mom = ss.moments(
        model,
        q0=0.5,
        p0=0.0,
        step=0.25,
        steps=40_000,
        save_every=400,
        paths=64,
        seed=1,
        scheme=scheme,
    )
    end[scheme] = mom.mean_energy[-1]
    line = "--" if scheme == "midpoint" else "-"  # it lies on stormer_verlet
    plt.plot(mom.t, mom.mean_energy, line, label=scheme, color=of_scheme(scheme)["color"])
plt.xlabel("t")
plt.ylabel("mean energy of 64 paths")
plt.legend()

start = float(model.value(0.5, 0.0)[0])
assert abs(end["midpoint"] - start) < 0.02 and abs(end["stormer_verlet"] - start) < 0.02
assert end["heun"] - start > 1.0
