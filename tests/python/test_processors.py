# SPDX-License-Identifier: BSD-3-Clause
"""OpenMP's runtime may bind the thread that loads it to a processor: work still uses all processors of the process."""

import os
import subprocess
import sys

import pytest

COUNT = """
import os
before = os.sched_getaffinity(0)
import symsde
bound = os.sched_getaffinity(0)
from symsde.batch import dispatch
with dispatch.own_threads(1) as own:
    all_of_them = own.submit(lambda: os.sched_getaffinity(0) == before).result()
print(len(before), len(bound), dispatch._threads(None), all_of_them)
os.sched_setaffinity(0, {min(before)})
with dispatch.own_threads(1) as own:
    print(dispatch._threads(None), own.submit(lambda: len(os.sched_getaffinity(0))).result())
"""


def counted(**settings):
    """What COUNT prints with these settings alone. A preloaded library would be bound before the first count."""
    others = ("OMP_", "SYMSDE_NUM", "GOMP_", "LD_PRELOAD")
    clean = {name: value for name, value in os.environ.items() if not name.startswith(others)}
    done = subprocess.run(
        [sys.executable, "-c", COUNT], env=clean | settings, capture_output=True, text=True, check=True
    )
    return [line.split() for line in done.stdout.splitlines()]


@pytest.mark.skipif(
    not hasattr(os, "sched_getaffinity") or len(os.sched_getaffinity(0)) < 2, reason="one processor, or no affinity"
)
@pytest.mark.parametrize("settings", [{"OMP_PROC_BIND": "true"}, {"OMP_PLACES": "cores"}, {}])
def test_pieces_go_to_all_processors(settings):
    """The mask of the loading thread is restored; a mask that the program sets later is kept."""
    (before, bound, threads, all_of_them), later = counted(**settings)
    assert (int(bound) < int(before)) == bool(settings)  # the loading thread is bound, or this test shows nothing
    assert threads == before
    assert all_of_them == "True"
    if not settings:  # a single processor set by the program cannot be told from one set by the runtime
        assert later == ["1", "1"]
