# SPDX-License-Identifier: BSD-3-Clause
"""check_versions.py ROOT LIBRARY: the version number, and all that must agree with it.

src/base/version.f90 states it. fpm.toml and CITATION.cff repeat it. The name by which programs look for the library
changes whenever interfaces may: with the minor version before 1.0, with the major version from then on."""

import re
import subprocess
import sys
from pathlib import Path

PATTERNS = {
    "src/base/version.f90": r"library_version = '([^']+)'",
    "fpm.toml": r'^version = "([^"]+)"',
    "CITATION.cff": r"^version: (\S+)",
}


def main() -> int:
    """Compare all places; print the differences."""
    root, library = Path(sys.argv[1]), Path(sys.argv[2])
    found = {}
    for name, pattern in PATTERNS.items():
        match = re.search(pattern, (root / name).read_text(encoding="utf-8"), re.M)
        found[name] = match[1] if match else "nothing"
    version = found["src/base/version.f90"]
    wrong = [f"{name} has {value}, src/base/version.f90 {version}" for name, value in found.items() if value != version]
    parts = version.split(".")
    wanted = f"libsymsde.so.{'.'.join(parts[:2]) if parts[0] == '0' else parts[0]}"
    dynamic = subprocess.run(["readelf", "-d", library], check=True, capture_output=True, text=True).stdout
    name = re.search(r"SONAME.*\[(.+)\]", dynamic)
    if name is None or name[1] != wanted:
        wrong.append(f"programs look for {name[1] if name else 'no name'}, not {wanted}")
    if library.name != f"libsymsde.so.{version}":
        wrong.append(f"the library is {library.name}, not libsymsde.so.{version}")
    print(*wrong or [f"{version} everywhere, {wanted}"], sep="\n")
    return len(wrong)


if __name__ == "__main__":
    sys.exit(main())
