#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# NumPy 2.4.6 (PyPI): default_rng and SeedSequence with lists.
# Guess: a seed and the index of a task, default_rng([seed, index]), give each task numbers of its own, and a list of two is not
#     a list of three.
# Seen: zeros at the end do not count, up to four entries: 7, [7], [7, 0], [7, 0, 0] and [7, 0, 0, 0] are one generator,
#     [7, 0, 0, 0, 0] is another. A number of more than 32 bits stands for several entries: [2**32 + 5, 3] is [5, 1, 3].
# For users of stochastic integrators: the first point of a sweep, [seed, 0] or [seed, 0, 0], has the noise of the run that was
#     made with the seed alone. With children of `spawn` it has not.
. "$(dirname "$0")/venv.sh" numpy==2.4.6
python - <<'END'
import numpy as np


def first(seed):
    return np.random.default_rng(seed).standard_normal(4)


print("NumPy", np.__version__)
for seed in (7, [7], [7, 0], [7, 0, 0], [7, 0, 0, 0], [7, 0, 0, 0, 0], [2**32 + 5, 3], [5, 1, 3]):
    print(seed, first(seed))
assert all(np.array_equal(first(7), first([7] + [0] * count)) for count in range(4))
assert not np.array_equal(first(7), first([7, 0, 0, 0, 0])) and not np.array_equal(first([7, 0]), first([7, 1]))
assert np.array_equal(first([2**32 + 5, 3]), first([5, 1, 3]))
assert not np.array_equal(first(7), first(np.random.SeedSequence(7).spawn(1)[0]))
END
