# SPDX-License-Identifier: BSD-3-Clause
"""Timing of a row: all its runs alternate, measured by processor time, each for about as long."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Any

Run = Callable[[int], Any]  #: a run of so many steps


def seconds_of(run: Callable[[], Any], clock: Callable[[], float] = time.process_time) -> float:
    """Seconds of one call."""
    begin = clock()
    run()
    return clock() - begin


def in_turn(runs: Iterable[Callable[[], Any]], repeats: int, clock: Callable[[], float] = time.process_time) -> list:
    """Seconds of every run, a list of `repeats` for each; all runs alternate."""
    rounds = [[seconds_of(run, clock) for run in runs] for _ in range(repeats)]
    return [list(column) for column in zip(*rounds, strict=True)]


def least(ways: Mapping, repeats: int, clock: Callable[[], float] = time.process_time) -> dict:
    """Least seconds of every run, by its name."""
    return {name: min(times) for name, times in zip(ways, in_turn(ways.values(), repeats, clock), strict=True)}


def fitted(run: Run, paths: int, seconds: float) -> int:
    """Steps for a run of so many seconds; compilation and allocation happen here, before runs are timed."""
    steps = 16
    run(steps)
    while True:
        took = min(seconds_of(partial(run, steps)) for _ in range(2))  # the first run may wait for memory
        if took > 0.3 * seconds or steps * paths > 10**9:
            return steps
        steps = steps * 4 if took < 0.05 * seconds else int(steps * seconds / took) + 1


def ns_of_steps(runs: Iterable[Run], paths: int, repeats: int, seconds: float) -> list[list[float]]:
    """ns of a path-step for every run; a run takes about `seconds` seconds and is repeated `repeats` times."""
    runs = list(runs)
    steps = [fitted(run, paths, seconds) for run in runs]
    calls = [partial(run, count) for run, count in zip(runs, steps, strict=True)]
    found = zip(in_turn(calls, repeats), steps, strict=True)
    return [[1e9 * x / (paths * count) for x in times] for times, count in found]
