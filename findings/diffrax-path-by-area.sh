#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# diffrax 0.7.2 with jax 0.10.2 (PyPI), VirtualBrownianTree.
# Guess: one key is one Wiener path; `levy_area` adds integrals to it, which a scheme of higher order needs.
# Seen: with another `levy_area` the path is another one inside: W(1) is equal to rounding, W(1/2) of BrownianIncrement and of
#     SpaceTimeLevyArea have correlation 0.50.
# For users of stochastic integrators: Euler and a scheme of order 3/2 with the same key are not on one path, so that their
#     difference is no strong error, unless both trees are made with the area of the richer one.
. "$(dirname "$0")/venv.sh" diffrax==0.7.2 jax==0.10.2 jaxlib==0.10.2 equinox==0.13.8 numpy==2.4.6 scipy==1.17.1
python - <<'END'
from importlib.metadata import version

import diffrax
import jax
import numpy as np

jax.config.update("jax_enable_x64", True)


def paths(area, t):
    found = jax.vmap(lambda key: diffrax.VirtualBrownianTree(0.0, 1.0, 2**-12, (), key, levy_area=area).evaluate(0.0, t))(
        jax.random.split(jax.random.PRNGKey(1), 4000))
    return np.array(getattr(found, "W", found))


areas = (diffrax.BrownianIncrement, diffrax.SpaceTimeLevyArea, diffrax.SpaceTimeTimeLevyArea)
half, whole = ([paths(area, t) for area in areas] for t in (0.5, 1.0))
print("diffrax", version("diffrax"), "largest difference of W(1)", max(abs(w - whole[0]).max() for w in whole[1:]))
for area, w in zip(areas, half, strict=True):
    print(area.__name__, "variance of W(1/2)", w.var(), "correlation with BrownianIncrement", np.corrcoef(half[0], w)[0, 1])
    assert abs(w.var() - 0.5) < 0.05
assert max(abs(w - whole[0]).max() for w in whole[1:]) < 1e-12
assert abs(np.corrcoef(half[0], half[1])[0, 1] - 0.5) < 0.05 and np.allclose(half[1], half[2])
END
