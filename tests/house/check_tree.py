# SPDX-License-Identifier: BSD-3-Clause
"""The shape of the source tree: layers, names, and statements that the library must not use (sizes: advice.py).

check_tree.py ROOT        one line per finding; exit 1 where there is one
check_tree.py --self-test plants a violation of every rule and requires that each is found
"""

import os
import re
import sys
import tempfile
from pathlib import Path

from bodies import bodies, expanded

LOWER = {"base": set()}
for area in ("noise", "model", "scheme", "solve"):
    LOWER[area] = {"base"}
LOWER["step"] = {"base", "noise", "model", "scheme", "solve"}
LOWER["ensemble"] = LOWER["step"] | {"step"}
LOWER["diagnose"] = LOWER["ensemble"] | {"ensemble"}
LOWER["capi"] = LOWER["diagnose"] | {"diagnose"}

MAX_PROCEDURE, MAX_COLUMNS = 100, 120
SOURCES = ("src/**/*.f90", "src/**/*.inc", "tests/**/*.pf", "tests/**/*.f90", "examples/**/*.f90", "bench/**/*.f90",
           "include/**/*.h", "include/**/*.hpp", "tests/**/*.cpp", "examples/**/*.cpp",
           "tests/**/*.c", "examples/**/*.c", "bench/**/*.c",
           "python/**/*.py", "tests/**/*.py", "examples/**/*.py", "bench/**/*.py")  # fmt: skip

# Forbidden in src: a name for the rule, and a pattern in code without comments and strings. Contracts alone may stop
# the program.
CONTRACTS = "src/base/contracts.f90"
FORBIDDEN = {
    "stops the program": r"(^|[);])\s*(error\s+stop\b|stop\s*($|[\d';,])|stop\s+[\w(])",
    "prints": r"\bprint\b\s*[*'(\"]|\bwrite\s*\(\s*\*",
    "opens a file": r"\b(open|inquire)\s*\(",
    "uses the preprocessor": r"^#",
    "uses a common block": r"^\s*common\s*/",
    "saves a variable": r"^\s*save\b|,\s*save\b",
}
ONLY_IN = {
    "calls LAPACK": (r"\bcall\s+d(ge|gb|po|pb|pt|gt|sy)(trf|trs|con|sv)\b", "src/solve/lapack.f90"),
    "starts threads": (r"^\s*!\$omp\s+parallel|^\s*use\s+omp_lib", "src/ensemble/"),
}
# Areas that must not name schemes of the catalogue; they may know equations of maps.
NAMELESS = {"base", "noise", "model", "solve"}
SCHEME = re.compile(r"['\"](midpoint|symplectic_euler|stormer_verlet|gauss\d|lobatto\d|verlet_|gauss_dkdkd)")
WORDS = "pure|impure|elemental|recursive|module|integer|real|logical|type|class|character"
BEGIN = re.compile(rf"^\s*(?:(?:{WORDS})\b(?:\([^)]*\))?\s+)*(subroutine|function)\s+(\w+)", re.I)
END = re.compile(r"^\s*end\s*(subroutine|function)\b", re.I)


def code_of(line):
    """The line without strings and comment, in lower case; OpenMP directives stay."""
    line = re.sub(r"'[^']*'|\"[^\"]*\"", "''", line)
    if not re.match(r"\s*!\$omp", line, re.I):
        line = line.split("!")[0]
    return line.lower()


def layers(path, text):
    """Findings: modules not named after their path, and imports from higher areas."""
    area = path.parts[1] if len(path.parts) > 2 else None
    if area is None:
        return
    wanted = "_".join(("symsde", *path.parts[1:-1], path.stem))
    for name in re.findall(r"^\s*module\s+(?!procedure\b|subroutine\b|function\b)(\w+)", text, re.I | re.M):
        if name.lower() != wanted:
            yield f"module {name} is not named after its path ({wanted})"
    if area not in LOWER:
        yield f"{area} is not an area of the library"
        return
    used = re.findall(r"^\s*use\b(?:\s*,\s*non_intrinsic)?\s*(?:::)?\s*(symsde(?:_(\w+))?)", text, re.I | re.M)
    for module, rest in used:
        to = rest.split("_")[0].lower()
        if to != area and to not in LOWER[area]:
            yield f"{area} must not use {module}"


