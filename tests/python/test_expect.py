# SPDX-License-Identifier: BSD-3-Clause
"""Expectations with an interval: every method gives the same number, the cheapest is chosen, misuse gets a message."""

import math
import time
from types import SimpleNamespace

import numpy as np
import pytest
import symsde as ss
from clock import Clock, WorkClock
from symsde.answers.expectation import choice, estimators, interval, tails
from symsde.answers.expectation.answer import Answer
from symsde.answers.expectation.candidates import frequency
from symsde.answers.expectation.carry_out import Execution
from symsde.answers.expectation.choice import Plan
from symsde.answers.expectation.estimators import Antithetic, Drawn, Plain, Quasi
from symsde.answers.expectation.interval import Tally
from symsde.answers.expectation.problem import make_problem
from symsde.answers.expectation.trial import Trial
from symsde.answers.expectation.watch import Watch
from symsde.run.simulate import Run
from symsde.schemes import as_scheme

PLACE = {"q0": 1.0, "p0": 0.0, "horizon": 2.0}


@pytest.fixture
def nonlinear():
    return ss.models.synchrotron(sigma1=0.8, sigma2=0.5)


@pytest.mark.parametrize("method", choice.METHODS)
def test_every_method_gives_the_exact_mean(method):
    """E q of Kubo's oscillator, within two half widths (8e-5)."""
    if method == choice.EVEN_LEVELS:
        pytest.importorskip("scipy")
    answer = ss.expect(ss.models.kubo(), "q", **PLACE, abs=4e-3, method=method, scheme="stormer_verlet", seed=2)
    exact = math.exp(-0.09) * math.cos(2.0)
    assert answer.reached and answer.method == method
    assert abs(answer.value - exact) < 2 * answer.half_width <= 8.4e-3
    assert answer.interval[0] < answer.value < answer.interval[1]


@pytest.mark.usefixtures("work_clock")
def test_intervals_hold_with_95_percent(nonlinear):
    """E H grows at a known rate. 32 or more of 40 intervals must contain the exact value; intervals of 95 % fail this
    with probability 3e-4. The twin doubles the error, so that 33 % of intervals contain the value, and 32 or more of 40
    do so with probability 2e-9."""
    model = ss.models.synchrotron(sigma1=0.3, sigma2=0.3)
    exact = -4 * math.cos(1.0) + 0.09 / 2 * 2.0
    held = shrunk = 0
    for seed in range(40):
        answer = ss.expect(model, model.value, **PLACE, abs=1e-2, seed=seed, scheme="gauss_dkdkd", method="plain")
        held += answer.interval[0] <= exact <= answer.interval[1]
        shrunk += abs(answer.value - exact) <= answer.half_width / 4
    assert held >= 32 > shrunk


def units(kind, problem, scheme, steps, count, **more):
    """Draws of an estimator in units."""
    return kind(problem, as_scheme(scheme), steps, 0, **more).draw(count).units


def test_antithetic_paths_cancel_what_is_odd():
    problem = make_problem(ss.models.linear_oscillator(), "q", **PLACE)
    drawn = Antithetic(problem, as_scheme("midpoint"), 20, 0).draw(100)
    assert drawn.units.variance < 1e-26 and drawn.paths == 200
    assert drawn.units.mean == pytest.approx(math.cos(2.0), abs=3e-3)


def test_bridge_makes_brownian_increments():
    """Covariance h times the identity for any number of steps, exactly: the map is linear in the normals."""
    for steps in (1, 2, 7, 16):
        bridge = estimators.Bridge(steps, horizon=3.0)
        columns = bridge.increments(np.eye(steps)[np.newaxis, :, np.newaxis, :])[:, 0]
        np.testing.assert_allclose(columns @ columns.T, 3.0 / steps * np.eye(steps), atol=1e-14)
        np.testing.assert_allclose(columns[:, 0].sum(), math.sqrt(3.0))  # the first normal gives W(T)
        np.testing.assert_allclose(columns[:, 1:].sum(axis=0), 0.0, atol=1e-14)


def test_sobol_points_beat_paths():
    """At 1024 points a unit the variance is at most a tenth of that of 1024 paths, and the mean is the same."""
    pytest.importorskip("scipy")
    problem = make_problem(ss.models.synchrotron(), "q**2", **PLACE)
    plain = units(Plain, problem, "stormer_verlet", 16, 20000)
    even = units(Quasi, problem, "stormer_verlet", 16, 24, log2_points=10)
    assert even.variance < 0.1 * plain.variance / 1024
    assert abs(even.mean - plain.mean) < 4.5 * math.hypot(plain.error, even.error)


