# SPDX-License-Identifier: BSD-3-Clause
"""One example in several languages prints the same number: that at the beginning of the line that holds the words.

compare_printed.py WORDS PROGRAM...     a program that ends in .py is run by this Python
"""

import subprocess
import sys


def printed(program: str, words: str) -> str:
    """The first word of that line; the program must end well."""
    command = [sys.executable, program] if program.endswith(".py") else [program]
    text = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    return next(line.split()[0] for line in text.splitlines() if words in line)


def main() -> int:
    """0 where all agree."""
    words, *programs = sys.argv[1:]
    found = {program: printed(program, words) for program in programs}
    print("\n".join(f"{number} {words}: {program}" for program, number in found.items()))
    return int(len(programs) < 2 or len(set(found.values())) > 1)


if __name__ == "__main__":
    sys.exit(main())
