# SPDX-License-Identifier: BSD-3-Clause
"""
A chain between a hot and a cold bath
=====================================

Baths act on the two ends of a Fermi-Pasta-Ulam chain alone: rates :math:`\\gamma` are zero inside,
where nothing is drawn. Heat flows from the hot end to the cold one, and temperatures jump at both
ends.
"""

import matplotlib.pyplot as plt
import numpy as np
import symsde as ss

paths = 8000
for n in (4, 8, 16):
    gamma, warmth = np.zeros(n), np.ones(n)
    gamma[[0, -1]], warmth[0], warmth[-1] = 1.0, 1.5, 0.5
    chain = ss.thermostat(ss.models.fpu_chain(n=n, sigma=0.0), beta=1 / warmth, gamma=gamma)
    mom = ss.moments(
        chain, scheme="chin4a", q0=0.0, p0=0.0, step=0.2, steps=1500, save_every=1500,
        paths=paths, seed=1,
    )  # fmt: skip
    kinetic = mom.var_p[-1] + mom.mean_p[-1] ** 2
    plt.plot((np.arange(n) + 0.5) / n, kinetic, "o-", label=f"{n} masses")
    # the heat that enters leaves, within five standard errors of two variances of normal momenta
    into, out = warmth[0] - kinetic[0], kinetic[-1] - warmth[-1]
    error = np.sqrt(2 / paths) * np.hypot(kinetic[0], kinetic[-1])
    assert abs(into - out) < 5 * error
    assert min(into, out) > 5 * error
plt.axhline(1.5, color="k", linestyle=":")
plt.axhline(0.5, color="k", linestyle=":")
plt.xlabel("place along the chain")
plt.ylabel("kinetic temperature")
plt.legend()
