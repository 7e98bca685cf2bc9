# SPDX-License-Identifier: BSD-3-Clause
"""
Error against the step
======================

The figure shows strong errors of symplectic schemes on one model; all steps follow the same
Brownian paths. Schemes that take increments alone have order one. With one more integral of the
path, :math:`dZ`, the order is higher.
"""

import matplotlib.pyplot as plt
import symsde as ss
from symsde.show.look import of_scheme, readable

model = ss.models.synchrotron(omega=1.0, sigma1=0.2, sigma2=0.1)
for scheme, low, high in (
    ("symplectic_euler", 0.85, 1.15),
    ("midpoint", 0.85, 1.25),
    ("gauss_dkdkd", 1.3, 2.1),
    ("chin4a", 1.3, 2.3),
):
    table = ss.convergence(
        model, scheme, q0=1.0, p0=0.0, steps=[8, 16, 32, 64], horizon=2.0, paths=400, seed=1
    )
    assert low < table.order < high, (scheme, table.order)
    plt.loglog(table.step, table.error, label=f"{scheme}: {table.order:.2f}", **of_scheme(scheme))
plt.xlabel("h")
plt.ylabel("root mean square error at t = 2")
plt.ylim(top=2.0)
plt.legend(title="order", loc="upper left", ncols=2)
readable([plt.gca()])
