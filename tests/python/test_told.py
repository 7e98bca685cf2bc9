# SPDX-License-Identifier: BSD-3-Clause
"""Words and numbers in answers, levels and advice, each against an independent number."""

import dataclasses
import importlib
import math
import re
import sys
from types import SimpleNamespace

import numpy as np
import pytest
import symsde as ss
from symsde.answers.advice.ladder import Ladder
from symsde.answers.advice.wants import Invariants, Moments, Paths, Seen
from symsde.answers.coupled import Draw, LevelSampler
from symsde.answers.expectation import choice
from symsde.answers.expectation.answer import UNSEEN, Alternative, Level, Multilevel
from symsde.answers.expectation.candidates import frequency, suitable
from symsde.answers.expectation.carry_out import Execution, _failures, _Outcome
from symsde.answers.expectation.estimators import Drawn
from symsde.answers.expectation.interval import Tally, make_tolerance, quantile
from symsde.answers.expectation.mlmc import Estimate, _doubts
from symsde.answers.expectation.pilot import Pilot
from symsde.answers.expectation.problem import make_problem
from symsde.answers.expectation.watch import Watch
from symsde.schemes import as_scheme

PLACE = {"q0": 1.0, "p0": 0.0, "horizon": 2.0}
LEVEL = Level(8, 1000, 0.5, 0.1, 0.25, 3.5, 0.6, 0.7, 0.875, 0.0115, 0)


@pytest.fixture(scope="module")
def pilot():
    """The pilot for E p^2 of an oscillator with noises on q and p, before any choice."""
    problem = make_problem(ss.models.additive_oscillator(sigma=0.5, gamma=1.0), "p**2", **PLACE)
    return Pilot(problem, make_tolerance(2e-2, None), Watch(None, False), suitable(problem))


def plan_of(pilot, method, level, seconds):
    """A plan with the first trial at this level of its ladder."""
    trial = pilot.trials[0]
    steps = trial.steps(level)
    return choice.Plan(method, trial.scheme, steps, steps, seconds, trial.variance, trial.bias(level))


def test_why_a_plan_was_taken_and_which_were_not(pilot):
    trial = pilot.trials[0]
    taken, other = plan_of(pilot, "plain", 1, 0.5), plan_of(pilot, "antithetic", 3, 2.0)
    name, far = trial.scheme.name, 2.0 / trial.steps(3)
    answer = Execution(pilot, [taken, other]).answer()
    assert (answer.method, answer.scheme, answer.step) == ("plain", name, 2.0 / trial.steps(1))
    assert answer.alternatives == (Alternative("antithetic", name, far, 2.0),) and far < answer.step
    assert answer.why == f"estimated at 0.5 s, 4 times less than the next (antithetic by {name}, h = {far:.4g})"
    assert Execution(pilot, [taken]).answer().why == "estimated at 0.5 s, nothing else to compare"


def test_paths_of_levels_are_all_that_were_computed(pilot):
    """A value of the first level takes one path, a value of another level two; failed paths are counted, too."""
    levels = tuple(
        dataclasses.replace(LEVEL, steps=4 << i, paths=paths, failed=failed)
        for i, (paths, failed) in enumerate([(100, 1), (50, 2), (20, 0)])
    )
    rates = {"alpha": UNSEEN, "beta": UNSEEN, "gamma": UNSEEN}
    found = Multilevel(2.0, (1.99, 2.01), 0.005, 0.001, "heun", levels, **rates, reached=True, notes=(), cost=1.0)
    answer = Execution(pilot, [plan_of(pilot, "multilevel", 2, 1.0)])._of_levels(found)
    assert (answer.paths, answer.step) == (101 + 2 * 52 + 2 * 20, 2.0 / 16)
    assert (answer.error, answer.bias, answer.interval) == (0.005, 0.001, pytest.approx((1.99, 2.01)))


def test_what_was_reached_and_what_an_interval_is(pilot):
    """A half width counts as reached up to a twentieth more than the 0.02 asked for; if the noise is below a fifth
    of the bias, the answer is a bound.
    """
    work = Execution(pilot, [plan_of(pilot, "plain", 1, 0.5)])

    def finished(half, error, bias):
        return work._finished(_Outcome(2.0, half, error, bias, 100, []))

    assert finished(0.0208, 0.01, 0.01).reached and finished(0.0208, 0.01, 0.01).notes == ()
    wide, biased = finished(0.0212, 0.01, 0.001), finished(0.0212, 0.01, 0.01)
    assert not wide.reached and wide.notes == ("paths were too few: the half width is 0.0212, not 0.02, as asked",)
    assert not biased.reached and biased.notes[0].startswith("the bias of the step is known only to 0.01")
    work.watch = Watch(1e-9, False)
    assert finished(0.03, 0.01, 0.01).notes == (
        "max_time = 1e-09 s was over: the half width is 0.03, not 0.02, as asked",
    )
    (bound,) = finished(0.02, 0.0019, 0.01).notes
    assert bound.startswith("the standard error 0.002 is negligible beside the bias of the step 0.01: the interval")
    assert finished(0.02, 0.0021, 0.01).notes == ()


