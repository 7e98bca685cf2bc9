# SPDX-License-Identifier: BSD-3-Clause
"""`symsde stability`: every scenario, its table and its figure."""

from __future__ import annotations

import argparse
import importlib
from pathlib import Path
from time import perf_counter

from ..native import files
from ..reports import expectations, pages

HELP = "Run stiff and extreme scenarios; compare what is observed with what is expected."
FAILED = 1


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument("--quick", action="store_true", help="fewer paths and steps, under twenty seconds")
    parser.add_argument("--out", metavar="DIR", default="out/stability", help="directory of the results (%(default)s)")
    parser.add_argument("--markdown", metavar="FILE", help="write this page, and figures/ beside it")


def run(options: argparse.Namespace) -> int:
    """Do it; 0, or 1 if a criterion failed."""
    files.optional("matplotlib", "plot")
    stability = importlib.import_module("symsde.reports.stability")
    page = importlib.import_module("symsde.reports.stability.stability_page")
    with files.folder(options.out) as directory:
        return _scenarios(stability, page, directory, options)


def _scenarios(stability, page, directory: Path, options: argparse.Namespace) -> int:
    """Every scenario, into a folder that is there."""
    found = []
    print(f"{pages.made_by()}: stiff and extreme cases{' (quick)' if options.quick else ''}")
    for function in stability.SCENARIOS:
        begin = perf_counter()
        found.append(function(options.quick))
        print(expectations.block(found[-1], "case", perf_counter() - begin), flush=True)
    page.write(directory / "stability.md", found, options.quick)
    if options.markdown:
        page.write(Path(options.markdown), found, options.quick)
    print(f"\nwritten to {options.markdown or directory}\n{expectations.summary(found)}")
    return FAILED if expectations.count(found, False) else 0
