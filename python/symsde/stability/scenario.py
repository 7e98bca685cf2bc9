# SPDX-License-Identifier: BSD-3-Clause
"""What a scenario hands over: checks, each with what was expected, and curves for the figure."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field
from typing import Any

import numpy as np

import symsde as ss

SIGMAS = 4.9  #: standard errors allowed: one false alarm in 10^4 runs of a hundred such checks
EPS = float(np.finfo(float).eps)


@dataclass(frozen=True)
class Check:
    """One line of the table."""

    scenario: str  #: number
    name: str
    expected: str
    observed: str
    criterion: str
    passed: bool


@dataclass
class Scenario:
    """One scenario; curves go into the figure only."""

    number: str
    title: str
    checks: list[Check] = field(default_factory=list)
    curves: dict[str, Any] = field(default_factory=dict)
    if_failed: str = ""  #: the known cause, said where a criterion fails

    def add(self, name: str, expected: object, observed: object, criterion: str, passed: object) -> None:
        """Add a line."""
        self.checks.append(Check(self.number, name, str(expected), str(observed), criterion, bool(passed)))

    def at_most(self, name: str, observed: float, bound: float, expected: object = 0) -> None:
        """Expect a number of at most `bound`."""
        self.add(name, expected, f"{observed:.2e}", f"<= {bound:.3g}", observed <= bound)

    def within(self, name: str, mean: float, error: float, expected: float) -> None:
        """Expect a mean within 4.9 of its standard errors."""
        passed = abs(mean - expected) <= SIGMAS * error
        self.add(name, f"{expected:.6g}", f"{mean:.6g} +- {error:.1g}", f"within {SIGMAS} s.e.", passed)

    def fraction(self, name: str, count: int, total: int, expected: float) -> None:
        """Expect a fraction within 4.9 standard errors of a probability."""
        self.within(name, count / total, max(np.sqrt(expected * (1 - expected) / total), 1e-300), expected)


def simulate(model, **options):
    """Integrate; failed paths are what is looked at here, not warned of."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ss.PathsFailedWarning)
        return ss.simulate(model, **options)


def moments(model, **options):
    """Likewise for moments."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ss.PathsFailedWarning)
        return ss.moments(model, **options)


def step(model, *arguments, **options):
    """Likewise for one step."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ss.PathsFailedWarning)
        return ss.step(model, *arguments, **options)


def says(report, words: str) -> bool:
    """Whether a run was warned of something before it began."""
    return any(words in warning for warning in report.warnings)
