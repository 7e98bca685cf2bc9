# SPDX-License-Identifier: BSD-3-Clause
"""Run the benchmark programs, print their tables, and write them down.

Called by `./bootstrap bench`, with its arguments:
    run.py --build BUILD [--quick] [--repeats N] [--markdown docs/performance.md] [--json FILE]
Only the standard library is needed; NumPy and MKL are compared with where they can be imported.
"""

import argparse
import ctypes
import datetime
import glob
import json
import math
import os
import platform
import re
import statistics
import subprocess
import sys
import time
from pathlib import Path

try:
    import numpy as np
except ImportError:
    np = None

# Fraction of the limit program's speed that a scene should reach.
TARGETS = {
    "kubo_single_path": 1.0,
    "kubo_midpoint": 0.8,
    "synchrotron_midpoint": 0.8,
    "additive_euler": 0.8,
    "fpu64_midpoint": 0.7,
}
# Exponent of time, and the point from which it is fitted.
GROWTH = {
    "paths": (1.0, 1000, "Kubo midpoint, 100 steps, moments; full blocks from 256 paths on"),
    "steps": (1.0, 10000, "Kubo midpoint, 8 paths, moments"),
    "ndof": (1.0, 16, "FPU chain, midpoint, 64 paths, 20 steps, without set-up"),
    "setup": (1.0, 256, "set-up of the same runs: probing the model's derivatives"),
    "noises": (1.0, 4, "oscillator with n additive noises, Stormer-Verlet, 1024 paths, 500 steps"),
    "saved": (None, 100, "Kubo midpoint, 256 paths, 20000 steps, n of them saved"),
    "threads": (-1.0, 1, "Kubo midpoint, 20480 paths, 500 steps"),
}


