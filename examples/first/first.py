# SPDX-License-Identifier: BSD-3-Clause
"""First run in Python: means of 10 000 Kubo oscillators, and one path.

python first.py
"""

import math

import symsde as ss

# dp = -a q dt - sigma q o dW, dq = a p dt + sigma p o dW: a rotation with a random angular velocity
model = ss.models.kubo(a=1.0, sigma=0.3)
common = {"q0": 1.0, "p0": 0.0, "step": 0.02, "steps": 500, "save_every": 50, "scheme": "midpoint", "seed": 1}

mean = ss.moments(model, paths=10_000, **common)
exact = math.exp(-0.045 * mean.t[-1]) * math.cos(mean.t[-1])
found, error = mean.mean_q[-1, 0], mean.se_mean_q[-1, 0]
print(f"E q = {found:.8f} +- {error:.8f} at t = {mean.t[-1]:.1f}, exact {exact:.8f}")

run = ss.simulate(model, paths=100, **common)  # the first 100 of these paths: run.q[time, dof, path]
kept = abs(run.q**2 + run.p**2 - 1).max()
print(f"path 0 ends at q = {run.q[-1, 0, 0]:.8f}, p = {run.p[-1, 0, 0]:.8f}")
print("p^2 + q^2 is kept to 1e-12 on every path" if kept < 1e-12 else "p^2 + q^2 has moved")
