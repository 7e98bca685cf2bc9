# SPDX-License-Identifier: BSD-3-Clause
"""
The equilibrium emittance of a storage ring
===========================================

Radiation damps synchrotron oscillations, with the damping time :math:`\\tau` of their amplitude,
and photons emitted at random excite them. In the phase :math:`\\phi` and the scaled energy
deviation :math:`p` momenta decay at the rate :math:`2/\\tau`, and bunches of any size come to the
emittance :math:`\\sigma^2\\tau/4`.
"""

import matplotlib.pyplot as plt
import numpy as np
import symsde as ss

tau, spread = 60.0, 0.05
ring = ss.model_from_sympy(
    "p**2/2 - cos(phi)",
    noise=["-sigma*phi"],
    q="phi",
    p="p",
    params={"sigma": spread * np.sqrt(4 / tau)},
    damping=2 / tau,
)
paths = 20_000
figure, (small, large) = plt.subplots(1, 2, figsize=(6.4, 3.2))
for size in (0.0, 3.0):
    start = size * spread * np.random.default_rng(1).normal(size=(2, 1, paths))
    mom = ss.moments(
        ring, scheme="gauss_dkdkd", q0=start[0], p0=start[1], step=0.25, steps=1200, save_every=40,
        paths=paths, seed=1, observers={"beam": ss.observe.Covariance(["phi", "p"])},
    )  # fmt: skip
    emittance = np.sqrt(np.linalg.det(mom.observed["beam"].covariance)) / spread**2
    small.plot(mom.t, emittance, label=f"from {size:g} times the size")
    # 5 standard errors of the root of a determinant of normal variances, and what amplitudes add
    assert abs(emittance[-1] - 1) < 5 / np.sqrt(paths) + 0.005
small.axhline(1, color="k", linestyle=":", label="the formula")
small.set(xlabel="t", ylabel=r"emittance over $\sigma^2\tau/4$", yscale="symlog")
small.legend()

# %%
# The whole law is that of the bath: a Gaussian in :math:`p`, of variance :math:`\\sigma^2\\tau/4`.

run = ss.simulate(
    ring, scheme="gauss_dkdkd", q0=0.0, p0=0.0, step=0.25, steps=1200, save_every=1200,
    paths=paths, seed=2,
)  # fmt: skip
p = run.p[-1, 0] / spread
x = np.linspace(-4, 4, 200)
large.hist(p, bins=40, density=True, alpha=0.5, label="energy deviations")
large.plot(x, np.exp(-(x**2) / 2) / np.sqrt(2 * np.pi), label="the bath's law")
large.set(xlabel=r"$p$ over $\sigma\sqrt{\tau}/2$", ylabel="density")
large.legend()
assert abs(np.mean(p**4) - 3) < 5 * np.sqrt(96 / paths)
