#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# mbtrack2 0.10.1 (PyPI): SynchrotronRadiation with TransverseMap.
# Guess: radiation damping and quantum excitation lead to the emittance of the ring, wherever the turn is cut.
# Seen: that holds where alpha and the dispersion are 0. At alpha = 1 and 2 the emittance becomes 2 and 5 times the ring's, since
#     the kick is of the size of the whole beam's divergence; at a dispersion of 0.5 m and beta = 10 m, with an energy spread of
#     1e-3 and an emittance of 1 nm, it becomes 26 times the ring's. Energy spread and vertical emittance are right.
# For users of stochastic integrators: noise on the momentum alone must be of size emittance/beta, not of the beam's divergence;
#     cut the turn at a waist without dispersion.
. "$(dirname "$0")/venv.sh" mbtrack2==0.10.1 accelerator-toolbox==0.9.0 numpy==2.4.6 scipy==1.17.1 pandas==2.3.3
python -W ignore - 2> /dev/null <<'END'
from importlib.metadata import version

import numpy as np
from mbtrack2 import Bunch, Electron, Optics, Synchrotron, SynchrotronRadiation, TransverseMap

beta, turn = 10.0, 1e-6
np.random.seed(1)


def emittance(alpha, dispersion):
    """Means over turns 1000 to 3000 of horizontal and vertical emittance and energy spread, over those of the ring."""
    optics = Optics(local_beta=np.full(2, beta), local_alpha=np.array([alpha, 0.0]),
                    local_dispersion=np.array([dispersion, 0.0, 0.0, 0.0]))
    ring = Synchrotron(h=100, optics=optics, particle=Electron(), L=300.0, E0=3e9, ac=1e-3, U0=1e6, tau=np.full(3, 200 * turn),
                       emit=np.array([1e-9, 1e-11]), tune=np.array([0.31, 0.27]), sigma_delta=1e-3, sigma_0=1e-11, chro=[0, 0])
    beam = Bunch(ring, mp_number=4000, current=1e-3)
    beam.init_gaussian()
    turns, radiation, found = TransverseMap(ring), SynchrotronRadiation(ring), []
    for n in range(3000):
        turns.track(beam)
        radiation.track(beam)
        if n >= 1000 and n % 50 == 0:
            x = np.cov(beam["x"] - dispersion * beam["delta"], beam["xp"])
            y = np.cov(beam["y"], beam["yp"])
            found.append((np.linalg.det(x) ** 0.5 / 1e-9, np.linalg.det(y) ** 0.5 / 1e-11, beam["delta"].std() / 1e-3))
    return np.mean(found, axis=0)


print("mbtrack2", version("mbtrack2"), "horizontal, vertical emittance and energy spread over the ring's")
for alpha, dispersion, due in ((0, 0, 1), (1, 0, 2), (2, 0, 5), (0, 0.5, 26)):
    found = emittance(alpha, dispersion)
    print("alpha", alpha, "dispersion", dispersion, "m:", *found)
    assert abs(found[0] / due - 1) < 0.1 and abs(found[1] - 1) < 0.1 and abs(found[2] - 1) < 0.05
END
