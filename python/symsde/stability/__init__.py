# SPDX-License-Identifier: BSD-3-Clause
"""Stiff and extreme cases: what was expected, what was observed, and whether the criterion holds.

One function a scenario, through the public interface of symsde only.
"""

from __future__ import annotations

from collections.abc import Iterator

from . import failures, linear, noise, nonlinear, rounding
from .scenario import Check, Scenario

SCENARIOS = (
    linear.fast_mode,
    linear.energy_input,
    linear.euler_limit,
    linear.resonances,
    nonlinear.quartic_steps,
    nonlinear.several_roots,
    noise.stiff_multiplicative,
    noise.no_noise,
    noise.vanishing_noise,
    noise.squeezing,
    noise.truncation,
    rounding.invariant_drift,
    rounding.nonlinear_drift,
    rounding.tiny_steps,
    rounding.round_trip,
    failures.overflow,
    failures.callbacks,
    failures.singular_matrices,
)

__all__ = ["SCENARIOS", "Check", "Scenario", "scenarios"]


def scenarios(quick: bool = False) -> Iterator[Scenario]:
    """Run all scenarios, each as it is ready."""
    for function in SCENARIOS:
        yield function(quick)
