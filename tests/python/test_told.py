# SPDX-License-Identifier: BSD-3-Clause
"""What answers, levels and advice tell of themselves, in words and in numbers: each against a number of its own."""

import dataclasses
import math
import re
import sys

import numpy as np
import pytest
import symsde as ss
from symsde.advise.wants import Moments
from symsde.expect import choice
from symsde.expect.answer import Alternative
from symsde.expect.candidates import suitable
from symsde.expect.estimators import Drawn
from symsde.expect.pilot import Pilot
from symsde.expect.problem import make_problem
from symsde.expect.stability import frequency
from symsde.expect.tally import Tally
from symsde.expect.tolerance import make_tolerance
from symsde.expect.watch import Watch
from symsde.expect.work import Work, _failures
from symsde.mlmc.answer import Level, Multilevel
from symsde.mlmc.mlmc import Estimate, _doubts
from symsde.mlmc.rates import UNSEEN
from symsde.mlmc.sampler import Draw, LevelSampler
from symsde.schemes import as_scheme

PLACE = {"q0": 1.0, "p0": 0.0, "horizon": 2.0}
LEVEL = Level(8, 1000, 0.5, 0.1, 0.25, 3.5, 0.6, 0.7, 0.875, 0.0115, 0)


@pytest.fixture(scope="module")
def pilot():
    """Of E p^2 of an oscillator with noises on q and p, before anything is chosen."""
    problem = make_problem(ss.models.additive_oscillator(sigma=0.5, gamma=1.0), "p**2", **PLACE)
    return Pilot(problem, make_tolerance(2e-2, None), Watch(None, False), suitable(problem), None)


def test_why_a_plan_was_taken_and_which_were_not(pilot):
    trial = pilot.trials[0]
    taken, other = choice.Plan("plain", trial, 1, 0.5), choice.Plan("extrapolated", trial, 3, 2.0)
    name, far = trial.scheme.name, 2.0 / trial.steps(3)
    answer = Work(pilot, [taken, other]).answer()
    assert (answer.method, answer.scheme, answer.step) == ("plain", name, 2.0 / trial.steps(1))
    assert answer.alternatives == (Alternative("extrapolated", name, far, 2.0),) and far < answer.step
    assert answer.why == f"reckoned at 0.5 s, 4 times less than the next (extrapolated by {name}, h = {far:.4g})"
    assert Work(pilot, [taken]).answer().why == "plain: reckoned at 0.5 s, nothing else to compare"


def test_paths_of_levels_are_all_that_were_computed(pilot):
    """A value of the first level takes one path, one of the others two; those that failed were computed, too."""
    levels = tuple(
        dataclasses.replace(LEVEL, steps=4 << i, paths=paths, failed=failed)
        for i, (paths, failed) in enumerate([(100, 1), (50, 2), (20, 0)])
    )
    rates = {"alpha": UNSEEN, "beta": UNSEEN, "gamma": UNSEEN}
    found = Multilevel(2.0, (1.99, 2.01), 0.005, 0.001, "heun", levels, **rates, reached=True, notes=(), cost=1.0)
    answer = Work(pilot, [choice.Plan("multilevel", pilot.trials[0], 2, 1.0)])._of_levels(found)
    assert (answer.paths, answer.step) == (101 + 2 * 52 + 2 * 20, 2.0 / 16)
    assert (answer.error, answer.bias, answer.interval) == (0.005, 0.001, pytest.approx((1.99, 2.01)))


@pytest.mark.parametrize(("paths", "words"), [(10, "2 of 10 paths failed"), (640, "2 of 10 groups of 64 paths failed")])
def test_units_that_failed_are_counted(paths, words):
    assert _failures(Drawn(Tally(8, 1.0), 1.0, 2, paths))[0].startswith(words)
    assert _failures(Drawn(Tally(10, 1.0), 1.0, 0, paths)) == []


def test_doubts_of_levels_tell_their_size():
    """The variance of 10^4 values of kurtosis 400 is known to sqrt(400/10^4)."""
    odd = dataclasses.replace(LEVEL, kurtosis=400.0, paths=10**4, consistency=2.04, failed=3)
    first, kurtosis, apart = _doubts((LEVEL, odd))
    assert first.startswith("3 of 11003 paths failed")
    assert kurtosis.startswith("level 1: the kurtosis 400 makes its variance uncertain by 20 %")
    assert apart.startswith("level 1: its coarse paths and the paths of level 0 have different means, 2.0 times")
    assert _doubts((LEVEL, LEVEL)) == []


