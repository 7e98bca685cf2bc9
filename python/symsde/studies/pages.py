# SPDX-License-Identifier: BSD-3-Clause
"""Tables and pages: one table in Markdown, one on the terminal, and parts of pages that programs write."""

from __future__ import annotations

import os
import re
import textwrap
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from ..native import files
from ..native.build import build_info

WIDTH = 120


def markdown(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table, each line ended; bars in cells are quoted."""
    lines = [head, ["---"] * len(head), *rows]
    return "".join("| " + " | ".join(cell.replace("|", r"\|") for cell in line) + " |\n" for line in lines)


def terminal(head: Sequence[str], rows: Iterable[Sequence[str] | str], numbers: Sequence[int] = ()) -> str:
    """A table whose columns are as wide as they must be; the columns `numbers` end in line, the others begin so.

    A row that is one text stands as it is, between the others.
    """
    rows = list(rows)
    cells = [head, *(row for row in rows if not isinstance(row, str))]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]

    def line(row: Sequence[str]) -> str:
        padded = (
            cell.rjust(n) if i in numbers else cell.ljust(n)
            for i, (cell, n) in enumerate(zip(row, widths, strict=True))
        )
        return "  " + "  ".join(padded).rstrip()

    rule = line(["-" * width for width in widths])
    return "\n".join([line(head), rule, *(row if isinstance(row, str) else line(row) for row in rows)])


def made_by() -> str:
    """Version and compiler of the library that computed the numbers."""
    info = build_info()
    return f"symsde {info['version']}, {info['compiler']}"


def machine() -> str:
    """Kind of processor."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else "unknown processor"


def wrapped(text: str, indent: str = "") -> str:
    """A paragraph in lines as long as they may be, the later ones indented. None begins with %: that is a comment."""
    kept = text.replace(" %", "\u00a0%")
    lines = textwrap.fill(kept, WIDTH, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)
    return lines.replace("\u00a0%", " %")


class Page:
    """A page whose words are written by hand, and parts of it by a program: between two comments with their name.

    Parts that a page does not have yet are put behind what is there, in the order in which they are given.
    """

    def __init__(self, target: str | os.PathLike, command: str):
        """Where it is, and the command that writes its parts."""
        self.target, self.command = Path(target), command
        self._parts: dict[str, str] = {}

    def put(self, name: str, *parts: str) -> None:
        """A part of the page, made of paragraphs, tables and figures with a blank line between two of them."""
        self._parts[name] = "\n\n".join(part.strip("\n") for part in parts)

    def figure(self, stem: str, data: object, draw: Callable[[Path, object], object], words: str) -> str:
        """Write the data of a figure and the figure into figures/ beside the page; how the page shows it."""
        folder = self.target.parent / "figures"
        folder.mkdir(parents=True, exist_ok=True)
        files.replace_text(folder / f"{stem}.json", files.json_text(data))
        draw(folder / f"{stem}.png", data)
        return f"![{words}](figures/{stem}.png)"

    def text(self) -> str:
        """The whole page."""
        page = self.target.read_text(encoding="utf-8") if self.target.is_file() else ""
        for name, text in self._parts.items():
            part = f"<!-- begin {name}: written by `{self.command}` -->\n\n{text}\n\n<!-- end {name} -->\n"
            known = re.search(rf"^<!-- begin {name}: .*?^<!-- end {name} -->\n", page, re.M | re.S)
            page = page[: known.start()] + part + page[known.end() :] if known else f"{page}\n{part}".lstrip("\n")
        return page

    def write(self) -> None:
        """Write the page, whole or not at all."""
        files.replace_text(self.target, self.text())
