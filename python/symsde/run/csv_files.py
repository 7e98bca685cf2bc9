# SPDX-License-Identifier: BSD-3-Clause
"""Tables as files of comma-separated values, in a form that all readers understand alike.

Lines end in LF, comments too. Numbers have all their digits; NaN is NaN, infinity is inf or -inf, and a cell
is empty if a row has no value. Only texts with a comma, a quote or a line end are quoted.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..native import files
from . import provenance


def write(target: Path, columns: Mapping[str, Iterable], about: Mapping[str, str]) -> None:
    """Write columns with their names in the first row, below lines that begin with # and describe the origin of the
    data."""
    cells = [[_cell(x) for x in (x.tolist() if isinstance(x, np.ndarray) else x)] for x in columns.values()]

    def put(part: Path) -> None:
        with part.open("w", newline="", encoding="utf-8") as file:
            file.writelines(provenance.comments(about))
            csv.writer(file, lineterminator="\n").writerows([columns, *zip(*cells, strict=True)])

    files.replace(target, put)


def _cell(value: Any) -> Any:
    if isinstance(value, bool | np.bool_):
        return int(value)
    if isinstance(value, float | np.floating):  # NumPy's numbers too, whose repr contains more than the number
        return "NaN" if math.isnan(value) else repr(float(value))
    return "" if value is None else value
