#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# neurolib 0.6.2 (PyPI): whole-brain models with noise, run in chunks.
# Guess: a run in chunks is the run in one piece, or at least one of the same law.
# Seen: each chunk has the noise of the first one: a stable node driven by noise repeats itself with the length of a chunk, to the
#     digits that its memory of the start leaves. It is so with a seed and without; without one the noise is that of seed 0 in
#     every run, only the start is by chance.
# For users of stochastic integrators: long runs are one short run many times; a spectrum has lines at the length of the chunk, an
#     error bar over chunks is zero.
. "$(dirname "$0")/venv.sh" neurolib==0.6.2 numpy==2.4.6 scipy==1.17.1 numba==0.68.1 pandas==3.1.1 setuptools==65.5.0
python -W ignore - 2> /dev/null <<'END'
from importlib.metadata import version

import numpy as np
from neurolib.models.hopf import HopfModel


def run(size, seed):
    """A damped node under noise for 400 ms in steps of 0.1 ms; `size` steps a chunk, None: one piece."""
    model = HopfModel(seed=seed)
    model.params["a"], model.params["sigma_ou"], model.params["duration"] = -1.0, 0.1, 400.0
    model.run(**({"chunkwise": True, "chunksize": size, "append": True} if size else {}))
    return model.output[0]


print("neurolib", version("neurolib"), "correlation of the chunks with the first one, without their first 20 ms")
for seed, size in ((1, None), (1, 1000), (1, 500), (None, 1000)):
    parts = run(size, seed).reshape(-1, size or 1000)[:, 200:]
    found = [np.corrcoef(parts[0], part)[0, 1] for part in parts[1:]]
    print("seed", seed, "chunks of", size, "steps:", *found)
    assert np.all(np.array(found) > 0.999) == (size is not None)
first, second = run(None, None), run(None, None)
alike = np.corrcoef(first[200:], second[200:])[0, 1]
print("two runs without a seed: correlation after 20 ms", alike, "first values", first[0], second[0])
assert alike > 0.999 and first[0] != second[0]
END
