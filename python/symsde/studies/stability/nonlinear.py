# SPDX-License-Identifier: BSD-3-Clause
"""Huge steps in nonlinear potentials: whether Newton converges, and whether the root is unique."""

from __future__ import annotations

import numpy as np

import symsde as ss

from ..expectations import Expectations
from .scenario import EPS, says, simulate
from .systems import double_well, quartic

MOST = 60  #: most Newton iterations


def quartic_steps(quick: bool) -> Expectations:
    """U = q^4/4 from q0 = 1e-3 .. 1e6 with h = 1e-3 .. 1e6, from zero increments."""
    result = Expectations("quartic_steps", "Newton on the quartic oscillator, midpoint")
    starts, sizes = (1e-3, 1.0, 1e3, 1e6), (1e-3, 0.1, 10.0, 1e6)
    counts = np.zeros((4, 4))
    for i, q0 in enumerate(starts):
        for j, h in enumerate(sizes):
            run = simulate(quartic(clocked=True), q0=q0, p0=0.0, step=1.0, steps=1, increments=np.array([[h]]),
                           max_iter=MOST)  # fmt: skip
            counts[i, j] = run.report.counters["iterations"]
            left = residual(q0, h, run.q[-1, 0, 0], run.p[-1, 0, 0])
            name = f"q0 = {q0:g}, h = {h:g}"
            passed = run.status[0] == 0 and counts[i, j] <= MOST
            result.expect(name, "iterations", f"{counts[i, j]:.0f}", f"solved, <= {MOST}", passed)
            result.at_most(name, "residual over its largest terms", left, 4 * EPS)
    result.curves = {"q0": starts, "h": sizes, "iterations": counts}
    return result


def residual(q0: float, h: float, q: float, p: float, p0: float = 0.0) -> float:
    """Residual of q - q0 = h (p0 + p)/2 and p - p0 = -h ((q0 + q)/2)^3, relative to the largest term of each."""
    force, drift = h * ((q0 + q) / 2) ** 3, h * (p0 + p) / 2
    first = abs(q - q0 - drift) / max(abs(q), abs(q0), abs(drift))
    # a rounding error of q alone changes the force by 3 h ((q0 + q)/2)^2 eps (|q0| + |q|)/2
    scale = max(abs(p), abs(p0), abs(force), 1.5 * h * ((q0 + q) / 2) ** 2 * (abs(q0) + abs(q)))
    return max(first, abs(p - p0 + force) / scale)


def several_roots(quick: bool) -> Expectations:
    """Pendulum and double well with h = 1.9 .. 30; above 2 the root may not be unique."""
    result = Expectations("several_roots", "Uniqueness of the implicit step")
    count = 64 if quick else 512
    grid = np.linspace(-3, 3, count)
    grid[0] = 0.0  # warnings use the first path: it starts at the top, or where the pendulum is stiffest
    for name, model in (("pendulum", ss.models.pendulum(sigma=0.0)), ("double well", double_well())):
        for h in (1.9, 2.1, 5.0, 30.0):
            options = {"q0": grid[None], "p0": 0.5, "step": h, "steps": 20, "paths": count}
            one, two = (simulate(model, threads=threads, **options) for threads in (1, 2))
            result.same(f"{name}, h = {h:g}", "warned of several roots", says(one.report, "several solutions"),
                        h**2 / 4 >= 1, "iff h^2 max(-U'')/4 >= 1")  # fmt: skip
            same = np.array_equal(one.q, two.q, equal_nan=True) and np.array_equal(one.status, two.status)
            kept = int((one.status == 0).sum())
            result.same(f"{name}, h = {h:g}", f"1 and 2 threads: same bits ({kept} of {count} paths ok)", same, True)
    return result
