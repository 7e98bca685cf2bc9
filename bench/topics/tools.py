# SPDX-License-Identifier: BSD-3-Clause
"""What the sections share: settings, the functions of the benchmark programs, and tables."""

import ctypes
import json
import shlex
import statistics
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

ABSENT = "absent, skipped"


@dataclass(frozen=True)
class Setting:
    """The build to measure, and how often."""

    build: Path  #: the CMake build directory
    repeats: int
    quick: bool
    rows: str = ""  #: a regular expression for the rows of the section loops
    python: str = sys.executable  #: the interpreter that has diffrax, torchsde and OpenMM

    @property
    def programs(self) -> ctypes.CDLL:
        """The benchmark programs as a library of functions, built by bench/CMakeLists.txt."""
        file = self.build / "bench" / "libbench_programs.so"
        if not file.exists():
            sys.exit(f"there is no {file}: configure with -DSYMSDE_BUILD_BENCH=ON")
        return ctypes.CDLL(str(file.resolve()))


def asked(setting: Setting, program: str, *arguments: str) -> dict | None:
    """What a program of bench/peers writes into a file, its last argument, in a process of its own; None if its package
    is not installed.
    """
    with tempfile.TemporaryDirectory() as folder:
        answer = Path(folder) / "answer.json"
        peer = Path(__file__).resolve().parents[1] / "peers" / program
        command = [*shlex.split(setting.python), str(peer), *arguments, str(answer)]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        if done.returncode:
            print(f"{' '.join([program, *arguments])}: skipped ({done.stderr.strip().splitlines()[-1:]})")
            return None
        return json.loads(answer.read_text())


def summary(values: list[float]) -> list[float]:
    """Median, least and largest."""
    return [statistics.median(values), min(values), max(values)]


def ratio(ours: list[float], theirs: list[float]) -> float:
    """The median of the ratios of paired times."""
    return statistics.median(a / b for a, b in zip(ours, theirs, strict=True))


def words(name: str) -> str:
    """A name as it is written in tables."""
    return name.replace("_", " ")


def table(heads: list[str], rows: list[list[str]]) -> str:
    """A markdown table with padded columns."""
    widths = [max(len(row[i]) for row in [heads, *rows]) for i in range(len(heads))]
    body = [heads, ["-" * w for w in widths], *rows]
    padded = [[cell.ljust(w) for cell, w in zip(row, widths, strict=True)] for row in body]
    return "\n".join(f"| {' | '.join(row)} |" for row in padded)


def spread(values: list[float] | None) -> str:
    """Format a median with its least and largest value."""
    return ABSENT if values is None else f"{values[0]:.3g} ({values[1]:.3g} .. {values[2]:.3g})"


def at_most(value: float | None, target: float | None) -> list[str]:
    """Two cells: an upper limit, and whether the value keeps it."""
    return _verdict(f"<= {target:g}", value <= target) if None not in (value, target) else ["", ""]


def at_least(value: float | None, target: float | None) -> list[str]:
    """Two cells: a lower limit, and whether the value keeps it."""
    return _verdict(f">= {target:g}", value >= target) if None not in (value, target) else ["", ""]


def _verdict(target: str, met: bool) -> list[str]:
    return [target, "met" if met else "missed"]
