#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# pykdtree 1.4.3, whose wheel holds libgomp, and intel-openmp 2026.2.0 (PyPI), on Linux, two processors or more.
# Guess: with OMP_PROC_BIND=true or OMP_PLACES=cores in a job script, importing a package leaves the process its processors;
#     threads are bound when a parallel region starts.
# Seen: libgomp binds the thread that loads it, before anything runs in parallel: after its import the process may run on
#     one processor, and so may every process that it starts, multiprocessing's workers too. Intel's library leaves all.
# For users of stochastic integrators: what counts processors by affinity (os.sched_getaffinity, nproc) finds one, and runs
#     with one thread; pools of processes share it. Say the number of threads, or bind by the launcher instead.
. "$(dirname "$0")/venv.sh" pykdtree==1.4.3 intel-openmp==2026.2.0 numpy==2.4.6
cat > count.py <<'END'
import multiprocessing
import os
import sys


def processors(_=None):
    return len(os.sched_getaffinity(0))


if __name__ == "__main__":
    before = processors()
    if sys.argv[1] == "gnu":
        import pykdtree.kdtree  # noqa: F401
    else:
        import ctypes

        ctypes.CDLL(sys.prefix + "/lib/libiomp5.so").omp_get_max_threads()
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        print(before, processors(), *pool.map(processors, range(1)))
END
all=$(env -u OMP_NUM_THREADS -u OMP_THREAD_LIMIT nproc)
[ "$all" -ge 2 ]
for case in "OMP_PROC_BIND=true gnu 1" "OMP_PLACES=cores gnu 1" \
   "OMP_PROC_BIND=false gnu $all" "OMP_PROC_BIND=true intel $all"; do
   read -r setting library wanted <<< "$case"
   found=$(env -u OMP_PLACES -u OMP_PROC_BIND "$setting" python count.py "$library")
   echo "$setting, $library: processors before, after, of a worker: $found"
   [ "$found" = "$all $wanted $wanted" ]
done
