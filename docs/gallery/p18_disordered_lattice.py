# SPDX-License-Identifier: BSD-3-Clause
"""
A disordered lattice with noise of phases
=========================================

A particle hops on a ring of 32 sites whose energies differ,
:math:`i\\,d\\psi_k = e_k\\psi_k\\,dt - (\\psi_{k-1} + \\psi_{k+1})\\,dt +
g|\\psi_k|^2\\psi_k\\,dt + s\\,\\psi_k\\circ dW_k`. Disorder holds it where it began; noise of the
phases sets it free. Energies and hopping are quadratic, and what is left are functions of the
actions :math:`|\\psi_k|^2/2`: ``gauss_dkdkd`` takes the first exactly and turns every phase by
the rest. The norm stays to rounding.
"""

import matplotlib.pyplot as plt
import numpy as np
import symsde as ss

n, step, steps = 32, 0.1, 300
sites, energies = range(1, n + 1), np.random.default_rng(4).uniform(-3, 3, n)
squares = [f"(q{k}**2 + p{k}**2)" for k in sites]
hopping = " ".join(f"- (q{k}*q{k % n + 1} + p{k}*p{k % n + 1})" for k in sites)
lattice = ss.model_from_sympy(
    " + ".join(f"e{k}*{x}/2 + g*{x}**2/4" for k, x in zip(sites, squares, strict=True)) + hopping,
    noise=[f"s*{x}/2" for x in squares],
    params={"g": 2.0, "s": 0.5} | {f"e{k}": float(e) for k, e in zip(sites, energies, strict=True)},
)
place = np.arange(n) - n // 2
start = (place == 0).astype(float)


def spread(model, paths):
    """Mean of the squared distance from the first site."""
    run = ss.simulate(
        model, scheme="gauss_dkdkd", q0=start, p0=0.0, step=step, steps=steps, save_every=10,
        paths=paths, seed=1,
    )  # fmt: skip
    density = run.q**2 + run.p**2
    assert np.abs(density.sum(axis=1) - 1).max() < 1e-13
    return run.t, (density * place[:, None] ** 2).sum(axis=1)


figure, axis = plt.subplots(figsize=(6.4, 3.4))
for g, s, paths in ((0.1, 0.0, 1), (2.0, 0.0, 1), (0.0, 0.5, 1000), (2.0, 0.5, 1000)):
    t, square = spread(lattice.with_parameters(g=g, s=s), paths)
    axis.plot(t, square.mean(axis=1), label=f"g = {g:g}, s = {s:g}")
    if (g, s) == (0.0, 0.5):
        noisy = square

# %%
# Without the nonlinear term the mean density is known: noise removes what is off the diagonal of
# :math:`\\rho = E\\,\\psi\\psi^+` at the rate :math:`s^2` (Haken and Strobl), a linear equation.

hop = np.diag(energies) - np.roll(np.eye(n), 1, axis=0) - np.roll(np.eye(n), -1, axis=0)
left, kept = 1 - np.eye(n), np.outer(start, start).astype(complex)
values, vectors = np.linalg.eigh(hop)
turn = (vectors * np.exp(-1j * values * step / 2)) @ vectors.T
exact = [0.0]
for i in range(steps):  # half of the hopping, the loss, half of the hopping: order two
    kept = turn @ (np.exp(-0.25 * step * left) * (turn @ kept @ turn.conj().T)) @ turn.conj().T
    if i % 10 == 9:
        exact.append((np.diag(kept).real * place**2).sum())
axis.plot(t, exact, "k:", label="the mean that is known")
axis.set(xlabel="t", ylabel="mean square distance")
axis.legend()
error = np.abs(noisy.mean(axis=1) - exact)[1:]
# 30 comparisons within 5 standard errors, and what steps leave
assert (error < 5 * noisy.std(axis=1)[1:] / np.sqrt(noisy.shape[1]) + 0.05).all()
