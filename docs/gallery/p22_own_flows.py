# SPDX-License-Identifier: BSD-3-Clause
r"""
A pair of flows of one's own
============================

A fast charge in a magnetic field B has :math:`D = \sqrt{1+|\pi|^2}` with
:math:`\pi = p + B(q_2,-q_1)/2`, which is not quadratic, so that no formula finds its exact flow.
By hand it is one line: :math:`\pi` turns by the angle :math:`B\tau/\sqrt{1+|\pi|^2}`. An electric
field, :math:`K_0 = -Eq_2`, and noise, :math:`K_k = -sq_k`, kick p. The two functions are the
model; :doc:`/own-model` has them in numba, C and Fortran, too. Two exact laws hold at every step,
however long. The centre of the circles, :math:`(q_1+\pi_2/B,\, q_2-\pi_1/B)`, moves by
:math:`(Et+sW_2,\, -sW_1)/B` on each path; and where :math:`E = 0`, the mean of :math:`|\pi|^2`
grows by :math:`2s^2t`.
"""

import matplotlib.pyplot as plt
import numpy as np
import symsde as ss

B, s = 2.0, 0.2


def momentum(q, p):
    """pi as a complex number; q and p are (dof, path)."""
    return p[0] + 1j * p[1] - 0.5j * B * (q[0] + 1j * q[1])


def drift(t, tau, q, p):
    """The flow of D over the time tau, of either sign."""
    pi = momentum(q, p)
    turned = pi * np.exp(-1j * B * tau / np.sqrt(1 + abs(pi) ** 2))
    z = q[0] + 1j * q[1] + 1j * (turned - pi) / B
    canonical = turned + 0.5j * B * z
    return np.array([z.real, z.imag]), np.array([canonical.real, canonical.imag])


def charge(field):
    """The model in the electric field E; a kick is the flow of w_0 K_0 + w_1 K_1 + w_2 K_2."""

    def kick(t, w, q, p):
        return q, p + np.array([s * w[1], field * w[0] + s * w[2]])

    return ss.Model(ndof=2, nnoise=2, drift=drift, kick=kick, name="fast charge")


start = {"q0": [0.0, 0.0], "p0": [1.0, 0.0], "seed": 2, "scheme": "gauss_dkdkd"}
run = ss.simulate(charge(0.2), step=0.1, steps=400, paths=20, **start)
pi = np.array([momentum(q, p) for q, p in zip(run.q, run.p, strict=True)])
centre = np.array([run.q[:, 0] + pi.imag / B, run.q[:, 1] - pi.real / B])
w = ss.diagnose.driving_increments(run)[:, :2].cumsum(axis=0)
moved = np.array([0.2 * run.t[1:, np.newaxis] + s * w[:, 1], -s * w[:, 0]]) / B
assert np.abs(centre[:, 1:] - centre[:, :1] - moved).max() < 1e-12

figure, (plane, growth) = plt.subplots(1, 2, figsize=(9, 3.6))
plane.plot(run.q[:, 0, 0], run.q[:, 1, 0], lw=0.8, label="a charge")
plane.plot(centre[0][:, 0], centre[1][:, 0], label="its centre")
plane.set(xlabel="$q_1$", ylabel="$q_2$")
plane.legend()

# %%
# The mean, at steps of nearly half a circle:

last = ss.simulate(charge(0.0), step=2.0, steps=20, paths=4000, **start)
square = np.array([abs(momentum(q, p)) ** 2 for q, p in zip(last.q, last.p, strict=True)])
mean, error = square.mean(axis=1), square.std(axis=1) / np.sqrt(4000)
growth.errorbar(last.t, mean, 2 * error, fmt=".", label="h = 2, two standard errors")
growth.plot(last.t, 1 + 2 * s**2 * last.t, label="$1 + 2s^2t$")
growth.set(xlabel="t", ylabel=r"mean of $|\pi|^2$")
growth.legend()
figure.tight_layout()
# twenty comparisons within five standard errors: 1 in 90,000 such programs would stop
assert (abs(mean - 1 - 2 * s**2 * last.t)[1:] < 5 * error[1:]).all()
