#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# REBOUND 5.2.2 (PyPI), Python 3.11 on Linux.
# Guess: after sim.integrate() the interrupt key works in the rest of the program as before it.
# Seen: integrate() sets its own handler of SIGINT and leaves it there: from then on the signal raises no KeyboardInterrupt in
#     any loop of Python, although signal.getsignal() still names Python's handler. signal.signal(SIGINT,
#     signal.default_int_handler) sets it back.
# For users of stochastic integrators: a notebook that compares with REBOUND can no longer interrupt a long run of another
#     package that waits for Python's handler.
. "$(dirname "$0")/venv.sh" rebound==5.2.2 numpy==2.4.6
python - <<'END'
import os
import signal
import time

import rebound


def interrupted():
    try:
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.1)
    except KeyboardInterrupt:
        return True
    return False


signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell may have it ignored in the background
before = interrupted()
sim = rebound.Simulation()
sim.add(m=1.0)
sim.add(m=1e-3, a=1.0)
sim.integrator = "whfast"
sim.dt = 0.01
sim.integrate(1.0)
after, named = interrupted(), signal.getsignal(signal.SIGINT) is signal.default_int_handler
signal.signal(signal.SIGINT, signal.default_int_handler)
restored = interrupted()
print("REBOUND", rebound.__version__, "SIGINT raises KeyboardInterrupt: before", before, "after integrate", after,
      "after setting the handler again", restored, "; getsignal names Python's handler:", named)
assert before and not after and named and restored
END
