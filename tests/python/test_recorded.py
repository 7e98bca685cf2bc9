# SPDX-License-Identifier: BSD-3-Clause
"""Results as they were recorded: nobody changes a number, a counter or a text unknowingly.

    python tests/python/test_recorded.py --record        writes recorded.txt anew

What stands in recorded.txt is no proof of correctness: orders, oracles and the facts of the paper are judged by other
suites. It is what came out when the file was written. Where a change is meant, write it anew, look which keys `git
diff` shows, and say in the commit why these, and no others, are what they are now.

Each line is a key and what is left of some results: a number is a weighted sum over all entries (recorded.py) that
agrees to 1e-9 with that of any build, and x... is a checksum of integers and text. Iterations, and what goes with
them, differ between builds: work of a scheme is how many of each, n, a path took in all runs of the group. Seen are
changes by more than 1 % and 3 roots of n; every change, where nothing iterates.
A key that is missing there fails, and so does one that nothing makes.
"""

import sys
import warnings
from pathlib import Path

import pytest
import recorded
import recorded_calls
import recorded_commands
import recorded_runs

FILE = Path(__file__).with_name("recorded.txt")
GROUPS = {f.__name__: f for f in (*recorded_runs.GROUPS, *recorded_calls.GROUPS, *recorded_commands.GROUPS)}
HEAD = "\n".join(f"# {line}".rstrip() for line in __doc__.splitlines())


def of_group(name):
    """All keys of a group with their numbers."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # those that belong to a result are among its numbers
        found = [(f"{name}: {key}", numbers) for key, numbers in GROUPS[name]()]
    assert len(found) == len(dict(found)), "two results have one key"
    return dict(found)


def test_no_other_keys_are_recorded():
    assert {key.partition(":")[0] for key in recorded.read(FILE)} == set(GROUPS)


@pytest.mark.parametrize("name", GROUPS)
def test_results_are_as_recorded(name):
    known = {key: x for key, x in recorded.read(FILE).items() if key.startswith(f"{name}:")}
    told = recorded.differ(known, of_group(name))
    assert not told, f"{len(told)} of {len(known)} results are not as they were:\n" + "\n".join(told[:20])


def test_a_fault_of_one_in_ten_thousand_is_seen():
    """The twin: of one entry among 300, and a text, an integer, a counter that is a fifth more."""
    x = recorded.weights(300)
    off = x + 1e-4 * (recorded.weights(300).argsort() == 7)
    assert not recorded.number(off).agrees(str(recorded.number(x)))
    assert recorded.number(x * (1 + 1e-13)).agrees(str(recorded.number(x)))
    for n, iterations in ((9900, 1), (10999, 0)):
        fewer, more = (recorded.counted([({"solves": 4 * x, "iterations": iterations}, 4)])[0] for x in (n, 11000))
        assert not more.agrees(str(fewer))
    assert recorded.code("a 1.0000001 of 2") == recorded.code("a 1 of 2") != recorded.code("a 1.001 of 2")
    assert recorded.differ({"a": ["1"]}, {}) and recorded.differ({}, {"a": [recorded.number([1.0])]})


if __name__ == "__main__":
    if sys.argv[1:] != ["--record"]:
        sys.exit(__doc__)
    lines = [f"{key} = {' '.join(map(str, x))}" for name in GROUPS for key, x in of_group(name).items()]
    FILE.write_text("\n".join([HEAD, *lines, ""]), encoding="utf-8")
