# SPDX-License-Identifier: BSD-3-Clause
"""The table on the terminal and the CSV file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from ...native.checks import counted
from ...run import provenance
from ...show import tables

#: column of the CSV -> meaning; times in seconds, everything else dimensionless
COLUMNS = {
    "scene": "name of the scene",
    "scheme": "name of the scheme",
    "steps": "number of steps to the horizon",
    "h": "step",
    "status": "ok; failed: some paths failed; diverged: finite, but far larger than the solution; saturated: as large "
    "as the solution; reference: not above the reference's own error; rounding: of the size of rounding errors",
    "pareto": "1 where no other point is both faster and as accurate",
    "reference": "what the paths are compared with",
    "ref_error": "rms error of the reference itself: its difference to half as many steps; 0 = exact",
    "paths": "paths of the error run",
    "failed": "of these, failed; errors are over the others",
    "err_strong": "root mean square of the error of (q, p) at the horizon, on common Brownian paths",
    "err_strong_low": "lower end of its 95 % interval",
    "err_strong_high": "upper end",
    "weak_q": "error of E q (mean over the degrees of freedom), on common Brownian paths",
    "weak_q_ci": "half width of its 95 % interval",
    "weak_p": "error of E p",
    "weak_p_ci": "half width",
    "weak_H": "error of E H",
    "weak_H_ci": "half width",
    "drift": "rms relative change of an invariant; empty where the scene has none",
    "seconds": "run time of a path, of the processor: median of warm repeats, increments of its own step",
    "seconds_low": "lower quartile",
    "seconds_high": "upper quartile",
    "elapsed": "elapsed time of a path, median; more than seconds where the machine has other work",
    "repeats": "timed runs",
    "timing_paths": "paths of a timed run",
    "threads": "threads of a timed run",
    "normals": "normal deviates of a path-step",
    "gradients": "gradients of a path-step",
    "hessians": "Hessians of a path-step",
    "iterations": "Newton iterations of a path-step",
    "solves": "linear systems of a path-step",
    "stepper": "the stepper that the traits chose",
}


def write_csv(path: Path, rows: list[dict], about: Mapping[str, str]) -> None:
    """Write one line per point; lines before the header that begin with # describe the origin and the columns."""

    columns = {name: [row.get(name) for row in rows] for name in COLUMNS}
    tables.write(path, columns, {**about, **provenance.made(), **COLUMNS})


HEAD = ("scheme", "h", "strong error", "95 %", "E q error", "+-", "E H error", "+-", "drift", "s/path", "+-", "grad",
        "hess", "iter", "norm", "")  # fmt: skip


def terminal(rows: list[dict], orders: dict) -> str:
    """A table of all points; * marks points that no other point beats."""
    lines: list[list[str] | str] = []
    for row, after in zip(rows, [*rows[1:], {"scheme": None}], strict=True):
        lines.append(cells(row))
        if after["scheme"] != row["scheme"]:
            lines.append(f"    order {orders[row['scheme']]}")
    return tables.terminal(HEAD, lines, numbers=range(1, len(HEAD) - 1))


def cells(row: dict) -> list[str]:
    """The cells of one point; a dash for a missing value."""
    text = [
        f"{'*' if row.get('pareto') else ' '} {row['scheme']}",
        f"{row['h']:.3g}",
        _number(row, "err_strong", ".3e"),
    ]
    text.append(_spread(row, "err_strong"))
    for name in "qH":
        text += [_number(row, f"weak_{name}", ".2e"), _number(row, f"weak_{name}_ci", ".1e")]
    text += [_number(row, "drift", ".1e"), _number(row, "seconds", ".2e"), _spread(row, "seconds")]
    text += [_number(row, name, ".3g") for name in ("gradients", "hessians", "iterations", "normals")]
    mark = {"ok": "", "failed": f"FAILED: {counted(row['failed'], 'path')}"}
    return [*text, mark.get(row["status"], f"({row['status']})")]


def _number(row: dict, name: str, form: str) -> str:
    return "-" if row.get(name) is None else format(row[name], form)


def _spread(row: dict, name: str) -> str:
    """Half width of the interval of a value, in per cent of the value."""
    if not row.get(name):
        return "-"
    return f"{100 * (row[f'{name}_high'] - row[f'{name}_low']) / 2 / row[name]:.0f}%"
