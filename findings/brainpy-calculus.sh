#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# brainpy 2.8.2 with jax 0.10.2 (PyPI), sdeint.
# Guess: intg_type='Stratonovich' is solved, or refused, by every method; with wiener_type='scalar' one Wiener process drives all
#     variables; derivative-free Milstein has strong order 1.
# Seen: srk1w1, srk2w1 and klpl solve Ito's equation in silence (heun refuses the other way round, exponential_euler refuses).
#     For Stratonovich, and with drift, milstein_grad_free has order 1/2: the mean of ln x is off by 0.08, 0.054, 0.037 at steps of
#     0.1, 0.05, 0.025. Each variable has a Wiener process of its own, also by the methods for scalar noise.
# For users of stochastic integrators: a Kubo oscillator, dq = 0.3 p o dW, dp = -0.3 q o dW, cannot be written so: q^2 + p^2, which
#     that keeps at 1, has the standard deviation 0.18 at t = 1.
. "$(dirname "$0")/venv.sh" brainpy==2.8.2 jax==0.10.2 jaxlib==0.10.2 numpy==2.4.6
python -W ignore - 2> /dev/null <<'END'
from importlib.metadata import version

import brainpy as bp
import brainpy.math as bm
import jax.numpy as jnp
import numpy as np

bm.enable_x64()
bm.set_platform("cpu")
paths, rate, sigma = 20000, 0.5, 0.8


def end(method, step, noise, start, drift=lambda x, t: 0.0 * x):
    """x at t = 1 of dx = drift dt + noise dW in the sense of Stratonovich; the same seed gives the same W."""
    bm.random.seed(3)
    move = bp.sdeint(f=drift, g=noise, dt=step, method=method, intg_type="Stratonovich", wiener_type="scalar")
    x = jnp.full(paths, start)
    for n in range(round(1 / step)):
        x = move(x, n * step)
    return np.asarray(bm.as_jax(x))


print("brainpy", version("brainpy"), "dx = x dt/2 + 0.8 x o dW: mean of ln x - 0.8 W - 1/2 (Ito: -0.32), and mean error of x")
for method in ("euler", "heun", "milstein", "milstein_grad_free", "srk1w1", "srk2w1", "klpl"):
    means, errors = [], []
    for step in (0.1, 0.05, 0.025):
        x = end(method, step, lambda x, t: sigma * x, 1.0, lambda x, t: rate * x)
        w = end(method, step, lambda x, t: 1.0 + 0 * x, 0.0)
        assert abs(w.var() - 1) < 0.05
        means.append((np.log(abs(x)) - sigma * w).mean() - rate)
        errors.append(abs(x - np.exp(rate + sigma * w)).mean())
    print(method, "means", *means, "errors", *errors)
    if method in ("srk1w1", "srk2w1", "klpl"):
        assert abs(means[-1] + sigma**2 / 2) < 0.03 and errors[-1] > 0.3
    elif method == "milstein_grad_free":
        assert errors[1] / errors[2] < 1.6 and 1.3 < means[1] / means[2] < 1.7 and means[2] > 0.025
    else:
        assert errors[1] / errors[2] > 1.8 and abs(means[-1]) < 0.01
for method in ("euler", "srk1w1"):
    one = bp.sdeint(f=lambda q, p, t: (0 * q, 0 * p), g=lambda q, p, t: (1.0 + 0 * q, 1.0 + 0 * p), dt=0.01, method=method,
                    wiener_type="scalar")
    dq, dp = (np.asarray(bm.as_jax(x)) for x in one(jnp.zeros(paths), jnp.zeros(paths), 0.0))
    print(method, "correlation of the noises of q and p:", np.corrcoef(dq, dp)[0, 1])
    assert abs(np.corrcoef(dq, dp)[0, 1]) < 0.04
kubo = bp.sdeint(f=lambda q, p, t: (0 * q, 0 * p), g=lambda q, p, t: (0.3 * p, -0.3 * q), dt=0.01, method="heun",
                 intg_type="Stratonovich", wiener_type="scalar")
q, p = jnp.ones(paths), jnp.zeros(paths)
for n in range(100):
    q, p = kubo(q, p, 0.01 * n)
radius = np.asarray(bm.as_jax(q * q + p * p))
print("Kubo oscillator, q^2 + p^2 at t = 1: from", radius.min(), "to", radius.max(), "standard deviation", radius.std())
assert abs(radius.std() - 0.18) < 0.03
END
