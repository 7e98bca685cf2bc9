# SPDX-License-Identifier: BSD-3-Clause
"""Build the site: .venv/bin/python docs/site/build.py [--out DIR]; ./bootstrap docs sets up what it needs.

The pages are those of docs/ as they stand, references made here, and a gallery whose programs are run. Warnings are
errors.
"""

import argparse
import importlib.util
import os
import shutil
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SKIPPED = 77
NEEDED = (
    "sphinx",
    "myst_parser",
    "furo",
    "sphinx_design",
    "sphinx_copybutton",
    "sphinx_gallery",
    "sphinx-mathjax-offline",
)
LINKED = ("examples", "include", "python", "src")


def assemble(tree):
    """What Sphinx reads: pages, figures, programs of the gallery, generated references."""
    import c_reference
    import fortran_reference
    import python_reference

    shutil.rmtree(tree, ignore_errors=True)
    docs = tree / "docs"
    shutil.copytree(ROOT / "docs", docs, ignore=shutil.ignore_patterns("*.py", "site", "gallery"))
    shutil.copytree(ROOT / "docs" / "gallery", docs / "gallery")
    for name in LINKED:
        (tree / name).symlink_to(ROOT / name)
    reference = docs / "reference"
    reference.mkdir()
    header = (ROOT / "include" / "symsde.h").read_text(encoding="utf-8")
    pages = {"c": c_reference.page(header), "cpp": Path(__file__).with_name("cpp.md").read_text(encoding="utf-8")}
    pages |= {"fortran": fortran_reference.page(ROOT), "python": python_reference.page()}
    for name, text in pages.items():
        (reference / f"{name}.md").write_text(text, encoding="utf-8")
    return docs


def main():
    """Assemble and build; the exit code of Sphinx, 77 where it is not installed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=ROOT / "build" / "site")
    out = parser.parse_args().out.resolve()
    missing = [name for name in NEEDED if importlib.util.find_spec(name) is None]
    if missing:
        print(f"skipped: {', '.join(missing)} not installed; ./bootstrap docs installs what the site needs in .venv")
        return SKIPPED
    from sphinx.cmd.build import main as sphinx

    sys.path[:0] = [str(ROOT / "docs" / "site"), str(ROOT / "docs")]
    os.environ.setdefault("MPLBACKEND", "Agg")
    docs = assemble(out / "tree")
    options = [
        "-q",
        "-W",
        "--keep-going",
        "-E",
        "-c",
        str(Path(__file__).resolve().parent),
        "-d",
        str(out / "doctrees"),
    ]
    status = sphinx([*options, str(docs), str(out / "html")])
    if status == 0:
        print(f"the site is {out / 'html' / 'index.html'}")
    return status


if __name__ == "__main__":
    sys.exit(main())
