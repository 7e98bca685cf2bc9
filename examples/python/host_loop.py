# SPDX-License-Identifier: BSD-3-Clause
"""A loop of one's own around single steps: oscillators in random stiffness that bounce off a wall at q = 0.

H = (p^2 + q^2)/2, H_1 = sigma (p^2 + q^2)/2: a prepared run is checked once, and its state is ours between steps.
"""

import numpy as np
import symsde as ss

model = ss.models.kubo(a=1.0, sigma=0.3)
run = ss.prepare(model, "midpoint", step=0.01, q0=1.0, p0=0.0, paths=1000, seed=1)

bounces = 0
for _ in range(2000):
    run.step()
    behind = run.q < 0
    run.q[behind] *= -1
    run.p[behind] *= -1
    bounces += np.count_nonzero(behind)
print(f"{bounces / 1000:.2f} bounces a path until t = {run.t:g}, {20 / np.pi:.2f} without noise")

# The mirror keeps p^2 + q^2, and so does the midpoint rule.
drift = np.max(np.abs(run.p**2 + run.q**2 - 1))
print(f"largest change of p^2 + q^2: {drift:.1e}")

# From there on without the wall, saved every 100 steps: run.run gives what simulate gives.
free = run.run(1000, save_every=100)
print(f"E q at t = {free.t[-1]:g}: {free.q[-1].mean():.3f}")
assert drift < 1e-11
