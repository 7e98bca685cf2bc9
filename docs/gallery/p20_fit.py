# SPDX-License-Identifier: BSD-3-Clause
r"""
Parameters from measured series
===============================

Two hundred series of a noisy pendulum, measured at twelve times. The spring :math:`k` and the
strength :math:`\sigma` of the noise are fitted to the mean of q and to the variance of p. The error
bars hold the noise of the measured series and that of the simulated paths.
"""

import matplotlib.pyplot as plt
import numpy as np
import symsde as ss

H, noise = "p**2/2 - k*cos(q)", ["sigma*sin(q)"]
run = {"q0": 1.0, "p0": 0.0, "step": 0.05, "scheme": "stormer_verlet"}

# %%
# The measurement, here another run, with parameters that the fit does not know:

truth = ss.model_from_sympy(H, noise, params={"k": 1.0, "sigma": 0.4})
series = ss.simulate(truth, **run, steps=120, paths=200, seed=7, save_every=10)
t, data = series.t[1:], {"q": series.q[1:, 0], "var(p)": series.p[1:, 0]}

# %%
# The search begins at the parameters of the model that is given:

guess = ss.model_from_sympy(H, noise, params={"k": 1.3, "sigma": 0.2})
found = ss.fit(guess, data, ["k", "sigma"], t=t, **run, paths=2000, seed=1)
print(found)

figure, axes = plt.subplots(2, 1, figsize=(6, 5), layout="constrained")
found.plot(ax=axes)

# %%
# Both parameters lie within four standard errors:

for name, x in (("k", 1.0), ("sigma", 0.4)):
    assert abs(found.values[name] - x) < 4 * found.se[name] < 0.1
assert np.isclose(found.se["k"], np.hypot(found.se_data["k"], found.se_paths["k"]))