def test_rates_and_consistency_of_levels():
    """Means that fall as 2^-2l, variances as 2^-3l and seconds that double: alpha 2, beta 3, gamma 1; the mean of a
    level and that of the coarse paths of the next one are 3 standard errors of their difference apart."""
    problem = make_problem(ss.models.synchrotron(), "q", **PLACE)
    sampler = LevelSampler(problem, as_scheme("midpoint"), 4)
    estimate = Estimate(sampler, make_tolerance(1e-2, None), levels=5, first=16, watch=Watch(None, False),
                        known=Tally(1000, 0.0, 999.0, 0.0, 2997.0))  # fmt: skip
    n = 1001
    apart = 3 * math.sqrt(2 / n)  # of two means of variance 1
    for i in range(4):
        fine = Tally(n, i * apart, n - 1.0, 0.0, 3.0 * n)
        variance = 2.0 ** (-3 * i)
        difference = Tally(n, 4.0**-i, (n - 1) * variance, 0.0, 3 * (n - 1) ** 2 / n * variance**2)
        coarse = Tally(n, (i - 1) * apart + apart, n - 1.0, 0.0, 3.0 * n)
        estimate.draws.append(Draw(difference, fine, coarse, n * 2.0**i, 0))
    found = estimate.answer()
    assert (found.alpha.value, found.beta.value) == (pytest.approx(2.0), pytest.approx(3.0))
    assert found.gamma.value == pytest.approx(1.0)
    assert [x.consistency for x in found.levels] == [0.0, *[pytest.approx(1.0)] * 3]
    assert [x.kurtosis for x in found.levels] == [pytest.approx(3.0)] * 4
    assert [x.steps for x in found.levels] == [4, 8, 16, 32]


def test_reasons_of_advice_hold_its_numbers():
    model, place = ss.models.fpu_chain(n=8), {"q0": 0.1, "p0": 0.0, "horizon": 8.0}
    advice = ss.advise(model, **place, tolerance=1e-2)
    told = " ".join(advice.reasons)
    fastest = frequency(make_problem(model, lambda q, p: q[0], **place), 64)
    times = float(re.search(r"fastest frequency times h is (\S+),", told)[1])
    assert times == pytest.approx(fastest * advice.step, rel=0.06)
    beside = float(re.search(rf"{advice.alternatives[0].scheme} would take (\S+) times as long", told)[1])
    assert beside == pytest.approx(advice.alternatives[0].seconds / advice.seconds, rel=0.06) and beside >= 1
    assert advice.steps == pytest.approx(8.0 / advice.step) and "symplectic" in told


def test_the_limit_that_is_told_is_that_of_the_scheme(monkeypatch):
    monkeypatch.setattr(sys.modules["symsde.advise.advise"], "scheme_names", lambda *_: ["stormer_verlet"])
    advice = ss.advise(ss.models.pendulum(), q0=1.0, p0=0.0, horizon=4.0, tolerance=0.05)
    assert advice.reasons[1].endswith("; stormer_verlet is stable up to 2") and advice.alternatives == ()
    assert advice.reasons[2] == "stormer_verlet is explicit here, and symplectic"


def test_noise_of_moments_is_that_of_their_differences():
    problem = make_problem(ss.models.synchrotron(sigma1=0.8, sigma2=0.5), lambda q, p: q[0], **PLACE)
    scheme = as_scheme("midpoint")
    seen = Moments(problem).see(scheme, 4)
    runs = [problem.run(scheme, 4 << i, paths=4096, refine=2 - i) for i in range(3)]
    ends = [np.concatenate([x.q[-1], x.p[-1], [problem.model.value(x.q[-1], x.p[-1])]]) for x in runs]
    pairs = [ends[i] - ends[j] for i, j in ((0, 1), (1, 2), (0, 2))]
    assert seen.noise == pytest.approx(max(x.std(axis=1).max() for x in pairs) / 64, rel=1e-3)
    assert [seen.first, seen.second, seen.both] == pytest.approx([np.abs(x.mean(axis=1)).max() for x in pairs])
