# SPDX-License-Identifier: BSD-3-Clause
"""check_wheel.py ROOT WORK: build the wheel, unpack it elsewhere, and load the library that it contains.

Exit 77 (skipped) where the build backend is not installed; nothing is downloaded.
"""

import importlib.util
import os
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

LOAD = "import symsde, sys; print(symsde.__file__, symsde.__version__); sys.exit(symsde.__version__ != sys.argv[1])"


def main():
    """Build, unpack, load; the version is the one that CMakeLists.txt states."""
    root, work = Path(sys.argv[1]), Path(sys.argv[2])
    if importlib.util.find_spec("scikit_build_core") is None:
        print("skipped: scikit-build-core is not installed; ./bootstrap test installs it in .venv")
        return 77
    shutil.rmtree(work / "site", ignore_errors=True)  # the build directory stays: nothing is compiled twice
    for old in work.glob("*.whl"):
        old.unlink()
    pip = [sys.executable, "-m", "pip", "wheel", "--no-deps", "--no-build-isolation", "--no-index", "-q"]
    subprocess.run([*pip, f"--config-settings=build-dir={work}/build", "-w", work, root], check=True)
    (wheel,) = work.glob("*.whl")
    if "-py3-none-" not in wheel.name:
        print(f"{wheel.name} is bound to one version of Python")
        return 1
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(work / "site")
    version = re.search(r"VERSION (\d+\.\d+\.\d+)", (root / "CMakeLists.txt").read_text())[1]
    environment = {**os.environ, "PYTHONPATH": str(work / "site")}
    del environment["SYMSDE_LIBRARY"]  # it must find its own
    return subprocess.run([sys.executable, "-c", LOAD, version], env=environment, cwd=work, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
