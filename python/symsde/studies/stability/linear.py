# SPDX-License-Identifier: BSD-3-Clause
"""Stiff linear modes: omega h from 0.01 to 1000, the limit of explicit steps, resonances of the step."""

from __future__ import annotations

import numpy as np

import symsde as ss

from ..expectations import Expectations
from .scenario import says, simulate
from .systems import spring, two_springs

STEPS = (0.01, 0.1, 0.5, 1.0, 2.0, 10.0, 100.0, 1000.0)  #: values of omega h
BELOW_LIMIT = (0.1, 0.5, 1.0, 1.9, 1.99)
DOUBLINGS = 40  #: number of doublings: after 2^40 steps the mean growth of the Euler pair has settled


def midpoint_factor(x: float) -> float:
    """Energy input of the midpoint rule over that of the exact equation, x = omega h."""
    return 1 / (1 + x**2 / 4)


def euler_factor(x: float) -> float:
    """Energy input of the Euler pair over that of the exact equation, averaged over long times; x < 2."""
    return 1 / (1 - x**2 / 4)


def fast_mode(quick: bool) -> Expectations:
    """A fast mode without noise, h = 0.1."""
    result = Expectations("fast_mode", "Fast linear mode, midpoint, h = 0.1")
    result.if_failed = (
        "A stepper that forms the change of q or p as a difference of large numbers loses omega h ulps a step; the "
        "change of H then grows with the square of the steps. The general stepper keeps them (`general=True`)."
    )
    steps = 2000
    for omega in (1e0, 1e2, 1e4, 1e6, 1e8):
        model = spring(omega)
        name = f"omega = {omega:.0e}"
        for general, stepper in ((True, "general stepper"), (False, "stepper chosen by the traits")):
            run = simulate(model, q0=1.0, p0=0.0, step=0.1, steps=steps, general=general)
            energy = model.value(run.q.reshape(1, -1), run.p.reshape(1, -1))
            result.at_most(name, f"change of H, {stepper}", np.abs(energy / energy[0] - 1).max(), 1e-10)
        iterations = run.report.counters["iterations"] / run.report.counters["path_steps"]
        result.between(name, "Newton iterations a step", iterations, 1, 3)
        result.same(name, "warned of h omega", says(run.report, "under-resolved"), omega * 0.1 > 1, "iff h omega > 1")
    return result


def energy_input(quick: bool) -> Expectations:
    """Noise feeds energy into a mode; the midpoint rule takes in 1/(1 + (omega h)^2/4) of it."""
    result = Expectations("energy_input", "Energy input of additive noise, midpoint")
    model = ss.models.linear_oscillator(sigma=1.0)
    paths, steps = (2**16, 64) if quick else (2**19, 256)
    sampled = []
    for h in STEPS:
        q, p = ss.step(model, "midpoint", 0.0, 0.0, h, dw=1.0)
        response = float(q[0, 0] ** 2 + p[0, 0] ** 2)
        factor, name = midpoint_factor(h), f"omega h = {h:g}"
        result.at_most(name, f"one step without sampling, / {factor:.6g} - 1", abs(response / factor - 1), 1e-12)
        found = ss.moments(model, q0=0.0, p0=0.0, step=h, steps=steps, paths=paths, seed=8, save_every=steps)
        scale = 2 / (steps * h)  # H = (p^2 + q^2)/2
        mean, error = scale * found.mean_energy[-1], scale * found.se_mean_energy[-1]
        result.within(name, "E(p^2 + q^2)/t, sampled", (mean, error), factor)
        result.same(name, "warned", says(found.report, "under-resolved"), h > 1, "iff omega h > 1")
        sampled.append(mean)
    result.curves = {"h": np.array(STEPS), "midpoint": np.array(sampled)}
    return result


def step_matrix(model, scheme: str, h: float) -> tuple[np.ndarray, np.ndarray]:
    """Matrix M (2, 2) and noise vector b (2,) of a linear step z' = M z + b dW, z = (q, p)."""
    q, p = ss.step(model, scheme, np.array([[1.0, 0.0, 0.0]]), np.array([[0.0, 1.0, 0.0]]), h,
                   dw=np.array([[0.0, 0.0, 1.0]]))  # fmt: skip
    found = np.concatenate([q, p])
    return found[:, :2], found[:, 2]