def test_quasi_units_are_independent_and_repeatable():
    pytest.importorskip("scipy")
    problem = make_problem(ss.models.synchrotron(), "q**2", **PLACE)
    estimator = Quasi(problem, as_scheme("midpoint"), 4, 0, log2_points=4)
    means = [estimator.draw(1).units.mean for _ in range(4)]
    assert len(set(means)) == 4
    again = Quasi(problem, as_scheme("midpoint"), 4, 0, log2_points=4)
    assert again.draw_from(2, 1).units.mean == means[2]
    assert again.draw_from(0, 4).units.mean == pytest.approx(np.mean(means), rel=1e-14)
    assert Quasi(problem, as_scheme("midpoint"), 4, 1, log2_points=4).draw(1).units.mean not in means


class FakeTrial:
    """A trial of known variance, bias and cost: bias 2^-level, variance of differences 4^-level."""

    variance = 1.0
    scheme = as_scheme("midpoint")
    pairs, problem = None, None

    def __init__(self, spread: float):
        self._spread, self.even = spread, {}

    def bias(self, level):
        return 0.1 * 2.0**-level, 0.0

    def seconds(self, level):
        return 1e-6 * 2.0**level

    def steps(self, level):
        return math.ceil(2**level)

    def spread(self, level):
        return self._spread * 4.0**-level


def test_multilevel_is_reckoned_as_giles_has_it():
    """Work is (sum of sqrt(variance x cost))^2 over the allowed variance."""
    error = 1e-2
    trial = FakeTrial(1.0)
    single, plan = choice.plans(trial, error)
    assert plan.level == 5 and plan.coarsest_steps == 4  # 0.1/32 < 1e-2 sqrt(0.1)
    terms = [math.sqrt(4e-6)] + [math.sqrt(4.0**-k * 1.5e-6 * 2.0**k) for k in range(3, 6)]
    begun = 256 * 1.5e-6 * (8 + 16 + 32) + 3 * choice._A_LEVEL
    assert plan.seconds == pytest.approx(sum(terms) ** 2 / (0.9 * error**2) + begun)
    # between two steps of the ladder the bias is a third of the noise
    assert single.level == pytest.approx(math.log2(0.1 / (1e-2 * math.sqrt(0.1))), abs=2**-6)
    assert single.seconds == pytest.approx(1e-6 * 2**single.level / (0.9 * error**2))
    assert plan.seconds < single.seconds
    trial.spread = lambda level: 2.0  # paths separate: differences are as large as f itself
    single, plan = choice.plans(trial, error)
    assert plan.seconds > single.seconds


def test_steps_between_those_of_the_ladder(nonlinear):
    """With order one the bias is proportional to h; level 1.5 has 2^1.5 times the coarsest number of steps, rounded up,
    level 2 exactly four times."""
    trial = Trial(make_problem(nonlinear, "q**2", **PLACE, threads=1), as_scheme("stormer_verlet"), 3, 256)
    assert [trial.steps(level) for level in (0, 1.5, 2, 6)] == [3, 9, 12, 192]
    assert trial.settled and trial.order == 1
    coarse, middle, fine = (trial.bias(level)[0] for level in (4, 4.5, 5))
    assert middle == pytest.approx(fine + (coarse - fine) * (math.sqrt(2) - 1))
    assert choice.longest(lambda level: (0.1 * 4.0**-level, 0.0), 1e-2 / math.sqrt(0.1)) == pytest.approx(
        math.log(10, 4), abs=2**-6
    )
    assert choice.longest(lambda level: (0.0, 0.0), 1e-2) == 0


def test_long_horizon_is_not_given_to_multilevel(monkeypatch):
    WorkClock(monkeypatch)
    answer = ss.expect(ss.models.synchrotron(sigma1=0.8, sigma2=0.5), "cos(q)", q0=1.0, p0=0.0, horizon=60.0, abs=0.05)
    assert answer.method != "multilevel" and answer.reached


def test_student_quantile():
    """Student's quantiles as tabled, and for many units the normal quantile."""
    for units_, tabled in (
        (2, 12.706),
        (3, 4.303),
        (9, 2.306),
        (12, 2.2010),
        (16, 2.1314),
        (32, 2.0395),
        (10**6, 1.96),
    ):
        assert interval.quantile(units_) == pytest.approx(tabled, abs=1e-3)