def lines_of(program: Path, *arguments: object) -> list[list[str]]:
    """The words of each line a program prints."""
    command = [str(program), *(str(a) for a in arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode not in (0, 1):
        sys.exit(f"{' '.join(command)} ended with status {done.returncode}\n{done.stderr}")
    return [line.split() for line in done.stdout.splitlines() if line.strip()]


def measure_scenes(bench: Path, repeats: int, quick: bool) -> list[dict]:
    """Run the scenes of the library and their limit programs in turn."""
    scenes = []
    for words in lines_of(bench / "bench_suite", repeats, 20 if quick else 100):
        numbers = [float(word) for word in words[2:]]
        scenes.append(
            {
                "name": words[1],
                "library_ns": numbers[0:3],
                "limit_ns": numbers[3:6],
                "ratio": numbers[6],
                "fraction": 1 / numbers[6],
                "target": TARGETS.get(words[1]),
            }
        )
    return scenes


def measure_blocks(bench: Path, repeats: int) -> list[dict]:
    """Time the building blocks and the machine."""
    return [
        {"kind": words[0], "name": words[1], "values": [float(word) for word in words[2:]]}
        for words in lines_of(bench / "bench_blocks", repeats)
    ]


def measure_counters(bench: Path) -> list[dict]:
    """Read the counters and verdicts of what scenes leave out."""
    return [
        {
            "claim": words[1],
            "model": words[2],
            "scheme": words[3],
            "normals": float(words[4]),
            "gradients": float(words[5]),
            "hessians": float(words[6]),
            "iterations": float(words[7]),
            "solves": float(words[8]),
            "verdict": words[9],
        }
        for words in lines_of(bench / "bench_counters")
        if words[0] == "counters"
    ]


def measure_memory(bench: Path) -> list[dict]:
    """Run moments for few and many paths and steps, one process each."""
    rows = []
    for paths, steps, save_every in ((10**4, 100, 10), (10**6, 100, 10), (10**4, 10000, 1000)):
        words = lines_of(bench / "bench_memory", paths, steps, save_every)[0]
        rows.append({"paths": paths, "steps": steps, "peak_kb": int(words[3])})
    return rows


def measure_user_models(build: Path, repeats: int) -> list[dict]:
    """One model written in several ways, by the Python package; nothing where NumPy is missing."""
    library, functions = build / "libsymsde.so", build / "bench" / "libbench_user_models.so"
    if np is None or not functions.exists():
        return []
    here = Path(__file__).resolve().parent
    paths = os.pathsep.join(p for p in (str(here.parent / "python"), os.environ.get("PYTHONPATH")) if p)
    done = subprocess.run(
        [sys.executable, str(here / "user_models.py"), str(functions.resolve()), str(repeats)],
        capture_output=True,
        text=True,
        check=True,
        env=os.environ | {"SYMSDE_LIBRARY": str(library.resolve()), "PYTHONPATH": paths},
    )
    lines = [line.split() for line in done.stdout.splitlines()]
    return [{"name": w[1].replace("_", " "), "ns": [float(x) for x in w[2:]]} for w in lines]


def slope(points: list[tuple[float, float]]) -> float:
    """Exponent of the least-squares power law."""
    x = [math.log(a) for a, _ in points]
    y = [math.log(b) for _, b in points]
    mx, my = statistics.fmean(x), statistics.fmean(y)
    spread = sum((a - mx) ** 2 for a in x)
    return sum((a - mx) * (b - my) for a, b in zip(x, y, strict=True)) / spread


def measure_growth(bench: Path, repeats: int, quick: bool) -> list[dict]:
    """Time runs along every axis and fit the exponent."""
    axes = []
    for axis, (expected, start, scene) in GROWTH.items():
        rows = lines_of(bench / "bench_growth", axis, 1 if quick else repeats)
        points = [(int(w[2]), [float(x) for x in w[3:6]]) for w in rows]
        exponent = slope([(x, times[0]) for x, times in points if x >= start])
        axes.append(
            {
                "axis": axis,
                "scene": scene,
                "expected": expected,
                "from": start,
                "exponent": exponent,
                "points": points,
            }
        )
    return axes


def measure_threads(bench: Path, repeats: int) -> dict:
    """Two threads against two independent processes of one thread, in turn."""
    program = str(bench / "bench_growth")
    threads, processes = [], []
    for _ in range(repeats):
        threads.append(float(lines_of(bench / "bench_growth", "load", 2)[0][2]))
        pair = [subprocess.Popen([program, "load", "1"], stdout=subprocess.PIPE, text=True) for _ in range(2)]
        processes.append(sum(float(p.communicate()[0].split()[2]) for p in pair))
    ratios = [a / b for a, b in zip(threads, processes, strict=True)]
    return {
        "two_threads_per_s": statistics.median(threads),
        "two_processes_per_s": statistics.median(processes),
        "ratio": statistics.median(ratios),
        "least_ratio": min(ratios),
        "largest_ratio": max(ratios),
    }


def median_ns(call, count: int, repeats: int) -> float:
    """Median time of a call per item, in ns."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        call()
        times.append((time.perf_counter() - start) * 1e9 / count)
    return statistics.median(times)


def measure_other_generators(repeats: int) -> list[dict]:
    """ns per normal of NumPy's and MKL's generators, where they are."""
    count, rows = 10**6, []
    if np is None:
        rows.append({"name": "numpy", "ns": None})
    else:
        out = np.empty(count)
        for bits in ("PCG64", "SFC64", "Philox"):
            generator = np.random.Generator(getattr(np.random, bits)(1))
            fill = median_ns(lambda g=generator: g.standard_normal(out=out), count, repeats)
            rows.append({"name": f"numpy {bits} ziggurat", "ns": fill})
    names = glob.glob(f"{sys.prefix}/lib/libmkl_rt.so*")
    if not names:
        rows.append({"name": "MKL (pip install mkl)", "ns": None})
        return rows
    mkl = ctypes.CDLL(names[0])
    stream, numbers = ctypes.c_void_p(), (ctypes.c_double * 4096)()
    philox, box_muller2 = 0x100000 * 16, 1
    mkl.vslNewStream(ctypes.byref(stream), philox, 1)
    zero, one = ctypes.c_double(0), ctypes.c_double(1)

    def draw() -> None:
        for _ in range(count // 4096):
            mkl.vdRngGaussian(box_muller2, stream, 4096, numbers, zero, one)

    rows.append({"name": "MKL Philox Box-Muller", "ns": median_ns(draw, count, repeats)})
    return rows


def describe_machine(build: Path) -> dict:
    """Name processor, system, compiler, flags, date and load."""
    cpu = re.search(r"model name\s*:\s*(.*)", Path("/proc/cpuinfo").read_text())
    flags_seen = re.search(r"flags\s*:\s*(.*)", Path("/proc/cpuinfo").read_text())
    cache = (build / "CMakeCache.txt").read_text()
    compiler = re.search(r"CMAKE_Fortran_COMPILER:\w+=(.*)", cache)
    version = subprocess.run(
        [compiler[1] if compiler else "gfortran", "--version"],
        capture_output=True,
        text=True,
        check=True,
    ).stdout.splitlines()[0]
    ninja = build / "build.ninja"
    flags = re.search(r"\n  FLAGS = (.*-O.*)", ninja.read_text()) if ninja.exists() else None
    level = "AVX-512" if flags_seen and "avx512f" in flags_seen[1] else "no AVX-512"
    return {
        "cpu": f"{cpu[1] if cpu else platform.processor()}, {os.cpu_count()} cores, {level}",
        "system": platform.platform(),
        "compiler": version,
        "flags": " ".join(f for f in flags[1].split() if f[:2] not in ("-J", "-I")) if flags else "unknown",
        "date": datetime.date.today().isoformat(),
        "load": f"{os.getloadavg()[0]:.2f} when it began",
    }


def table(heads: list[str], rows: list[list[str]]) -> str:
    """A markdown table with padded columns."""
    widths = [max(len(row[i]) for row in [heads, *rows]) for i in range(len(heads))]
    body = [heads, ["-" * w for w in widths], *rows]
    padded = [[cell.ljust(w) for cell, w in zip(row, widths, strict=True)] for row in body]
    return "\n".join(f"| {' | '.join(row)} |" for row in padded)


def spread(values: list[float]) -> str:
    """Format a median with its least and largest value."""
    return f"{values[0]:.3g} ({values[1]:.3g} .. {values[2]:.3g})"


def optional(value: float | None, text: str = "{:.2f}", none: str = "") -> str:
    """Format a number that may be absent."""
    return none if value is None else text.format(value)


def scene_section(results: dict) -> str:
    """Write the section of the scenes."""
    rows = [
        [
            s["name"],
            spread(s["library_ns"]),
            spread(s["limit_ns"]),
            f"{s['ratio']:.2f}",
            f"{s['fraction']:.2f}",
            optional(s["target"], ">= {:.1f}"),
        ]
        for s in results["scenes"]
    ]
    heads = ["scene", "library [ns]", "limit [ns]", "library/limit", "fraction", "target"]
    return (
        "## Scenes beside hand-fused programs\n\n"
        "ns of processor time per path-step on one thread: median (least .. largest), both in turn.\n"
        "Fraction is the limit program's time over the library's. The limit programs of\n"
        "`bench/limits/` have the same scheme, generator and arithmetic and none of the machinery\n"
        "(no status, checks, observers). `synchrotron_midpoint_fused` is the same scene beside a\n"
        "limit program with a copy of sine and cosine in its one loop.\n"
        "`kubo_single_path` is one path beside a plain scalar loop with a ziggurat generator.\n\n" + table(heads, rows)
    )


def block_section(results: dict) -> str:
    """Write the section of the building blocks."""
    blocks = [b for b in results["blocks"] if b["kind"] == "block"]
    machine = [b for b in results["blocks"] if b["kind"] == "machine"]
    rows = [[b["name"].replace("_", " "), spread(b["values"])] for b in blocks]
    rates = [[b["name"].replace("_", " "), spread(b["values"])] for b in machine]
    others = [[g["name"], optional(g["ns"], none="absent, skipped")] for g in results["generators"]]
    return (
        "## Building blocks\n\nBlocks of 256 lanes, one thread, ns each.\n\n"
        + table(["block", "ns"], rows)
        + "\n\nThe machine, one thread:\n\n"
        + table(["machine", "rate"], rates)
        + "\n\nNormals of other libraries, ns each:\n\n"
        + table(["generator", "ns"], others)
    )


def counter_section(results: dict) -> str:
    """Write the section of the counters."""
    rows = [
        [c["claim"].replace("_", " "), c["model"], c["scheme"]]
        + [f"{c[k]:g}" for k in ("normals", "gradients", "hessians", "iterations", "solves")]
        + [c["verdict"]]
        for c in results["counters"]
    ]
    heads = ["claim", "model", "scheme", "normals", "gradients", "Hessians"]
    heads += ["iterations", "solves", "verdict"]
    return "## What is left out\n\nCounters per path-step.\n\n" + table(heads, rows)


def user_section(results: dict) -> str:
    """Write the section of user models."""
    rows = [[u["name"], spread(u["ns"])] for u in results["user_models"]]
    return (
        "## Models of one's own\n\nThe linear oscillator of the catalogue and the same model written by a user, 4096 "
        "paths, one thread: ns of\nprocessor time per path-step. The loop by hand has NumPy's own generator and "
        "arrays of the library's size.\n`numba cfunc` is absent where numba is not installed.\n\n"
        + table(["model, scheme", "ns"], rows or [["NumPy is not installed", "skipped"]])
    )


def memory_section(results: dict) -> str:
    """Write the section of memory."""
    memory = results["memory"]
    rows = [[str(m["paths"]), str(m["steps"]), f"{m['peak_kb'] / 1024:.2f}"] for m in memory]
    ratio = memory[1]["peak_kb"] / memory[0]["peak_kb"]
    return (
        "## Memory of moments\n\nPeak resident memory of a Fortran program, two threads.\n\n"
        + table(["paths", "steps", "peak [MB]"], rows)
        + f"\n\n10^6 paths over 10^4 paths: {ratio:.3f}."
    )


def growth_section(results: dict) -> str:
    """Write the section of growth."""
    parts = []
    for axis in results["growth"]:
        rows = [[str(x), *(f"{t:.3g}" for t in times)] for x, times in axis["points"]]
        parts.append(
            f"### {axis['axis']}\n\n{axis['scene']}. Fitted exponent from {axis['from']} on: "
            f"{axis['exponent']:.2f}"
            + (f", expected {axis['expected']:g}." if axis["expected"] is not None else ".")
            + "\n\n"
            + table([axis["axis"], "seconds", "least", "largest"], rows)
        )
    return "## Growth\n\nSeconds of a run.\n\n" + "\n\n".join(parts)


def thread_section(results: dict) -> str:
    """Write the section of threads."""
    t = results["threads"]
    return "## Threads\n\nSynchrotron midpoint, path-steps per second; medians of runs in turn.\n\n" + table(
        ["two threads", "two processes of one thread", "ratio"],
        [
            [
                f"{t['two_threads_per_s']:.3e}",
                f"{t['two_processes_per_s']:.3e}",
                spread([t["ratio"], t["least_ratio"], t["largest_ratio"]]),
            ]
        ],
    )


def page(results: dict) -> str:
    """Join the sections to one page."""
    machine = "\n".join(f"- {key}: {value}" for key, value in results["machine"].items())
    sections = [scene_section, block_section, user_section, counter_section]
    sections += [memory_section, growth_section, thread_section]
    return (
        "# Performance\n\nWritten by `./bootstrap bench --markdown docs/performance.md`; all "
        "numbers are of one run on one\nmachine. Compare ratios, not nanoseconds, between "
        "machines. Scenes are timed by processor time, all the\nrest by the clock: with a load "
        f"near or above the number of cores, other work disturbed it.\n\n{machine}\n\n"
        + "\n\n".join(s(results) for s in sections)
        + "\n"
    )


def main() -> int:
    """Run everything and return the status for the shell."""
    parser = argparse.ArgumentParser(description="Run symsde's benchmarks and print their tables.")
    parser.add_argument("--build", type=Path, required=True, help="the CMake build directory")
    parser.add_argument("--quick", action="store_true", help="shorter runs: rougher numbers")
    parser.add_argument("--repeats", type=int, default=7, help="repeats of each measurement")
    parser.add_argument("--markdown", type=Path, help="write the tables to this page")
    parser.add_argument("--json", type=Path, help="write the numbers to this file")
    options = parser.parse_args()
    bench = options.build / "bench"
    if not (bench / "bench_suite").exists():
        sys.exit(f"{bench} has no benchmark programs: configure with -DSYMSDE_BUILD_BENCH=ON")
    repeats = max(1, options.repeats)

    def say(what: str) -> None:
        print(f"bench: {what}", file=sys.stderr, flush=True)

    results: dict = {"machine": describe_machine(options.build)}
    say("scenes")
    results["scenes"] = measure_scenes(bench, repeats, options.quick)
    say("building blocks")
    results["blocks"] = measure_blocks(bench, repeats)
    results["generators"] = measure_other_generators(repeats)
    say("models of one's own")
    results["user_models"] = measure_user_models(options.build, min(repeats, 5))
    say("counters and memory")
    results["counters"] = measure_counters(bench)
    results["memory"] = measure_memory(bench)
    say("growth")
    results["growth"] = measure_growth(bench, repeats, options.quick)
    say("threads")
    results["threads"] = measure_threads(bench, 2 if options.quick else max(5, repeats))
    text = page(results)
    print(text)
    if options.markdown:
        options.markdown.write_text(text, encoding="utf-8")
    if options.json:
        options.json.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
