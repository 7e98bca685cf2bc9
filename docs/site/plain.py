# SPDX-License-Identifier: BSD-3-Clause
"""Plain text of comments and docstrings as markup: backquotes, lists and indented formulas mean something, no more."""

import re


def as_rest(text):
    """As reStructuredText: indented lines become literal blocks, names in backquotes code, stars stay stars."""
    found = []
    for kind, lines in _pieces(text):
        if kind == "formula":
            found += ["", "::", "", *(f"    {line}" for line in lines), ""]
        elif kind == "list":
            found += ["", *_items(lines), ""]
        else:
            found += ["", *map(_escaped, lines), ""]
    return "\n".join(found)


def as_markdown(text):
    """As Markdown: the same pieces."""
    found = []
    for kind, lines in _pieces(text):
        if kind == "formula":
            found += ["", "```text", *lines, "```", ""]
        elif kind == "list":
            found += ["", *(re.sub(r"([*_<])", r"\\\1", line) if "`" not in line else line for line in lines), ""]
        else:
            found += ["", *(_marked(line) for line in lines), ""]
    return "\n".join(found).strip() + "\n"


def _pieces(text):
    """(kind, lines) of a text: formula, list or paragraph."""
    kind, lines, found = None, [], []
    for line in [*text.expandtabs().splitlines(), ""]:
        if not line.strip():
            new = kind if kind == "formula" else None
        elif re.match(r"- ", line):
            new = "list"
        elif line.startswith(" ") and kind in ("list", "paragraph"):
            new = kind
        elif line.startswith("  "):
            new = "formula"
        else:
            new = "paragraph" if kind != "paragraph" else kind
        if new != kind and lines:
            found.append((kind, lines))
            lines = []
        kind = new
        if line.strip():
            lines.append(line.rstrip())
    if lines:
        found.append((kind, lines))
    return found


def _items(lines):
    """Items of a list, each with its lines under it."""
    for line in lines:
        yield _escaped(line) if line.startswith("- ") else f"  {_escaped(line.strip())}"


def _escaped(line):
    """A line without markup but code: what stands between backquotes."""
    parts = re.split(r"(``[^`]+``|`[^`]+`)", line)
    return "".join(f"``{part.strip('`')}``" if part.startswith("`") else _flat(part) for part in parts)


def _flat(text):
    return re.sub(r"([*|\\`])", r"\\\1", re.sub(r"(\w)_(?=\W|$)", r"\1\\_", text))


def _marked(line):
    """A line of Markdown whose stars, underscores and brackets are letters."""
    parts = re.split(r"(`[^`]+`)", line)
    return "".join(part if part.startswith("`") else re.sub(r"([*_<\[\]$#|])", r"\\\1", part) for part in parts)
