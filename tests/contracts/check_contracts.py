# SPDX-License-Identifier: BSD-3-Clause
"""check_contracts.py EXECUTED VIOLATE OBJECTS: contracts end a broken program where they are executed, and only there.

EXECUTED is 1 where the build executes contracts (presets dev and sanitize), else 0; VIOLATE is the program that breaks
the contract of one area of src (violate.f90); OBJECTS is a list of the objects of the library, one a line.

Where contracts are executed, every area must end the program with the sentence that was broken. Elsewhere the same
program must run to its end, and no object but the contracts' own may name a procedure of a contract."""

import re
import subprocess
import sys
from pathlib import Path

BROKEN = {
    "noise": "paths of padding repeat that of the last real lane",
    "model": "weights are finite",
    "scheme": "nodes and weights are finite",
    "solve": "statuses of lanes are codes that a path can have",
    "step": "positions are finite in lanes without a status",
    "ensemble": "real paths are 1 to nlane",
    "options": "options were checked where a user gave them",
    "diagnose": "increments and functionals are finite",
}
OF = {"options": "ensemble"}  # argument that names no area -> the area whose contract is broken
# Objects of the contracts themselves, by file name; the build of the wheel copies contracts.f90, hence no folder here.
OWN = re.compile(r"/contracts?\.f90\.o$")
CALL = re.compile(rb"__symsde_(?:base_contracts|[a-z]+_contract)_MOD_\w+")


def run(violate, area):
    """Exit code and output of VIOLATE when it breaks the contract of this area."""
    done = subprocess.run([violate, area], capture_output=True, text=True, check=False)
    return done.returncode, done.stdout + done.stderr


def findings(executed, violate, objects):
    """Every finding as a line of text."""
    if run(violate, "executed")[1].strip() != ("T" if executed else "F"):
        yield "the constant contracts_are_executed is not what the build says"
    for area, sentence in {"none": None, **BROKEN}.items():
        code, text = run(violate, area)
        if executed and sentence:
            of = OF.get(area, area)
            if code == 0 or not re.search(rf"contract of {of}, [\w ]+ broken: {sentence}", text):
                yield f"{area}: '{sentence}' was broken and not noticed (exit code {code}: {text.strip()})"
        elif code or "came to its end" not in text:
            yield f"{area}: the program did not come to its end (exit code {code}: {text.strip()})"
    calling = [name for name in objects if not OWN.search(name) and CALL.search(Path(name).read_bytes())]
    if executed and {Path(name).parts[-2] for name in calling}.isdisjoint(BROKEN):
        yield "no object calls a contract"
    if not executed:
        yield from (f"{name} names {CALL.search(Path(name).read_bytes())[0].decode()}" for name in calling)


def main():
    """Print the findings; exit 1 where there are some."""
    executed, violate, objects = sys.argv[1] == "1", sys.argv[2], Path(sys.argv[3]).read_text().split()
    found = list(findings(executed, violate, objects))
    print("\n".join(found) if found else "nothing to report")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