def imports(text):
    """Findings: names that a module imports and neither uses nor passes on."""
    code = re.sub(r"&\s*\n\s*", "", "\n".join(map(code_of, text.split("\n"))))
    uses = re.findall(r"^\s*use\b[^\n]*\bonly:\s*(.*)$", code, re.M)
    rest = re.sub(r"^\s*use\b.*$", "", code, flags=re.M)
    for name in (x.split("=>")[0].strip() for use in uses for x in use.split(",")):
        if not re.search(rf"(\b|_){re.escape(name)}\b", rest):  # _ as in 1.0_wp
            yield f"imports {name} and does not use it"


def pointers(lines):
    """Findings: local pointers with an initial value, which are saved and shared by threads; components are not."""
    in_type = False
    for number, line in enumerate(lines, 1):
        if re.match(r"^\s*type\b(?!\s*\()", line):
            in_type = True
        elif re.match(r"^\s*end\s*type\b", line):
            in_type = False
        elif not in_type and re.search(r"::.*=>\s*null\s*\(", line):
            yield f"{number}: gives a local pointer an initial value"


def procedures(lines):
    """Findings: procedures that are longer than allowed."""
    start = []
    in_interface = False
    for number, line in enumerate(lines, 1):
        if re.match(r"^\s*(abstract\s+)?interface\b", line):
            in_interface = True
        elif re.match(r"^\s*end\s*interface\b", line):
            in_interface = False
        if in_interface:
            continue
        if END.match(line) and start:
            first, name = start.pop()
            if number - first + 1 > MAX_PROCEDURE:
                yield f"{first}: {name} has {number - first + 1} lines, allowed are {MAX_PROCEDURE}"
        elif found := BEGIN.match(line):
            start.append((number, found[2]))


def library(path, text):
    """Findings by rules for src alone."""
    lines = [code_of(line) for line in text.split("\n")]
    yield from layers(path, text)
    yield from pointers(lines)
    for number, line in enumerate(lines, 1):
        for what, pattern in FORBIDDEN.items():
            if re.search(pattern, line) and (what, path.as_posix()) != ("stops the program", CONTRACTS):
                yield f"{number}: the library {what}"
        for what, (pattern, place) in ONLY_IN.items():
            if re.search(pattern, line) and not path.as_posix().startswith(place):
                yield f"{number}: {what}, which only {place} may"
    for number, line in enumerate(text.split("\n"), 1) if path.parts[1] in NAMELESS else ():
        if SCHEME.search(line.split("!")[0]):
            yield f"{number}: {path.parts[1]} names a scheme: say its equation (base/maps), or its data"


def listed(root, path):
    """Findings: sources and suites missing from the lists of CMake, which would never be compiled or run."""
    if path.suffix == ".inc":
        body = Path(os.path.normpath(root / path))
        if not any(body in bodies(file) for file in (root / "src").rglob("*.f90")):
            yield "is a body that no module includes"
        return
    name = {".pf": path.stem, ".py": path.name}.get(path.suffix, path.name)
    if path.parts[0] == "src" or path.suffix == ".pf" or path.match("tests/python/test_*.py"):
        cmake = root / path.parent / "CMakeLists.txt"
        if not (cmake.exists() and re.search(rf"\b{re.escape(name)}\b", cmake.read_text())):
            yield f"is not listed in {path.parent.as_posix()}/CMakeLists.txt"


def every_file(root, path, text):
    """Findings by rules for every source."""
    lines = text.split("\n")
    if "SPDX-License-Identifier: BSD-3-Clause" not in lines[0]:
        yield "1: does not begin with its licence (SPDX-License-Identifier: BSD-3-Clause)"
    for number, line in enumerate(lines, 1):
        if len(line) > MAX_COLUMNS and path.suffix in {".f90", ".inc"}:
            yield f"{number}: has {len(line)} columns, allowed are {MAX_COLUMNS}"
        if re.search(r"\b(TO" + r"DO|FIX" + r"ME)\b", line):
            yield f"{number}: holds a note of unfinished work"
        if re.search(r"[\"'\s(](/home|/root|/tm" + r"p|/work)/", line):
            yield f"{number}: names a path of some machine"
    if path.suffix in {".f90", ".pf", ".inc"}:
        yield from procedures([code_of(line) for line in lines])


