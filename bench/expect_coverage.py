# SPDX-License-Identifier: BSD-3-Clause
"""Coverage and cost of the intervals of `symsde.expect` on scenes whose mean is known.

    .venv/bin/python bench/expect_coverage.py [--repeats 1000] [--pilots 250] [--narrower N] [--scenes WORD]
    .venv/bin/python bench/expect_coverage.py --long [--repeats 160] [--pilots 40] [--narrower N] [--scenes WORD]
    .venv/bin/python bench/expect_coverage.py --cost 8 [--repeats 5] [--scenes WORD] [--out FILE.json]

All means but one are known exactly; the reference of the last scene is a run of 2^24 paths by another scheme, whose
standard error is printed. Coverage is the share of answers whose interval holds the mean, with its standard error. A
pilot takes longer than most answers here, so each pilot serves several answers, which have seeds and paths of their
own; the standard error allows for the shared pilot. --narrower N asks for intervals N times as narrow, which Sobol
points then reach more often.

--long takes scenes of horizons from 1 to 1000 and of rare events instead. Their references, where there is no formula,
are runs of 2^16 paths by chin4a at fine steps.

--cost N asks for intervals N times as narrow, and prints the cost of answers, with their pilots, over the best choice
by hand: the cheapest of all schemes, methods and steps that a pilot of eight times the paths allows, executed and
timed.
"""

from __future__ import annotations

import argparse
import collections
import dataclasses
import json
import math
import time
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import symsde as ss
from symsde.answers.expectation.candidates import suitable
from symsde.answers.expectation.carry_out import Execution
from symsde.answers.expectation.choice import Plan
from symsde.answers.expectation.interval import Tolerance, make_tolerance
from symsde.answers.expectation.pilot import Pilot
from symsde.answers.expectation.problem import make_problem
from symsde.answers.expectation.trial import LEVELS
from symsde.answers.expectation.watch import Watch


@dataclass(frozen=True)
class Case:
    """A function whose mean is known."""

    name: str
    model: ss.Model
    f: Any
    start: dict[str, Any]
    abs: float
    exact: float
    known_to: float = 0.0  #: standard error of the reference


def second_moments(model_name: str, **parameters: float) -> float:
    """E q^2 at t = 1 of the oscillator with noises that do not commute, from q = 1, p = 0, by a matrix exponential."""
    s1, s2 = parameters["s1"], parameters["s2"]
    a = np.array([[0.0, 1.0], [-1.0, 0.0]])
    noises = [np.array([[0.0, s1], [0.0, 0.0]]), np.array([[0.0, 0.0], [-s2, 0.0]])]
    drift = a + sum(b @ b for b in noises) / 2
    eye = np.eye(2)
    generator = np.kron(drift, eye) + np.kron(eye, drift) + sum(np.kron(b, b) for b in noises)
    values, vectors = np.linalg.eig(generator)
    start = np.array([1.0, 0, 0, 0])
    return float((vectors @ (np.exp(values) * np.linalg.solve(vectors, start))).real[0])


