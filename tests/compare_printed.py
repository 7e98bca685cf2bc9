# SPDX-License-Identifier: BSD-3-Clause
"""An example in several languages prints the same number: the first on the line that contains WORDS.

compare_printed.py ROOT WORDS PROGRAM...

This Python runs programs named .py, whose number is not compared if they skip; programs named .cpp are compiled by $CXX
or c++ against the library SYMSDE_LIBRARY."""

import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path


def printed(command: list[str], words: str) -> str | None:
    """The first number on the line with these words; None if the program skips. It must succeed otherwise."""
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    if done.returncode == 77:
        return None
    if done.returncode:
        sys.exit(f"{command} ended with {done.returncode}: {done.stdout}{done.stderr}")
    return next(re.search(r"-?\d+\.\d+", line)[0] for line in done.stdout.splitlines() if words in line)


def main() -> int:
    """Compare all; the exit code is 0 if they agree."""
    root, words, *programs = sys.argv[1:]
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        for program in programs:
            command = [sys.executable, program] if program.endswith(".py") else [program]
            if program.endswith(".cpp"):
                command, library = [f"{folder}/{Path(program).stem}"], Path(os.environ["SYMSDE_LIBRARY"])
                options = ["-std=c++17", f"-I{root}/include", program, str(library), f"-Wl,-rpath,{library.parent}"]
                subprocess.run([os.environ.get("CXX", "c++"), *options, "-o", *command], check=True)
            found[program] = printed(command, words)
    print("\n".join(f"{number or 'skipped'} {words}: {program}" for program, number in found.items()))
    numbers = [number for number in found.values() if number]
    return int(len(numbers) < 2 or len(set(numbers)) > 1)


if __name__ == "__main__":
    sys.exit(main())
