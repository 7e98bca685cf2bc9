#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# py-pde 0.59.0 (PyPI): DiffusionPDE with noise.
# Guess: a field with noise of variance 1e-15, as in SI units, is the field with noise 1, scaled; `rng` makes a run repeatable;
#     a run to t = 1 ends there.
# Seen: noise below 1e-14 is none: the field stays at rest, in silence. The backend numba, the default, does not look at `rng`. With
#     dt = 0.3 the run ends at 1.2, with the variance of 1.2.
# For users of stochastic integrators: choose units in which the noise is of order one, the backend numpy, and a step that divides.
. "$(dirname "$0")/venv.sh" py-pde==0.59.0 numpy==2.4.6 scipy==1.17.1 numba==0.68.1
python -W ignore - <<'END'
import numpy as np
import pde


def run(noise=1.0, seed=1, dt=0.1, cells=20000, **options):
    """The field at t = 1, without diffusion."""
    equation = pde.DiffusionPDE(diffusivity=0, noise=noise, rng=np.random.default_rng(seed))
    return equation.solve(pde.ScalarField(pde.UnitGrid([cells]), 0.0), t_range=1, dt=dt, tracker=None, **options).data


print("py-pde", pde.__version__)
for noise in (1e-12, 2e-14, 5e-15, 1e-20):
    field = run(noise, backend="numpy")
    print("noise", noise, "variance over it", field.var() / noise)
    assert (abs(field.var() / noise - 1) < 0.05) if noise > 1e-14 else not field.any()
for options in ({"backend": "numpy"}, {"backend": "numba"}, {}):
    first, second = run(**options), run(**options)
    print(options or "default", "same generator, same field:", np.array_equal(first, second))
    assert np.array_equal(first, second) == (options == {"backend": "numpy"})
late = run(dt=0.3, backend="numpy").var()
print("variance at t = 1 with steps of 0.3:", late)
assert abs(late - 1.2) < 0.06
END
