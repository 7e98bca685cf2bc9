# SPDX-License-Identifier: BSD-3-Clause
"""Execute a notebook, whose cells check what they say: run_notebook.py FILE.ipynb FIGURES TABLES; 77 without nbclient.

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
    if any(cell.get("outputs") for cell in notebook.cells):
        print(f"{sys.argv[1]} holds outputs: clear them before it is committed")
        return 1
    with tempfile.TemporaryDirectory() as folder:  # the folder in which the notebook writes its files
        place = {"metadata": {"path": folder}}
        nbclient.NotebookClient(notebook, timeout=None, kernel_name="python3", resources=place).execute()
    kinds = [kind for cell in notebook.cells for found in cell.get("outputs", []) for kind in found.get("data", {})]
    print({kind: kinds.count(kind) for kind in sorted(set(kinds))})
    figures, tables = map(int, sys.argv[2:])
    return 0 if kinds.count("image/png") >= figures and kinds.count("text/html") >= tables else 1


if __name__ == "__main__":
    sys.exit(main())
