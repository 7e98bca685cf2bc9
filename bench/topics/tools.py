# SPDX-License-Identifier: BSD-3-Clause
"""What the sections share: settings, runs of the benchmark programs, and tables."""

import os
import statistics
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

ABSENT = "absent, skipped"


@dataclass(frozen=True)
class Setting:
    """What is measured, and how often."""

    build: Path  #: the CMake build directory
    avx2_build: Path | None  #: a second one for x86-64-v3
    repeats: int
    quick: bool
    rows: str = ""  #: a regular expression for the rows of the section loops

    @property
    def bench(self) -> Path:
        """Where the benchmark programs are."""
        return self.build / "bench"


def lines_of(program: Path, *arguments: object) -> list[list[str]]:
    """The words of each line a program prints."""
    command = [str(program), *(str(a) for a in arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode not in (0, 1):
        sys.exit(f"{' '.join(command)} ended with status {done.returncode}\n{done.stderr}")
    return [line.split() for line in done.stdout.splitlines() if line.strip()]


def lines_of_python(script: str, build: Path, *arguments: object) -> list[list[str]]:
    """The words of each line that a script of this folder prints, run with the library of a build."""
    here = Path(__file__).resolve().parents[1]
    paths = os.pathsep.join(p for p in (str(here.parent / "python"), os.environ.get("PYTHONPATH")) if p)
    done = subprocess.run(
        [sys.executable, str(here / script), *(str(a) for a in arguments)],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"SYMSDE_LIBRARY": str((build / "libsymsde.so").resolve()), "PYTHONPATH": paths},
    )
    if done.returncode != 0:
        sys.exit(f"{script} ended with status {done.returncode}\n{done.stderr}")
    return [line.split() for line in done.stdout.splitlines() if line.strip()]


def summary(values: list[float]) -> list[float]:
    """Median, least and largest."""
    return [statistics.median(values), min(values), max(values)]


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
    """Two cells: a target from above and whether it is met."""
    return _verdict(f"<= {target:g}", value <= target) if None not in (value, target) else ["", ""]


def at_least(value: float | None, target: float | None) -> list[str]:
    """Two cells: a target from below and whether it is met."""
    return _verdict(f">= {target:g}", value >= target) if None not in (value, target) else ["", ""]


def _verdict(target: str, met: bool) -> list[str]:
    return [target, "met" if met else "missed"]
