# SPDX-License-Identifier: BSD-3-Clause
"""Heat along a chain between two baths.

The first of eight masses of an FPU chain feels kT = 3/2, the last one kT = 1/2. The heat that enters, gamma (kT_1 -
<p_1^2>), is the heat that leaves.
"""

import numpy as np
import symsde as ss

N, PATHS = 8, 20_000
gamma, warmth = np.zeros(N), np.ones(N)  # friction and noise at the ends alone
gamma[[0, -1]], warmth[0], warmth[-1] = 1.0, 1.5, 0.5
chain = ss.thermostat(ss.models.fpu_chain(n=N, sigma=0.0), beta=1 / warmth, gamma=gamma)
at_rest = ss.moments(chain, scheme="chin4a", q0=0.0, p0=0.0, step=0.2, steps=1500, save_every=1500, paths=PATHS, seed=1)
kinetic = at_rest.var_p[-1] + at_rest.mean_p[-1] ** 2
hot, cold = 1.5 - kinetic[0], kinetic[-1] - 0.5
print("kinetic temperatures:", *(f"{x:.2f}" for x in kinetic))
print(f"heat in {hot:.4f}, heat out {cold:.4f}")
# Five standard errors of the variances of normal momenta; 1 in 2 million such programs would stop here.
assert abs(hot - cold) < 5 * np.sqrt(2 * (kinetic[0] ** 2 + kinetic[-1] ** 2) / PATHS)
assert min(hot, cold) > 0.1
