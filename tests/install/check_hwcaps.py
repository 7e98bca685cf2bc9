# SPDX-License-Identifier: BSD-3-Clause
"""check_hwcaps.py ROOT WORK: an installed tree with variants, and a C program that glibc gives the right one of them.

The loader takes the variant of the processor, and a lower one, or the library itself, where it may not; the variants
compute the same bits of nine scenes. Exit 77 (skipped) where processor or glibc know of no such folders.
"""

import re
import shutil
import subprocess
import sys
from pathlib import Path

LOADER = "/lib64/ld-linux-x86-64.so.2"
LEVELS = ("x86-64-v4", "x86-64-v3")


def main() -> int:
    """Build with variants, install, link a program, ask the loader."""
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
    # all that the processor knows, then without the highest, and so on
    for first in range(len(mine) + 1):
        wanted = [*mine, ""][first]
        command = [LOADER, "--glibc-hwcaps-mask", ":".join(mine[first:]) or "none"]
        found = re.search(r"libsymsde\S* => (\S+)", ask(*command, "--list", program))[1]
        folder = str(Path(found).parent.relative_to(prefix))
        if folder != (f"lib/glibc-hwcaps/{wanted}" if wanted else "lib"):
            wrong.append(f"allowed {mine[first:] or 'no variant'}, the loader takes {folder}")
        said[wanted] = ask(*command, program)
        print(wanted or "base", folder)
    rounded = said.pop("")  # the library itself has no fused multiply-add
    if len(set(said.values())) != 1 or rounded in said.values():
        wrong.append(f"the variants compute other bits, or those of the library itself, {rounded}: {said}")
    print(*wrong or ["every variant is taken as it should be"], sep="\n")
    return len(wrong)


def ask(*command: object) -> str:
    """What a command prints; it must succeed."""
    done = subprocess.run([str(word) for word in command], check=False, capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"{command} failed:\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
    return done.stdout


if __name__ == "__main__":
    sys.exit(main())