def test_interval_holds_with_and_without_the_bias_that_is_reckoned_with():
    """With normal errors and a bias of a third of the standard error, 94.9 % of intervals contain the value; without
    a bias 95.9 % do.
    """

    def below(x):
        return 0.5 * math.erfc(-x / math.sqrt(2))

    share = math.sqrt(interval.BIAS_SHARE / (1 - interval.BIAS_SHARE))
    half = interval.half_width(1.0, share, 10**9)
    assert 0.948 < below(half - share) - below(-half - share) < 0.951
    assert 0.955 < below(half) - below(-half) < 0.962


def test_tail_index_tells_infinite_variance():
    rng = np.random.default_rng(3)
    for index in (1.0, 1.5):
        found, error = tails.tail_index(rng.pareto(index, 4096))
        assert abs(found - index) < 4 * error
        with pytest.raises(ss.errors.NumericalError, match="no finite variance"):
            tails.require_variance(rng.pareto(1.0, 4096), "f")
    for values in (rng.standard_normal(4096), rng.exponential(size=4096), np.ones(4096), rng.integers(0, 2, 4096)):
        tails.require_variance(values.astype(float), "f")


def test_frequency_is_that_of_the_fastest_mode():
    """Frequencies: omega of the synchrotron at rest; 2 cos(pi/(2 n + 2)) of the linear part of a chain of n masses."""
    problem = make_problem(ss.models.synchrotron(omega=3.0), "q", q0=0.0, p0=0.0, horizon=1.0)
    assert frequency(problem) == pytest.approx(3.0)
    problem = make_problem(ss.models.fpu_chain(n=8), lambda q, p: q[0], q0=0.0, p0=0.0, horizon=1.0)
    assert frequency(problem) == pytest.approx(2 * math.cos(math.pi / 18))


def test_answer_tells_choice_and_alternatives(nonlinear):
    answer = ss.expect(nonlinear, "q**2", **PLACE, abs=2e-2)
    assert answer.alternatives and answer.cost > 0 and answer.pilot < answer.cost
    assert [x.cost for x in answer.alternatives] == sorted(x.cost for x in answer.alternatives)
    text = str(answer)
    assert answer.scheme in text and "times less than" in text and "others" in text


def test_constants_and_noise_free_models():
    one = ss.expect(ss.models.synchrotron(), lambda q, p: np.ones(q.shape[1]), **PLACE, abs=1e-3)
    assert one.value == 1.0 and one.half_width == 0.0
    assert "not seen" in one.notes[0]  # one path of a million might have the value 2
    zero = ss.expect(ss.models.synchrotron(), lambda q, p: np.zeros(q.shape[1]), **PLACE, rel=1e-3)
    assert zero.value == 0.0 and zero.reached
    still = ss.expect(ss.models.synchrotron(sigma1=0.0, sigma2=0.0), "q", **PLACE, abs=1e-5)
    fine = ss.simulate(
        ss.models.synchrotron(sigma1=0.0, sigma2=0.0), q0=1.0, p0=0.0, step=2 / 4096, steps=4096, scheme="chin4a"
    )
    assert abs(still.value - fine.q[-1, 0, 0]) < 1e-5 and still.half_width <= 1.05e-5


def test_schemes_with_areas_are_taken_when_asked_for():
    model = ss.models.noncommutative_oscillator()
    place = {"q0": 1.0, "p0": 0.0, "horizon": 0.5, "areas": "law"}
    answer = ss.expect(model, "q", **place, abs=2e-2, scheme="midpoint_areas", method="plain")
    assert answer.reached and answer.scheme == "midpoint_areas"
    with pytest.raises(ss.errors.InvalidArgumentError, match="give a scheme"):
        ss.expect(model, "q", **place, abs=2e-2)


def test_budget_gives_a_warning_and_the_best_interval_so_far(monkeypatch):
    WorkClock(monkeypatch)
    with pytest.warns(ss.BudgetWarning, match="max_time"):
        answer = ss.expect(ss.models.synchrotron(), "q", **PLACE, abs=1e-8, max_time=1.0)
    assert not answer.reached and any("max_time" in note for note in answer.notes)
    assert answer.half_width < 0.05


