# SPDX-License-Identifier: BSD-3-Clause
"""What is planned again once more is known: twice the points of a sequence, and measurements that a plan hangs on."""

import dataclasses
import math
import sys
from types import SimpleNamespace

import numpy as np
import pytest
import symsde as ss
from clock import WorkClock
from symsde.answers.coupled import LevelSampler
from symsde.answers.expectation import choice, variants
from symsde.answers.expectation.candidates import suitable
from symsde.answers.expectation.carry_out import Execution, _more
from symsde.answers.expectation.control import Control
from symsde.answers.expectation.estimators import Drawn, Plain
from symsde.answers.expectation.pilot import Pilot
from symsde.answers.expectation.problem import make_problem
from symsde.answers.expectation.quasi import Quasi
from symsde.answers.expectation.tally import Tally
from symsde.answers.expectation.tolerance import make_tolerance
from symsde.answers.expectation.watch import Watch
from symsde.schemes import as_scheme

START = {"q0": 1.0, "p0": 0.0, "horizon": 2.0}


@pytest.fixture
def pilot(monkeypatch):
    """Of E p^2 of an oscillator with noises on q and p, before anything is chosen. Its times are those of work that was
    counted: what it looks at depends on estimated seconds."""
    WorkClock(monkeypatch)
    problem = make_problem(ss.models.additive_oscillator(sigma=0.5, gamma=1.0), "p**2", **START)
    return Pilot(problem, make_tolerance(5e-4, None), Watch(None, False), suitable(problem), None)


def plan_of(trial, method, **more):
    return choice.Plan(method, trial, more.pop("level", 1), more.pop("seconds", 1.0), **more)


@pytest.mark.parametrize("differences", [False, True])
@pytest.mark.parametrize("at_a_time", [2**6, 2**20])
def test_doubled_points_are_those_of_the_longer_sequence(monkeypatch, differences, at_a_time):
    """2^6 points and as many more are 2^7 points, also of units that follow: means to rounding, however many of them
    fit in memory."""
    pytest.importorskip("scipy")
    monkeypatch.setattr(Quasi, "_at_a_time", at_a_time)
    problem = make_problem(ss.models.synchrotron(sigma1=0.8, sigma2=0.5), "q**2", **START)
    short, long = (
        Quasi(problem, as_scheme("midpoint"), 4, 7, log2_points=points, differences=differences) for points in (6, 7)
    )
    short.draw(16)
    one, other = short.doubled(), long.draw(16)
    for _ in range(2):
        assert one.units.mean == pytest.approx(other.units.mean, rel=1e-12)
        assert one.units.variance == pytest.approx(other.units.variance, rel=1e-9)
        assert (one.units.n, one.failed, one.paths) == (other.units.n, other.failed, other.paths)
        one, other = one + short.draw(4), other + long.draw(4)


@pytest.mark.parametrize(("method", "points"), [(Quasi.name, 7), (choice.EVEN_LEVELS, [7, 5])])
def test_points_are_doubled_where_units_are_too_few(pilot, method, points):
    """A plan that reckons with too few points: 15 000 and 25 000 paths give the error, as the points are doubled; more
    units of 2^6 of them took more than 65 000."""
    pytest.importorskip("scipy")
    pilot.tolerance = make_tolerance(4e-3, None)
    plan = plan_of(pilot.trials[0], method, level=3, coarsest=2, options={"log2_points": points})
    answer = Execution(pilot, [plan]).answer()
    assert answer.error < 0.0019 and answer.paths <= 2**16
    assert plan.options == {"log2_points": points}


def test_work_begins_with_a_quarter_of_the_points(pilot):
    """16 units of 2^9 points where 2^11 were planned, and are more than it takes; not below 2^8."""
    pytest.importorskip("scipy")
    pilot.tolerance = make_tolerance(1.0, None)
    for planned, begun in ((11, 9), (9, 8), (7, 7)):
        plan = plan_of(pilot.trials[0], Quasi.name, level=3, options={"log2_points": planned})
        assert Execution(pilot, [plan]).answer().paths == 16 * 2**begun


