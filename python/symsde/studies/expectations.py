# SPDX-License-Identifier: BSD-3-Clause
"""Expected numbers, and whether results meet them: the lines of the reports of `symsde paper` and `symsde stability`.

Means of random numbers are expected within 4.9 of their standard errors: for a normal mean one such check in a million
is a false alarm. A number that is not finite meets no expectation.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from time import perf_counter
from typing import Any

from ..show import tables

STANDARD_ERRORS = 4.9  #: most standard errors between a mean and its expected value
FALSE_ALARM = math.erfc(STANDARD_ERRORS / math.sqrt(2))  #: rate of false alarms of one such check, 9.6e-7
VERDICTS = {True: "ok", False: "FAILED", None: "-"}


@dataclass(frozen=True)
class Check:
    """One line of a report; `passed` is None if a number is reported without an expectation."""

    about: str  #: equations of the paper, or a description of the case
    quantity: str
    measured: str
    expected: str
    passed: bool | None

    def cells(self) -> tuple[str, ...]:
        """The cells of the table's row, the verdict last."""
        return self.about, self.quantity, self.measured, self.expected, VERDICTS[self.passed]


@dataclass
class Expectations:
    """The checks of one experiment or scenario. `curves` are used in figures only."""

    name: str
    title: str
    checks: list[Check] = field(default_factory=list)
    curves: dict[str, Any] = field(default_factory=dict)
    if_failed: str = ""  #: known cause, printed if an expectation is not met

    def expect(self, about: str, quantity: str, measured: object, expected: object, holds: object) -> None:
        """Add a check that the caller has judged."""
        self.checks.append(Check(about, quantity, str(measured), str(expected), bool(holds)))

    def report(self, about: str, quantity: str, measured: object, expected: str = "") -> None:
        """Add a number without an expectation."""
        self.checks.append(Check(about, quantity, str(measured), expected, None))

    def at_most(self, about: str, quantity: str, value: float, bound: float) -> None:
        """Expect value <= bound."""
        self.expect(about, quantity, f"{value:.2e}", f"<= {bound:.3g}", -math.inf < value <= bound)

    def at_least(self, about: str, quantity: str, value: float, bound: float) -> None:
        """Expect value >= bound."""
        self.expect(about, quantity, f"{value:.4g}", f">= {bound:.4g}", bound <= value < math.inf)

    def between(self, about: str, quantity: str, value: float, low: float, high: float) -> None:
        """Expect low <= value <= high."""
        self.expect(about, quantity, f"{value:.4g}", f"{low:g} to {high:g}", low <= value <= high)

    def near(self, about: str, quantity: str, value: float, expected: float, tolerance: float) -> None:
        """Expect |value - expected| <= tolerance."""
        text = f"{expected:.6g} +- {tolerance:.1g}"
        self.expect(about, quantity, f"{value:.6g}", text, abs(value - expected) <= tolerance)

    def within(self, about: str, quantity: str, estimate: tuple[float, float], expected: float) -> None:
        """Expect a mean (value, standard error) within STANDARD_ERRORS of the expected value."""
        text = f"{expected:.6g} within {STANDARD_ERRORS:g} s.e."
        self.expect(about, quantity, _shown(estimate), text, -math.inf < _beyond(estimate, expected) <= 0)

    def beyond(self, about: str, quantity: str, estimate: tuple[float, float], excluded: float) -> None:
        """Expect a mean (value, standard error) to differ from a value by more than STANDARD_ERRORS."""
        text = f"not {excluded:.6g}, beyond {STANDARD_ERRORS:g} s.e."
        self.expect(about, quantity, _shown(estimate), text, 0 < _beyond(estimate, excluded) < math.inf)

    def fraction(self, about: str, quantity: str, count: int, total: int, probability: float) -> None:
        """Expect a share of draws within STANDARD_ERRORS of its probability; if the probability is 0 or 1, exactly."""
        error = math.sqrt(probability * (1 - probability) / total)
        self.within(about, quantity, (count / total, error), probability)

    def same(self, about: str, quantity: str, measured: object, expected: object, why: str = "") -> None:
        """Expect the measured and the expected value to be equal; `why` names the source of the expected value."""
        text = f"{_word(expected)} ({why})" if why else _word(expected)
        self.expect(about, quantity, _word(measured), text, measured == expected)


def carry_out(cases: Iterable[Callable[[], Expectations]], head: str) -> list[Expectations]:
    """Carry out experiments or scenarios, and print each on the terminal as soon as it is finished."""
    found = []
    for case in cases:
        begin = perf_counter()
        found.append(case())
        print(block(found[-1], head, perf_counter() - begin), flush=True)
    return found


def count(found: list[Expectations], verdict: bool | None) -> int:
    """The number of checks with this verdict."""
    return sum(check.passed is verdict for part in found for check in part.checks)


def block(found: Expectations, head: str, seconds: float) -> str:
    """One experiment or scenario for the terminal; `head` is the title of the first column."""
    rows = [check.cells() for check in found.checks]
    return f"\n{found.title}   [{seconds:.1f} s]\n{tables.terminal(_head(head), rows)}"


def section(found: Expectations, head: str) -> str:
    """One experiment or scenario as a Markdown table, with the known cause of a failure."""
    rows = [[*check.cells()[:-1], check.cells()[-1].replace("FAILED", "**FAILED**")] for check in found.checks]
    failed = any(check.passed is False for check in found.checks)
    return tables.markdown(_head(head), rows) + (f"\n{found.if_failed}\n" if found.if_failed and failed else "")


def summary(found: list[Expectations]) -> str:
    """The failed checks again, and the counts."""
    lines = [
        f"FAILED {part.title}: {check.about} {check.quantity.strip()}: {check.measured}, expected {check.expected}"
        for part in found
        for check in part.checks
        if check.passed is False
    ]
    return "\n".join([*lines, f"{count(found, True)} expectations met, {count(found, False)} failed"])


def _head(first: str) -> tuple[str, ...]:
    return first, "quantity", "measured", "expected", "verdict"


def _beyond(estimate: tuple[float, float], value: float) -> float:
    """Distance of a mean from a value, minus the allowed standard errors; infinite or NaN if one of the numbers is."""
    mean, error = estimate
    return abs(mean - value) - STANDARD_ERRORS * error


def _shown(estimate: tuple[float, float]) -> str:
    return f"{estimate[0]:.6g} +- {estimate[1]:.1g}"


def _word(value: object) -> str:
    if value is None or value == []:
        return "none"
    return {True: "yes", False: "no"}[value] if isinstance(value, bool) else str(value)