def findings(root):
    """Every finding in the tree, as a line of text."""
    for pattern in SOURCES:
        for file in sorted(root.glob(pattern)):
            path = file.relative_to(root)
            text = file.read_text(encoding="utf-8")
            rules = [every_file(root, path, text), listed(root, path)]
            if path.parts[0] == "src":
                rules.append(library(path, text))
            if path.parts[0] == "src" and len(path.parts) > 2 and path.suffix == ".f90":
                rules.append(imports(expanded(file)))
            for rule in rules:
                for finding in rule:
                    yield f"{path.as_posix()}:{'' if finding[0].isdigit() else ' '}{finding}"


SPDX = "! SPDX-License-Identifier: BSD-3-Clause\n"
USE = "   use symsde_base_kinds, only: wp\n"
GOOD = SPDX + f"module symsde_noise_a\n{USE}   real(wp) :: a\nend module symsde_noise_a\n"
HARMLESS = GOOD + "if (stop) return\nstop = .true.\nlogical :: stop\ntext = 'stop'\n! stop\n"
PLANTED = {
    "module symsde_noise_b is not named": GOOD.replace("noise_a", "noise_b"),
    "noise must not use symsde_step_x": GOOD.replace("base_kinds", "step_x"),
    "noise must not use symsde_model_x": GOOD.replace("base_kinds", "model_x"),
    "imports i8": GOOD.replace("only: wp", "only: wp, &\n i8"),
    "stops the program": GOOD + "error stop 'no'\n",
    "5: the library stops": GOOD.replace("end module", "if (x) stop\nend module"),
    "prints": GOOD + "print *, 1\n",
    "opens a file": GOOD + "open (newunit=unit, file='x')\n",
    "uses the preprocessor": GOOD + "#ifdef X\n",
    "uses a common block": GOOD + "common /x/ y\n",
    "saves a variable": GOOD + "real, save :: x\n",
    "calls LAPACK": GOOD + "call dgetrf(n)\n",
    "starts threads": GOOD + "!$omp parallel do\n",
    "names a scheme": GOOD + "known = name == 'stormer_verlet'\n",
    "local pointer": GOOD + "real, pointer :: x => null()\n",
    "does not begin with its licence": GOOD.removeprefix(SPDX),
    "has 121 columns": GOOD + "!" + "x" * 120 + "\n",
    "unfinished work": GOOD + "! TO" + "DO\n",
    "names a path": GOOD + "! in /tm" + "p/x\n",
    "long has 101 lines": GOOD + "pure subroutine long(x)\n" + "\n" * 99 + "end subroutine long\n",
}


def contracts_alone(root):
    """A contract may stop the program, and must obey all other rules."""
    file = root / CONTRACTS
    file.parent.mkdir()
    (file.parent / "CMakeLists.txt").write_text(file.name)
    good = GOOD.replace("noise_a", "base_contracts").replace(USE, "")
    file.write_text(good + "error stop 'broken'\n")
    if found := list(findings(root)):
        yield f"a contract that stops the program gave {found}"
    file.write_text(good + "print *, 1\n")
    if not any("prints" in line for line in findings(root)):
        yield "a contract that prints was not found"
    file.unlink()


def self_test():
    """A sound file gives no finding, and every planted violation is found by its own rule."""
    failures = []
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        area = root / "src" / "noise"
        area.mkdir(parents=True)
        (area / "CMakeLists.txt").write_text("a.f90\n")
        for wanted, text in {"": HARMLESS, **PLANTED}.items():
            (area / "a.f90").write_text(text)
            found = list(findings(root))
            if (found != []) if wanted == "" else not any(wanted in line for line in found):
                failures.append(f"planted '{wanted}', found {found}")
        (area / "a.f90").write_text(GOOD)
        (area / "CMakeLists.txt").write_text("b.f90\n")
        if not any("is not listed" in line for line in findings(root)):
            failures.append("a source that is not listed was not found")
        (area / "CMakeLists.txt").write_text("a.f90\n")
        failures += contracts_alone(root)
        (area / "b.inc").write_text(SPDX)
        if not any("that no module includes" in line for line in findings(root)):
            failures.append("a body that is not included was not found")
        (area / "a.f90").write_text(GOOD + "   include 'b.inc'\n")
        if found := list(findings(root)):
            failures.append(f"a body that is included gave {found}")
    return failures


def main():
    """Run the check or its self-test."""
    found = self_test() if sys.argv[1] == "--self-test" else list(findings(Path(sys.argv[1])))
    print("\n".join(found) if found else "nothing to report")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
