# SPDX-License-Identifier: BSD-3-Clause
"""Noise up to and beyond the limit of solvable implicit steps; truncated and vanishing noise."""

from __future__ import annotations

import math

import numpy as np

import symsde as ss

from ..expectations import Expectations
from .scenario import EPS, says, simulate
from .systems import noisy_spring, squeeze

TRUNCATED = {0.01: 4.29, 0.1: 3.03, 10.0: 3.03}  #: step -> cut c = sqrt(4 |ln h|), for steps at which runs are allowed
REFUSED = (0.2, 0.5, 0.9, 0.99, 1.0, 1.5)  #: steps at which c < 3
STILL = 0.0  #: increment of the case no_noise
TINY = (1e-300, 1e-160, 1e-17)


def clip_probability(cut: float) -> float:
    """The probability P(|xi| > c)."""
    return math.erfc(cut / math.sqrt(2))


def lost_variance(cut: float) -> float:
    """The lost variance 1 - E clip(xi)^2."""
    density = math.sqrt(2 / math.pi) * math.exp(-(cut**2) / 2)
    return clip_probability(cut) * (1 - cut**2) + cut * density


def stiff_multiplicative(quick: bool) -> Expectations:
    """U'' = 1e6 and noise sigma q^2/2: solvable while 1 + h^2 U''/4 + h sigma dW/4 > 0."""
    result = Expectations("stiff_multiplicative", "Stiff spring with multiplicative noise, midpoint")
    stiffness, paths = 1e6, 10**5 if quick else 10**6
    for sigma, h in ((1e0, 0.1), (1e2, 0.1), (1e3, 0.1), (1e5, 0.01)):
        model = noisy_spring(stiffness, sigma)
        run = simulate(model, q0=1.0, p0=0.5, step=h, steps=1, paths=paths, seed=14)
        dw = ss.increments(model, step=h, steps=1, paths=paths, seed=14)[0, 0]
        pivot = 1 + h**2 * stiffness / 4 + h * sigma * dw / 4
        probability = 0.5 * math.erfc((1 + h**2 * stiffness / 4) / (h * sigma * math.sqrt(h) / 4) / math.sqrt(2))
        name = f"sigma = {sigma:.0e}, h = {h:g}"
        result.fraction(name, "draws beyond solvability", int((pivot <= 0).sum()), paths, probability)
        rate = h * stiffness + sigma * dw
        exact = (0.5 - rate * (1 + h * 0.5 / 4)) / pivot  # p' of the linear equations, solved by hand
        error = np.abs(run.p[-1, 0] - exact) / (np.abs(exact) + rate.std() / np.abs(pivot) + 1)
        good = run.status == 0
        result.at_most(name, "distance to the root of the equations", error[good].max(), 1e-9)
        result.same(name, "paths that fail", int((~good).sum()), 0, "the equations are linear")
        if probability > 1e-3:
            result.same(name, "warned before the run", says(run.report, "so strong that some implicit steps"), True)
    return result


def squeezing(quick: bool) -> Expectations:
    """H_1 = sigma q p with truncated increments, sigma c sqrt(h)/2 from 0.5 to 2.4."""
    result = Expectations("squeezing", "Noise up to and beyond the bound of solvability, truncated")
    h, steps, paths = 0.1, 10, 10**4 if quick else 10**5
    cut = math.sqrt(4 * abs(math.log(h)))
    found, expected = [], []
    bounds = (0.5, 0.96, 1.07, 2.4)
    for bound in bounds:
        sigma = 2 * bound / (cut * math.sqrt(h))
        run = simulate(squeeze(sigma), q0=1.0, p0=0.0, step=h, steps=steps, paths=paths, seed=17, save_every=steps,
                       truncation=(2, 1.0), threads=1)  # fmt: skip
        wrong = int((run.q[-1, 0] < 0).sum())
        probability = sign_probability(sigma, h, steps) if bound > 1 else 0.0
        name = f"sigma c sqrt(h)/2 = {bound:g}"
        result.fraction(name, "paths with the wrong sign of q", wrong, paths, probability)
        warned = says(run.report, "so strong that some implicit steps")
        result.same(name, "warned", warned, bound >= 1, "iff 1 or more")
        found.append(wrong / paths)
        expected.append(probability)
    result.curves = {"bound": bounds, "wrong": np.array(found), "expected": np.array(expected)}
    return result


def sign_probability(sigma: float, h: float, steps: int) -> float:
    """Probability of an odd number of factors (1 + a)/(1 - a) below 0, where |a| = sigma |dW|/2 > 1."""
    flip = clip_probability(2 / (sigma * math.sqrt(h)))
    return (1 - (1 - 2 * flip) ** steps) / 2


