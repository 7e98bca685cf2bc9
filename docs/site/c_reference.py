# SPDX-License-Identifier: BSD-3-Clause
"""The C reference: include/symsde.h as a page, entry by entry, in the words of its comments."""

import re

from plain import as_markdown

INTRODUCTION = """\
# C interface

`#include <symsde.h>`, and link with `pkg-config --cflags --libs symsde`. This page is made from the header when the
site is built. Each comment of the header stands above the declarations that it describes. For C++17 there is a thin
layer over it, the [C++ interface](cpp.md). [First ten minutes](../first-ten-minutes.md) and
[a model of your own](../own-model.md) have complete programs.
"""
PROTOTYPE = re.compile(r"^int (symsde_\w+)\(", re.M)


def page(header):
    """The page, from the text of the header; ValueError where a function would be missing from it."""
    opening, body = header.split("#ifndef SYMSDE_H", 1)
    found = [INTRODUCTION, as_markdown(_uncommented(opening.partition("\n *\n")[2]))]
    body = re.split(r'^extern "C" \{\n#endif\n', body, maxsplit=1, flags=re.M)[1].split("#ifdef __cplusplus")[0]
    for title, text in _sections(body):
        found.append(f"## {title}\n")
        found += [_entry(comment, code) for comment, code in _entries(text)]
    whole = "\n".join(found)
    for name in PROTOTYPE.findall(header):
        if not re.search(rf"^### .*`{name}`", whole, re.M):
            raise ValueError(f"symsde.h: {name} has no heading on the page")
    return whole


def _sections(body):
    """(title, text) between the ruled comments of the header."""
    parts = re.split(r"^/\* -{4} (\w[\w ]*?) -+ \*/\n", body, flags=re.M)
    return [(title.capitalize(), text) for title, text in zip(parts[1::2], parts[2::2], strict=True)]


def _entries(text):
    """(comment, declarations) of a section; declarations that neither comment nor blank line parts are one entry."""
    comment, code, commenting = [], [], False
    for line in [*text.splitlines(), ""]:
        begins = line.startswith("/*")
        if code and (begins or not line):
            yield "\n".join(comment), "\n".join(code)
            comment, code = [], []
        commenting |= begins
        if line:
            (comment if commenting else code).append(line)
        commenting &= not line.rstrip().endswith("*/")


def _entry(comment, code):
    """A heading with the names, what the comment says, the declarations as they stand."""
    names = PROTOTYPE.findall(code) + re.findall(r"^typedef int \(\*(\w+)\)", code, re.M)
    names += re.findall(r"^\} (symsde_\w+);|^typedef struct \w+ \*(\w+);|^enum (\w+)|^#define (\w+)", code, re.M)
    names = ["".join(name) if isinstance(name, tuple) else name for name in names]
    heading = ", ".join(f"`{name}`" for name in names)
    return f"### {heading}\n\n{as_markdown(_uncommented(comment))}\n```c\n{code.rstrip()}\n```\n"


def _uncommented(comment):
    """The words of a comment."""
    lines = comment.replace("*/", "").splitlines()
    return "\n".join(re.sub(r"^(/\* ?| \* ?| {3}(?=\S))", "", line).rstrip() for line in lines)