@pytest.mark.filterwarnings("ignore::symsde.BudgetWarning")
@pytest.mark.parametrize(
    ("planned", "seconds", "left", "cut"),
    [
        (11, 4.0, 4.0, 11),
        (11, 32.0, 4.0, 8),
        (11, 33.0, 4.0, 7),
        (11, 1e6, 4.0, 6),
        (5, 32.0, 4.0, 5),
        (11, 0.008, -1.0, 8),
        ([11, 7, 5], 32.0, 4.0, [8, 6, 5]),  # of levels
    ],
)
def test_points_are_cut_to_the_time_that_is_left(pilot, planned, seconds, left, cut):
    """By halvings, to 2^6 at the least, and of no time that is left as of a thousandth of a second."""
    pilot.watch = SimpleNamespace(seconds=0.0, max_time=100.0, elapsed=100.0 - left)
    method = Quasi.name if isinstance(planned, int) else choice.EVEN_LEVELS
    plan = plan_of(pilot.trials[0], method, seconds=seconds, options={"log2_points": planned})
    assert Execution(pilot, [plan]).plan.options == {"log2_points": cut}


def test_what_is_done_once_is_scaled_to_the_step(pilot):
    """Responses take as many paths as there are increments: at three levels more they take the longer, by their price;
    without the bias the finest level of the ladder counts."""
    trial = pilot.trials[0]
    trial.measured = {Control.name: variants.Variant(1, 0.0, 1e-6, 1e-3)}
    prices = [variants.price(trial, Control.name, level) for level in (1, 3)]
    unit = 256e-6 * trial.seconds(3) / trial.seconds(1)  # as few units as an interval takes
    assert choice.without_bias(trial, 1e-3) == pytest.approx(1e-3 * prices[1] / prices[0] + unit)
    trial.measured = {Control.name: None}
    assert choice.without_bias(trial, 1e-3) == float("inf")


def test_a_far_cheaper_way_is_worth_to_know_its_bias(pilot):
    """The control variate leaves E p^2 no variance: its changes are looked at, and by Sobol's points, beside a plan of
    a second, not beside one of a microsecond."""
    pytest.importorskip("scipy")
    trial = pilot.trials[0]
    trial.look_at(Control, 3)
    changes, *tasks = [task for _, task in pilot._hopes(plan_of(trial, "plain"))]
    assert changes == trial.look_at_changes and [task.args for task in tasks] == [(1,), (2,), (3,)]
    changes()
    tasks[0]()
    assert [task.args for _, task in pilot._hopes(plan_of(trial, "plain"))] == [(2,), (3,)]
    assert not list(pilot._hopes(plan_of(trial, "plain", seconds=1e-6)))


def test_a_method_is_looked_at_again_at_a_much_longer_step(pilot):
    """Measured at level 3: the plan at level 1 has it measured there, and that is enough."""
    trial = pilot.trials[0]
    trial.look_at(Control, 3)
    ((_, task),) = pilot._again(plan_of(trial, Control.name, level=1))
    task()
    assert trial.measured[Control.name].level == 1
    assert not list(pilot._again(plan_of(trial, Control.name, level=1)))
    assert not list(pilot._again(dataclasses.replace(plan_of(trial, Control.name), level=0.6)))
    assert not list(pilot._again(plan_of(trial, Control.name, level=3)))


def test_a_plan_for_ever_is_not_the_last_word(pilot, monkeypatch):
    """Where noise hides every step of single paths, and extrapolation alone has a plan, the next scheme is tried."""
    monkeypatch.setattr(choice, "plain", lambda *_: None)
    plan = plan_of(pilot.trials[0], "extrapolated", seconds=1e4)
    changes, higher = [task for _, task in pilot._tasks(plan)]
    assert changes == pilot.trials[0].look_at_changes and higher == pilot._try_highest
    changes()
    pilot._try_highest()
    assert pilot.trials[-1].scheme.name == "gauss2_strong32"  # of weak order two, where the others have one
    assert [task for _, task in pilot._tasks(plan)][-1] == pilot._try_next