def truncation(quick: bool) -> Expectations:
    """Truncated increments lose variance; near h = tau they would lose all noise."""
    result = Expectations("truncation", "Truncated increments, l = 2, tau = 1")
    model = ss.models.kubo(sigma=0.01)
    steps, paths = (1000, 1000) if quick else (1000, 10000)
    for h, printed in TRUNCATED.items():
        cut, name = math.sqrt(4 * abs(math.log(h))), f"h = {h:g}"
        result.same(name, "cut c", round(cut, 2), printed, "sqrt(4 |ln h|)")
        run = simulate(model, q0=1.0, p0=0.0, step=h, steps=1, truncation=(2, 1.0))
        lost = run.report.lost_variance
        result.near(name, "variance lost, reported", lost, lost_variance(cut), 5e-4 * lost)
        dw = ss.increments(model, step=h, steps=steps, paths=paths, seed=18, truncation=(2, 1.0)) / math.sqrt(h)
        clipped = int((np.abs(dw) >= cut * (1 - 1e-12)).sum())
        result.fraction(name, "share of clipped draws", clipped, dw.size, clip_probability(cut))
        squares = np.square(dw)
        result.within(name, "variance", (squares.mean(), squares.std() / math.sqrt(dw.size)), 1 - lost)
    for h in REFUSED:
        try:
            simulate(model, q0=1.0, p0=0.0, step=h, steps=1, truncation=(2, 1.0))
            told = "accepted"
        except ss.SymsdeError as error:
            told = "refused" if "variance" in str(error) else str(error)
        result.same(f"h = {h:g}", f"c = {math.sqrt(4 * abs(math.log(h))):.2f}", told, "refused", "where c < 3")
    return result


def no_noise(quick: bool) -> Expectations:
    """sigma = 0 is the deterministic scheme, bit for bit, and draws nothing."""
    result = Expectations("no_noise", "sigma = 0")
    steps = 50
    options = {"q0": 1.0, "p0": 0.5, "step": 0.1, "steps": steps, "paths": 9, "threads": 1}
    zeros = np.full((steps, 1), STILL)
    tried, different, drawn, distances = 0, [], [], [0.0]
    for name in ss.schemes.names():
        info = ss.schemes.get(name).info
        if info.form == "Euler-Maruyama" or info.orders["additive"].value != 1:
            continue  # Ito drift, brackets or laws of these schemes need more than an increment
        for model in (ss.models.kubo, ss.models.pendulum):
            try:
                silent = simulate(model(sigma=0.0), scheme=name, **options)
                driven = simulate(model(sigma=0.0), scheme=name, increments=zeros, **options)
                still = simulate(model(sigma=0.3), scheme=name, increments=zeros, **options)
            except ss.errors.IncompatibleError:
                continue
            tried += 1
            # noise of strength zero may lead to a cheaper stepper, which rounds differently
            same = [driven, *([still] if still.report.stepper == silent.report.stepper else [])]
            if not all(np.array_equal(run.q, silent.q) and np.array_equal(run.p, silent.p) for run in same):
                different.append(f"{name} on {model.__name__}")
            distances.append(max(np.abs(still.q - silent.q).max(), np.abs(still.p - silent.p).max()))
            drawn += [name] if silent.report.counters["normals"] else []
    result.at_least("zero increments", "pairs of scheme and model", tried, 21)
    result.same("zero increments", "pairs with other bits, one stepper", ", ".join(different) or "none", "none")
    result.at_most("stepper of sigma = 0.3", "largest distance", max(distances), steps * EPS)
    result.same("sigma = 0", "schemes that draw normals", ", ".join(drawn) or "none", "none")
    return result


def vanishing_noise(quick: bool) -> Expectations:
    """Noise below rounding changes nothing and needs no additional work."""
    result = Expectations("vanishing_noise", "sigma = 1e-300 .. 1e-17")
    steps, paths = 1000, 4096 if quick else 16384
    for name, model in (("kubo", ss.models.kubo), ("pendulum", ss.models.pendulum)):
        options = {"q0": 1.0, "p0": 0.5, "step": 0.01, "steps": steps, "paths": paths, "threads": 1}
        options["save_every"] = steps
        still, usual = (simulate(model(sigma=sigma), **options) for sigma in (0.0, 0.1))
        for sigma in TINY:
            run = simulate(model(sigma=sigma), **options)
            moved = max(np.abs(run.q[-1] - still.q[-1]).max(), np.abs(run.p[-1] - still.p[-1]).max())
            result.at_most(f"{name}, sigma = {sigma:g}", "distance to sigma = 0", moved, steps * EPS)
            result.at_most(f"{name}, sigma = {sigma:g}", "work by that of sigma = 0.1", _work(run) / _work(usual), 1)
    return result


def _work(run: ss.Run) -> int:
    """Counts of evaluations, iterations and solves."""
    return sum(run.report.counters[name] for name in ("gradients", "hessians", "iterations", "solves", "damped"))
