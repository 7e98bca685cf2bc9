# SPDX-License-Identifier: BSD-3-Clause
"""The table on the terminal and the CSV file."""

from __future__ import annotations

import csv
from pathlib import Path

from .. import _files, provenance

#: columns of the CSV, with what they are; times in seconds, everything else dimensionless
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


def write_csv(path: Path, rows: list[dict]) -> None:
    """Write one line a point; columns as in COLUMNS, explained in lines that begin with #."""

    def write(part: Path) -> None:
        with part.open("w", newline="", encoding="utf-8") as file:
            file.writelines(provenance.comments({**provenance.made(), **COLUMNS}))
            table = csv.writer(file)
            table.writerow(COLUMNS)
            table.writerows([_cell(row.get(name)) for name in COLUMNS] for row in rows)

    _files.replace(path, write)


def _cell(value):
    if isinstance(value, bool):
        return int(value)
    if isinstance(value, float):  # of Python or NumPy, whose repr is not a number
        return repr(float(value))
    return "" if value is None else value


HEADER = (
    f"  {'scheme':22s} {'h':>9s} {'strong error':>12s} {'95 %':>6s} {'E q error':>10s} {'+-':>7s} {'E H error':>10s} "
    f"{'+-':>7s} {'drift':>8s} {'s/path':>9s} {'+-':>4s} {'grad':>5s} {'hess':>5s} {'iter':>5s} {'norm':>5s}"
)


def terminal(rows: list[dict], orders: dict) -> str:
    """All points; * marks those that no other beats."""
    lines = [HEADER]
    last = None
    for row in rows:
        if last not in (None, row["scheme"]):
            lines.append(f"  {'':22s} order {orders[last]}")
        last = row["scheme"]
        lines.append(line(row))
    if last is not None:
        lines.append(f"  {'':22s} order {orders[last]}")
    return "\n".join(lines)


def line(row: dict) -> str:
    """One point."""
    text = f"{'*' if row.get('pareto') else ' '} {row['scheme']:22s} {row['h']:9.3g} "
    if "err_strong" in row:
        half = (row["err_strong_high"] - row["err_strong_low"]) / 2
        text += f"{row['err_strong']:12.3e} {percent(half, row['err_strong']):>6s} "
        text += "".join(_weak(row, name) for name in "qH")
        text += f"{row['drift']:8.1e} " if row.get("drift") is not None else f"{'-':>8s} "
    else:
        text += f"{'-':>12s} {'-':>6s} {'-':>10s} {'-':>7s} {'-':>10s} {'-':>7s} {'-':>8s} "
    if "seconds" in row:
        spread = (row["seconds_high"] - row["seconds_low"]) / 2
        text += f"{row['seconds']:9.2e} {percent(spread, row['seconds']):>4s} "
        text += " ".join(f"{row[name]:5.3g}" for name in ("gradients", "hessians", "iterations", "normals"))
    mark = {"ok": "", "failed": f"  FAILED: {row['failed']} paths"}.get(row["status"], f"  ({row['status']})")
    return text + mark


def _weak(row: dict, name: str) -> str:
    if f"weak_{name}" not in row:
        return f"{'-':>10s} {'-':>7s} "
    return f"{row[f'weak_{name}']:10.2e} {row[f'weak_{name}_ci']:7.1e} "


def percent(part: float, whole: float) -> str:
    """A share in per cent."""
    return f"{100 * part / whole:.0f}%" if whole else "-"
