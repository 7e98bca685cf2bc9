# SPDX-License-Identifier: BSD-3-Clause
"""Write docs/models.md, schemes.md, which-scheme.md and its tables from the library and docs/figures, and a notebook.

    .venv/bin/python docs/generate.py

src/scheme/measured.f90 is written from docs/measured.json first; where it changes, build the library and run again.
docs/measure_orders.py measures anew (a quarter of an hour).
"""

import sys
from pathlib import Path

import measured_module
import notebook
import which_scheme
from symsde.reports import tables

PAGES = {
    "models.md": tables.models_markdown,
    "schemes.md": tables.schemes_markdown,
    "which-scheme.md": which_scheme.page,
    "which-scheme-tables.md": which_scheme.tables,
}


def main() -> int:
    """Write the pages beside this file; 1 where the library must be built first."""
    if measured_module.TARGET.read_text(encoding="utf-8") != measured_module.module():
        measured_module.write()
        print(f"{measured_module.TARGET} was not current: build the library, then run this again")
        return 1
    for name, page in PAGES.items():
        Path(__file__).with_name(name).write_text(page(), encoding="utf-8")
    notebook.TARGET.write_text(notebook.notebook(), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