def test_changes_of_a_linear_model_are_known_without_noise(pilot):
    """E p^2 of oscillators with additive noise: what a level changes is a quadratic of two linear responses, of the
    fine and of the coarse paths. It is the mean that 2^16 plain paths show, within 4.5 standard errors (7e-6)."""
    trial = pilot.trials[0]
    assert [task for _, task in pilot._changes(trial, of_all=True)] == [trial.look_at_changes]
    assert not list(pilot._changes(trial))  # how much of f a control variate leaves is not known
    trial.look_at_changes()
    assert not list(pilot._changes(trial, of_all=True))
    for level in (1, 2, 3):
        known = trial.changes[level]
        plain = LevelSampler(trial.problem, trial.scheme, trial.steps(0)).draw(level, 2**16)
        assert known.error < 1e-9
        assert abs(known.mean - plain.difference.mean) < 4.5 * plain.error
        assert trial._differences()[0][level - 1] == known.mean


def test_levels_with_far_more_points_than_were_seen_are_looked_at_again(pilot):
    """2^13 points of level 1 planned, 2^9 seen: with 2^10 it is known how their variance falls."""
    pytest.importorskip("scipy")
    trial = pilot.trials[0]
    for level in (1, 2):
        trial.look_evenly(level)
    plan = plan_of(trial, choice.EVEN_LEVELS, level=2, coarsest=1, options={"log2_points": [13, 12]})
    ((_, task),) = pilot._again(plan)
    assert task.args == (1, 10)
    task()
    assert sorted(trial.even[1].fine) == [6, 10] and not list(pilot._again(plan))
    whole = plan_of(trial, Quasi.name, level=1.5, options={"log2_points": 14})
    assert [task.args for _, task in pilot._again(whole)] == [(2, 11)]


def test_what_packages_take_to_load_is_in_the_price(pilot, monkeypatch):
    """Half a second, until they are there."""
    there = variants.price(pilot.trials[0], Quasi.name, 1)
    monkeypatch.setitem(sys.modules, "scipy.stats.qmc", None)
    monkeypatch.delitem(sys.modules, "scipy.stats.qmc")
    assert variants.price(pilot.trials[0], Quasi.name, 1) == pytest.approx(there + 0.5)


@pytest.mark.parametrize(("abs", "bound"), [(5e-4, True), (2.0, False)])
def test_an_interval_without_noise_says_that_it_is_a_bound(monkeypatch, abs, bound):
    """E p^2 = sin^2 + its variance, of oscillators with additive noise: the control variate leaves the bias alone,
    single paths do not. The mean is in the bound for every seed."""
    WorkClock(monkeypatch)  # schemes are chosen by seconds
    model, exact = ss.models.additive_oscillator(sigma=0.5, gamma=1.0), 1.93492134
    for seed in range(3):
        method = "control variate" if bound else "plain"
        answer = ss.expect(model, "p**2", **START, abs=abs, seed=seed, method=method)
        assert any("the interval is a bound" in note for note in answer.notes) == bound
        assert bool(answer.interval[0] < exact < answer.interval[1]) or not bound


def test_units_that_are_added_at_the_end_are_those_that_are_missing():
    assert [_more(x) for x in (0.1, 3.0, 5.0, 15.5, 40.0)] == [3, 4, 6, 16, 17]


def test_the_error_of_a_change_is_that_of_the_longer_sequence():
    """By eight units, whose own error is known to a fifth."""
    few, more = Tally(8, 0.0, 56.0), Tally(8, 0.0, 14.0)
    tallies = {variants.SHORT: few, variants.LONG: more}
    known = variants.Even(1, tallies, tallies, 1e-6, 0.0)
    assert known.error == pytest.approx(1.2 * (2 / 8) ** 0.5)


