#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# pyAT 0.9.0 (accelerator-toolbox, PyPI), tracking with quantum diffusion.
# Guess: a process that sets no seed has noise of its own, and with a seed a particle's path does not depend on how many
#     others are tracked beside it.
# Seen: two processes without a seed track the same noise, bit for bit. With a seed particle 0 goes another way when a second
#     particle is added: all draw in turn from one stream.
# For users of stochastic integrators: tasks of a job array that set no seed are one task many times; a bunch cut into shards
#     is another bunch.
. "$(dirname "$0")/venv.sh" accelerator-toolbox==0.9.0 numpy==2.4.6 scipy==1.17.1
cat > track.py <<'END'
import sys

import at
import numpy as np

count, seed = int(sys.argv[1]), sys.argv[2]
if seed != "none":
    at.reset_rng(seed=int(seed))
noise = at.SimpleQuantDiff("noise", betax=1.0, betay=1.0, emitx=1e-8, taux=100.0)
ring = at.Lattice([at.Drift("half", 1.0), noise, at.Drift("half", 1.0)], energy=3e9, periodicity=1)
found = ring.track(np.asfortranarray(np.zeros((6, count))), nturns=3)[0]
print(found[0, 0, 0, -1].hex())
END
run() { python track.py "$@" 2> log | tail -1; }
python -c 'from importlib.metadata import version; print("pyAT", version("accelerator-toolbox"))'
unseeded=$(run 1 none) again=$(run 1 none) one=$(run 1 7) repeated=$(run 1 7) other=$(run 1 8) two=$(run 2 7)
echo "x of particle 0: unseeded $unseeded and $again; seed 7 $one and $repeated; seed 8 $other; seed 7 with a second one $two"
[ "$unseeded" = "$again" ] && [ "$one" = "$repeated" ]
[ "$one" != "$other" ] && [ "$one" != "$two" ]
