# SPDX-License-Identifier: BSD-3-Clause
"""Run the benchmarks, print their tables, and write them down.

Called by `./bootstrap bench`, with its arguments:
    run.py --build BUILD [--quick] [--only SECTION ...]
           [--rows REGEX] [--repeats N] [--markdown docs/performance.md] [--json FILE] [--python COMMAND]
`./bootstrap bench loops [REGEX]` runs the section loops alone, or only those of its rows that match.
Comparisons with loops are skipped where numba is not installed. Each module of topics/ measures and writes one section
of the page of tables, in a process of its own, by the library of the build; first_screen.py writes the page.
"""

import argparse
import functools
import importlib
import importlib.util
import json
import os
import re
import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import first_screen
from topics import machine
from topics.tools import Setting

TOPICS = {
    "scenes": "scenes",
    "loops": "loops",
    "stages": "stages",
    "generators": "generators",
    "models": "models",
    "python": "python_calls",
    "counters": "left_out",
    "memory": "memory",
    "growth": "growth",
    "threads": "threads",
    "open": "open_systems",
    "brought": "brought",
    "sweeps": "sweeps",
    "gradients": "gradients",
}


def measured(module: str, setting: Setting) -> tuple[object, str]:
    """Numbers and text of a section, measured in a process of its own."""
    topic = importlib.import_module(f"topics.{module}")
    found = topic.measure(setting)
    return found, topic.section(found)


def page(described: dict, sections: list[str]) -> str:
    """Join the sections to one page."""
    about = "\n".join(f"- {key}: {value}" for key, value in described.items())
    return (
        "# Performance: the tables\n\n`./bootstrap bench --markdown docs/performance.md` writes this page; all numbers "
        "are of one run on one\nmachine. Compare ratios, not nanoseconds, between machines. Times are wall-clock times "
        "unless they are\ncalled processor times. Other work disturbed wall-clock times if the load was near or above "
        f"the number of\ncores.\n\n{about}\n\n" + "\n\n".join(sections) + "\n"
    )


def replaced(tables: str, section: str) -> str:
    """The tables with a new section in place of the section with the same heading, or at the end."""
    heading = section.partition("\n")[0]
    old = re.search(rf"^{re.escape(heading)}\n.*?(?=^## |\Z)", tables, re.MULTILINE | re.DOTALL)
    if old is None:
        return f"{tables}\n{section}\n"
    return tables[: old.start()] + f"{section}\n\n{tables[old.end() :]}".rstrip() + "\n"


def write_sections(target: Path, sections: list[str], results: dict) -> None:
    """Write these sections of the page of tables alone, and the page with its counts and its picture."""
    tables = target.with_stem(f"{target.stem}-tables").read_text(encoding="utf-8")
    write(target, functools.reduce(replaced, sections, tables), results)


def write(target: Path, tables: str, results: dict) -> None:
    """Write the tables, and the page with its picture: numbers that were not measured are those of the last time."""
    target.with_stem(f"{target.stem}-tables").write_text(tables, encoding="utf-8")
    figure = target.parent / "figures" / "performance.json"
    figure.parent.mkdir(exist_ok=True)
    rows = first_screen.rows(results.get("loops", []))
    if rows is None and not figure.exists():
        return
    data = {"rows": rows or json.loads(figure.read_text(encoding="utf-8"))["rows"]}
    data["brought"] = first_screen.brought(tables)
    target.write_text(first_screen.page(data, tables), encoding="utf-8")
    figure.write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")
    if importlib.util.find_spec("matplotlib") is not None:
        first_screen.save(figure.with_suffix(".png"), data)


def parse() -> argparse.Namespace:
    """Read the arguments of the command."""
    parser = argparse.ArgumentParser(description="Run symsde's benchmarks and print their tables.")
    parser.add_argument("--build", type=Path, required=True, help="the CMake build directory")
    parser.add_argument("--quick", action="store_true", help="shorter runs: rougher numbers")
    parser.add_argument("--repeats", type=int, default=7, help="repeats of each measurement")
    parser.add_argument("--only", nargs="+", choices=TOPICS, default=list(TOPICS), help="these sections alone")
    parser.add_argument("--python", default=sys.executable, help="an interpreter that has diffrax, torchsde and OpenMM")
    parser.add_argument("--rows", default="", help="of the section loops: rows whose name matches alone")
    parser.add_argument("--markdown", type=Path, help="write the tables to this page, with --only these sections")
    parser.add_argument("--json", type=Path, help="write the numbers to this file")
    return parser.parse_args()


def main() -> int:
    """Run everything and return the status for the shell."""
    options = parse()
    setting = Setting(options.build, max(1, options.repeats), options.quick, options.rows, options.python)
    os.environ["SYMSDE_LIBRARY"] = str((options.build / "libsymsde.so").resolve())
    sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "python"))
    results: dict = {"machine": machine.describe(setting)}
    sections = []
    for name in options.only:
        print(f"bench: {name}", file=sys.stderr, flush=True)
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
            results[name], text = pool.submit(measured, TOPICS[name], setting).result()
        sections.append(text)
    text = page(results["machine"], sections)
    print(text)
    if options.markdown and options.only != list(TOPICS):
        write_sections(options.markdown, sections, results)
    elif options.markdown:
        write(options.markdown, text, results)
    if options.json:
        options.json.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
