# SPDX-License-Identifier: BSD-3-Clause
"""The machine, the compiler and the moment."""

import datetime
import os
import platform
import re
import subprocess
from pathlib import Path

from .tools import Setting


def describe(setting: Setting) -> dict:
    """Name processor, compiler, flags, date and load."""
    info = Path("/proc/cpuinfo").read_text()
    cpu = re.search(r"model name\s*:\s*(.*)", info)
    flags_seen = re.search(r"flags\s*:\s*(.*)", info)
    cache = (setting.build / "CMakeCache.txt").read_text()
    compiler = re.search(r"CMAKE_Fortran_COMPILER:\w+=(.*)", cache)
    version = subprocess.run(
        [compiler[1] if compiler else "gfortran", "--version"],
        capture_output=True,
        text=True,
        check=True,
    ).stdout.splitlines()[0]
    level = "AVX-512" if flags_seen and "avx512f" in flags_seen[1] else "no AVX-512"
    return {
        "cpu": f"{cpu[1] if cpu else platform.processor()}, {os.cpu_count()} cores, {level}",
        "compiler": version,
        "flags": f"`{flags_of(setting.build)}`",
        "date": datetime.date.today().isoformat(),
        "load": f"{os.getloadavg()[0]:.2f} when it began",
    }


def flags_of(build: Path) -> str:
    """Compile flags of a build."""
    ninja = build / "build.ninja"
    flags = re.search(r"\n  FLAGS = (.*-O.*)", ninja.read_text()) if ninja.exists() else None
    return " ".join(f for f in flags[1].split() if f[:2] not in ("-J", "-I")) if flags else "unknown"
