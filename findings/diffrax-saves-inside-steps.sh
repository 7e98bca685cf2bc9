#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# diffrax 0.7.2 with jax 0.10.2 (PyPI).
# Guess: SaveAt(ts=..) at a time inside a step of dX = dW gives a variance of t, as at the ends of steps.
# Seen: values inside are on the straight line between the ends: with steps of 1/4 the variance at 1/8 is 1/16, half of what
#     it should be, and at 3/8 it is 5/16.
# For users of stochastic integrators: moments on a fine grid of saved times are scalloped; save at ends of steps.
. "$(dirname "$0")/venv.sh" diffrax==0.7.2 jax==0.10.2 jaxlib==0.10.2 equinox==0.13.8 numpy==2.4.6 scipy==1.17.1
python - <<'END'
from importlib.metadata import version

import diffrax
import jax
import jax.numpy as jnp
import numpy as np

times = jnp.array([0.125, 0.25, 0.375, 0.5, 1.0])


def path(key):
    noise = diffrax.VirtualBrownianTree(0.0, 1.0, 2**-12, (), key)
    terms = diffrax.MultiTerm(diffrax.ODETerm(lambda t, y, a: 0 * y), diffrax.ControlTerm(lambda t, y, a: jnp.ones(()), noise))
    return diffrax.diffeqsolve(terms, diffrax.Euler(), 0.0, 1.0, 0.25, jnp.zeros(()), saveat=diffrax.SaveAt(ts=times)).ys


variance = np.array(jax.vmap(path)(jax.random.split(jax.random.PRNGKey(1), 4000))).var(axis=0)
print("diffrax", version("diffrax"), "times", np.array(times), "variance over t", variance / np.array(times))
assert np.allclose(variance, [1 / 16, 1 / 4, 5 / 16, 1 / 2, 1], rtol=0.1)
END
