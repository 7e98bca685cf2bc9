# SPDX-License-Identifier: BSD-3-Clause
"""advice.py ROOT: places in the tree that may trouble a reader. They are hints, and no test fails because of them.

Files of more than 500 lines, files of the Python package that share a name, and areas of src with more than five files
beside their rooms.
"""

import sys
from collections import Counter
from pathlib import Path

MOST_LINES, MOST_BESIDE = 500, 5
SOURCES = ("src", "python", "tests", "examples", "bench", "include")
ENDINGS = {".f90", ".inc", ".pf", ".py", ".c", ".h", ".hpp", ".cpp"}


def long_files(root):
    """Files that may have more than one task."""
    for top in SOURCES:
        for file in sorted((root / top).rglob("*")):
            if file.suffix in ENDINGS and (lines := file.read_text(encoding="utf-8").count("\n")) > MOST_LINES:
                yield f"{file.relative_to(root)} has {lines} lines: has it one duty?"


def shared_names(root):
    """Names that several files of the package have."""
    names = Counter(file.stem for file in (root / "python/symsde").rglob("*.py") if not file.stem.startswith("__"))
    for name, count in sorted(names.items()):
        if count > 1:
            yield f"python/symsde has {count} files of the name {name}: do readers know which is meant?"


def beside_rooms(root):
    """Areas of src that hold more than five files in addition to rooms."""
    for area in sorted(path for path in (root / "src").iterdir() if path.is_dir()):
        files = sum(path.suffix in {".f90", ".inc", ".c"} for path in area.iterdir())
        if files > MOST_BESIDE and any(path.is_dir() for path in area.iterdir()):
            yield f"src/{area.name} holds {files} files beside its rooms: do some make a room?"


def main():
    """Print all hints."""
    root = Path(sys.argv[1])
    found = [line for look in (long_files, shared_names, beside_rooms) for line in look(root)]
    print("\n".join(found) or "nothing to ask")


if __name__ == "__main__":
    main()
