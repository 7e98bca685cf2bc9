#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# PyRETIS 3.0.5 (PyPI), its own Langevin engine, on a free particle with mass, temperature and step 1.
# Guess: friction towards 0 goes over into motion without friction and noise.
# Seen: after one step from rest the variance of the position, over its value 2 gamma/3 for small gamma, is 1.0 for gamma = 0.01 and
#     1e-5, and 81 for gamma = 1e-6; gamma = 3e-6, 2e-6 and 1e-7 raise LinAlgError (matrix is not positive definite). The
#     variance of the velocity is right where there is one.
# For users of stochastic integrators: the covariances of the Ornstein-Uhlenbeck step are differences of numbers near 1, and a ratio
#     of them by gamma h squared is noise below gamma h = 1e-5; they need a series there.
. "$(dirname "$0")/venv.sh" pyretis==3.0.5 numpy==2.4.6 scipy==1.17.1
python - <<'END'
from importlib.metadata import version

import numpy as np
from pyretis.core import Particles, System, create_box
from pyretis.engines.internal import Langevin
from pyretis.forcefield import ForceField
from pyretis.forcefield.potentials import DoubleWell


def variances(gamma, paths=20000):
    """Of position and velocity after one step from rest, over their leading terms in gamma."""
    system = System(temperature=1.0, units="reduced", box=create_box(periodic=[False]))
    system.particles = Particles(dim=1)
    system.particles.add_particle(np.zeros(1), np.zeros(1), np.zeros(1), mass=1.0, name="A", ptype=0)
    system.forcefield = ForceField("free", potential=[DoubleWell(a=0.0, b=0.0, c=0.0)])
    system.potential_and_force()
    engine, ends = Langevin(1.0, gamma, seed=2), []
    for _ in range(paths):
        system.particles.pos[:] = system.particles.vel[:] = 0.0
        engine.integration_step(system)
        ends.append((system.particles.pos[0, 0], system.particles.vel[0, 0]))
    x, v = np.array(ends).T
    return x.var() / (2 * gamma / 3), v.var() / (2 * gamma)


print("PyRETIS", version("pyretis"))
for gamma in (1e-2, 1e-5, 1e-6):
    x, v = variances(gamma)
    print("gamma", gamma, "variance of x, of v, over the leading terms", x, v)
    assert abs(v - 1) < 0.05
    assert 70 < x < 90 if gamma == 1e-6 else abs(x - 1) < 0.06
for gamma in (3e-6, 2e-6, 1e-7):
    try:
        variances(gamma, 1)
    except np.linalg.LinAlgError as error:
        print("gamma", gamma, "LinAlgError:", error)
    else:
        raise SystemExit(f"gamma = {gamma} raises nothing")
END