def long_reference(model, f, start, *, scheme: str, steps: int, log2_paths: int) -> tuple[float, float]:
    """Mean and its error over many paths."""
    total = squares = 0.0
    part = min(2**16, 2**log2_paths)
    for i in range(2**log2_paths // part):
        run = ss.simulate(model, scheme=scheme, step=start["horizon"] / steps, steps=steps, save_every=steps,
                          paths=part, first_path=i * part, seed=987654321, q0=start["q0"], p0=start["p0"])  # fmt: skip
        values = f(run.q[-1], run.p[-1])
        total, squares = total + values.sum(), squares + (values**2).sum()
    n = 2**log2_paths
    return total / n, math.sqrt(max(squares / n - (total / n) ** 2, 0.0) / n)


def cases(log2_paths: int, word: str) -> list[Case]:
    """The scenes whose name contains this word."""
    t, found = 2.0, []
    cos, sin = math.cos(t), math.sin(t)
    from_one = {"q0": 1.0, "p0": 0.0, "horizon": t}

    def add(name, model, f, exact, wanted, *, start=from_one, known_to=0.0):
        found.append(Case(name, model, f, start, wanted, exact, known_to))

    add("Kubo, E q", ss.models.kubo(), "q", math.exp(-0.09 * t / 2) * cos, 4e-3)
    squared = 0.5 + math.exp(-2 * 0.09 * t) * math.cos(2 * t) / 2
    add("Kubo, E q^2", ss.models.kubo(), "q**2", squared, 4e-3)
    spread = t / 2 - math.sin(2 * t) / 4
    add("linear oscillator, E q^2", ss.models.linear_oscillator(), "q**2", cos**2 + spread, 2e-2)
    beyond = 0.5 * math.erfc((0.5 - cos) / math.sqrt(2 * spread))
    add("linear oscillator, P(q > 1/2)", ss.models.linear_oscillator(), lambda q, p: q[0] > 0.5, beyond, 5e-3)
    model = ss.models.additive_oscillator(sigma=0.5, gamma=1.0)
    momentum = 0.25 * (t / 2 - math.sin(2 * t) / 4) + (t / 2 + math.sin(2 * t) / 4)
    add("additive oscillator, E p^2", model, "p**2", sin**2 + momentum, 2e-2)
    model = ss.models.noncommutative_oscillator(s1=0.5, s2=0.5)
    exact = second_moments("noncommutative_oscillator", s1=0.5, s2=0.5)
    add("noncommutative oscillator, E q^2", model, "q**2", exact, 5e-3, start={**from_one, "horizon": 1.0})
    model = ss.models.synchrotron(omega=2.0, sigma1=0.3, sigma2=0.3)
    add("synchrotron, E H", model, model.value, -4 * math.cos(1.0) + 0.045 * t, 2e-3)
    model = ss.models.fpu_chain(n=16, sigma=0.2)
    start = {"q0": np.sin(np.arange(1, 17) * math.pi / 17), "p0": 0.0, "horizon": t}
    exact = float(model.value(start["q0"], 0.0)[0]) + 16 * 0.04 * t / 2
    add("FPU chain of 16, E H", model, model.value, exact, 5e-3, start=start)
    model = ss.models.synchrotron(omega=2.0, sigma1=0.8, sigma2=0.5)
    if word in (name := "synchrotron, E q^2"):
        exact, error = long_reference(
            model, lambda q, p: q[0] ** 2, from_one, scheme="chin4a_strong2", steps=16, log2_paths=log2_paths
        )
        add(name, model, "q**2", exact, 8e-3, known_to=error)
    return [case for case in found if word in case.name]


def long_cases(word: str) -> list[Case]:
    """Means at short and long horizons, where phases are lost, and of rare events; those whose name contains this
    word.
    """
    found = []

    def add(name, model, f, exact, wanted, where, known_to=0.0):  # noqa: PLR0917
        found.append(Case(name, model, f, where, wanted, exact, known_to))

    def start(t, q0=1.0, p0=0.0):
        return {"q0": q0, "p0": p0, "horizon": t}

    def spread(t, omega=1.0):  # variance of q over sigma^2
        return (t / 2 - math.sin(2 * omega * t) / (4 * omega)) / omega**2

    sigma = math.sqrt(1 / 32)
    for t, wanted in ((1.0, 5e-3), (10.0, 2e-2), (50.0, 0.05), (100.0, 0.1), (150.0, 0.1), (200.0, 0.1), (250.0, 0.1),
                      (1000.0, 0.5)):  # fmt: skip
        model, exact = ss.models.linear_oscillator(sigma=sigma), math.cos(t) ** 2 + sigma**2 * spread(t)
        add(f"linear oscillator, E q^2, T = {t:g}", model, "q**2", exact, wanted, start(t))
    fast = ss.model_from_sympy("p**2/2 + omega**2*q**2/2", noise=["-sigma*q"], params={"omega": 2.0, "sigma": 0.5})
    for t, wanted in ((10.0, 0.02), (100.0, 0.1), (1000.0, 1.0)):
        exact = math.cos(2 * t) ** 2 + 0.25 * spread(t, 2.0)
        add(f"omega = 2, E q^2, T = {t:g}", fast, "q**2", exact, wanted, start(t))
    for t, wanted in ((10.0, 1e-2), (100.0, 0.02), (1000.0, 0.05)):
        model, decay = ss.models.kubo(sigma=0.05), math.exp(-0.0025 * t / 2)
        add(f"Kubo, E q, T = {t:g}", model, "q", decay * math.cos(t), wanted, start(t))
        squared = 0.5 + decay**4 * math.cos(2 * t) / 2
        add(f"Kubo, E q^2, T = {t:g}", model, "q**2", squared, wanted, start(t))
    for t, wanted in ((10.0, 5e-3), (100.0, 2e-2)):
        model = ss.models.synchrotron(omega=2.0, sigma1=0.1, sigma2=0.1)
        add(f"synchrotron, E H, T = {t:g}", model, model.value, -4 * math.cos(1.0) + 0.005 * t, wanted, start(t))
    chain = np.sin(np.arange(1, 9) * math.pi / 9)
    for name, model, f, at, horizons in (
        ("synchrotron, E cos q", ss.models.synchrotron(sigma1=0.02, sigma2=0.01), lambda q, p: np.cos(q[0]), (1.0, 0.0),
         ((30.0, 0.01), (100.0, 0.02), (300.0, 0.03))),
        ("Henon-Heiles, E q1^2", ss.models.henon_heiles(sigma1=0.002, sigma2=0.002), lambda q, p: q[0] ** 2,
         ([0.3, 0.1], [0.1, 0.2]), ((30.0, 2e-3), (100.0, 3e-3), (200.0, 5e-3))),
        ("FPU chain of 8, E q1^2", ss.models.fpu_chain(n=8, sigma=0.05), lambda q, p: q[0] ** 2, (chain, 0.0),
         ((10.0, 5e-3), (100.0, 2e-2))),
    ):  # fmt: skip
        for t, wanted in horizons:
            where = start(t, *at)
            if word in (label := f"{name}, T = {t:g}"):
                exact, error = long_reference(model, f, where, scheme="chin4a", steps=round(10 * t), log2_paths=16)
                add(label, model, f, exact, wanted, where, error)
    for name, model, omega, size in (("linear oscillator", ss.models.linear_oscillator(), 1.0, 1.0),
                                     ("omega = 2", fast, 2.0, 0.5)):  # fmt: skip
        for p, z in ((3e-3, 2.747781), (1e-3, 3.090232), (1e-4, 3.719016)):
            edge = math.cos(3 * omega) + z * size * math.sqrt(spread(3.0, omega))
            for kind, f in (("", lambda q, p, edge=edge: q[0] > edge), (", floats", _floats_above(edge))):
                add(f"{name}, P = {p:g}{kind}", model, f, p, p / 4, start(3.0))
    return [case for case in found if word in case.name]


def _floats_above(edge: float):
    return lambda q, p: np.where(q[0] > edge, 1.0, 0.0)


def repeat(case: Case, repeats: int, pilots: int) -> dict:
    """Answers with so many seeds; every pilot serves repeats/pilots answers, which have paths of their own."""
    chosen, found = collections.Counter(), []
    begin = time.process_time()
    tolerance = make_tolerance(case.abs, None)
    for first in range(pilots):
        problem = make_problem(case.model, case.f, seed=first, threads=1, **case.start)
        pilot = Pilot(problem, tolerance, Watch(None, False), suitable(problem))
        plans = pilot.choose()
        for seed in range(repeats // pilots):
            pilot.problem = dataclasses.replace(problem, seed=(first + 1) * 10**6 + seed)
            answer = Execution(pilot, plans).answer()
            found.append(answer)
            chosen[f"{answer.method} by {answer.scheme}"] += 1
    held = np.array([x.interval[0] <= case.exact <= x.interval[1] for x in found])
    shares = held.reshape(pilots, -1).mean(axis=1)  # share for each pilot
    bounds = np.array([any("is a bound" in note for note in x.notes) for x in found])
    off = np.array([x.value for x in found]) - case.exact
    return {
        "scene": case.name,
        "abs": case.abs,
        "exact": case.exact,
        "known_to": case.known_to,
        "repeats": len(found),
        "pilots": pilots,
        "coverage": float(held.mean()),
        "coverage_error": float(max(shares.std(ddof=1) / math.sqrt(pilots), math.sqrt(0.01 / len(found)))),
        "reached": float(np.mean([x.reached for x in found])),
        "bounds": int(bounds.sum()),
        "coverage_of_the_others": float(held[~bounds].mean()) if not bounds.all() else math.nan,
        "mean_half_width": float(np.mean([x.half_width for x in found])),
        "bias_share": float(np.mean([(x.bias / x.error) ** 2 if x.error else math.inf for x in found])),
        "mean_error": float(off.mean()),
        "rms_error": float(np.sqrt(np.mean(off**2))),
        "median_seconds": float(np.median([x.cost - x.pilot for x in found])),
        "pilot_seconds": float(np.median([x.pilot for x in found])),
        "chosen": dict(chosen.most_common(4)),
        "seconds": time.process_time() - begin,
    }


def every_plan(pilot: Pilot) -> list[Plan]:
    """Plans of all schemes and methods by a pilot with eight times the paths; the cheapest first."""
    pilot.try_all()
    for trial in pilot.trials:
        for _ in range(3):
            trial.double()
        if math.isfinite(trial.price_of_pairs(LEVELS - 1)):
            trial.look_at_pairs(LEVELS - 1)
        for level in range(LEVELS):
            if math.isfinite(trial.price_of_points(level)):
                trial.look_at_points(level)
    return pilot.plans()


def by_hand(case: Case, tolerance: Tolerance, repeats: int) -> tuple[list[float], str]:
    """Seconds of the best existing plan, and its name: the likely plans are all executed."""
    problem = make_problem(case.model, case.f, seed=10**9, threads=1, **case.start)
    pilot = Pilot(problem, tolerance, Watch(None, False), suitable(problem))
    plans = every_plan(pilot)
    likely = [plan for plan in plans[:8] if plan.seconds < 4 * plans[0].seconds]
    spent: dict[str, list[float]] = {}
    for plan in likely:
        taken = []
        for seed in range(repeats):
            pilot.problem = dataclasses.replace(problem, seed=10**9 + 1 + seed)
            begin = time.process_time()
            Execution(pilot, [plan]).answer()
            taken.append(time.process_time() - begin)
        spent[f"{plan.method} by {plan.scheme.name}, {plan.steps} steps"] = taken
    best = min(spent, key=lambda name: np.median(spent[name]))
    return spent[best], best


def cost(case: Case, times: float, repeats: int) -> dict:
    """Seconds of whole answers to a half width `times` narrower, and of the best choice by hand."""
    tolerance = make_tolerance(case.abs / times, None)
    best, which = by_hand(case, tolerance, max(3, repeats // 10))
    whole, work, chosen = [], [], collections.Counter()
    for seed in range(repeats):
        answer = ss.expect(case.model, case.f, abs=tolerance.absolute, seed=seed, threads=1, **case.start)
        whole.append(answer.cost)
        work.append(answer.cost - answer.pilot)
        chosen[f"{answer.method} by {answer.scheme}, {round(case.start['horizon'] / answer.step)} steps"] += 1
    return {
        "scene": case.name,
        "abs": tolerance.absolute,
        "best_seconds": float(np.median(best)),
        "best": which,
        "work_seconds": float(np.median(work)),
        "whole_seconds": float(np.median(whole)),
        "work_over_best": float(np.median(work) / np.median(best)),
        "whole_over_best": float(np.median(whole) / np.median(best)),
        "chosen": dict(chosen.most_common(4)),
    }


def told(row: dict) -> str:
    """A row of the table as a line."""
    if "best" in row:
        return (
            f"{row['scene']:34s} best {row['best_seconds']:.3f} s ({row['best']}), work {row['work_over_best']:.2f}, "
            f"with the pilot {row['whole_over_best']:.2f} times that  {row['chosen']}"
        )
    return (
        f"{row['scene']:34s} {100 * row['coverage']:5.1f} % +- {100 * row['coverage_error']:.1f} "
        f"({100 * row['coverage_of_the_others']:.1f} but for {row['bounds']} bounds)  half width "
        f"{row['mean_half_width']:.2e} of {row['abs']:.0e} ({100 * row['reached']:.0f} % reached)  rms error "
        f"{row['rms_error']:.2e}, mean {row['mean_error']:+.1e}  {row['median_seconds']:.4f} s + "
        f"{row['pilot_seconds']:.2f} s  {row['chosen']}"
    )


def main() -> None:
    """Print a table; write it as JSON on request."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, help="answers: 1000, with --cost 5")
    parser.add_argument("--pilots", type=int, help="250, with --long 40")
    parser.add_argument("--long", action="store_true", help="the scenes of long horizons and rare events")
    parser.add_argument("--scenes", default="")
    parser.add_argument("--log2-paths", type=int, default=24)
    parser.add_argument("--cost", metavar="N", type=float, help="cost of intervals N times as narrow, not coverage")
    parser.add_argument("--narrower", metavar="N", type=float, default=1.0, help="coverage, of such intervals")
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    warnings.simplefilter("error", ss.PathsFailedWarning)
    rows = []
    many, pilots = (160, options.pilots or 40) if options.long else (1000, options.pilots or 250)
    log2_paths = 0 if options.cost else options.log2_paths
    for case in long_cases(options.scenes) if options.long else cases(log2_paths, options.scenes):
        if options.cost:
            row = cost(case, options.cost, options.repeats or 5)
        else:
            narrow = dataclasses.replace(case, abs=case.abs / options.narrower)
            row = repeat(narrow, options.repeats or many, pilots)
        rows.append(row)
        print(told(row), flush=True)
        if options.out:
            options.out.write_text(json.dumps({"version": ss.__version__, "rows": rows}, indent=1) + "\n")


if __name__ == "__main__":
    main()
