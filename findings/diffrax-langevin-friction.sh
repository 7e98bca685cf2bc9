#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# diffrax 0.7.2 with jax 0.10.2 (PyPI), ALIGN, ShOULD and QUICSORT on a free particle: v' = -gamma v + sqrt(2 gamma) W', x' = v.
# Guess: schemes made for underdamped Langevin dynamics step a free particle by its exact law, whatever gamma h.
# Seen: after one step of 1 from rest the variance of v, over 1 - exp(-2 gamma), is 0.98, 1.00, 1.03 for gamma = 2, then 0.84, 0.98,
#     1.40 for gamma = 5, and 0.34, 0.61, 5.1 for gamma = 20. Without noise, x is exact to rounding for gamma = 0.101 and wrong by
#     1.4e-8 for gamma = 0.099, where a Taylor series begins (taylor_threshold = 0.1).
# For users of stochastic integrators: the noise enters by three integrals of the Brownian path a step, which hold the law only for
#     small gamma h; in comparisons at strong friction the temperature is the first thing to look at.
. "$(dirname "$0")/venv.sh" diffrax==0.7.2 jax==0.10.2 jaxlib==0.10.2 equinox==0.13.8 numpy==2.4.6 scipy==1.17.1
python - <<'END'
from importlib.metadata import version

import diffrax
import jax
import jax.numpy as jnp
import numpy as np

jax.config.update("jax_enable_x64", True)


def step(solver, gamma, u, v, keys):
    """One step of length 1 of each key from x = 0 and this v."""
    gamma, u = jnp.array([gamma]), jnp.array([u])

    def path(key):
        tree = diffrax.VirtualBrownianTree(0.0, 1.0, 0.125, (1,), key, levy_area=diffrax.SpaceTimeTimeLevyArea)
        terms = diffrax.MultiTerm(
            diffrax.UnderdampedLangevinDriftTerm(gamma, u, lambda x, args: 0 * x),
            diffrax.UnderdampedLangevinDiffusionTerm(gamma, u, tree))
        x, v1 = diffrax.diffeqsolve(terms, solver, 0.0, 1.0, 1.0, (jnp.zeros(1), jnp.full(1, v))).ys
        return x[-1, 0], v1[-1, 0]

    return tuple(np.array(z) for z in jax.vmap(path)(keys))


print("diffrax", version("diffrax"))
keys = jax.random.split(jax.random.PRNGKey(1), 100000)
seen = {diffrax.ALIGN: (0.98, 0.84, 0.34), diffrax.ShOULD: (1.0, 0.98, 0.61), diffrax.QUICSORT: (1.03, 1.40, 5.1)}
for solver, expected in seen.items():
    ratios = [step(solver(0.1), g, 1.0, 0.0, keys)[1].var() / -np.expm1(-2 * g) for g in (2.0, 5.0, 20.0)]
    errors = [abs(step(solver(0.1), g, 0.0, 1.0, keys[:1])[0][0] / (-np.expm1(-g) / g) - 1) for g in (0.099, 0.101)]
    print(solver.__name__, "variance of v over the exact one, gamma = 2, 5, 20:", ratios, "x at gamma = .099, .101:", errors)
    assert np.allclose(ratios, expected, rtol=0.03)
    assert 1e-9 < errors[0] < 1e-7 and errors[1] < 1e-14
END
