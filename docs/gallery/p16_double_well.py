# SPDX-License-Identifier: BSD-3-Clause
"""
Over the barrier of a thermal double well
=========================================

In :math:`U = q^4/4 - q^2/2` a heat bath moves paths from well to well, for moderate friction at
Kramers' rate :math:`k = \\omega_0 (\\sqrt{\\gamma^2/4 + 1} - \\gamma/2)\\, e^{-\\beta/4}/(2\\pi)`
with :math:`\\omega_0^2 = 2`. The share on the right of the barrier is
:math:`(1 - e^{-2kt})/2`.
"""

import matplotlib.pyplot as plt
import numpy as np
import symsde as ss

gamma = 1.0
bare = ss.model_from_sympy("p**2/2 + q**4/4 - q**2/2")
for beta in (12.0, 16.0, 20.0):
    well = ss.thermostat(bare, beta=beta, gamma=gamma)
    mom = ss.moments(
        well, scheme="chin4a", q0=-1.0, p0=0.0, step=0.25, steps=1600, save_every=40, paths=8000,
        seed=1, observables={"right": lambda q, p: 1.0 * (q[0] > 0)},
    )  # fmt: skip
    rate = np.sqrt(2) / (2 * np.pi) * (np.sqrt(gamma**2 / 4 + 1) - gamma / 2) * np.exp(-beta / 4)
    (line,) = plt.plot(mom.t, mom.mean["right"], label=f"$\\beta$ = {beta:g}")
    plt.plot(mom.t, (1 - np.exp(-2 * rate * mom.t)) / 2, ":", color=line.get_color())
    # 4/beta is the order of what Kramers left out
    share, error = mom.mean["right"][-1], mom.se_mean["right"][-1]
    low, high = ((1 - np.exp(-2 * rate * x * mom.t[-1])) / 2 for x in (1 - 4 / beta, 1 + 4 / beta))
    assert low - 5 * error < share < high + 5 * error
plt.xlabel("t")
plt.ylabel("share of paths on the right")
plt.legend()

# %%
# At rest positions have the density :math:`e^{-\\beta U}`, whatever the friction. Its mean of
# :math:`q^2` is compared with a quadrature.

beta, paths = 4.0, 20_000
run = ss.simulate(
    ss.thermostat(bare, beta=beta, gamma=gamma), scheme="chin4a", q0=-1.0, p0=0.0, step=0.25,
    steps=400, save_every=400, paths=paths, seed=1,
)  # fmt: skip
q = np.linspace(-2.5, 2.5, 2001)
law = np.exp(-beta * (q**4 / 4 - q**2 / 2))
law /= law.sum() * (q[1] - q[0])
plt.figure()
plt.hist(run.q[-1, 0], bins=50, density=True, alpha=0.5, label="paths at rest")
plt.plot(q, law, label="$e^{-\\beta U}$")
plt.xlabel("q")
plt.ylabel("density")
plt.legend()
second = run.q[-1, 0] ** 2
exact = (law * q**2).sum() * (q[1] - q[0])
assert abs(second.mean() - exact) < 5 * second.std() / np.sqrt(paths) + 1e-3
