# SPDX-License-Identifier: BSD-3-Clause
"""Stiff and extreme cases: expected values, measured values, and whether they agree.

Each scenario is a function that uses the public interface of symsde only.
"""

from __future__ import annotations

from . import bifurcation, failures, limits, linear, long_time, noise, nonlinear, rounding
from .one_step_map import FixedPoint as FixedPoint
from .one_step_map import fixed_points as fixed_points

SCENARIOS = (
    limits.stability_limits,
    bifurcation.bifurcations,
    long_time.long_time,
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
