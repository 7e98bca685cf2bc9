# SPDX-License-Identifier: BSD-3-Clause
"""The page of the benchmark has words for every group of rows that it is given."""

import re
import sys
from pathlib import Path

BENCH = Path(__file__).parents[2] / "bench"


def test_every_group_of_rows_has_its_words(monkeypatch):
    monkeypatch.syspath_prepend(str(BENCH))
    from topics import loops

    groups = set(re.findall(r'Row\(\s*f?"(\w+)', (BENCH / "loop_rows.py").read_text()))
    assert {"stages", "many", "few", "error", "call"} <= groups
    groups = groups - {"few", "given"} | {f"few{paths}" for paths in (1, 2, 8, 32)} | {"given1", "given1000"}
    assert groups <= set(loops.GROUPS)
    sys.modules.pop("topics", None)
