# SPDX-License-Identifier: BSD-3-Clause
"""Reduce results to a few numbers, which change whenever the results do, and keep tables of these numbers in a file."""

import dataclasses
import functools
import re
import zlib
from pathlib import Path

import numpy as np

EXACT = ("path_steps", "normals", "failures")  # counters without influence of rounding
TEXTS = re.compile(r"(?<![\w.])[+-]?\d+\.?\d*(?:e[+-]?\d+)?", re.IGNORECASE)
MASKED = re.compile(r"[\d.e+-]+ to (?:set up|run)|/tmp/[\w./-]*|\d{4}-\d\d-\d\dT[\d:.+Z-]+|0x[0-9a-f]+")


@dataclasses.dataclass(frozen=True)
class Number:
    """A number, and its tolerance against other builds."""

    value: float
    room: float

    def __str__(self):
        return f"{self.value:.11g}"

    def agrees(self, text):
        """Whether the number in the file agrees within the tolerance."""
        try:
            return abs(float(text) - self.value) <= self.room
        except ValueError:
            return False


class Code(str):
    """Checksum of integers and text, which must agree exactly."""

    __slots__ = ()

    def agrees(self, text):
        """Whether the checksum in the file is equal."""
        return text == self


def weights(size):
    """Fixed irregular weights between one half and three halves."""
    return 0.5 + (0.6180339887498949 * np.arange(1, size + 1)) % 1


def number(*arrays, rtol=1e-9, scale=np.arcsinh):
    """The weighted sum over all entries of arrays, large ones by their logarithms; NaN and infinity count, too."""
    x = [np.asarray(a, float).ravel() * (1 + 0.37 * i) for i, a in enumerate(arrays) if a is not None]
    x = np.nan_to_num(np.concatenate(x or [[]]), nan=0.7713, posinf=3.77, neginf=-5.33)
    x = scale(x) * weights(x.size)
    return Number(float(x.sum()), rtol * float(np.abs(x).sum()) + 1e-300)


def counted(found):
    """Counters that rounding may change if a scheme iterates, for each path, summed over runs."""
    totals = {name: sum(counters[name] / paths for counters, paths in found) for name in found[0][0]}
    room = (0.01, 3) if totals["iterations"] else (1e-9, 0)
    return [Number(n, room[0] * n + room[1] * np.sqrt(n)) for name, n in totals.items() if name not in EXACT]


def tallied(group):
    """For a group of (scheme, key, numbers, (counters, paths) of its runs): its keys, and the work of each scheme."""

    @functools.wraps(group)
    def rows():
        by_scheme = {}
        for scheme, key, numbers, found in group():
            by_scheme.setdefault(scheme, []).extend(found)
            yield key, numbers
        for scheme, found in by_scheme.items():
            if found:
                yield f"work of {scheme}", counted(found)

    return rows


def plain(text):
    """Text without times and folders, with numbers of six digits and without numbers at rounding."""
    text = MASKED.sub("~", str(text))
    return TEXTS.sub(lambda m: f"{x:.6g}" if abs(x := float(m[0])) > 1e-9 else "0", text)


def code(*things):
    """The checksum of integers and text."""
    told = "\n".join(
        str(np.asarray(x).tolist()) if not isinstance(x, str | tuple | list | dict) else plain(x) for x in things
    )
    return Code(f"x{zlib.crc32(told.encode()):08x}")


def exact_of(report):
    """The report without items that rounding or the machine may change."""
    said = (report.stepper, report.correction, report.left_out, report.warnings, report.outcome, report.lost_variance)
    return [*(report.counters[x] for x in EXACT), *said, report.failed, report.stopped, report.lanes]


def parts_of(x, found, told):
    """Collect the floats of any result in `found`, everything else in `told`."""
    if isinstance(x, np.ndarray) and x.dtype.kind == "f":
        found.append(x)
        told.append(x.shape)
    elif isinstance(x, float | np.floating):
        found.append([x])
    elif isinstance(x, np.ndarray | int | np.integer | str | bool | None.__class__):
        told.append(x)
    elif isinstance(x, dict):
        for key, value in x.items():
            told.append(str(key))
            parts_of(value, found, told)
    elif isinstance(x, list | tuple):
        for value in x:
            parts_of(value, found, told)
    elif dataclasses.is_dataclass(x):
        parts_of({f.name: getattr(x, f.name) for f in dataclasses.fields(x)}, found, told)
    else:
        told.append(repr(x))


def facts(*results, rtol=1e-9):
    """One number and one checksum for all these results."""
    answer = []
    for x in results:
        found, told = [], []
        parts_of(x, found, told)
        answer += [number(*found, rtol=rtol)] * bool(found) + [code(*told)] * bool(told)
    return answer


def read(path: Path):
    """The numbers in the file, by key."""
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    rows = (line.partition(" = ") for line in lines if line and not line.startswith("#"))
    return {key: values.split() for key, _, values in rows}


def differ(known, found):
    """The differences, one line each: changed numbers, new keys, missing keys."""
    told = []
    for key in known.keys() | found.keys():
        old, new = known.get(key, []), found.get(key, [])
        if len(old) != len(new) or not all(x.agrees(y) for x, y in zip(new, old, strict=True)):
            told.append(f"{key}: was {' '.join(old) or 'not there'}, is {' '.join(map(str, new)) or 'not there'}")
    return sorted(told)
