# SPDX-License-Identifier: BSD-3-Clause
"""check_flang.py ROOT WORK: flang-19 compiles the library, and the C tests pass with it.

Exit 77 (skipped) where Debian's flang-19 or its OpenMP (libomp-19-dev) is not installed.
"""

import shutil
import subprocess
import sys
from pathlib import Path

FLANG = "flang-new-19"


def main() -> int:
    """Configure, build, run."""
    root, work = Path(sys.argv[1]), Path(sys.argv[2])
    shutil.rmtree(work, ignore_errors=True)
    work.mkdir(parents=True)
    if shutil.which(FLANG) is None or not links_openmp(work):
        print("skipped: no flang-19 with OpenMP; apt-get install flang-19 libomp-19-dev")
        return 77
    run("cmake", "-S", root, "-B", work / "build", "-G", "Ninja", f"-DCMAKE_Fortran_COMPILER={FLANG}",
        "-DSYMSDE_PYTHON=OFF", "-DSYMSDE_BUILD_EXAMPLES=OFF")  # fmt: skip
    run("cmake", "--build", work / "build", "--target", "symsde", "capi_tests")
    return run("ctest", "--test-dir", work / "build", "-R", "^test_capi", "--no-tests=error", "--output-on-failure")


def links_openmp(work: Path) -> bool:
    """Whether a program with OpenMP can be linked."""
    program = work / "threads.f90"
    program.write_text("use omp_lib\nprint *, omp_get_max_threads()\nend\n")
    command = [FLANG, "-fopenmp", str(program), "-o", str(work / "threads")]
    return subprocess.run(command, check=False, capture_output=True).returncode == 0


def run(*command: object) -> int:
    """Run a command, which must succeed."""
    return subprocess.run([str(word) for word in command], check=True).returncode


if __name__ == "__main__":
    sys.exit(main())
