# SPDX-License-Identifier: BSD-3-Clause
"""What one experiment hands over: its parameters, its numbers, and what was expected of them."""

from dataclasses import dataclass, field

import numpy as np


@dataclass
class Check:
    """One line of the table; `passed` is None where a number is reported and nothing is expected of it."""

    equations: str
    quantity: str
    measured: str
    expected: str
    passed: bool | None


@dataclass
class Experiment:
    """One experiment of the paper. `numbers` go to results.json, `curves` only into the figure."""

    name: str
    title: str
    seed: int
    parameters: dict
    numbers: dict = field(default_factory=dict)
    curves: dict = field(default_factory=dict)
    checks: list[Check] = field(default_factory=list)

    def at_most(self, equations, quantity, value, bound):
        """Expect value <= bound."""
        self._add(equations, quantity, f"{value:.2e}", f"<= {bound:.0e}", value <= bound)

    def at_least(self, equations, quantity, value, bound):
        """Expect value >= bound."""
        self._add(equations, quantity, f"{value:.4g}", f">= {bound:.4g}", value >= bound)

    def between(self, equations, quantity, value, low, high):
        """Expect low <= value <= high."""
        self._add(equations, quantity, f"{value:.4g}", f"{low:g} to {high:g}", low <= value <= high)

    def near(self, equations, quantity, value, expected, tolerance):
        """Expect |value - expected| <= tolerance."""
        text = f"{expected:.5g} +- {tolerance:.1g}"
        self._add(equations, quantity, f"{value:.5g}", text, abs(value - expected) <= tolerance)

    def within_errors(self, equations, quantity, estimate, expected, factor=5.0):
        """Expect a mean (value, standard error) within `factor` standard errors of its expectation.

        Five standard errors: a false alarm in two million normal deviates.
        """
        value, error = estimate
        text = f"{expected:.5g} within {factor:g} s.e."
        self._add(equations, quantity, f"{value:.5g} +- {error:.1g}", text, abs(value - expected) <= factor * error)

    def beyond_errors(self, equations, quantity, estimate, excluded, factor=5.0):
        """Expect a mean (value, standard error) to differ from a value by more than `factor` standard errors."""
        value, error = estimate
        text = f"not {excluded:.5g}, > {factor:g} s.e."
        self._add(equations, quantity, f"{value:.5g} +- {error:.1g}", text, abs(value - excluded) > factor * error)

    def report(self, equations, quantity, measured, expected=""):
        """Print a number of which nothing is required."""
        self._add(equations, quantity, measured, expected, None)

    def _add(self, equations, quantity, measured, expected, passed):
        self.checks.append(Check(equations, quantity, measured, expected, None if passed is None else bool(passed)))


def plain(value):
    """Turn NumPy arrays and scalars into what JSON holds; not a number becomes None."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [plain(item) for item in value]
    if isinstance(value, (bool, np.bool_)):
        return bool(value)
    if isinstance(value, (int, np.integer)):
        return int(value)
    if isinstance(value, (float, np.floating)):
        return float(value) if np.isfinite(value) else None
    return value
