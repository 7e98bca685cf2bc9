# SPDX-License-Identifier: BSD-3-Clause
"""
A hundred bodies, from a sum over pairs
=======================================

The attraction :math:`-\\sum_{i<j} G m_i m_j/\\sqrt{|r_i-r_j|^2+\\epsilon^2}` is a sum over pairs,
`Sum(.., i < j)`. One pair is differentiated, once; the generated code loops over all 4950 of them.
A cluster that begins with too little kinetic energy contracts and widens again. Kicks at random,
the same for all bodies, push the whole cluster and leave it alone inside. The energy of the motion
about the centre is kept by Störmer-Verlet up to errors of order h^2.
"""

import matplotlib.pyplot as plt
import numpy as np
import symsde as ss

n, rng = 100, np.random.default_rng(5)
kinetic = "Sum((u[i]**2 + v[i]**2 + w[i]**2)/(2*m[i]), i)"
pairs = "Sum(G*m[i]*m[j]/sqrt((x[i]-x[j])**2 + (y[i]-y[j])**2 + (z[i]-z[j])**2 + soft**2), i < j)"
masses = rng.uniform(0.5, 1.5, n) / n
model = ss.model_from_sympy(
    f"{kinetic} - {pairs}",
    noise=["s*Sum(m[i]*x[i], i)"],
    q="x y z",
    p="u v w",
    n=n,
    params={"G": 1.0, "soft": 0.1, "s": 0.1, "m": masses},
)
positions = rng.normal(size=(n, 3))
momenta = 0.3 * masses[:, np.newaxis] * rng.normal(size=(n, 3))
run = ss.simulate(
    model,
    q0=positions.ravel(),
    p0=momenta.ravel(),
    step=0.01,
    steps=600,
    save_every=10,
    seed=3,
    scheme="stormer_verlet",
)
x, y = (a[..., 0].reshape(-1, n, 3) for a in (run.q, run.p))
centre = (masses[:, np.newaxis] * x).sum(axis=1) / masses.sum()
radius = np.sqrt(((x - centre[:, np.newaxis]) ** 2).sum(axis=2))

plt.plot(run.t, np.quantile(radius, [0.25, 0.5, 0.75], axis=1).T, label=["25 %", "50 %", "75 %"])
plt.plot(run.t, centre[:, 0], "k--", label="centre, x")
plt.xlabel("t")
plt.ylabel("distance from the centre")
plt.legend(loc="upper left", bbox_to_anchor=(1.02, 1))

total = y.sum(axis=1)
assert np.abs(total[:, 1:] - total[0, 1:]).max() < 1e-14 and np.ptp(total[:, 0]) > 0.01
inside = run.energy[:, 0] - (total**2).sum(axis=1) / (2 * masses.sum())
assert np.abs(inside / inside[0] - 1).max() < 1e-4
