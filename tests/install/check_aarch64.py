# SPDX-License-Identifier: BSD-3-Clause
"""check_aarch64.py ROOT WORK: nine scenes have the same bits on aarch64 as on this machine, if products are rounded
before they are added.

gcc 12 fuses other products for aarch64 than for x86-64, so both are built with SYMSDE_FP_CONTRACT=off.

Debian's cross compilers (gfortran-aarch64-linux-gnu) build the library as an archive, qemu-user-static runs a program
that holds it. The scenes are so small that LAPACK is never called: its names are stubs that stop the program.

Exit 77 (skipped) where compilers or emulator are not installed.
"""

import re
import shutil
import subprocess
import sys
from pathlib import Path

ARM = "aarch64-linux-gnu-"
NEEDED = (f"{ARM}gfortran", f"{ARM}gcc", "qemu-aarch64-static")
CROSS = (
    "-DCMAKE_SYSTEM_NAME=Linux", "-DCMAKE_SYSTEM_PROCESSOR=aarch64", f"-DCMAKE_C_COMPILER={ARM}gcc",
    f"-DCMAKE_Fortran_COMPILER={ARM}gfortran"
)  # fmt: skip


def main() -> int:
    """Build twice, run twice, compare."""
    root, work = Path(sys.argv[1]), Path(sys.argv[2])
    missing = [name for name in NEEDED if shutil.which(name) is None]
    if missing:
        print(
            f"skipped: {', '.join(missing)} not installed; apt-get install gfortran-aarch64-linux-gnu qemu-user-static"
        )
        return 77
    here = ask(program(root, work / "here", "gfortran"))
    there = ask(
        "qemu-aarch64-static", "-L", "/usr/aarch64-linux-gnu", program(root, work / "aarch64", f"{ARM}gfortran", *CROSS)
    )
    for ours, theirs in zip(here.splitlines(), there.splitlines(), strict=True):
        print(f"{theirs}: {'the same' if ours == theirs else f'here {ours}'}")
    lines = len(here.splitlines())
    return int(here != there or lines != 9)


def program(root: Path, work: Path, compiler: str, *options: str) -> Path:
    """tests/install/digest.c linked with the library."""
    ask("cmake", "-S", root, "-B", work, "-G", "Ninja", "-DBUILD_SHARED_LIBS=OFF", "-DSYMSDE_BUILD_TESTING=OFF",
        "-DSYMSDE_FLAGS=release", "-DSYMSDE_FP_CONTRACT=off", *options)  # fmt: skip
    ask("cmake", "--build", work)
    archive, names, made = work / "libsymsde.a", work / "lapack.c", work / "digest"
    needed = re.findall(r"^ +U (d\w+_|ilaver_)$", ask("nm", archive), re.M)
    lines = [f"void {name}(void) {{ abort(); }}" for name in sorted(set(needed))]
    names.write_text("\n".join(["#include <stdlib.h>", *lines, ""]))
    main_program = work / "digest.o"
    ask(compiler, "-O1", "-c", root / "tests/install/digest.c", f"-I{root}/include", "-o", main_program)
    ask(compiler, "-fopenmp", main_program, names, archive, "-lm", "-o", made)
    return made


def ask(*command: object) -> str:
    """Output of a command, which must succeed."""
    done = subprocess.run([str(word) for word in command], check=False, capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"{' '.join(map(str, command))} failed:\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
    return done.stdout


if __name__ == "__main__":
    sys.exit(main())