def test_units_of_which_few_differ_vary_as_the_pilot_knows(pilot):
    """256 paths without an event have no scatter, and 16 scramblings that agree count as 16 paths: the pilot's variance
    is used. If many units differ, their own variance is used, even if the pilot's is larger.
    """
    for method, few, paths in (("plain", np.zeros(256), 256), (choice.EVEN_LEVELS, np.zeros(16), 2048)):
        work = Execution(pilot, [dataclasses.replace(plan_of(pilot, method, 1, 0.5), variance=9.0)])
        assert work._noises([Drawn(Tally.of(few), 1.0, 0, paths)]) == [9.0 / paths]
        many = Tally.of(np.arange(len(few)) % 2.0)
        assert work._noises([Drawn(many, 1.0, 0, paths)]) == [many.variance / many.n]


def test_the_cost_of_an_answer_holds_its_pilot(pilot, monkeypatch):
    """The cost of an answer contains 2.5 seconds for the choice and 1.5 for the draws."""
    work = Execution(pilot, [plan_of(pilot, "plain", 1, 0.5)])
    monkeypatch.setattr(pilot, "seconds", 2.5)
    work.watch = SimpleNamespace(seconds=work._begin + 1.5)
    answer = work._finished(_Outcome(2.0, 0.02, 0.01, 0.01, 100, []))
    assert (answer.pilot, answer.cost) == (2.5, pytest.approx(4.0))


@pytest.mark.parametrize("units", [*range(2, 12), 12, 30, 1000])
def test_quantiles_hold_95_percent(units):
    """Student's density over the interval, by Simpson's rule."""
    degrees, end = units - 1, quantile(units)
    x = np.linspace(-end, end, 4001)
    scale = math.exp(math.lgamma((degrees + 1) / 2) - math.lgamma(degrees / 2)) / math.sqrt(degrees * math.pi)
    density = scale * (1 + x**2 / degrees) ** (-(degrees + 1) / 2)
    share = (density[0] + density[-1] + 4 * density[1:-1:2].sum() + 2 * density[2:-1:2].sum()) * (x[1] - x[0]) / 3
    assert share == pytest.approx(0.95, abs=2e-5 if units < 12 else 1e-4)


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
    level and that of the next level's coarse paths differ by 3 standard errors."""
    problem = make_problem(ss.models.synchrotron(), "q", **PLACE)
    sampler = LevelSampler(problem, as_scheme("midpoint"), 4)
    estimate = Estimate(sampler, make_tolerance(1e-2, None), levels=5, first=16, watch=Watch(None, False),
                        known=Tally(1000, 0.0, 999.0, 0.0, 2997.0))  # fmt: skip
    n = 1001
    apart = 3 * math.sqrt(2 / n)  # two means of variance 1
    for i in range(4):
        fine = Tally(n, 2 * i * apart, n - 1.0, 0.0, 3.0 * n)
        variance = 2.0 ** (-3 * i)
        difference = Tally(n, 4.0**-i, (n - 1) * variance, 0.0, 3 * (n - 1) ** 2 / n * variance**2)
        coarse = Tally(n, (2 * i - 1) * apart, n - 1.0, 0.0, 3.0 * n)
        estimate.draws.append(Draw(difference, fine, coarse, n * 2.0**i, 0))
    found = estimate.answer()
    assert (found.alpha.value, found.beta.value) == (pytest.approx(2.0), pytest.approx(3.0))
    assert found.gamma.value == pytest.approx(1.0)
    assert [x.consistency for x in found.levels] == [0.0, *[pytest.approx(1.0)] * 3]
    assert [x.kurtosis for x in found.levels] == [pytest.approx(3.0)] * 4
    assert [x.steps for x in found.levels] == [4, 8, 16, 32]
    assert [x.fine_mean for x in found.levels] == [2 * i * apart for i in range(4)]
    half = found.half_width
    for wanted, reached in ((half / 1.04, True), (half / 1.06, False)):
        estimate.tolerance = make_tolerance(wanted, None)
        assert estimate.answer().reached is reached


def test_a_level_on_which_few_values_differ_varies_as_those_that_were_looked_at():
    """Level 0 has at least the variance of f; a finer level has a variance as if one more of its differences were as
    large."""
    sampler = LevelSampler(make_problem(ss.models.synchrotron(), "q", **PLACE), as_scheme("midpoint"), 4)
    known = Tally.of(np.arange(1000) % 2.0)
    estimate = Estimate(sampler, make_tolerance(1e-2, None), levels=5, first=16, watch=Watch(None, False), known=known)
    one = Tally.of(np.eye(64)[0])
    estimate.draws = [Draw(one, one, one, 1.0, 0)] * 2
    assert estimate._variance(0) == known.variance > 5 * estimate._variance(1)
    assert estimate._variance(1) == pytest.approx(64 * math.hypot(one.error, one.size / 64) ** 2)


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
    monkeypatch.setattr(sys.modules["symsde.answers.advice.advise"], "scheme_names", lambda *_: ["stormer_verlet"])
    advice = ss.advise(ss.models.pendulum(), q0=1.0, p0=0.0, horizon=4.0, tolerance=0.05)
    assert advice.reasons[1].endswith("; stormer_verlet is stable up to 2") and advice.alternatives == ()
    assert advice.reasons[2] == "stormer_verlet is explicit here, and symplectic"


