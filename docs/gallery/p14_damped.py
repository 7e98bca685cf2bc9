# SPDX-License-Identifier: BSD-3-Clause
"""
Damping in a heat bath
======================

The Langevin equation :math:`\\ddot q = -\\gamma\\dot q - \\omega^2 q + \\sigma\\dot W` is an
oscillator with ``damping=gamma``. (The Hamiltonians of Caldirola and Kanai, which depend on time,
give the same motion of q.) Its variance tends to :math:`\\sigma^2/(2\\gamma\\omega^2)`.
"""

import matplotlib.pyplot as plt
import numpy as np
import symsde as ss

gamma, omega, sigma = 0.5, 1.5, 0.4
model = ss.model_from_sympy(
    "p**2/2 + omega**2*q**2/2",
    noise=["-sigma*q"],
    params={"omega": omega, "sigma": sigma},
    damping=gamma,
)
mom = ss.moments(
    model,
    scheme="gauss_dkdkd",
    q0=1.0,
    p0=0.0,
    step=0.02,
    steps=1000,
    save_every=10,
    paths=20_000,
    seed=1,
)
limit = sigma**2 / (2 * gamma * omega**2)
plt.fill_between(
    mom.t, *(mom.mean_q[:, 0] + s * np.sqrt(mom.var_q[:, 0]) for s in (-1, 1)), alpha=0.3
)
plt.plot(mom.t, mom.mean_q[:, 0], label="mean of q and one standard deviation")
for s in (-1, 1):
    plt.axhline(
        s * np.sqrt(limit),
        color="k",
        linestyle=":",
        label="stationary deviation" if s > 0 else None,
    )
plt.xlabel("t")
plt.ylabel("q")
plt.legend()

# %%
# The standard error of the variance of n normal numbers is sqrt(2/n) times this variance; the mean
# is the damped oscillation.

assert abs(mom.var_q[-1, 0] / limit - 1) < 5 * np.sqrt(2 / 20_000)
nu = np.sqrt(omega**2 - gamma**2 / 4)
damped = np.exp(-gamma * mom.t / 2) * (np.cos(nu * mom.t) + gamma / (2 * nu) * np.sin(nu * mom.t))
assert np.all(np.abs(mom.mean_q[:, 0] - damped)[1:] < 5 * mom.se_mean_q[1:, 0] + 1e-3)
