# SPDX-License-Identifier: BSD-3-Clause
"""Bodies (.inc) that several modules include: what tools that know whole modules alone are shown of them."""

import os
import re
from pathlib import Path

INCLUDE = re.compile(r"^ *include '([\w./]+\.inc)'$", re.MULTILINE)


def bodies(file):
    """The bodies that a source includes; they are named from where it stands."""
    names = INCLUDE.findall(file.read_text(encoding="utf-8"))
    return [Path(os.path.normpath(file.parent / name)) for name in names]


def expanded(file):
    """The text of a source with its bodies in the places where it includes them."""
    text = file.read_text(encoding="utf-8")
    return INCLUDE.sub(lambda found: (file.parent / found[1]).read_text(encoding="utf-8").rstrip("\n"), text)


def expand_into(folder, root, names):
    """Write sources with bodies, expanded, below a folder, and say where each of the names is looked at now."""
    for name in names:
        if name.endswith(".f90") and bodies(root / name):
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(expanded(root / name), encoding="utf-8")
            yield str(folder / name)
        else:
            yield name
