# SPDX-License-Identifier: BSD-3-Clause
"""Pages: the parts that programs write, and the names of machine and library that these parts give."""

from __future__ import annotations

import os
import re
import textwrap
from collections.abc import Callable
from pathlib import Path

from ..native import files
from ..native.build import build_info

WIDTH = 120


def made_by() -> str:
    """Version and compiler of the library that computed the numbers."""
    info = build_info()
    return f"symsde {info['version']}, {info['compiler']}"


def machine() -> str:
    """The kind of processor."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else "unknown processor"


def wrapped(text: str, indent: str = "") -> str:
    """A paragraph broken into lines, the later ones indented. No line begins with %, which would make it a comment."""
    kept = text.replace(" %", "\u00a0%")
    lines = textwrap.fill(kept, WIDTH, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)
    return lines.replace("\u00a0%", " %")


class Page:
    """A page written by hand, except for parts that a program writes between two comments with the part's name.

    Parts that the page does not have yet are appended, in the order in which they are given.
    """

    def __init__(self, target: str | os.PathLike, command: str):
        """Store the place of the page, and the command that writes its parts."""
        self.target, self.command = Path(target), command
        self._parts: dict[str, str] = {}

    def put(self, name: str, *parts: str) -> None:
        """Set a part of the page: paragraphs, tables and figures, separated by blank lines."""
        self._parts[name] = "\n\n".join(part.strip("\n") for part in parts)

    def figure(self, stem: str, data: object, draw: Callable[[Path, object], object], words: str) -> str:
        """Write the data of a figure and the figure into figures/ beside the page; return the page's link to the
        figure.
        """
        folder = self.target.parent / "figures"
        folder.mkdir(parents=True, exist_ok=True)
        files.replace_text(folder / f"{stem}.json", files.json_text(data))
        draw(folder / f"{stem}.png", data)
        return f"![{words}](figures/{stem}.png)"

    def text(self) -> str:
        """The text of the whole page."""
        page = self.target.read_text(encoding="utf-8") if self.target.is_file() else ""
        for name, text in self._parts.items():
            part = f"<!-- begin {name}: written by `{self.command}` -->\n\n{text}\n\n<!-- end {name} -->\n"
            known = re.search(rf"^<!-- begin {name}: .*?^<!-- end {name} -->\n", page, re.M | re.S)
            page = page[: known.start()] + part + page[known.end() :] if known else f"{page}\n{part}".lstrip("\n")
        return page

    def write(self) -> None:
        """Write the page, completely or not at all."""
        files.replace_text(self.target, self.text())
