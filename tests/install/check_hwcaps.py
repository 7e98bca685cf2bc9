# SPDX-License-Identifier: BSD-3-Clause
"""check_hwcaps.py ROOT WORK: the loader of glibc gives a C program the right variant of an installed library.

The loader takes the variant of the processor's level, or a lower one, or the plain library, if higher levels are
masked; all variants compute the same bits of nine scenes. Exit 77 (skipped) where processor or glibc has no such
levels."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

LOADER = "/lib64/ld-linux-x86-64.so.2"
LEVELS = ("x86-64-v4", "x86-64-v3")


def main() -> int:
    """Build with variants, install, link a program, and let the loader choose."""
    root, work = Path(sys.argv[1]), Path(sys.argv[2])
    known = ask(LOADER, "--help") if Path(LOADER).exists() else ""
    mine = [level for level in LEVELS if re.search(rf"{level} \(supported", known)]
    if not mine:
        print("skipped: this processor is below x86-64-v3, or the loader knows no folders glibc-hwcaps")
        return 77
    build, prefix, program = work / "build", work / "prefix", work / "digest"
    shutil.rmtree(prefix, ignore_errors=True)
    ask("cmake", "-S", root, "-B", build, "-G", "Ninja", "-DSYMSDE_VARIANTS=ON", "-DSYMSDE_FLAGS=release",
        "-DSYMSDE_BUILD_TESTING=OFF", "-DCMAKE_INSTALL_LIBDIR=lib")  # fmt: skip
    ask("cmake", "--build", build)
    ask("cmake", "--install", build, "--prefix", prefix)
    ask("cc", root / "tests/install/digest.c", f"-I{prefix}/include", f"-L{prefix}/lib", "-lsymsde",
        f"-Wl,-rpath,{prefix}/lib", "-o", program)  # fmt: skip
    wrong, said = [], {}
    # all levels of the processor, then without the highest, and so on
    for first in range(len(mine) + 1):
        wanted = [*mine, ""][first]
        command = [LOADER, "--glibc-hwcaps-mask", ":".join(mine[first:]) or "none"]
        found = re.search(r"libsymsde\S* => (\S+)", ask(*command, "--list", program))[1]
        folder = str(Path(found).parent.relative_to(prefix))
        if folder != (f"lib/glibc-hwcaps/{wanted}" if wanted else "lib"):
            wrong.append(f"allowed {mine[first:] or 'no variant'}, the loader takes {folder}")
        said[wanted] = ask(*command, program)
        print(wanted or "base", folder)
    rounded = said.pop("")  # the plain library has no fused multiply-add
    if len(set(said.values())) != 1 or rounded in said.values():
        wrong.append(f"the variants compute other bits, or those of the library itself, {rounded}: {said}")
    print(*wrong or ["every variant is taken as it should be"], sep="\n")
    return len(wrong)


def ask(*command: object) -> str:
    """Output of a command, which must succeed."""
    done = subprocess.run([str(word) for word in command], check=False, capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"{command} failed:\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
    return done.stdout


if __name__ == "__main__":
    sys.exit(main())
