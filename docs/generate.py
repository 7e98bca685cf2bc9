# SPDX-License-Identifier: BSD-3-Clause
"""Write the tables of docs/models.md, schemes.md, damping.md and gradients.md, which-scheme.md and its tables from the
library and docs/figures, and a notebook; typeset the formulas of the parts that other programs have written.

    .venv/bin/python docs/generate.py

src/scheme/measured.f90 is written from docs/measured.json first; where it changes, build the library and run again.
docs/measure_orders.py measures anew (a quarter of an hour).
"""

import re
import sys
from pathlib import Path

import damping_orders
import gradient_schemes
import measured_module
import notebook
import typeset
import which_scheme
from symsde.studies import catalogue
from symsde.studies.pages import Page

COMMAND = "docs/generate.py"
CATALOGUES = {
    "models.md": catalogue.models_parts,
    "schemes.md": catalogue.schemes_parts,
    "damping.md": damping_orders.parts,
    "gradients.md": gradient_schemes.parts,
}
CHAPTERS = {
    "beyond-order-one": "[Beyond order one](method/beyond-order-one.md)",
    "explicit": "[Explicit family](method/explicit.md)",
    "weak": "[Weak schemes](method/weak.md)",
}
#: whose parts are written by programs that measure
MEASURED = ("stability.md", "stability-tables.md", "work-precision.md", "work-precision-tables.md", "peers.md")


def pages() -> dict[str, str]:
    """The text of every page."""
    found = {"which-scheme.md": which_scheme.page(), "which-scheme-tables.md": which_scheme.tables()}
    for name, parts in CATALOGUES.items():
        page = Page(Path(__file__).with_name(name), COMMAND)
        for part, text in parts().items():
            linked = re.sub(r"docs/method/([\w-]+)\.md", lambda chapter: CHAPTERS[chapter[1]], text)
            page.put(part, typeset.linked(typeset.markdown(linked), "paper-map.md"))
        found[name] = page.text()
    return found | {name: typeset.parts(Path(__file__).with_name(name).read_text("utf-8")) for name in MEASURED}


def main() -> int:
    """Write the pages beside this file; 1 where the library must be built first."""
    if measured_module.TARGET.read_text(encoding="utf-8") != measured_module.module():
        measured_module.write()
        print(f"{measured_module.TARGET} was not current: build the library, then run this again")
        return 1
    for name, page in pages().items():
        Path(__file__).with_name(name).write_text(page, encoding="utf-8")
    notebook.TARGET.write_text(notebook.notebook(), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