def test_a_control_variate_is_fitted_on_as_many_paths_as_its_units_ask_for(pilot):
    """The regression adds the number of controls over these to the variance of the units: 4 sqrt(units), within 256
    and 2048."""
    trial = pilot.trials[0]
    trial.look_at_changes()
    for variance, fit in ((0.0, 256), (0.9 * 4e-6 * 10**4, 400), (0.25, 1054), (10.0, 2048)):
        trial.measured = {Control.name: variants.Variant(3, variance, 1e-6, 0.0)}
        plan = choice.of_variant(trial, Control.name, 2e-3)
        assert plan.options == {"fit": fit}
        units = max(256, variance / 0.9 / 4e-6)
        same = variants.price(trial, Control.name, plan.level) / variants.price(trial, Control.name, 3)
        unit = 1e-6 * trial.seconds(plan.level) / trial.seconds(3)
        assert same > 0 and plan.seconds == pytest.approx((units + fit - 256) * unit, rel=1e-3)
        assert plan.estimator(0, pilot.problem)._fit_on == fit


def test_units_are_looked_at_again_where_few_of_them_differ(pilot, monkeypatch):
    """Their seconds are those of a call and of each unit: 32 and 256 of them in two calls of 2 s, and 1 ms a unit."""
    drawn = []

    class Seldom(Quasi):
        name = "seldom"

        def __init__(self, *_):
            pass

        def draw(self, count):
            drawn.append(count)
            values = np.zeros(count)
            values[:1] = 1.0
            return Drawn(Tally.of(values), 2.0 + 1e-3 * count, 0, count)

    monkeypatch.setattr(variants.time, "process_time", lambda: 0.0)  # nothing before the first unit
    found = variants.measure(pilot.trials[0], Seldom, 1)
    assert drawn == [32, 256, 768]
    assert found.seconds == pytest.approx(1e-3) and found.once == pytest.approx(2.0, rel=1e-3)


def test_levels_of_the_scheme_whose_paths_cost_least_are_looked_at_first(pilot, monkeypatch):
    """Beside a multilevel plan of the first scheme, a finer one by far, that of the second."""
    pytest.importorskip("scipy")
    pilot._try_highest()
    first, second = pilot.trials
    seconds = {first: 2.0, second: 1.0}
    monkeypatch.setattr(choice, "plain", lambda trial, error: plan_of(trial, "plain", level=2, seconds=seconds[trial]))
    tasks = [task for _, task in pilot._tasks(plan_of(first, "multilevel", level=9, seconds=1e-9))]
    looked = [task.func.__self__ for task in tasks if getattr(task, "func", None) == second.look_evenly]
    others = [task.func for task in tasks if getattr(task, "func", None) in {first.look_evenly, second.look_evenly}]
    assert len(looked) >= 3 and others[:3] == [second.look_evenly] * 3 and first.look_evenly in others


class Slow(Plain):
    """Units of a second each, by a clock that they alone move on, in parts of a hundred."""

    part = 100

    def __init__(self, watch):
        self.watch = watch

    def draw_from(self, unit, count):
        self.watch.elapsed += count
        self.watch.seconds += count
        return Drawn(Tally.of(np.arange(count) % 2.0), float(count), 0, count)


class Told(Watch):
    """A watch whose time is told."""

    elapsed = seconds = 0.0


@pytest.mark.parametrize(("left", "units"), [(250.5, 250), (300.0, 300), (0.0, 2), (2.5, 100)])
def test_no_unit_is_begun_that_does_not_fit_into_the_time(pilot, left, units):
    """All of the time and no more, but for the first part, of which nothing is known, and two units where there is no
    time at all."""
    watch = Told(3600.0, False)
    watch.elapsed = watch.seconds = 3600.0 - left
    pilot.watch, pilot.tolerance = watch, make_tolerance(1e-9, None)
    plan = SimpleNamespace(method="plain", scheme=as_scheme("midpoint"), seconds=0.0, variance=1.0, steps=1)
    plan.bias, plan.estimator = (0.0, 0.0), lambda *_: Slow(watch)
    answer = Execution(pilot, [plan]).answer()
    assert answer.paths == units and not answer.reached
    assert any("max_time = 3600 s" in note for note in answer.notes)


