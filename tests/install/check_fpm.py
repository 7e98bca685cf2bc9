# SPDX-License-Identifier: BSD-3-Clause
"""check_fpm.py ROOT WORK: `fpm build` and `fpm test` of the library, and of another project that has one line for it.

Exit 77 (skipped) where fpm is not installed, beside this Python or on the path: pip install fpm==0.12.0.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

STRANGER = 'name = "stranger"\n[dependencies]\nsymsde = { path = "../symsde" }\n'
SAYS = {"symsde": "all as known, symsde ", "stranger": "Fortran: p^2 + q^2 is kept"}


def main() -> int:
    """Copy all that fpm needs, since fpm writes beside its manifest; build, test, and build a dependent project."""
    root, work = Path(sys.argv[1]), Path(sys.argv[2])
    places = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    fpm = shutil.which("fpm", path=places)
    if fpm is None:
        print("skipped: fpm is not installed; pip install fpm==0.12.0 puts it beside this Python")
        return 77
    library, stranger = work / "symsde", work / "stranger"
    for name in ("src", "include", "tests/install/fpm"):
        shutil.copytree(root / name, library / name, dirs_exist_ok=True)
    shutil.copy(root / "fpm.toml", library)
    (stranger / "app").mkdir(parents=True, exist_ok=True)
    (stranger / "fpm.toml").write_text(STRANGER)
    shutil.copy(root / "tests/install/consumer/consumer.f90", stranger / "app/main.f90")
    wrong = 0
    for folder, verbs in ((library, ("build", "test")), (stranger, ("run",))):
        for verb in verbs:
            said = run(fpm, verb, folder)
        wrong += SAYS[folder.name] not in said
        print(folder.name, "as it should be" if SAYS[folder.name] in said else f"said {said[-2000:]}")
    return wrong


def run(fpm: str, verb: str, folder: Path) -> str:
    """Output of fpm, which must succeed."""
    command = [fpm, verb, "--profile", "release"]
    done = subprocess.run(command, cwd=folder, check=False, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    if done.returncode != 0:
        sys.exit(f"fpm {verb} in {folder.name} failed:\n{done.stdout[-4000:]}")
    return done.stdout


if __name__ == "__main__":
    sys.exit(main())
