# SPDX-License-Identifier: BSD-3-Clause
"""A model of one's own in Python: the gradient as a NumPy callable.

H = p^2/2 - cos q, H_1 = sigma sin q: a pendulum that is shaken sideways.
"""

import numpy as np
import symsde as ss

SIGMA = 0.3


def gradient(t, w, q, p):
    """Gradient of w[0] H + w[1] H_1 for a block of paths.

    w is (1 + noise, lane), q and p are (dof, lane), all float64; returns (d/dq, d/dp).
    """
    h, dw = w
    return h * np.sin(q) + dw * SIGMA * np.cos(q), h * p


def value(t, w, q, p):
    """Value of w[0] H + w[1] H_1, (lane,). It is optional: with it runs average the energy."""
    h, dw = w
    return h * (p[0] ** 2 / 2 - np.cos(q[0])) + dw * SIGMA * np.sin(q[0])


def hessian(t, w, q, p):
    """Second derivatives, (dof, dof, lane) each. They are optional: without them gradients are differenced."""
    h, dw = w
    one = np.ones_like(q[0])
    return [[h * np.cos(q[0]) - dw * SIGMA * np.sin(q[0])]], [[0 * one]], [[h * one]]


# Declared traits decide which work is skipped. A false trait is refused by name.
model = ss.Model(
    ndof=1,
    nnoise=1,
    gradient=gradient,
    value=value,
    hessian=hessian,
    separable=True,
    position_noise=True,
    identity_mass=True,
)

# Save 500 paths: run.q and run.p are (time, dof, path).
run = ss.simulate(model, q0=1.0, p0=0.0, step=0.05, steps=200, paths=500, seed=3, save_every=20)
print(run.report)
print(f"q of path 0 at t = {run.t[-1]:.1f}: {run.q[-1, 0, 0]:.4f}")

# Average 20 000 paths: no path is stored.
mom = ss.moments(model, q0=1.0, p0=0.0, step=0.05, steps=200, paths=20_000, seed=3, save_every=20)
print(f"E q = {mom.mean_q[-1, 0]:.6f} +- {mom.se_mean_q[-1, 0]:.6f} at t = {mom.t[-1]:.1f}")
print(f"E H at t = {mom.t[-1]:.1f}: {mom.mean_energy[-1]:.4f} +- {mom.se_mean_energy[-1]:.4f}")

# The scheme is symplectic for every sample of the noise: the tangent map of one step shows it.
defect = ss.diagnose.symplecticity(model, "midpoint", q=1.0, p=0.0, step=0.05, dw=0.1)
print(f"symplecticity defect of one step: {np.max(defect):.1e}")
assert np.max(defect) < 1e-11
