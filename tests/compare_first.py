# SPDX-License-Identifier: BSD-3-Clause
"""The programs of the first ten minutes print the same numbers in every language.

compare_first.py ROOT PROGRAM... [--cxx COMPILER ARGUMENT...] runs examples/first in Python and on the command line, the
programs, and the C++ example if a compiler is given."""

import csv
import importlib.util
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

NUMBER = re.compile(r"-?\d*\.\d+")
EXPECTED = 6  #: E q, its standard error, t, the exact value, q and p of path 0


def output(*command):
    """Output of a program, which must succeed."""
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"{command} ended with {done.returncode}: {done.stdout}{done.stderr}")
    return done.stdout


def numbers(text):
    """The numbers in the output as text, without leading zeros; the numbers of the last line are left out."""
    return [f"{float(number):.8f}" for number in NUMBER.findall(text.replace("1e-12", ""))]


def on_the_command_line(scene, folder):
    """The same numbers, read from the files of a run; the numbers of path 0 need netCDF4."""
    output(sys.executable, "-m", "symsde", "run", str(scene), "--out", str(folder), "--quiet")
    with (folder / "moments.csv").open(encoding="utf-8") as file:
        last = list(csv.DictReader(line for line in file if not line.startswith("#")))[-1]
    found = [float(last["mean q_1"]), float(last["se_mean q_1"]), float(last["t"])]
    ends = []
    if importlib.util.find_spec("netCDF4"):
        import netCDF4

        with netCDF4.Dataset(folder / "run.nc") as data:
            ends = [float(data[name][-1].ravel()[0]) for name in ("q", "p")]
    return [f"{x:.8f}" for x in found], [f"{x:.8f}" for x in ends]


def main():
    """Compare all; the exit code is 0 if they agree."""
    root, *rest = sys.argv[1:]
    programs, _, compiler = (" ".join(rest)).partition(" --cxx ")
    first = Path(root) / "examples" / "first"
    expected = numbers(output(sys.executable, str(first / "first.py")))
    if len(expected) != EXPECTED:
        raise SystemExit(f"first.py prints {expected}, not {EXPECTED} numbers")
    with tempfile.TemporaryDirectory() as folder:
        commands = programs.split()
        if compiler:
            commands.append(f"{folder}/first_cpp")
            output(*compiler.split(), "-o", commands[-1])
        wrong = []
        for command in commands:
            text = output(command)
            if numbers(text) != expected or "kept to 1e-12" not in text:
                wrong.append(f"{os.path.basename(command)} prints\n{text}where Python has {expected}")
        moments, ends = on_the_command_line(first / "first.toml", Path(folder) / "run")
        if moments != expected[:3] or ends not in ([], expected[4:]):
            wrong.append(f"the command line has {moments} {ends} where Python has {expected}")
    print("\n".join(wrong) or f"{len(commands)} programs and the command line agree with Python: {expected}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
