# SPDX-License-Identifier: BSD-3-Clause
"""
The area of a loop of particles
===============================

If all particles share the noise, one random symplectic map moves them all. It may stretch a loop
of particles, but keeps its area. A symplectic scheme keeps it, too; other schemes do not.
"""

import matplotlib.pyplot as plt
import numpy as np
import symsde as ss
from symsde.show.look import of_scheme

model = ss.models.synchrotron(omega=1.0, sigma1=0.1, sigma2=0.1)
angle = np.linspace(0, 2 * np.pi, 4000, endpoint=False)
q0, p0 = 0.8 + 0.3 * np.cos(angle), 0.3 * np.sin(angle)


def area(q, p):
    """What the polygon of the particles bounds."""
    return 0.5 * abs(np.sum(q * np.roll(p, -1) - np.roll(q, -1) * p))


figure, (left, right) = plt.subplots(1, 2)
figure.get_layout_engine().set(wspace=0.1)
change = {}
for scheme in ("midpoint", "heun"):
    run = ss.simulate(
        model,
        q0=q0[None],
        p0=p0[None],
        step=0.4,
        steps=60,
        paths=len(angle),
        seed=4,
        scheme=scheme,
        common_noise=[1, 2],
    )
    areas = np.array([area(q[0], p[0]) for q, p in zip(run.q, run.p, strict=True)])
    change[scheme] = abs(areas[-1] / areas[0] - 1)
    right.plot(run.t, areas / areas[0], label=scheme, color=of_scheme(scheme)["color"])
    if scheme == "midpoint":
        for n, grey in ((0, "0.8"), (20, "0.6"), (60, "0.3")):
            left.fill(run.q[n, 0], run.p[n, 0], color=grey, label=f"t = {run.t[n]:g}")
left.set_xlabel("q")
left.set_ylabel("p")
left.legend()
right.set_xlabel("t")
right.set_ylabel("area over its first value")
right.legend()

# %%
# The polygon of 4000 particles differs a little from the loop, hence the tolerance.

assert change["midpoint"] < 1e-3
assert change["heun"] > 0.1
