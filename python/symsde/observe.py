# SPDX-License-Identifier: BSD-3-Clause
"""Streaming observers: statistics that a run keeps while it runs, in memory independent of paths and steps.

    wanted = {"x": ss.observe.Histogram("q_1", -3, 3, 60), "loss": ss.observe.Passage("q_1", within=2.5)}
    found = ss.moments(model, ..., observers=wanted)
    found.observed["x"].share, found.observed["x"].se_share     # (time, slot), with standard errors
    found.observed["loss"].lost                                 # (time,), share of the paths that left |q_1| < 2.5

Values are named as in `Moments.columns`: q_1, p_1, .., energy, and the observables of the run. Results of shards merge
exactly: any threads, blocks and shards give the same bits (docs/observers.md).

`temperature` gives observables, and `temperatures` makes the kinetic and the configurational temperature of them.
"""

from .run.observers.observer_results import Observed
from .run.observers.requests import (
    Autocorrelation,
    Covariance,
    Extremes,
    Histogram,
    Observer,
    Passage,
    Paths,
    Quantiles,
)
from .run.temperature import temperature, temperatures

__all__ = [
    "Autocorrelation",
    "Covariance",
    "Extremes",
    "Histogram",
    "Observed",
    "Observer",
    "Passage",
    "Paths",
    "Quantiles",
    "temperature",
    "temperatures",
]
