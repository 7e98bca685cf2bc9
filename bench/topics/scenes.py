# SPDX-License-Identifier: BSD-3-Clause
"""Scenes of the library beside hand-fused programs."""

from .tools import Setting, at_least, lines_of, spread, table

# Fraction of the limit program's speed that a scene should reach.
TARGETS = {
    "kubo_single_path": 1.0,
    "synchrotron_single_path": 1.0,
    "kubo_midpoint": 0.93,
    "synchrotron_midpoint": 0.83,
    "additive_euler": 0.91,
    "fpu64_midpoint": 0.95,
}


def measure(setting: Setting) -> list[dict]:
    """Run the scenes of the library and their limit programs in turn."""
    scenes = []
    for words in lines_of(setting.bench / "bench_suite", setting.repeats, 20 if setting.quick else 100):
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


def section(scenes: list[dict]) -> str:
    """Write the section."""
    rows = [
        [
            s["name"],
            spread(s["library_ns"]),
            spread(s["limit_ns"]),
            f"{s['ratio']:.2f}",
            f"{s['fraction']:.2f}",
            *at_least(s["fraction"], s["target"]),
        ]
        for s in scenes
    ]
    heads = ["scene", "library [ns]", "limit [ns]", "library/limit", "fraction", "target", ""]
    return (
        "## Scenes beside hand-fused programs\n\n"
        "The table gives ns of processor time for a step of a path on one thread: the median (least .. largest)\n"
        "of runs that alternate between library and [limit program](words.md#limit-program). Those of\n"
        "bench/limits have the same scheme, generator and arithmetic, but no status, checks and observers. The\n"
        "fraction is the time of the limit program over that of the library. That of `synchrotron_midpoint_fused`\n"
        "has a copy of sine and cosine in its single loop. `kubo_single_path` and `synchrotron_single_path`\n"
        "compare one path with a plain scalar loop with a ziggurat generator.\n\n" + table(heads, rows)
    )
