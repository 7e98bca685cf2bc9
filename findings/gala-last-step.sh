#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# gala 1.11.0 (PyPI), integrate_orbit with LeapfrogIntegrator and Ruth4Integrator.
# Guess: from t1 = 0 to t2 = 1 by dt = 0.25 the last time is 1, as it is by dt = 0.1; values at times `t` belong to these.
# Seen: by dt = 0.25 the last time is 0.75. With t = [0, 0.25, 0.5, 1] all steps are the first one: the position at "1" is that
#     at 0.75 (DOPRI853Integrator is right there).
# For users of stochastic integrators: a reference orbit ends one step early, or is that of another time, without a word.
. "$(dirname "$0")/venv.sh" gala==1.11.0 numpy==2.4.6 scipy==1.17.1 astropy==8.0.2
python - 2> /dev/null <<'END'
from importlib.metadata import version

import gala.dynamics
import gala.integrate
import gala.potential
import numpy as np
from gala.units import dimensionless

well = gala.potential.HarmonicOscillatorPotential(omega=[1.0, 1.0, 1.0], units=dimensionless)
start = gala.dynamics.PhaseSpacePosition(pos=[1.0, 0.0, 0.0], vel=[0.0, 1.0, 0.0])


def orbit(name, **times):
    found = well.integrate_orbit(start, Integrator=getattr(gala.integrate, name), **times)
    return found.t.value, found.x.value


print("gala", version("gala"))
for name in ("LeapfrogIntegrator", "Ruth4Integrator", "DOPRI853Integrator"):
    quarter, tenth = (orbit(name, dt=dt, t1=0.0, t2=1.0)[0] for dt in (0.25, 0.1))
    t, x = orbit(name, t=np.array([0.0, 0.25, 0.5, 1.0]))
    print(name, "last time by 0.25:", quarter[-1], "by 0.1:", tenth[-1])
    print("    at", t, "arccos of x", np.arccos(x))
    assert abs(quarter[-1] - 0.75) < 1e-12 and abs(tenth[-1] - 1) < 1e-12 and t[-1] == 1
    assert abs(np.arccos(x[-1]) - (1.0 if name == "DOPRI853Integrator" else 0.75)) < 0.01
END
