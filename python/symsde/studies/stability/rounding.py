# SPDX-License-Identifier: BSD-3-Clause
"""Rounding: drift of an invariant by stopping rule and summation, round trips, tiny steps."""

from __future__ import annotations

import numpy as np

import symsde as ss

from ..expectations import Expectations
from .scenario import says, simulate
from .systems import turning

SEEDS = 32
RULES = {  #: name of a rule -> options of `simulate`
    "Newton, plain": {},
    "Newton, compensated": {"compensated": True},
    "fixed_point = 4, plain": {"fixed_point": 4},
    "fixed_point = 4, compensated": {"fixed_point": 4, "compensated": True},
    "fixed_point = 16, plain": {"fixed_point": 16},
}
WALK = 0.6  #: largest slope that counts as a random walk
#: rule -> bound of the drift at 1e7 steps
BOUNDS = {"Newton, plain": 1e-12, "Newton, compensated": 1e-13, "fixed_point = 16, plain": 1e-12}


def drifts(run) -> np.ndarray:
    """Rms over the paths of the relative change of p^2 + q^2 at the saved times, without the first."""
    square = run.q[:, 0] ** 2 + run.p[:, 0] ** 2
    return np.sqrt(np.mean(np.square(square[1:] / square[0] - 1), axis=1))


def slope(steps: np.ndarray, values: np.ndarray) -> float:
    """Slope of log values over log steps, at steps that are evenly spaced on the logarithmic scale."""
    chosen = np.unique(np.geomspace(1, len(steps), 40).astype(int)) - 1
    return float(np.polyfit(np.log(steps[chosen]), np.log(np.maximum(values[chosen], 1e-17)), 1)[0])


def invariant_drift(quick: bool) -> Expectations:
    """p^2 + q^2 of Kubo's oscillator over 10^7 steps: its error grows like a random walk, not linearly."""
    result = Expectations("invariant_drift", "Drift of an invariant, midpoint on kubo, h = 0.01, sigma = 0.5")
    total = 10**5 if quick else 10**7
    every = total // 1000
    model = ss.models.kubo(a=1.0, sigma=0.5)
    steps = np.arange(1, 1001) * every
    result.curves = {"steps": steps}
    for rule, options in RULES.items():
        run = simulate(model, q0=1.0, p0=0.0, step=0.01, steps=total, paths=SEEDS, seed=20, save_every=every, **options)
        drift = drifts(run)
        result.curves[rule] = drift
        found = slope(steps, drift)
        if rule in BOUNDS:
            _walk(result, rule, found, drift[-1], total)
        else:
            result.at_least(rule, "growth as steps^k, a line: k", found, 0.9)
            result.report(rule, f"drift after {total:.0e} steps", f"{drift[-1]:.1e}")
    return result


def _walk(result: Expectations, rule: str, exponent: float, last: float, total: int) -> None:
    """Expect the bounds at 10^7 steps, scaled by the square root of the number of steps."""
    result.at_most(rule, "growth as steps^k, a random walk: k", exponent, WALK)
    result.at_most(rule, f"drift after {total:.0e} steps", last, BOUNDS[rule] * np.sqrt(total / 1e7))


def nonlinear_drift(quick: bool) -> Expectations:
    """The invariant of a nonlinear problem, where Newton has to iterate."""
    result = Expectations("nonlinear_drift", "Drift of an invariant, midpoint on H = I + I^2/2, h = 0.01, sigma = 0.5")
    total = 2000 if quick else 10**5
    every = total // 100
    steps = np.arange(1, 101) * every
    for rule, options in {"Newton, plain": {}, "Newton, compensated": {"compensated": True}}.items():
        run = simulate(turning(0.5), q0=1.0, p0=0.0, step=0.01, steps=total, paths=SEEDS, seed=21, save_every=every,
                       **options)  # fmt: skip
        drift = drifts(run)
        _walk(result, rule, slope(steps, drift), drift[-1], total)
    return result


def round_trip(quick: bool) -> Expectations:
    """Steps forward, then back with -h and the increments in reversed order with opposite signs."""
    result = Expectations("round_trip", "Round trips of symmetric schemes")
    steps, paths = 1000 if quick else 10**4, 16
    # the noise is so small that no path nears the unstable point, where rounding errors grow like exp(omega t)
    calm = ss.models.synchrotron(sigma1=0.05, sigma2=0.05)
    for name, model in (("kubo", ss.models.kubo()), ("synchrotron", calm)):
        drive = ss.increments(model, step=0.01, steps=steps, paths=paths, seed=22)
        for scheme in ("midpoint", "stormer_verlet", "gauss2"):
            common = {"scheme": scheme, "steps": steps, "paths": paths, "save_every": steps}
            out = simulate(model, q0=0.5, p0=0.5, step=0.01, increments=drive, **common)
            back = simulate(model, q0=out.q[-1], p0=out.p[-1], step=-0.01, increments=-drive[::-1], **common)
            distance = np.hypot(back.q[-1, 0] - 0.5, back.p[-1, 0] - 0.5).max()
            result.at_most(f"{name}, {scheme}", f"distance after {steps:.0e} steps and back", distance, 1e-11)
    return result


def tiny_steps(quick: bool) -> Expectations:
    """h = 1e-16 from q = p = 1, where every increment is below the rounding error of the state."""
    result = Expectations("tiny_steps", "Increments below rounding, h = 1e-16")
    steps = 10**6
    model = ss.models.kubo(a=1.0, sigma=0.0)
    common = {"q0": 1.0, "p0": 1.0, "step": 1e-16, "steps": steps, "save_every": steps}
    kept = simulate(model, compensated=True, **common)
    moved = (kept.q[-1, 0, 0] - 1) + kept.q_low[0, 0]
    result.near("compensated", "q moves by", moved, 1e-10, 1e-15)
    for name, run in (("plain", simulate(model, **common)), ("compensated", kept)):
        result.same(name, "warned before the run", says(run.report, "below the rounding"), name == "plain")
    return result
