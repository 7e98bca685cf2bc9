# SPDX-License-Identifier: BSD-3-Clause
"""Lines of the library and of the Python package that no suite runs.

measure_coverage.py BUILD [--kept]

BUILD holds a build with the flags `coverage`. All suites but the long ones run there; the output lists lines that no
suite reached, by file, and shares by folder. The exit code is not 0 if a suite fails, or if under 97 % of the Fortran
or of the Python lines are reached. --kept shows the counts of the last run."""

import json
import os
import re
import subprocess
import sys
from collections import defaultdict
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
LABELS = "unit|verification|capi|python"
LONG = "^(test_order|test_beyond_one|check_funit)$"
WANTED = 97.0  # per cent
# Lines that gcov counts although nothing runs there: ends of procedures (clean-up after an early return), declarations
# and continuations.
SILENT = re.compile(r"\s*(end (subroutine|function|associate|block|do|if|select|module)|contains\b|&)", re.IGNORECASE)

Lines = dict[Path, dict[int, int]]  # runs of each line, for each source


def run_suites(build: Path, folder: Path) -> bool:
    """Run the suites, with every Python process under coverage.py; returns whether all passed."""
    for counts in [*build.rglob("*.gcda"), *folder.glob("data*")]:
        counts.unlink()
    folder.mkdir(exist_ok=True)
    (folder / "sitecustomize.py").write_text("import coverage\n\ncoverage.process_startup()\n")
    settings = folder / "settings"
    settings.write_text(f"[run]\nparallel = true\nsource = {ROOT / 'python'}\ndata_file = {folder / 'data'}\n")
    environment = os.environ | {"PYTHONPATH": str(folder), "COVERAGE_PROCESS_START": str(settings)}
    command = ["ctest", "--test-dir", build, "-L", LABELS, "-E", LONG, "-j2", "--output-on-failure"]
    return subprocess.run(command, check=False, env=environment).returncode == 0


def count_fortran(build: Path) -> Lines:
    """How often each line of each source of the library ran."""

    def read(notes: Path) -> list[dict]:
        command = ["gcov", "--json-format", "--stdout", str(notes)]
        found = subprocess.run(command, check=True, capture_output=True, text=True, cwd=build).stdout
        return json.loads(found)["files"]

    sources = {path.relative_to(ROOT / "src"): path for path in (ROOT / "src").rglob("*.*")}
    lines: Lines = {}
    with ThreadPoolExecutor() as pool:
        for part in (part for parts in pool.map(read, sorted((build / "src").rglob("*.gcno"))) for part in parts):
            source = source_of(part["file"], sources)
            counts = lines.setdefault(source, defaultdict(int))
            for line in part["lines"]:
                counts[line["line_number"]] += line["count"]
    return {source: spoken_for(source, counts) for source, counts in lines.items()}


def source_of(name: str, sources: dict[Path, Path]) -> Path:
    """The source for a name given by gcov, which may be that of its preprocessed copy."""
    path = Path(name.removesuffix("-pp.f90")) if name.endswith("-pp.f90") else Path(name)
    return next((full for short, full in sources.items() if path.parts[-len(short.parts) :] == short.parts), path)


def spoken_for(source: Path, counts: dict[int, int]) -> dict[int, int]:
    """The counts of lines that execute something."""
    text = source.read_text().splitlines()
    return {number: count for number, count in counts.items() if not SILENT.match(text[number - 1])}


def count_python(folder: Path) -> Lines:
    """For the Python package, whether each line ran: 1 or 0."""
    import coverage

    measured = coverage.Coverage(data_file=str(folder / "data"), config_file=False)
    measured.combine([str(folder)], keep=True)
    lines: Lines = {}
    for path in sorted((ROOT / "python" / "symsde").rglob("*.py")):
        _, every, _, missing, _ = measured.analysis2(str(path))
        lines[path] = {number: int(number not in missing) for number in every}
    return lines


def ranges(numbers: list[int]) -> str:
    """3, 4, 5, 9 as 3-5, 9."""
    parts: list[list[int]] = []
    for number in numbers:
        if parts and number == parts[-1][1] + 1:
            parts[-1][1] = number
        else:
            parts.append([number, number])
    return ", ".join(f"{a}-{b}" if b > a else str(a) for a, b in parts)


def rows(lines: Lines) -> Iterator[str]:
    """For each source the lines that never ran, then the share of each folder."""
    folders: dict[str, list[int]] = defaultdict(list)
    for source, counts in sorted(lines.items()):
        folders[str(source.parent.relative_to(ROOT))] += counts.values()
        if missed := sorted(number for number, count in counts.items() if count == 0):
            yield f"{source.relative_to(ROOT)}: {ranges(missed)}"
    for folder, counts in folders.items():
        yield f"{share(counts):6.1f} %  of {len(counts):5d} lines  {folder}"


def share(counts: list[int]) -> float:
    """Per cent that ran."""
    return 100 * sum(count > 0 for count in counts) / max(len(counts), 1)


def main() -> int:
    """Run, and print the table."""
    build = Path(sys.argv[1]).resolve()
    folder = build / "python-coverage"
    good = "--kept" in sys.argv or run_suites(build, folder)
    for name, lines in [("Fortran", count_fortran(build)), ("Python", count_python(folder))]:
        print(*rows(lines), sep="\n")
        counts = [count for of_file in lines.values() for count in of_file.values()]
        print(f"{share(counts):6.1f} %  of {len(counts):5d} lines  {name}\n")
        if share(counts) < WANTED:
            print(f"less than {WANTED:.0f} % of the {name} lines ran")
            good = False
    return int(not good)


if __name__ == "__main__":
    sys.exit(main())