@pytest.mark.parametrize(
    ("change", "error", "words"),
    [
        ({"abs": None}, ss.errors.WrongTypeError, "one of abs and rel"),
        ({"abs": math.nan}, ss.errors.InvalidArgumentError, "not finite"),
        ({"abs": 1e-18}, ss.errors.InvalidArgumentError, "double precision"),
        ({"abs": 1e300}, ss.errors.InvalidArgumentError, "no larger than"),
        ({"f": "1e-200*q**2", "abs": None, "rel": 1e-2}, ss.errors.InvalidArgumentError, "multiply f by a constant"),
        ({"method": "antithetik"}, ss.errors.UnknownNameError, "antithetic"),
        ({"method": "antithetic", "scheme": "chin4a"}, ss.errors.NumericalError, "no scheme reaches"),
        ({"scheme": "midpiont"}, ss.errors.UnknownNameError, "midpoint"),
        ({"scheme": "verlet_dz"}, ss.errors.SymsdeError, "verlet_dz"),
        ({"f": lambda q, p: q}, ss.errors.WrongShapeError, "one number a path"),
        ({"f": lambda q, p: 1 / (q[0] - 0.4)}, ss.errors.NumericalError, "no finite variance"),
        ({"f": lambda q, p: np.where(q[0] < 0.4, np.nan, q[0])}, ss.errors.InvalidArgumentError, "is nan on"),
        ({"seed": -1}, ss.errors.InvalidArgumentError, "seed"),
        ({"f": lambda q, p: np.sin(q, out=q)[0]}, ss.errors.InvalidArgumentError, "changes q or p in place"),
        ({"f": lambda q, p: p.fill(0.0)}, ss.errors.InvalidArgumentError, "changes q or p in place"),
    ],
)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_misuse_gets_a_sentence(nonlinear, change, error, words):
    with pytest.raises(error, match=words):
        ss.expect(nonlinear, **{"f": "q", **PLACE, "abs": 1e-2, **change})


def test_paths_that_escape_are_told_of():
    model = ss.models.henon_heiles(sigma1=0.6, sigma2=0.6)
    with pytest.raises(ss.errors.NumericalError, match="escape"):
        ss.expect(model, "q1**2", q0=0.3, p0=0.0, horizon=10.0, abs=1e-2, scheme="stormer_verlet")


def test_plan_makes_the_estimator_it_names(nonlinear):
    problem = make_problem(nonlinear, "q", **PLACE)
    for method, kind in (("plain", Plain), ("antithetic", Antithetic)):
        (made,) = Plan(method, as_scheme("midpoint"), 8, 8, 0.0, 1.0, (0.0, 0.0)).estimators(3, problem)
        assert type(made) is kind and (made.steps, made.begin) == (8, 3)
    pytest.importorskip("scipy")
    plan = Plan(choice.EVEN_LEVELS, as_scheme("midpoint"), 8, 4, 0.0, 1.0, (0.0, 0.0), [7, 5])
    found = plan.estimators(3, problem)
    assert [(type(x), x.steps, x.begin, x.paths_a_unit) for x in found] == [(Quasi, 4, 3, 128), (Quasi, 8, 4, 64)]


def test_frequency_follows_the_way():
    """A pendulum that begins near the top is linearised at later states, too, at which its frequency is 1."""
    problem = make_problem(ss.models.synchrotron(omega=1.0), "q", q0=3.0, p0=0.0, horizon=8.0)
    assert frequency(problem) == pytest.approx(1.0, abs=0.1)


def test_ctrl_c_carries_an_answer_or_nothing(nonlinear, monkeypatch):
    """Interrupted in the pilot, the exception holds no answer and no unfinished run; later it holds an Answer, with
    every method.
    """

    def during(self, level, paths):
        stop = KeyboardInterrupt()
        stop.partial = "a run"
        raise stop

    with monkeypatch.context() as patch:
        patch.setattr(Trial, "_draw", during)
        with pytest.raises(KeyboardInterrupt) as caught:
            ss.expect(nonlinear, "q**2", **PLACE, abs=1e-2)
        assert caught.value.partial is None

    def told(done, total):
        raise KeyboardInterrupt

    for method in ("plain", "multilevel"):
        with pytest.raises(KeyboardInterrupt) as caught:
            ss.expect(nonlinear, "q**2", **PLACE, abs=1e-3, method=method, scheme="midpoint", progress=told)
        found = caught.value.partial
        assert isinstance(found, Answer) and found.method == method and not found.reached
        assert found.interval[0] < found.value < found.interval[1]


