# SPDX-License-Identifier: BSD-3-Clause
"""Run the benchmark programs, print their tables, and write them down.

Called by `./bootstrap bench`, with its arguments:
    run.py --build BUILD [--avx2-build BUILD] [--quick] [--only SECTION ...]
           [--rows REGEX] [--repeats N] [--markdown docs/performance.md] [--json FILE]
`./bootstrap bench loops [REGEX]` runs the section loops alone, and of it the rows that match.
Only the standard library is needed; what else is compared with (NumPy, numba, MKL) is skipped where it is not
installed. Each module of topics/ measures and writes one section of the page of tables, first_screen.py the page.
"""

import argparse
import importlib.util
import json
import sys
from pathlib import Path

import first_screen
from topics import (
    avx2,
    blocks,
    counters,
    generators,
    growth,
    loops,
    machine,
    memory,
    models,
    python_calls,
    scenes,
    stages,
    threads,
)
from topics.tools import Setting

TOPICS = {
    "scenes": scenes,
    "loops": loops,
    "stages": stages,
    "blocks": blocks,
    "generators": generators,
    "avx2": avx2,
    "models": models,
    "python": python_calls,
    "counters": counters,
    "memory": memory,
    "growth": growth,
    "threads": threads,
}


def page(results: dict) -> str:
    """Join the sections to one page."""
    described = "\n".join(f"- {key}: {value}" for key, value in results["machine"].items())
    sections = [topic.section(results[name]) for name, topic in TOPICS.items() if name in results]
    return (
        "# Performance: the tables\n\n`./bootstrap bench --markdown docs/performance.md` writes this page; all numbers "
        "are of one run on one\nmachine. Compare ratios, not nanoseconds, between machines. Times are wall-clock times "
        "unless they are\ncalled processor times. Other work disturbed wall-clock times if the load was near or above "
        f"the number of\ncores.\n\n{described}\n\n" + "\n\n".join(sections) + "\n"
    )


def write(target: Path, tables: str, results: dict) -> None:
    """Write the tables beside the page; the page and its picture, too, where all that they show was measured."""
    target.with_stem(f"{target.stem}-tables").write_text(tables, encoding="utf-8")
    if (data := first_screen.data(results.get("loops", []))) is None:
        return
    target.write_text(first_screen.page(data, tables), encoding="utf-8")
    figure = target.parent / "figures" / "performance.json"
    figure.parent.mkdir(exist_ok=True)
    figure.write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")
    if importlib.util.find_spec("matplotlib") is not None:
        first_screen.save(figure.with_suffix(".png"), data)


def parse() -> argparse.Namespace:
    """Read the arguments of the command."""
    parser = argparse.ArgumentParser(description="Run symsde's benchmarks and print their tables.")
    parser.add_argument("--build", type=Path, required=True, help="the CMake build directory")
    parser.add_argument("--avx2-build", type=Path, help="a second one, compiled for x86-64-v3")
    parser.add_argument("--quick", action="store_true", help="shorter runs: rougher numbers")
    parser.add_argument("--repeats", type=int, default=7, help="repeats of each measurement")
    parser.add_argument("--only", nargs="+", choices=TOPICS, default=list(TOPICS), help="these sections alone")
    parser.add_argument("--rows", default="", help="of the section loops: rows whose name matches alone")
    parser.add_argument("--markdown", type=Path, help="write the tables to this page")
    parser.add_argument("--json", type=Path, help="write the numbers to this file")
    return parser.parse_args()


def main() -> int:
    """Run everything and return the status for the shell."""
    options = parse()
    setting = Setting(options.build, options.avx2_build, max(1, options.repeats), options.quick, options.rows)
    if options.only != ["loops"] and not (setting.bench / "bench_suite").exists():
        sys.exit(f"{setting.bench} has no benchmark programs: configure with -DSYMSDE_BUILD_BENCH=ON")
    results: dict = {"machine": machine.describe(setting)}
    for name in options.only:
        print(f"bench: {name}", file=sys.stderr, flush=True)
        results[name] = TOPICS[name].measure(setting)
    text = page(results)
    print(text)
    if options.markdown:
        write(options.markdown, text, results)
    if options.json:
        options.json.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
