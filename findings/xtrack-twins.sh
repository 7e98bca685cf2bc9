#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# xtrack 0.118.4 (PyPI), radiation of model 'quantum'; xsuite 0.67.0 has its kernels.
# Guess: particles that are copied, or merged with their copy to double the beam, radiate independently from then on.
# Seen: before the first turn a copy gets a noise of its own; after it a copy has the same photons as its original, also one by
#     to_dict or to_pandas: 8 merged particles are 4 twice, to the last bit.
# For users of stochastic integrators: a beam doubled after some turns has half the particles it seems to have, and error bars
#     smaller by 1.41 than they should be; a restart from a copy is an exact restart.
. "$(dirname "$0")/venv.sh" xsuite==0.67.0 xtrack==0.118.4 xpart==0.23.23 xfields==0.27.5 xobjects==0.7.2 xdeps==0.11.0 \
   xcoll==0.12.5 numpy==2.4.6 scipy==1.17.1
python -W ignore - <<'END'
import numpy as np
import xtrack as xt

cells = 16
bend = 2 * np.pi / cells
cell = [xt.Quadrupole(length=0.3, k1=0.8), xt.Drift(length=0.7), xt.Bend(length=1.0, k0=bend, angle=bend),
        xt.Quadrupole(length=0.3, k1=-0.8), xt.Drift(length=0.7)]
line = xt.Line(elements=[element.copy() for _ in range(cells) for element in cell])
line.particle_ref = xt.Particles(mass0=xt.ELECTRON_MASS_EV, q0=1, energy0=3e9)
line.build_tracker()
line.configure_radiation(model="quantum")


def same_noise(first, second):
    """Whether the losses of three turns are equal, particle by particle."""
    start = first.delta.copy(), second.delta.copy()
    for particles in (first, second):
        line.track(particles, num_turns=3)
    return np.array_equal(first.delta - start[0], second.delta - start[1])


beam = line.build_particles(x=np.zeros(4))
fresh = same_noise(beam, beam.copy())
later = same_noise(beam, beam.copy())
by_dict = same_noise(beam, xt.Particles.from_dict(beam.to_dict()))
by_pandas = same_noise(beam, xt.Particles.from_pandas(beam.to_pandas()))
double = xt.Particles.merge([beam, beam.copy()])
line.track(double, num_turns=3)
print("xtrack", xt.__version__, "same noise of a copy before the first turn:", fresh, "after it:", later, "by dict:", by_dict)
print("by pandas:", by_pandas, "delta of the doubled beam:", double.delta)
assert not fresh and later and by_dict and by_pandas
assert np.array_equal(double.delta[:4], double.delta[4:]) and len(np.unique(double.delta)) == 4
END
