# SPDX-License-Identifier: BSD-3-Clause
"""Results as they were recorded, so that no number, counter or text changes unnoticed.

    python tests/python/test_recorded.py --record        writes recorded.txt anew

The numbers in recorded.txt prove nothing: other suites test orders, oracles and the facts of the paper. They are the
results when the file was written. After an intended change write the file again, see which keys `git diff` shows, and
say in the commit why these keys, and no others, changed.

Each line is a key and a summary of some results: a number is a weighted sum over all entries (recorded.py) that agrees
between builds to 1e-9, and x... is a checksum of integers and text. Counts of iterations differ between builds: `work`
gives each count n for a path over all runs of the group, and a change by more than 1 % and 3 sqrt(n) fails, or any
change if nothing iterates. A key missing from the file fails, and so does a key that no group makes.
"""

import sys
import warnings
from pathlib import Path

import pytest
import recorded
import recorded_calls
import recorded_commands
import recorded_runs

pytestmark = pytest.mark.optimised

FILE = Path(__file__).with_name("recorded.txt")
GROUPS = {f.__name__: f for f in (*recorded_runs.GROUPS, *recorded_calls.GROUPS, *recorded_commands.GROUPS)}
HEAD = "\n".join(f"# {line}".rstrip() for line in __doc__.splitlines())


def of_group(name):
    """All keys of a group with their numbers."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # warnings of results are recorded with their numbers
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
    """The twin: a change of one entry among 300, of a text, an integer, or a counter by a fifth is noticed."""
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
