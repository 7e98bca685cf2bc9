# SPDX-License-Identifier: BSD-3-Clause
"""Moments of a longer run: those of its first steps and those from kept last states on, joined along time.

A path at step n is x_n = F_n .. F_(m+1) x_m, where F_k takes the increments of step k alone. So a run that begins at
x_m with first_step = m has the bits of the whole run from m on, if x_m is kept with its low parts. A row of moments
belongs to one saved time: those of the later run follow those of the first one, whose last row is its first.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from ..run.kept_paths import LAST
from ..run.observers.requests import Observer
from ..run.setup import Setup
from .shard_file import Shard

STEP = "step"  #: fact of a state that says after how many steps it was kept
_JOINED = ("means", "covariance", "histogram", "quantiles", "paths")  # kinds that keep numbers of each saved time alone
_BY_TIME = ("t", "n_ok", "mean", "m2")
_LARGE = 1e6  # growth of q and p at which the library warns


def join(kinds: Iterable[str]) -> bool:
    """Whether results of these kinds of observers are joined: others look at the whole of a path."""
    return all(kind in _JOINED for kind in kinds)


def begins(options: Mapping[str, Any], observers: Mapping[str, Observer], state: Shard, *, grouped: bool) -> bool:
    """Whether a longer run begins at the end of a shard: not if a path of it failed, whose state is no start; nor if
    groups are collected at the common divisor of unequal times, which changes with them."""
    whole = "last_q" in state.arrays and not state.facts["failed"] and not state.facts.get("stopped")
    unequal = options.get("save_at") is not None
    return whole and not (unequal and grouped) and join(x.KIND for x in observers.values())


def options_from(options: Mapping[str, Any], state: Shard) -> dict[str, Any]:
    """The options of the steps after this state."""
    q, p, *low = (state.arrays.get(name) for name in LAST)
    begun = {"first_step": options.get("first_step", 0) + state.facts[STEP], "q0": q, "p0": p}
    here = {**options, **begun, "steps": int(options["steps"]) - state.facts[STEP]}
    if options.get("save_at") is not None:
        first = options.get("t0", 0.0) + begun["first_step"] * options["step"]
        here["save_at"] = [first, *options["save_at"][len(state.arrays["t"]) :]]
    return here if low[0] is None else {**here, "q0_low": low[0], "p0_low": low[1]}


def fits(before: Shard, later: Shard, *, unequal: bool) -> bool:
    """Whether the later moments begin with the row that the first ones end with; where saved times are unequal, these
    may have ended before their last state."""
    if unequal and before.arrays["t"][-1] != later.arrays["t"][0]:
        return True
    pairs = ((before.arrays[name][-1], later.arrays[name][0]) for name in _BY_TIME)
    return all(np.array_equal(*pair, equal_nan=True) for pair in pairs)


def may_have_grown(setup: Setup, before: Shard, later: Shard) -> bool:
    """Whether a path may count as grown in the whole run, which compares its end with its start and with a state that
    is not kept. One that is within a factor of its start does not, in q or in p. A path that begins at rest in both is
    judged by its two parts."""
    grew = later.arrays["status"] == 0
    rests = True
    for start, end in ((setup.q0, "last_q"), (setup.p0, "last_p")):
        first = np.abs(start).max(axis=0)
        grew = grew & (np.abs(later.arrays[end]).max(axis=0) / _LARGE > first)
        rests = rests & (first == 0)
    either = before.facts["grown"] or later.facts["grown"]
    return bool((grew & ~rests).any() or ((grew & rests).any() and either))


def joined(before: Shard, later: Shard, facts: Mapping[str, Any], kinds: Mapping[str, str], groups: int) -> Shard:
    """The shard of the whole run. facts: of the whole run before its first step; kinds: of the observers, by name;
    groups: number of groups of paths, 1 without groups."""
    arrays = dict(later.arrays)
    for name in _BY_TIME:
        arrays[name] = np.concatenate([before.arrays[name], later.arrays[name][1:]])
    times = len(before.arrays["t"]), len(later.arrays["t"])
    for name, kind in kinds.items():
        counts, sums = (f"observed.{name}.{what}" for what in ("counts", "sums"))
        # One table of times for each group; those of chosen paths have one for each path of each group.
        tables = later.arrays[counts].size if kind == "paths" else groups
        for key in (sums,) if kind == "paths" else (counts, sums):
            first, more = (x.arrays[key].reshape(tables, n, -1) for x, n in zip((before, later), times, strict=True))
            arrays[key] = np.concatenate([first, more[:, 1:]], axis=1).ravel()
    counters = {name: n + later.facts["counters"][name] for name, n in before.facts["counters"].items()}
    found = {**facts, "counters": counters, "failed": later.facts["failed"], "grown": 0}
    found["lapack"] = later.facts["lapack"] or before.facts["lapack"]
    found.pop("stopped", None)
    return Shard(arrays, found | {key: later.facts[key] for key in ("stopped",) if key in later.facts})
