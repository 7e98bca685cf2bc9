# SPDX-License-Identifier: BSD-3-Clause
"""The library built for x86-64-v3 (AVX2) beside the build for this machine."""

from pathlib import Path

from .machine import flags_of
from .tools import ABSENT, Setting, at_most, lines_of, spread, summary, table

# Largest time over that of AVX-512.
TARGETS = {"Kubo midpoint, path-step": 2.2}
BLOCKS = {"normal": "normal", "philox_word": "Philox word"}


def measure(setting: Setting) -> dict:
    """Run both builds in turn; nothing where one is missing or this machine has no AVX-512."""
    builds = (setting.build, setting.avx2_build)
    if None in builds or "avx512f" not in Path("/proc/cpuinfo").read_text():
        return {}
    rows: dict[str, list] = {}
    for _ in range(max(5, setting.repeats)):
        for i, build in enumerate(builds):
            for name, ns in once(build / "bench", setting.quick).items():
                rows.setdefault(name, ([], []))[i].append(ns)
    return {"flags": flags_of(builds[1]), "rows": rows}


def once(bench: Path, quick: bool) -> dict[str, float]:
    """One time of each, ns."""
    found = {
        "Kubo midpoint, path-step": float(
            lines_of(bench / "bench_suite", 1, 20 if quick else 50, "kubo_midpoint")[0][2]
        )
    }
    for words in lines_of(bench / "bench_blocks", 1):
        if words[1] in BLOCKS:
            found[BLOCKS[words[1]]] = float(words[2])
    return found


def section(found: dict) -> str:
    """Write the section."""
    head = "## AVX2 beside AVX-512\n\n"
    if not found:
        return head + f"This section needs --avx2-build and a machine with AVX-512: {ABSENT}."
    rows = []
    for name, (native, avx2) in found["rows"].items():
        ratio = summary([b / a for a, b in zip(native, avx2, strict=True)])
        verdict = at_most(ratio[0], TARGETS.get(name))
        rows.append([name, spread(summary(native)), spread(summary(avx2)), spread(ratio), *verdict])
    return (
        head
        + f"Both builds in turn, one thread, ns. Flags of the second: `{found['flags']}`.\n\n"
        + table(["", "this machine", "x86-64-v3", "ratio", "target", ""], rows)
    )