def mean_growth(matrix: np.ndarray, vector: np.ndarray, h: float) -> float:
    """E(p^2 + q^2)/t after 2^40 steps from rest: S_2n = M^n S_n (M^n)^T + S_n."""
    second = h * np.outer(vector, vector)
    power = matrix.copy()
    for _ in range(DOUBLINGS):
        second = power @ second @ power.T + second
        power = power @ power
    return float(np.trace(second) / (2.0**DOUBLINGS * h))


def euler_limit(quick: bool) -> Expectations:
    """The Euler pair is bounded below omega h = 2, and unbounded above."""
    result = Expectations("euler_limit", "Stability limit of explicit steps")
    model = ss.models.linear_oscillator(sigma=1.0)
    grown = []
    for h in BELOW_LIMIT:
        for scheme in ("symplectic_euler", "symplectic_euler_adjoint"):
            matrix, vector = step_matrix(model, scheme, h)
            growth, factor = mean_growth(matrix, vector, h), euler_factor(h)
            result.near(f"{scheme}, omega h = {h:g}", "E(p^2 + q^2)/t", growth, factor, 0.005 * factor)
        grown.append(growth)
    result.curves = {"h": np.array(BELOW_LIMIT), "euler": np.array(grown)}
    for h in (1.7, 1.9, 2.0, 2.01, 3.0):
        _beyond(result, model, h, 4000 if quick else 20000)
    return result


def _beyond(result: Expectations, model, h: float, steps: int) -> None:
    """Run into overflow, and compare with the same steps in extended precision; above 1.8 a warning is expected."""
    run = simulate(model, q0=1.0, p0=0.0, scheme="symplectic_euler", step=h, steps=steps, seed=9, save_every=steps)
    expected = overflow_step(h, ss.increments(model, step=h, steps=steps, seed=9)[:, 0, 0])
    steps = (str(n) if n >= 0 else "none" for n in (int(run.failed_step[0]), expected))
    result.same(f"omega h = {h:g}", "step that overflows", *steps, "in extended precision")
    result.same(f"omega h = {h:g}", "warned of the limit", says(run.report, "stability limit"), h >= 1.8, "from 1.8 up")


def overflow_step(h: float, drive: np.ndarray) -> int:
    """First step with a term beyond the largest double, -1 = none: [WHSB] (89)-(90) in extended precision."""
    largest = np.finfo(float).max
    wide = np.longdouble
    h, q, p = wide(h), wide(1), wide(0)
    for n, dw in enumerate(drive):
        kick = h * q
        p += wide(dw) - kick
        drift = h * p
        q += drift
        if max(abs(kick), abs(p), abs(drift), abs(q)) > largest:
            return n
    return -1


def resonances(quick: bool) -> Expectations:
    """Two hundred steps with omega h from 0.2 to 20 for a fast spring coupled to a quartic one."""
    result = Expectations("resonances", "Scan of steps for resonances")
    omega, count, steps = 50.0, 200, 1000 if quick else 20000
    x = np.geomspace(0.2, 20, count)
    model = two_springs(omega, coupling=0.1)
    increments = np.broadcast_to(x / omega, (steps, 1, count)).copy()
    start = {"q0": np.tile([[0.02], [1.0]], count), "p0": 0.0, "step": 1.0, "steps": steps, "paths": count}
    curves = {"x": x}
    for scheme in ("midpoint", "stormer_verlet"):
        run = simulate(model, scheme=scheme, increments=increments, save_every=10, **start)
        with np.errstate(over="ignore", invalid="ignore"):
            flat = [state.transpose(1, 0, 2).reshape(2, -1) for state in (run.q, run.p)]
            energy = model.value(*flat, w=np.array([0.0, 1.0])).reshape(-1, count)
            change = np.abs(energy / energy[0] - 1).max(axis=0)
        curves[scheme] = np.where(run.status == 0, change, np.inf)
        failed = int((run.status != 0).sum())
        if scheme == "midpoint":
            result.same(scheme, "steps, of 200, at which the path fails", failed, 0)
            result.at_most(scheme, "median change of H, omega h < 1", np.median(change[x < 1]), 1e-2)
            worst = int(np.argmax(change))
            result.expect(scheme, "largest change of H", f"{change[worst]:.2e} at omega h = {x[worst]:.3g}",
                          "finite at every step", np.isfinite(change).all())  # fmt: skip
        else:
            wild = ~(curves[scheme] < 1e3)
            first = x[wild].min() if wild.any() else np.inf
            result.between(scheme, "first omega h that blows up", first, 1.9, 2.1)
    result.curves = curves
    return result
