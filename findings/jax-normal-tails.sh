#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# jax 0.10.2 (PyPI), on processors: jax.random.normal in its default, single precision.
# Guess: of 268 million normal numbers the largest is about 5.8, the smallest about -5.8.
# Seen: none is above 5.2202, where 24 are due, and none below -5.42, where 8 are due: a uniform number of 23 bits is mapped,
#     and the largest one is farther from 1 than the smallest from -1.
# For users of stochastic integrators: rare exits are driven by such numbers, and their rates come out too small, those to the
#     right smaller than those to the left. In double precision the tails go on.
. "$(dirname "$0")/venv.sh" jax==0.10.2 jaxlib==0.10.2 numpy==2.4.6 scipy==1.17.1
python - <<'END'
import jax
import numpy as np
from scipy.stats import norm

low, high, above, count = 0.0, 0.0, 0, 2**24
draw = jax.jit(lambda key: jax.random.normal(key, (count,), dtype=np.float32))
for key in jax.random.split(jax.random.PRNGKey(1), 16):
    x = np.asarray(draw(key))
    low, high, above = min(low, x.min()), max(high, x.max()), above + int((x > 5.1).sum())
print("jax", jax.__version__, "numbers", 16 * count, "smallest", low, "largest", high)
print("due above 5.2202:", 16 * count * norm.sf(5.2202), "below -5.42:", 16 * count * norm.sf(5.42))
print("above 5.1:", above, "due:", 16 * count * norm.sf(5.1))
assert 5.15 < high < 5.2202 and -5.42 < low < -5.2
END
