#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# NumPy 2.4.6 (PyPI) and Random123 (librandom123-dev of Debian 12, headers): Philox4x64 with ten rounds. Wants g++ and
# `apt-get update` done once.
# Guess: the first four numbers of Philox(key=k, counter=c) are the block of c under k, as in the library of its authors.
# Seen: they are the block of c + 1: the counter is raised before the first block. From then on the two agree.
# For users of stochastic integrators: who addresses noise by (path, step) in the counter and checks it against another
#     implementation is off by one, and the block of counter 0 is met only by a counter of all ones.
. "$(dirname "$0")/venv.sh" numpy==2.4.6
apt-get -q -o APT::Sandbox::User=root download librandom123-dev > log
dpkg -x librandom123-dev_*.deb .
cat > blocks.cpp <<'END'
#include <Random123/philox.h>
#include <cinttypes>
#include <cstdio>
int main()
{
    const r123::Philox4x64::key_type key = {{12345, 678}};
    for (unsigned count = 0; count < 4; ++count) {
        const r123::Philox4x64::ctr_type counter = {{count, 0, 0, 0}}, block = r123::Philox4x64()(counter, key);
        std::printf("%" PRIu64 " %" PRIu64 " %" PRIu64 " %" PRIu64 "\n", block[0], block[1], block[2], block[3]);
    }
}
END
g++ -Iusr/include -o blocks blocks.cpp
./blocks > blocks.txt
python - <<'END'
import numpy as np

theirs = np.loadtxt("blocks.txt", dtype=np.uint64)
ours = np.random.Philox(key=[12345, 678], counter=0).random_raw(12).reshape(3, 4)
last = np.random.Philox(key=[12345, 678], counter=[2**64 - 1] * 4).random_raw(4)
print("NumPy", np.__version__, "from counter 0:\n", ours, "\nRandom123, counters 0 to 3:\n", theirs)
assert np.array_equal(ours, theirs[1:]) and not np.array_equal(ours[0], theirs[0])
assert np.array_equal(last, theirs[0])
END
