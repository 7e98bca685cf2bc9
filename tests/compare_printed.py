# SPDX-License-Identifier: BSD-3-Clause
"""One example in several languages prints the same number: the first of the line that holds the words.

compare_printed.py ROOT WORDS PROGRAM...

A program that ends in .py is run by this Python, and left out where it is skipped; one that ends in .cpp is compiled by
c++, or $CXX, with the library of SYMSDE_LIBRARY.
"""

import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path


def printed(command: list[str], words: str) -> str | None:
    """The first number of that line; None where the program is skipped. It must end well."""
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    if done.returncode == 77:
        return None
    if done.returncode:
        sys.exit(f"{command} ended with {done.returncode}: {done.stdout}{done.stderr}")
    return next(re.search(r"-?\d+\.\d+", line)[0] for line in done.stdout.splitlines() if words in line)


def main() -> int:
    """0 where all agree."""
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
