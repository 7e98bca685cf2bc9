# SPDX-License-Identifier: BSD-3-Clause
"""The one writer of tables: in Markdown, on the terminal, in notebooks, and as files of comma-separated values."""

from __future__ import annotations

import csv
import html
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..native import files

Rows = Iterable[Sequence[str]]


def markdown(head: Sequence[str], rows: Rows) -> str:
    """A Markdown table, each line with its line end; vertical bars in cells are escaped."""
    lines = [head, ["---"] * len(head), *rows]
    return "".join("| " + " | ".join(cell.replace("|", r"\|") for cell in line) + " |\n" for line in lines)


def notebook(head: Sequence[str], rows: Rows) -> str:
    """A table in HTML."""

    def line(cells: Sequence[str], tag: str) -> str:
        return "<tr>" + "".join(f"<{tag}>{html.escape(cell)}</{tag}>" for cell in cells) + "</tr>"

    body = "\n".join(line(row, "td") for row in rows)
    return f"<table>\n{line(head, 'th')}\n{body}\n</table>\n"


def aligned(rows: Rows, widths: Sequence[int], gap: str = " ") -> str:
    """Lines whose cells have at least the given widths, aligned right, or left if the width is negative."""
    return "\n".join(
        gap.join(
            cell.rjust(width) if width > 0 else cell.ljust(-width) for cell, width in zip(row, widths, strict=True)
        ).rstrip()
        for row in rows
    )


def facts(lines: Iterable[tuple[str, str]], width: int = 11) -> str:
    """A line for each fact, after its name, which is padded to `width` characters."""
    return aligned(((f"{name:<{width - 1}} ", text) for name, text in lines), (0, 0), "")


def terminal(head: Sequence[str], rows: Iterable[Sequence[str] | str], numbers: Sequence[int] = ()) -> str:
    """A table whose columns have the least width; the columns `numbers` are aligned right, all others left.

    A row that is a single text is printed unchanged.
    """
    rows = list(rows)
    cells = [head, *(row for row in rows if not isinstance(row, str))]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    signed = [0, *(width if i in numbers else -width for i, width in enumerate(widths))]
    lines = [head, ["-" * width for width in widths], *rows]
    return "\n".join(row if isinstance(row, str) else aligned([["", *row]], signed, "  ") for row in lines)


def write(target: Path, columns: Mapping[str, Iterable], about: Mapping[str, str]) -> None:
    """Write columns as a file of comma-separated values, in a form that all readers understand alike.

    Lines that begin with # describe the origin of the data; the first row below them names the columns. All lines end
    in LF. Numbers have all their digits; NaN is NaN, infinity is inf or -inf, and a cell without a value is empty. Only
    texts with a comma, a quote or a line end are quoted.
    """
    cells = [[_cell(x) for x in (x.tolist() if isinstance(x, np.ndarray) else x)] for x in columns.values()]

    def put(part: Path) -> None:
        with part.open("w", newline="", encoding="utf-8") as file:
            file.writelines(_comments(about))
            csv.writer(file, lineterminator="\n").writerows([columns, *zip(*cells, strict=True)])

    files.replace(target, put)


def _comments(about: Mapping[str, str]) -> Iterator[str]:
    """The attributes as lines that begin with #; a text of several lines follows below its name."""
    for key, value in about.items():
        first, *others = value.splitlines() or [""]
        if not others:
            yield f"# {key}: {first}\n"
            continue
        yield f"# {key}:\n"
        yield from (f"#   {line}".rstrip() + "\n" for line in (first, *others))


def _cell(value: Any) -> Any:
    if isinstance(value, bool | np.bool_):
        return int(value)
    if isinstance(value, float | np.floating):  # NumPy's floats, too: their repr has more than the number
        return "NaN" if math.isnan(value) else repr(float(value))
    return "" if value is None else value
