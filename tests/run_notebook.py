# SPDX-License-Identifier: BSD-3-Clause
"""Execute a notebook, whose cells check what they say: run_notebook.py FILE.ipynb FIGURES TABLES; 77 without nbclient.

Outputs that stand in the file are texts of its page (docs/notebook.py), which their cells must print again.

FIGURES and TABLES: the least numbers of pictures and of HTML representations in its output.
"""

import importlib.util
import os
import sys
import tempfile
from pathlib import Path


def main():
    """Execute the notebook; 0 if every cell runs and all figures and HTML representations are there."""
    missing = [name for name in ("nbclient", "nbformat", "ipykernel") if importlib.util.find_spec(name) is None]
    if missing:
        print(f"skipped: {', '.join(missing)} not installed; ./bootstrap docs installs them in .venv")
        return 77
    import nbclient
    import nbformat

    os.environ.pop("MPLBACKEND", None)  # set by tests; figures must appear in the notebook
    notebook = nbformat.read(Path(sys.argv[1]), as_version=4)
    shown = [printed(cell) for cell in notebook.cells]
    if any(found.get("name") != "stdout" for cell in notebook.cells for found in cell.get("outputs", [])):
        print(f"{sys.argv[1]} holds outputs that are no text: clear them before it is committed")
        return 1
    with tempfile.TemporaryDirectory() as folder:  # the folder in which the notebook writes its files
        place = {"metadata": {"path": folder}}
        nbclient.NotebookClient(notebook, timeout=None, kernel_name="python3", resources=place).execute()
    for cell, text in zip(notebook.cells, shown, strict=True):
        if text and text != printed(cell):
            print(f"{sys.argv[1]} shows\n{text}where its cell prints\n{printed(cell)}")
            return 1
    kinds = [kind for cell in notebook.cells for found in cell.get("outputs", []) for kind in found.get("data", {})]
    print({kind: kinds.count(kind) for kind in sorted(set(kinds))})
    figures, tables = map(int, sys.argv[2:])
    return 0 if kinds.count("image/png") >= figures and kinds.count("text/html") >= tables else 1


def printed(cell) -> str:
    """The text that the outputs of a cell hold as printed."""
    return "".join(found["text"] for found in cell.get("outputs", []) if found.get("name") == "stdout")


if __name__ == "__main__":
    sys.exit(main())
