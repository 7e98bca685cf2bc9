# SPDX-License-Identifier: BSD-3-Clause
"""lint.py TOOL ROOT: run a linter or formatter over the tree; exit 77 (skipped) where it is missing."""

import subprocess
import sys
import tempfile
from pathlib import Path

from bodies import expand_into

MISSING = 77
FORTRAN = ("src", "tests", "examples", "bench")
C = ("include", "tests", "examples", "bench")
PYTHON = ("python", "tests", "examples", "bench", "docs")


def files(root, folders, *suffixes):
    """Files of the project's own folders, by suffix."""
    found = [
        path
        for folder in folders
        for path in sorted((root / folder).rglob("*"))
        if path.suffix in suffixes and "build" not in path.parts
    ]
    return [path.relative_to(root).as_posix() for path in found]


def command(tool, root):
    """The command line of a tool, and the files that it checks."""
    if tool == "fortitude":
        return ["fortitude", "check"], files(root, FORTRAN, ".f90")
    if tool == "fprettify":
        return ["fprettify", "--silent", "--config-file", ".fprettify.rc", "--diff"], files(root, FORTRAN, ".f90")
    if tool == "ruff":
        return ["ruff", "check", "--no-cache"], files(root, PYTHON, ".py")
    if tool == "ruff-format":
        return ["ruff", "format", "--no-cache", "--diff"], files(root, PYTHON, ".py")
    return ["clang-format", "--dry-run", "-Werror"], files(root, C, ".c", ".h", ".cpp", ".hpp")


def main():
    """Run the tool; fprettify says by its output, not by its exit code, whether it would change a file."""
    tool, root = sys.argv[1], Path(sys.argv[2])
    words, targets = command(tool, root)
    program = Path(sys.executable).parent / words[0]
    if not program.exists():
        print(f"skipped: {words[0]} is not installed; ./bootstrap test installs it in .venv")
        return MISSING
    if not targets:
        print("nothing to look at")
        return 0
    with tempfile.TemporaryDirectory() as scratch:
        targets = list(expand_into(Path(scratch), root, targets))
        done = subprocess.run([program, *words[1:], *targets], cwd=root, check=False, capture_output=True, text=True)
    print(done.stdout + done.stderr)
    return done.returncode or (tool == "fprettify" and done.stdout.strip() != "")


if __name__ == "__main__":
    sys.exit(main())
