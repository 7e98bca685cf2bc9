# SPDX-License-Identifier: BSD-3-Clause
"""Bodies (.inc), which several modules include: put them into their modules for tools that read whole modules."""

import os
import re
from pathlib import Path

INCLUDE = re.compile(r"^ *include '([\w./]+\.inc)'$", re.MULTILINE)


def bodies(file):
    """The bodies that a source includes, as paths from the source's folder."""
    names = INCLUDE.findall(file.read_text(encoding="utf-8"))
    return [Path(os.path.normpath(file.parent / name)) for name in names]


def expanded(file):
    """The text of a source with its bodies in place of the include lines."""
    text = file.read_text(encoding="utf-8")
    return INCLUDE.sub(lambda found: (file.parent / found[1]).read_text(encoding="utf-8").rstrip("\n"), text)


def expand_into(folder, root, names):
    """Write sources that have bodies, expanded, below a folder; yield the path to check for each of the names."""
    for name in names:
        if name.endswith(".f90") and bodies(root / name):
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(expanded(root / name), encoding="utf-8")
            yield str(folder / name)
        else:
            yield name
