# SPDX-License-Identifier: BSD-3-Clause
"""Plain text of comments and docstrings as markup: backquotes, lists and indented formulas mean something, no more."""

import re

import typeset


def as_rest(text):
    """As reStructuredText: indented lines become literal blocks, names in backquotes code, stars stay stars."""
    found = []
    for kind, lines in _pieces(text):
        if kind == "formula" and (shown := typeset.displayed(lines)):
            found += ["", ".. math::", "", f"    {shown}", ""]
        elif kind == "formula":
            found += ["", "::", "", *(f"    {line}" for line in lines), ""]
        elif kind == "list":
            found += ["", *_items(lines), ""]
        else:
            found += ["", *_escaped("\n".join(lines)).split("\n"), ""]
    return "\n".join(found)


def as_markdown(text):
    """As Markdown: the same pieces."""
    found = []
    for kind, lines in _pieces(text):
        if kind == "formula" and (shown := typeset.displayed(lines)):
            found += ["", "$$", shown, "$$", ""]
        elif kind == "formula":
            found += ["", "```text", *lines, "```", ""]
        elif kind == "list":
            found += ["", *map(_marked, lines), ""]
        else:
            found += ["", *_marked("\n".join(lines)).split("\n"), ""]
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
        name = re.match(r"- (\*{0,2}\w+(?:, \w+)*)(?=: )", line)
        code = ", ".join(f"``{part}``" for part in name[1].split(", ")) if name else ""
        if line.startswith("- "):
            yield f"- {code}{_escaped(line[name.end() if name else 2 :])}"
        else:
            yield f"  {_escaped(line.strip())}"


def _escaped(text):
    """Text without markup but code, which stands between backquotes, and formulas."""
    return "".join(map(_as_role, re.split(r"(``[^`]+``|`[^`]+`|\$[^$]+\$)", typeset.typeset(text))))


def _as_role(part):
    if part.startswith("`"):
        return f"``{part.strip('`')}``"
    if part.startswith("$"):
        return f":math:`{part.strip('$')}`"
    return re.sub(r"\[WHSB\] \((\d+)\)(?:-\(\d+\))?", r"`\g<0> <../paper-map.html#eq-\1>`__", _flat(part))


def _flat(text):
    return re.sub(r"([*|\\`])", r"\\\1", re.sub(r"(\w)_(?=\W|$)", r"\1\\_", text))


def _marked(text):
    """Text as Markdown in which stars, underscores and brackets are letters, and formulas are TeX."""
    text = typeset.linked(typeset.typeset(text), "../paper-map.md")
    parts = re.split(r"(`[^`]+`|\$[^$]+\$|\[\[WHSB\][^\]]*\]\([^)]*\)|^- )", text)
    return "".join(part if i % 2 else re.sub(r"([*_<\[\]$#|])", r"\\\1", part) for i, part in enumerate(parts))
