# SPDX-License-Identifier: BSD-3-Clause
"""check_readme.py ROOT WORK [SITE]: the code in README runs with the packages that its line of pip installs, and no
others.

The clean environment links the packages of this Python that the line names, and their requirements; nothing is
downloaded. The package is that of SITE, or of the tree. Without the line's extras the formulas must fail, which shows
that the environment is clean. Every extra that a page names exists."""

import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from importlib import metadata
from pathlib import Path

PIP = re.compile(r"pip install [^\n]*?(?:\.|symsde)\[([\w,]+)\]")


def main() -> int:
    """Build the environments, run the page in both."""
    root, work, *site = map(Path, sys.argv[1:])
    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    page = (root / "README.md").read_text(encoding="utf-8")
    wrong = []
    for path in (root / "README.md", *(root / "docs").glob("*.md")):
        for names in PIP.findall(path.read_text(encoding="utf-8")):
            wrong += [f"{path.name}: there is no extra {x}" for x in names.split(",") if x not in extras]
    wanted = [name for extra in PIP.search(page)[1].split(",") for name in extras[extra]]
    for folder, needed in (("with", [*project["dependencies"], *wanted]), ("without", project["dependencies"])):
        try:
            links(work / folder, needed)
        except ModuleNotFoundError as error:  # package metadata may be missing, too
            print(f"skipped: {error.name} is not installed; ./bootstrap test installs it in .venv")
            return 77
    code = re.findall(r"^```python\n(.*?)^```", page, re.M | re.S)
    words = [" ".join(text.split()) for text in re.findall(r"`([^`]+)`", page.replace("```", ""))]
    formulas = "import symsde as ss\n" + "\n".join(text for text in words if text.startswith("ss.") and "(" in text)
    places = site or [root / "python"]
    for program in (*code, formulas):
        wrong += [f"README's code fails:\n{said}" for said in run(work / "with", places, root, "-c", program)]
    for text in words:
        if text.startswith("symsde run"):
            shutil.rmtree(work / "run", ignore_errors=True)
            command = ["-m", *shlex.split(text), "--out", str(work / "run")]
            wrong += [f"{text} fails:\n{said}" for said in run(work / "with", places, root, *command)]
    if len(code) != 1 or "model_from_sympy" not in formulas:
        wrong.append("README shows no block of Python, or no formula: this test looks for them")
    if not any("sympy" in said for said in run(work / "without", places, root, "-c", formulas)):
        wrong.append("README's formula runs without sympy: the environment is not clean")
    print(*wrong or [f"README's code runs with {', '.join(wanted)}"], sep="\n")
    return len(wrong)


def links(folder: Path, needed: list[str]) -> None:
    """Link the required packages, and those that they require on this machine, into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    from packaging.requirements import Requirement

    found, left = set(), list(needed)
    while left:
        requirement = Requirement(left.pop())
        if requirement.name.lower() in found or (requirement.marker and not requirement.marker.evaluate({"extra": ""})):
            continue
        found.add(requirement.name.lower())
        package = metadata.distribution(requirement.name)
        left += package.requires or []
        for name in {file.parts[0] for file in package.files or []} - {"..", "__pycache__"}:
            if not (folder / name).exists():
                (folder / name).symlink_to(package.locate_file(name))


def run(packages: Path, places: list[Path], root: Path, *arguments: str) -> list[str]:
    """Error output of a program that fails; nothing if it succeeds."""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(map(str, [packages, *places]))}
    if places != [root / "python"]:
        environment.pop("SYMSDE_LIBRARY", None)  # the package has its own library
    command = [sys.executable, "-S", *arguments]
    done = subprocess.run(command, env=environment, cwd=root, check=False, capture_output=True, text=True)
    return [f"{done.stdout[-500:]}{done.stderr[-1500:]}"] if done.returncode else []


if __name__ == "__main__":
    sys.exit(main())
