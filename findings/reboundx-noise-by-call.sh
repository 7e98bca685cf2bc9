#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# REBOUND 5.2.2 with REBOUNDx 5.1.0 (PyPI), force stochastic_forces, integrator whfast.
# Guess: the random force depends on the step alone, not on how many steps each call of integrate() makes.
# Seen: called for one step at a time there is no noise at all: the orbit is exactly that of kappa = 0. With two steps a call
#     the semi-major axis has a scatter of 59 kappa after 512 steps, in one call 42 kappa: each call throws the last of its
#     random kicks away, and the correlation time is longer by k/(k - 1) for k steps a call.
# For users of stochastic integrators: a loop that steps once and saves, as written for other packages, saves a smooth orbit.
. "$(dirname "$0")/venv.sh" rebound==5.2.2 reboundx==5.1.0 numpy==2.4.6
python - <<'END'
import warnings

import numpy as np
import rebound
import reboundx


def radii(kappa, seed, by, steps=512):
    """Changes of the semi-major axis after 512 steps, by so many a call."""
    sim = rebound.Simulation()
    sim.rand_seed = seed
    sim.add(m=1.0)
    sim.add(m=0.0, a=1.0)
    sim.integrator = "whfast"
    sim.dt = 2 * np.pi / 64
    extras = reboundx.Extras(sim)
    force = extras.load_force("stochastic_forces")
    extras.add_force(force)
    sim.particles[1].params["kappa"] = kappa
    for _ in range(steps // by):
        sim.integrate(sim.t + (by - 0.5) * sim.dt, exact_finish_time=0)
    assert sim.steps_done == steps
    return sim.particles[1].a - 1


print("REBOUND", rebound.__version__, "REBOUNDx", reboundx.__version__)
warnings.simplefilter("ignore")
rms = {}
for by in (1, 2, 512):
    found = np.array([radii(1e-3, seed, by) for seed in range(1, 201)])
    rms[by] = np.sqrt(np.mean(found**2)) / 1e-3
    print(by, "steps a call: scatter of the semi-major axis over kappa", rms[by])
assert rms[1] == 0 and radii(0.0, 1, 512) == 0
assert rms[2] > 1.15 * rms[512] > 30
END
