#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# blond 2.2.4 (PyPI, CERN's longitudinal tracking): SynchrotronRadiation and FlatSpectrum.
# Guess: np.random.seed(1) at the head of a script makes a run repeatable; the argument `seed`, "when tracking in C", does with
#     python=False; two phase noises without seeds differ; processes without seeds differ.
# Seen: none of it. SynchrotronRadiation(seed=None) seeds NumPy's global generator anew by chance, so a seed set before has no
#     effect. `seed` has one with python=True only. Every FlatSpectrum has the same phase noise, and its generate() seeds NumPy's
#     global generator: after it, quantum excitation is the same in every process, to the bit.
# For users of stochastic integrators: the order of construction decides whether photons are random: without RF noise no run can be
#     repeated, with RF noise all tasks of a job array have the same photons.
. "$(dirname "$0")/venv.sh" blond==2.2.4 numpy==2.4.6 scipy==1.17.1 numba==0.68.1
cat > track.py <<'END'
import sys
import warnings

import numpy as np

warnings.simplefilter("ignore")
from blond.beam.beam import Beam, Electron
from blond.input_parameters.rf_parameters import RFStation
from blond.input_parameters.ring import Ring
from blond.llrf.rf_noise import FlatSpectrum
from blond.synchrotron_radiation.synchrotron_radiation import SynchrotronRadiation

case = sys.argv[1]
ring = Ring(96e3, 1e-5, 175e9, Electron(), n_turns=20000)
station = RFStation(ring, [130000], [10e9], [0.0])
beam = Beam(ring, 5, 1e10)
beam.dt[:] = 0
beam.dE[:] = 0
if case == "global":
    np.random.seed(1)
radiation = SynchrotronRadiation(ring, station, beam, 10e3, seed=3 if "seed" in case else None, python=case != "seed-c",
                                 shift_beam=False)
if case == "noise":
    first, second = (FlatSpectrum(ring, station, delta_f=0.1, corr_time=5000, folder_plots=None, print_option=False)
                     for _ in range(2))
    first.generate()
    second.generate()
    assert first.dphi.std() > 0 and np.array_equal(first.dphi, second.dphi)
for _ in range(3):
    radiation.track()
print(float(beam.dE[0]).hex())
END
python -c 'from importlib.metadata import version; print("blond", version("blond"))'
echo "energy of the first particle in two processes"
twice() {
   one=$(python track.py "$1" 2> log | tail -1) two=$(python track.py "$1" 2> log | tail -1)
   echo "$1: $one $two"
   [ -n "$one" ] && [ -n "$two" ]
}
twice none && [ "$one" != "$two" ]
twice global && [ "$one" != "$two" ]
twice seed-python && [ "$one" = "$two" ]
twice seed-c && [ "$one" != "$two" ]
twice noise && [ "$one" = "$two" ]
