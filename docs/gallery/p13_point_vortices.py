# SPDX-License-Identifier: BSD-3-Clause
"""
Three point vortices, from a formula
====================================

The Hamiltonian :math:`H = -\\frac{1}{4\\pi}\\sum_{i<j}\\ln\\bigl((q_i-q_j)^2+(p_i-p_j)^2\\bigr)`
is not separable. It is given as a text, from which symsde derives derivatives and compiled code.
The noise :math:`H_1 = -\\frac{\\sigma}{2}\\sum_i (q_i^2+p_i^2)` rotates the frame at random. The
midpoint rule keeps the moment of inertia to rounding.
"""

import matplotlib.pyplot as plt
import numpy as np
import symsde as ss

pairs = " + ".join(f"log((q{i}-q{j})**2 + (p{i}-p{j})**2)" for i, j in ((1, 2), (2, 3), (3, 1)))
inertia = " + ".join(f"q{i}**2 + p{i}**2" for i in (1, 2, 3))
model = ss.model_from_sympy(
    f"-({pairs})/(4*pi)", noise=[f"-sigma*({inertia})/2"], params={"sigma": 0.2}
)
run = ss.simulate(
    model,
    q0=[1.0, -0.4, -0.5],
    p0=[0.0, 0.9, -0.7],
    step=0.05,
    steps=600,
    seed=1,
    scheme="midpoint",
)
for i in range(3):
    plt.plot(run.q[:, i, 0], run.p[:, i, 0], label=f"vortex {i + 1}")
plt.gca().set_aspect("equal")
plt.xticks([-1, 0, 1])
plt.yticks([-1, 0, 1])
plt.xlabel("x")
plt.ylabel("y")
plt.legend(loc="upper left", bbox_to_anchor=(1.02, 1))

moment = (run.q**2 + run.p**2).sum(axis=1)
assert np.abs(moment - moment[0]).max() < 1e-12