def test_cost_is_all_that_was_spent(nonlinear, monkeypatch):
    """With a clock that f alone advances: first evaluations of f, pairs, and schemes that were given up are all
    counted.
    """
    clock = Clock()
    monkeypatch.setattr(time, "process_time", clock)
    answer = ss.expect(nonlinear, clock.f, **PLACE, abs=2e-2, method="antithetic", scheme="midpoint")
    assert answer.cost == clock.now and 0 < answer.pilot < answer.cost


def test_a_method_that_is_asked_for_is_taken_where_it_is_not_needed(nonlinear):
    """A requested method is used, although one step of the ladder would be enough here."""
    answer = ss.expect(nonlinear, "q**2", **PLACE, abs=0.5, method="multilevel", scheme="gauss_dkdkd")
    assert answer.method == "multilevel" and answer.reached
    with pytest.raises(
        ss.errors.NumericalError, match="antithetic needs noise, one initial state, no truncation, and a scheme that"
    ):
        ss.expect(nonlinear, "q", **PLACE, abs=1e-2, method="antithetic", scheme="chin4a")


def test_paths_of_all_levels_are_told(nonlinear, monkeypatch):
    """Those of both steps of a change of f."""
    ran = []

    def counted(execution, work=Execution._multilevel, fill=Run.fill):
        with monkeypatch.context() as patch:
            patch.setattr(Run, "fill", lambda run, *given: ran.append(run.setup.paths) or fill(run, *given))
            return work(execution)

    monkeypatch.setattr(Execution, "_multilevel", counted)
    answer = ss.expect(nonlinear, "q**2", **PLACE, abs=0.1, method="multilevel", scheme="gauss_dkdkd")
    assert answer.paths == sum(ran) > 256


def work_of(nonlinear, seconds: float, **more) -> Execution:
    """An Execution of a plan with this estimate of seconds, and with further arguments."""
    plan = Plan("plain", as_scheme("midpoint"), 4, 4, seconds, 1.0, (0.0, 0.0))
    for name, value in more.items():
        setattr(plan, name, value)
    pilot = {"seconds": 0.0, "tolerance": interval.make_tolerance(1e-2, None), "watch": Watch(3600.0, False)}
    pilot |= {"problem": make_problem(nonlinear, "q", **PLACE), "looked_at": Drawn(Tally(), 0.0, 0, 0)}
    return Execution(SimpleNamespace(**pilot), [plan])


def test_long_work_within_its_time_is_announced_as_that(nonlinear):
    with pytest.warns(ss.BudgetWarning, match="700 s of the processor: give a larger tolerance"):
        work_of(nonlinear, 700.0)
    with pytest.warns(ss.BudgetWarning, match=r"3\.6e\+03 s of max_time are left"):
        work_of(nonlinear, 4000.0)


def test_units_that_all_fail_do_not_go_on_for_ever(nonlinear):
    fails = SimpleNamespace(least_units=4, part=4, draw_from=lambda first, count: Drawn(Tally(), 0.0, count, 8 * count))
    work = work_of(nonlinear, 0.0, estimators=lambda first, problem: [fails])
    with pytest.raises(ss.errors.NumericalError, match="4 of 4 groups of 8 paths failed"):
        work.answer()


def test_frequency_is_that_of_the_time():
    """H = p^2/2 + (1 + t) q^2/2 from t = 8 to 15: frequency 3 to 4."""
    model = ss.Model(
        ndof=1,
        nnoise=1,
        gradient=lambda t, w, q, p: (w[0] * (1 + t) * q + w[1], w[0] * p),
        hessian=lambda t, w, q, p: ((w[0] * (1 + t))[None, None], 0 * q[None], w[0][None, None]),
    )
    problem = make_problem(model, "q", q0=1.0, p0=0.0, horizon=7.0, t0=8.0)
    assert frequency(problem) == pytest.approx(4.0)


def test_formulas_hold_the_time_of_the_end():
    """The formula contains the time of the end: E q = cos(t) from t = 0, here from t0 = 3 to 5."""
    answer = ss.expect(ss.models.linear_oscillator(), "q + t", **PLACE, t0=3.0, abs=0.05)
    assert abs(answer.value - 5 - math.cos(2.0)) < 2 * answer.half_width
