#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# jax 0.10.2 (PyPI) on the CPU of x86-64, double precision, calling numpy 2.4.6 by pure_callback.
# Guess: a NumPy function gives the same numbers inside jax.pure_callback as outside: it is NumPy that computes.
# Seen: inside a compiled function the processor flushes denormal numbers to zero while the callback runs, in the very thread
#     of the program: half of the smallest normal number is 0 there, 1.1e-308 outside; back outside it is 1.1e-308 again.
# For users of stochastic integrators: any library that is called so loses tails below 2e-308 (weights, densities, products
#     of likelihoods), and its bits can differ from those of a direct call.
. "$(dirname "$0")/venv.sh" jax==0.10.2 jaxlib==0.10.2 numpy==2.4.6 scipy==1.17.1
python - <<'END'
import threading

import jax
import numpy as np

jax.config.update("jax_enable_x64", True)
shape = jax.ShapeDtypeStruct((), np.float64)
threads = []


def positive(x):
    """1 where half of the smallest normal number, by NumPy, is positive."""
    threads.append(threading.get_ident())
    return np.float64(np.finfo(np.float64).tiny * np.float64(x) > 0)


before = positive(0.5)
inside = float(jax.jit(lambda x: jax.pure_callback(positive, shape, x))(0.5))
after = positive(0.5)
print("jax", jax.__version__, "numpy", np.__version__, "half of the smallest normal number is positive: before", bool(before),
      "in the callback", bool(inside), "after", bool(after), "one thread:", len(set(threads)) == 1)
assert before == 1 and inside == 0 and after == 1
END
