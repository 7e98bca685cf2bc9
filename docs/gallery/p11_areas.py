# SPDX-License-Identifier: BSD-3-Clause
"""
Noise that does not commute
===========================

The Hamiltonians of the two noises do not commute. Then no scheme that takes increments alone has
an order above 1/2. With the Lévy areas of the same paths the order is one.
"""

import matplotlib.pyplot as plt
import symsde as ss
from symsde.show.look import of_scheme, readable

model = ss.models.noncommutative_oscillator(s1=0.5, s2=0.5)
print(ss.commutator(model))
orders = {}
for scheme in ("midpoint", "gauss2", "midpoint_areas"):
    table = ss.convergence(
        model, scheme, q0=1.0, p0=0.0, steps=[4, 8, 16, 32], horizon=1.0, paths=150, seed=1
    )
    orders[scheme] = table.order
    line = "--" if scheme == "gauss2" else "-"  # it lies on midpoint
    plt.loglog(
        table.step, table.error, line, label=f"{scheme}: {table.order:.2f}", **of_scheme(scheme)
    )
plt.xlabel("h")
plt.ylabel("root mean square error at t = 1")
plt.legend(title="order")
readable([plt.gca()])

assert orders["midpoint"] < 0.75 < orders["midpoint_areas"]
