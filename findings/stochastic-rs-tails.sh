#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# stochastic-rs 2.6.0 (PyPI): Brownian motion, white noise, normal numbers.
# Guess: increments are normal: of ten million 5760 are beyond 3.4426 standard deviations, and 5.7 beyond 5.
# Seen: none is beyond 3.4427, in double and in single precision; the variance is 0.998, the fourth moment 2.95.
# For users of stochastic integrators: rare events, escapes over a barrier and losses at an aperture are undercounted where they
#     need a large kick.
. "$(dirname "$0")/venv.sh" stochastic-rs==2.6.0 numpy==2.4.6
python - <<'END'
from importlib.metadata import version

import numpy as np
import stochastic_rs

count = 10_000_000
print("stochastic-rs", version("stochastic-rs"), "of", count, "numbers 5760 are due beyond 3.4426, 26998 beyond 3")
for name, draw in (("PyBm", lambda: np.diff(stochastic_rs.PyBm(count + 1, 1.0, seed=5).sample()) * count**0.5),
                   ("PyGn", lambda: np.asarray(stochastic_rs.PyGn(count, 1.0, seed=2).sample()) * count**0.5),
                   ("PyNormal", lambda: np.asarray(stochastic_rs.PyNormal(0.0, 1.0, seed=1).sample(count))),
                   ("PyNormal f32", lambda: np.asarray(stochastic_rs.PyNormal(0.0, 1.0, seed=1, dtype="f32").sample(count)))):
    x = np.asarray(draw(), dtype=float)
    print(name, "largest", abs(x).max(), "beyond 3:", (abs(x) > 3).sum(), "variance", x.var(), "fourth moment", (x**4).mean())
    assert x.size == count and 3.44 < abs(x).max() < 3.4427 and (abs(x) > 3).sum() > 0.9 * 26998 and abs(x.var() - 1) < 0.005
END