def test_kicks_are_explicit_whatever_else_a_model_declares(monkeypatch):
    """H = p^2/2 - cos q with noise in position, by a model that does not declare itself separable."""
    monkeypatch.setattr(sys.modules["symsde.answers.advice.advise"], "scheme_names", lambda *_: ["gauss_dkdkd"])
    model = ss.Model(
        ndof=1, nnoise=1, identity_mass=True, position_noise=True,
        gradient=lambda t, w, q, p: (w[0] * np.sin(q) + w[1] * np.cos(q), w[0] * p),
    )  # fmt: skip
    advice = ss.advise(model, q0=1.0, p0=0.0, horizon=4.0, tolerance=0.05)
    assert advice.reasons[2] == "gauss_dkdkd is explicit here, and symplectic"


def test_the_pilot_is_told_by_its_finest_steps():
    model, place = ss.models.synchrotron(), {"q0": 1.0, "p0": 0.0, "horizon": 2.0}
    advice = ss.advise(model, **place, tolerance=1e-4)
    found = re.fullmatch(
        r"pilot on 192 paths: root mean square distance of paths at the horizon falls with order (\S+), is (\S+) at "
        r"(\d+) steps", advice.reasons[0]
    )  # fmt: skip
    order, error, steps = map(float, found.groups())
    seen = Paths(make_problem(model, lambda q, p: q[0], **place)).see(as_scheme(advice.scheme), int(steps))
    assert order == pytest.approx(math.log2(seen.first / seen.second), abs=0.006)
    assert error == pytest.approx(seen.error(math.log2(seen.first / seen.second)), rel=0.06)


def test_changes_of_invariants_are_relative_to_the_first():
    """Root mean square over 64 paths of max |H - H_0|/|H_0| by Verlet, which does not conserve H."""
    problem = make_problem(ss.models.kubo(sigma=0.8), lambda q, p: q[0], **PLACE)
    seen = Invariants(problem).see(as_scheme("stormer_verlet"), 8)
    run = problem.run(as_scheme("stormer_verlet"), 8, paths=64, save_every=1)
    energy = (run.q[:, 0] ** 2 + run.p[:, 0] ** 2) / 2
    change = np.abs(energy / energy[0] - 1).max(axis=0)
    assert seen.first == pytest.approx(math.sqrt(np.mean(change**2)), rel=1e-12) and seen.second == 0
    assert seen.first > 1.1 * change.mean()


def test_steps_lie_between_the_last_that_misses_and_the_next():
    """Errors 8, 2, 4, 1 with 4, 8, 16, 32 steps, whose differences fall as 1/4: error 2 by a power law from 16 on."""
    problem = make_problem(ss.models.pendulum(), "q", **PLACE)
    ladder = Ladder(problem, as_scheme("midpoint"), Paths(problem), fewest=4, tolerance=2.0 + 1e-12)
    ladder.steps = [4, 8, 16, 32]
    ladder.seen = [Seen(x * 3 / 4, x * 3 / 16, x * 15 / 16) for x in (8.0, 2.0, 4.0, 1.0)]
    assert ladder.order == pytest.approx(2.0) and [ladder.error(i) for i in range(4)] == pytest.approx([8, 2, 4, 1])
    assert ladder._between() == pytest.approx(16 * math.sqrt(2))


def test_noise_of_moments_is_that_of_their_differences():
    problem = make_problem(ss.models.synchrotron(sigma1=0.8, sigma2=0.5), lambda q, p: q[0], **PLACE)
    scheme = as_scheme("midpoint")
    seen = Moments(problem).see(scheme, 4)
    runs = [problem.run(scheme, 4 << i, paths=4096, refine=2 - i) for i in range(3)]
    ends = [np.concatenate([x.q[-1], x.p[-1], [problem.model.value(x.q[-1], x.p[-1])]]) for x in runs]
    pairs = [ends[i] - ends[j] for i, j in ((0, 1), (1, 2), (0, 2))]
    assert seen.noise == pytest.approx(max(x.std(axis=1).max() for x in pairs) / 64, rel=1e-3)
    assert [seen.first, seen.second, seen.both] == pytest.approx([np.abs(x.mean(axis=1)).max() for x in pairs])


@pytest.mark.parametrize(
    ("name", "where"), [("scene", "batch.scene"), ("stability", "studies.stability"), ("study", "studies.study")]
)
def test_modules_that_moved_are_found_by_their_old_names(name, where):
    with pytest.warns(DeprecationWarning, match=f"symsde.{name} is now symsde.{where}"):
        found = getattr(ss, name)
    assert found is importlib.import_module(f"symsde.{where}")


def test_the_room_of_studies_is_found_by_its_old_name():
    with pytest.warns(DeprecationWarning, match=r"symsde\.reports is now symsde\.studies"):
        found = importlib.import_module("symsde.reports")
    assert found is importlib.import_module("symsde.studies")
    assert importlib.import_module("symsde.reports.stability").fixed_points