def test_skew_units_are_as_many_as_the_pilot_knows(pilot):
    """Squares of normal numbers, of which 600 are wanted, known to the pilot: over 4000 answers their mean is 0 within
    4.5 standard errors (7e-6). Begun with 256, it is off by seven of them, with 600 by five."""
    rng, pilot.tolerance = np.random.default_rng(8), make_tolerance(1.96 * (2 / 0.9 / 600) ** 0.5, None)
    plan = SimpleNamespace(method="plain", scheme=as_scheme("midpoint"), seconds=0.0, variance=2.0, steps=1)
    plan.bias, work = (0.0, 0.0), None
    squares = SimpleNamespace(least_units=256, part=2**15)
    squares.draw_from = lambda unit, count: Drawn(Tally.of(rng.standard_normal(count) ** 2 - 1), 1e-6, 0, count)
    plan.estimator = lambda *_: squares
    values = []
    for _ in range(4000):
        work = Execution(pilot, [plan])
        values.append(work.answer().value)
    assert abs(np.mean(values)) < 4.5 * np.std(values) / len(values) ** 0.5


class Scattered(Quasi):
    """A level whose units are normal, of mean 0; their variance falls as points^-1.5."""

    def __init__(self, rng, size):
        self.rng, self.size, self.log2_points, self.least, self.count = rng, size, 8, 16, 0

    @property
    def part(self):
        return 2**20

    def draw_from(self, unit, count):
        self.count = unit + count
        return self.given(count)

    def doubled(self):
        self.size, self.log2_points = self.size * 2**-0.75, self.log2_points + 1
        return self.given(self.count)

    def given(self, count):
        points = count << self.log2_points
        return Drawn(Tally.of(self.rng.normal(0.0, self.size, count)), 1e-9 * points, 0, points)


def test_intervals_hold_where_work_ends_by_their_own_scatter(pilot):
    """Three levels of 16 units, doubled until the half width is 1: of 8000 intervals 95.7 +- 0.2 % hold, and none is
    wider than asked; of as many by the scatter as it is, 93.9 +- 0.3 %."""
    rng, pilot.tolerance = np.random.default_rng(3), make_tolerance(1.0, None)
    plan = SimpleNamespace(method=choice.EVEN_LEVELS, scheme=as_scheme("midpoint"), seconds=1.0, variance=0.0, steps=1)
    plan.options, plan.bias = {"log2_points": [8, 8, 8]}, (0.0, 0.0)
    plan.even_level = lambda level, *_: Scattered(rng, size * 0.5**level)
    held = 0
    for i in range(8000):
        size = (2.5, 4.0)[i % 2]
        answer = Execution(pilot, [plan]).answer()
        held += answer.interval[0] <= 0.0 <= answer.interval[1]
        assert answer.half_width <= 1.0 + 1e-12
    assert held > 0.95 * 8000


def test_an_event_that_the_first_points_did_not_meet_is_not_taken_for_impossible(monkeypatch):
    """P = 1e-4 by two levels. 16 units of 2^8 points, which work begins with, often meet no event: it goes on, and a
    value is off by twice the half width once in 10 000. By the scatter of units that all agree it is 0."""
    pytest.importorskip("scipy")
    edge = math.cos(3.0) + 3.719016 * math.sqrt(1.5 - math.sin(6.0) / 4)
    scheme, options = as_scheme("gauss2"), {"log2_points": [8, 8]}

    def values():
        for seed in range(12):
            problem = make_problem(
                ss.models.linear_oscillator(), lambda q, p: q[0] > edge, q0=1.0, p0=0.0, horizon=3.0, seed=seed
            )
            pilot = Pilot(problem, make_tolerance(1e-4, None), Watch(None, False), [scheme], None)
            plan = SimpleNamespace(method=choice.EVEN_LEVELS, scheme=scheme, seconds=1.0, variance=1e-4, steps=64)
            plan.options, plan.bias = options, (0.0, 0.0)
            plan.even_level = lambda i, first, given: choice.even_level_of(
                given, scheme, 32, i, first=first, options=options
            )
            yield Execution(pilot, [plan]).answer().value

    assert all(abs(value - 1e-4) < 2e-4 and value > 0 for value in values())
    monkeypatch.setattr(Execution, "_noises", lambda _, drawn: [x.units.variance / x.units.n for x in drawn])
    assert 0.0 in values()
