# SPDX-License-Identifier: BSD-3-Clause
"""The notebook of a page of docs/: text and blocks are its cells, scenes are written to files, commands are run.

A block of text that the page shows is the output of the block before it.
"""

import json
import re
from pathlib import Path

PAGE = Path(__file__).with_name("project.md")
TARGET = PAGE.parents[1] / "examples" / "notebooks" / "project.ipynb"
_FENCE = re.compile(r"^```(\w+)\n(.*?)^```$", re.M | re.S)


def notebook() -> str:
    """The notebook of PAGE, as TARGET holds it."""
    cells, end, text = [], 0, PAGE.read_text(encoding="utf-8")
    for block in _FENCE.finditer(text):
        between, end = text[end : block.start()].strip(), block.end()
        if between:
            cells.append(_cell("markdown", _linked(between)))
        if block[1] == "text":
            lines = block[2].splitlines(keepends=True)
            cells[-1]["outputs"] = [{"name": "stdout", "output_type": "stream", "text": lines}]
        else:
            cells.append(_cell("code", _code(*block.groups())))
    cells.append(_cell("markdown", _linked(text[end:])))
    for number, cell in enumerate(cells):
        cell["id"] = f"cell-{number:02}"
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    about = {"kernelspec": kernel, "language_info": {"name": "python"}}
    whole = {"cells": cells, "metadata": about, "nbformat": 4, "nbformat_minor": 5}
    return json.dumps(whole, indent=1, sort_keys=True, ensure_ascii=False) + "\n"


def _cell(kind: str, text: str) -> dict:
    """A cell without output."""
    lines = text.strip().splitlines(keepends=True)
    empty = {"execution_count": None, "outputs": []} if kind == "code" else {}
    return {"cell_type": kind, "metadata": {}, "source": lines, **empty}


def _linked(text: str) -> str:
    """Links of the page, as seen from the folder of the notebook."""
    return re.sub(r"\]\((?!\w+:)", "](../../docs/", text)


def _code(kind: str, body: str) -> str:
    """A block as a cell: a scene goes to the file that its first line names, symsde is that of this Python."""
    if kind == "toml":
        return f"%%writefile {body.partition(chr(10))[0].removeprefix('# ')}\n{body}"
    if kind == "sh":
        return "import sys\n\n" + re.sub(r"^symsde", "!{sys.executable} -m symsde", body, flags=re.M)
    return body
