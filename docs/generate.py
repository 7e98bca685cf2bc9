# SPDX-License-Identifier: BSD-3-Clause
"""Write docs/models.md and docs/schemes.md, as the library describes itself: .venv/bin/python docs/generate.py.

Strong orders that were not measured yet are measured first (seconds a scheme).
"""

from pathlib import Path

import measure_orders
from symsde import tables

PAGES = {"models.md": tables.models_markdown, "schemes.md": tables.schemes_markdown}


def main() -> None:
    """Write both pages beside this file."""
    measure_orders.measure_missing()
    for name, page in PAGES.items():
        Path(__file__).with_name(name).write_text(page(), encoding="utf-8")


if __name__ == "__main__":
    main()
