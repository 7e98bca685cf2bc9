# SPDX-License-Identifier: BSD-3-Clause
r"""
A noisy frequency makes an oscillator unstable
==============================================

In :math:`q'' = -q - \sigma q \circ \dot W` the noise changes the frequency. However weak it is,
neighbouring paths separate like :math:`e^{\lambda t}`. The slope z = p/q moves by itself,
:math:`dz = -(1+z^2)dt - \sigma dW`, and its stationary density gives the exponent as a quotient of
two integrals, with :math:`w(u) = \exp(-2(u^3/12 + u)/\sigma^2)`:

.. math:: \lambda = \tfrac12 \int_0^\infty \sqrt u\,w(u)\,du \Big/ \int_0^\infty u^{-1/2}\,w(u)\,du
"""

import matplotlib.pyplot as plt
import numpy as np
import symsde as ss

sigmas = np.array([0.2, 0.4, 0.6, 0.8, 1.0, 1.2])
measured, errors = [], []
for sigma in sigmas:
    model = ss.model_from_sympy("p**2/2 + q**2/2", noise=["s*q**2/2"], params={"s": sigma})
    found = ss.lyapunov(
        model,
        q0=1.0,
        p0=0.0,
        step=0.05,
        steps=4000,
        paths=100,
        seed=1,
        count=1,
        scheme="stormer_verlet",
    )
    measured.append(found.exponents[0])
    errors.append(found.se[0])
measured, errors = np.array(measured), np.array(errors)

x = np.linspace(0.0, 4.0, 4001)  # u = x^2
fine = np.linspace(0.05, 1.25, 61)
weights = np.exp(-2 / fine[:, np.newaxis] ** 2 * (x**6 / 12 + x**2))
exact = (x**2 * weights).sum(axis=1) / weights.sum(axis=1) / 2
plt.plot(fine, exact, label="integrals")
plt.errorbar(sigmas, measured, 2 * errors, fmt="o", label="Störmer-Verlet, two standard errors")
plt.plot(fine, fine**2 / 8, "--", label=r"$\sigma^2/8$")
plt.xlabel(r"$\sigma$")
plt.ylabel(r"largest Lyapunov exponent $\lambda$")
plt.legend()

# %%
# The points lie on the curve, within four standard errors and the error of the step:

there = np.interp(sigmas, fine, exact)
assert (abs(measured - there) < 4 * errors + 0.02 * there).all()
