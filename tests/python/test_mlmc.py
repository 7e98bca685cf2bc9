# SPDX-License-Identifier: BSD-3-Clause
"""Multilevel Monte Carlo: levels share their Brownian path, their sum telescopes, and the intervals hold the mean."""

import itertools
import math
import time

import numpy as np
import pytest
import symsde as ss
from clock import Clock, WorkClock
from symsde.answers.coupled import LevelSampler
from symsde.answers.expectation import bias, mlmc
from symsde.answers.expectation.answer import Level, fall
from symsde.answers.expectation.interval import Tally
from symsde.answers.expectation.problem import make_problem
from symsde.schemes import as_scheme

PLACE = {"q0": 1.0, "p0": 0.0}


def free_gradient(t, w, q, p):
    """H = p^2/2, H_1 = -q: p(T) = W(T) for any step."""
    return np.broadcast_to(-w[1], q.shape), w[0] * p


def free_particle() -> ss.Model:
    flags = dict.fromkeys(("separable", "additive", "position_noise", "identity_mass", "quadratic"), True)
    return ss.Model(ndof=1, nnoise=1, gradient=free_gradient, **flags)


def test_tallies_merge_as_if_they_were_one():
    rng = np.random.default_rng(1)
    values = rng.standard_gamma(2.0, 5000) - 100.0
    whole = sum((Tally.of(part) for part in np.split(values, [7, 8, 3000])), Tally())
    deviations = values - values.mean()
    assert whole.n == 5000
    np.testing.assert_allclose(whole.mean, values.mean(), rtol=1e-14)
    np.testing.assert_allclose(whole.variance, values.var(ddof=1), rtol=1e-12)
    np.testing.assert_allclose(whole.m3, (deviations**3).sum(), rtol=1e-10)
    np.testing.assert_allclose(whole.kurtosis, (deviations**4).mean() / values.var() ** 2, rtol=1e-11)
    np.testing.assert_allclose(whole.error, values.std(ddof=1) / math.sqrt(5000), rtol=1e-12)


@pytest.mark.parametrize("scheme", ["midpoint", "stormer_verlet", "gauss_dkdkd", "chin4a"])
@pytest.mark.parametrize("antithetic", [False, True])
def test_fine_and_coarse_follow_one_brownian_path(scheme, antithetic):
    """p(T) = W(T): on another path it would differ by about 1; exchanging halves keeps the sum."""
    if antithetic and scheme in ("gauss_dkdkd", "chin4a"):
        pytest.skip("takes more of the path than increments")
    place = {"q0": 0.0, "p0": 0.0, "horizon": 2.0}
    sampler = ss.level_sampler(free_particle(), "p", **place, scheme=scheme, steps=3, antithetic=antithetic)
    for level in (1, 3):
        draw = sampler.draw(level, 300)
        assert draw.fine.variance > 1.0
        assert abs(draw.difference.mean) < 1e-13 and draw.difference.variance < 1e-26


def test_levels_and_calls_have_paths_of_their_own():
    sampler = ss.level_sampler(free_particle(), "p", q0=0.0, p0=0.0, horizon=1.0, steps=2)
    means = [sampler.draw(level, 64).fine.mean for level in (0, 0, 1, 1, 2)]
    assert len(set(means)) == 5
    again = ss.level_sampler(free_particle(), "p", q0=0.0, p0=0.0, horizon=1.0, steps=2)
    assert again.draw(1, 64).fine.mean == means[2]


def test_a_level_begins_at_its_own_path():
    """Path i of level l is path l 2^41 + i of the seed."""
    sampler = ss.level_sampler(ss.models.kubo(), "q", **PLACE, horizon=1.0, steps=2, seed=3)
    run = {**PLACE, "step": 1 / 4, "steps": 4, "paths": 5, "seed": 3}
    fine = ss.simulate(ss.models.kubo(), **run, first_path=2**41).q[-1, 0]
    assert sampler.draw(1, 5).fine.mean == pytest.approx(fine.mean(), rel=1e-14)


def test_means_within_two_errors_say_nothing_of_a_rate():
    """1, 1/4 and 1/16 fall by two powers of two; a fourth mean of 1.9 standard errors is left out."""
    rate = fall([1.0, 0.25, 0.0625, 0.9], [1e-3, 1e-3, 1e-3, 0.9 / 1.9])
    assert rate.value == pytest.approx(2.0, abs=1e-12)
    assert math.isnan(fall([1.0, 0.1], [0.1, 0.06]).value)


def test_truncation_of_the_coarse_path_is_that_of_its_own_step():
    """Sums of two increments are clipped at the bound of the coarse step: otherwise the subtracted mean has another law
    than the mean one level below, and the sum over levels does not telescope."""
    model, truncation = ss.models.kubo(), (2, 1.0)
    step, count = 1 / 64, 2**16
    given = {"paths": count, "seed": 5, "truncation": truncation}
    coarse = ss.increments(model, step=2 * step, steps=2, refine=1, **given)
    alone = ss.increments(model, step=2 * step, steps=2, refine=0, **given)
    bound = math.sqrt(4 * abs(math.log(2 * step))) * math.sqrt(2 * step)
    for dw in (coarse, alone):
        np.testing.assert_allclose(np.abs(dw).max(), bound, rtol=1e-12)  # some of 131072 normals exceed 3.7


@pytest.mark.parametrize("scheme", ["midpoint", "gauss_dkdkd", "chin4a"])
@pytest.mark.parametrize("options", [{}, {"truncation": (2, 1.0)}, {"t0": 0.7, "compensated": True}])
def test_increments_of_a_problem_drive_its_runs(scheme, options):
    """`increments` of a problem, of which antithetic paths are made, are those of its runs, with any options."""
    problem = make_problem(ss.models.synchrotron(), "q**2", **PLACE, horizon=2.0, seed=2**40 + 3, **options)
    dw = problem.increments(as_scheme(scheme), 32, 2**33 + 5, 3000)
    run = problem.run(as_scheme(scheme), 32, first_path=2**33 + 5, paths=3000)
    np.testing.assert_array_equal(dw, ss.diagnose.driving_increments(run))
    beyond = np.abs(dw).max() > 3.4 * 0.25  # the bound is at 3.33 standard deviations
    assert beyond != ("truncation" in options) and dw.shape == (32, 2, 3000)


@pytest.mark.parametrize("first", [0, 2**40])
@pytest.mark.parametrize("level", [0, 1, 3])
def test_samples_by_their_numbers(first, level):
    """Sample n of level l is path 2^41 l + first + n, in whatever order samples are requested."""
    problem = make_problem(ss.models.synchrotron(), "q**2", **PLACE, horizon=2.0, seed=3)
    sampler = LevelSampler(problem, "midpoint", 4, first=first)
    for sample in (300, 0, 7):
        found = sampler.draw_from(level, sample, 40)
        paths = {"first_path": 2**41 * level + first + sample, "paths": 40}
        fine = problem.values(problem.run("midpoint", 4 << level, **paths))[0]
        coarse = 0 * fine
        if level:
            coarse = problem.values(problem.run("midpoint", 2 << level, refine=1, **paths))[0]
        assert found.fine.mean == pytest.approx(fine.mean(), rel=1e-13)
        assert found.difference.mean == pytest.approx((fine - coarse).mean(), rel=1e-11)


def test_sums_are_those_of_giles_interface():
    sampler = ss.level_sampler(ss.models.kubo(), "q", **PLACE, horizon=1.0, steps=4, seed=3)
    twin = ss.level_sampler(ss.models.kubo(), "q", **PLACE, horizon=1.0, steps=4, seed=3)
    for level in (0, 2):
        sums, cost = sampler(level, 1000)
        draw = twin.draw(level, 1000)
        assert sums.shape == (6,) and cost > 0
        np.testing.assert_allclose(sums[0] / 1000, draw.difference.mean, rtol=1e-11)
        np.testing.assert_allclose(sums[1] / 1000 - (sums[0] / 1000) ** 2, draw.difference.m2 / 1000, rtol=1e-9)
        np.testing.assert_allclose(sums[4] / 1000, draw.fine.mean, rtol=1e-12)
        np.testing.assert_allclose(sums[5] / 1000, draw.fine.m2 / 1000 + draw.fine.mean**2, rtol=1e-12)
        mean = sums[0] / 1000
        third = sums[2] / 1000 - 3 * mean * sums[1] / 1000 + 2 * mean**3
        np.testing.assert_allclose(third, draw.difference.m3 / 1000, rtol=1e-6, atol=1e-15)


@pytest.mark.parametrize(
    ("scheme", "model", "low", "high"),
    [
        ("midpoint", ss.models.synchrotron(sigma1=0.8, sigma2=0.5), 1.8, 2.4),  # strong order 1
        ("gauss_dkdkd", ss.models.synchrotron(sigma1=0.8, sigma2=0.5), 2.8, 3.7),  # 3/2 and above
        ("chin4a", ss.models.synchrotron(sigma1=0.8, sigma2=0.5), 2.8, 3.7),
        ("verlet_dz", ss.models.linear_oscillator(), 3.7, 4.3),  # 2 for additive noise
    ],
)
def test_variance_falls_by_twice_the_strong_order(scheme, model, low, high):
    sampler = ss.level_sampler(model, "q", **PLACE, horizon=1.0, steps=8, scheme=scheme)
    draws = [sampler.draw(level, 4000) for level in range(1, 5)]
    rate = fall(
        [d.variance for d in draws], [d.variance * math.sqrt((d.difference.kurtosis - 1) / 4000) for d in draws]
    )
    assert low < rate.value - rate.half and rate.value + rate.half < high


def test_intervals_of_rates_are_of_95_percent():
    """With two levels the rate is log2 of a ratio, whose noise is that of both levels."""
    rate = fall([0.8, 0.1], [0.08, 0.005])
    assert rate.value == pytest.approx(3.0, abs=1e-12)
    assert rate.half == pytest.approx(1.959964 * math.hypot(0.1, 0.05) / math.log(2), rel=1e-4)


def test_exchanged_halves_restore_the_order_that_areas_take():
    """For noises that do not commute, increments alone give beta = 1, and antithetic pairs 2 or more."""
    rates = []
    for antithetic in (False, True):
        sampler = ss.level_sampler(
            ss.models.noncommutative_oscillator(), "q**2 + p**2", **PLACE, horizon=0.5, steps=2, antithetic=antithetic
        )
        rates.append(fall([sampler.draw(level, 4000).variance for level in (2, 3, 4, 5)], [0.0] * 4).value)
    assert rates[0] < 1.6 and rates[1] > 1.9


def test_estimate_of_a_bias():
    """d_l = c 2^(-a l): the finest step has the bias c 2^(-a L)/(2^a - 1)."""
    for order in (1.0, 2.0, 3.0):
        means = [2.0 ** (-order * level) for level in (1, 2, 3)]
        exact = 2.0 ** (-3 * order) / (2**order - 1)
        seen, noise = bias.estimate(means, [1e-9] * 3, order)
        np.testing.assert_allclose(seen, exact, rtol=1e-6)
        assert noise < 2e-9
        further, _ = bias.estimate(means, [1e-9] * 3, order, extra=2)
        np.testing.assert_allclose(further, exact / 4**order, rtol=1e-6)
        assert bias.order_of(means, [1e-9] * 3, 1.0) == min(order, 2.0)
    # with noise alone the bias is its noise, and a difference through zero on a coarse level hides nothing
    assert math.hypot(*bias.estimate([0.0], [1e-3], 1.0)) == pytest.approx(1e-3)
    assert math.hypot(*bias.estimate([0.0, 1e-2], [1e-5, 1e-5], 1.0)) > 0.8e-2
    assert bias.order_of([1e-3, 1e-4], [1e-3, 1e-3], 1.0) == 1.0


def test_differences_that_contradict_each_other_do_not_cancel():
    """The oscillator with q p and q^2/2 noises, h = 3/2, 3/4 and 3/8: differences change their sign, and the bias is
    7e-3. The weighted mean of the differences is -2e-3 +- 2e-3; this error would be right only if differences agreed
    within their noise."""
    assert math.hypot(*bias.estimate([-1.25e-2, 1.06e-2], [3e-3, 4e-3], 1.0)) > 5e-3
    assert bias.estimate([2e-2, 1.06e-2], [3e-3, 4e-3], 1.0)[1] < 4e-3


def exact_square(t: float) -> float:
    """E q^2 of the linear oscillator from q = 1, p = 0."""
    return math.cos(t) ** 2 + t / 2 - math.sin(2 * t) / 4


@pytest.mark.usefixtures("work_clock")
def test_interval_holds_with_95_percent():
    """50 or more of 60 intervals must contain the value; intervals of 95 % fail this with probability 3e-4. The twin
    halves the intervals: then 67 % contain the value, and 50 or more of 60 do so with probability 4e-3."""
    exact, held = exact_square(2.0), {1.0: 0, 0.5: 0}
    for seed in range(60):
        found = ss.mlmc(
            ss.models.linear_oscillator(),
            "q**2",
            **PLACE,
            horizon=2.0,
            abs=0.05,
            scheme="midpoint",
            seed=seed,
            first=256,
        )
        assert found.reached and found.half_width <= 0.0525
        for scale in held:
            held[scale] += abs(found.value - exact) <= scale * found.half_width
    assert held[1.0] >= 50 > held[0.5]


def test_narrow_interval_is_where_the_mean_is():
    """The mean lies within two half widths: a false alarm has probability 8e-5, and the bias has its share of the
    width.
    """
    found = ss.mlmc(ss.models.linear_oscillator(), "q**2", **PLACE, horizon=2.0, abs=5e-3, seed=4)
    assert abs(found.value - exact_square(2.0)) < 2 * found.half_width
    assert found.bias < 0.4 * found.error


def test_report_tells_rates_and_levels(monkeypatch):
    """A path of the first level takes one second here, and a path of a finer level two, since it runs both steps."""
    clock = Clock(by_paths=True)
    monkeypatch.setattr(time, "process_time", clock)
    model = ss.models.synchrotron(sigma1=0.8, sigma2=0.5)
    found = ss.mlmc(model, clock.f, **PLACE, horizon=1.0, abs=4e-3, scheme="midpoint")
    assert found.reached and found.half_width <= 4.2e-3
    assert [x.steps for x in found.levels] == [found.levels[0].steps << i for i in range(len(found.levels))]
    assert 1.6 < found.beta.value < 2.5
    assert all(x.consistency < 1.5 for x in found.levels) and not found.notes
    assert "alpha" in str(found) and "consistent" in str(found)
    for before, x in itertools.pairwise(found.levels):  # the variances of f on successive levels are nearly equal
        apart = abs(before.fine_mean - (x.fine_mean - x.mean))
        error = math.hypot(*(math.sqrt(y.fine_variance / y.paths) for y in (before, x)))
        assert x.consistency == pytest.approx(apart / (3 * error), rel=0.5)
    costs = [x.paths * math.sqrt(x.seconds / x.paths / x.variance) for x in found.levels if x.paths > 1024]
    assert len(costs) > 2 and max(costs[:-1]) / min(costs) < 1.1  # paths in proportion to sqrt(variance / cost)
    assert costs[-1] > 0.9 * costs[0]  # the finest level begins with the number of paths that its bias needs


@pytest.mark.parametrize(
    ("kurtosis", "paths", "told"), [(100.0, 999, ""), (101.0, 10099, "10 %"), (101.0, 10100, ""), (1e4, 160000, "25 %")]
)
def test_heavy_tails_are_told_where_they_make_a_variance_uncertain(kurtosis, paths, told):
    """The warning names a relative uncertainty of a tenth or more."""
    notes = mlmc._doubts((Level(8, paths, 0.1, 0.01, 1.0, kurtosis, 0.1, 1.0, 0.0, 1.0, 0),))
    assert [told in note for note in notes] == [True] * bool(told)


def test_scheme_with_areas_telescopes_in_law():
    found = ss.mlmc(
        ss.models.noncommutative_oscillator(),
        "q**2",
        **PLACE,
        horizon=0.5,
        abs=0.02,
        scheme="midpoint_areas",
        areas="law",
        steps=2,
    )
    assert found.reached and all(x.consistency < 1.5 for x in found.levels)


def test_a_function_that_jumps_is_not_trusted_with_few_paths():
    """If no path differs on fine levels, their variance is not taken for zero."""
    sampler = ss.level_sampler(
        ss.models.synchrotron(), lambda q, p: q[0] > 0, q0=0.0, p0=0.0, horizon=0.5, scheme="chin4a", steps=8
    )
    draw = sampler.draw(3, 200)
    assert draw.difference.m2 == 0 and draw.fine.variance > 0
    assert draw.error == pytest.approx(draw.fine.size / 200) and draw.fine.size == pytest.approx(0.5, rel=1e-2)
    assert draw.error_by(1.0) == pytest.approx(1 / 200)  # the error allows for an event that these paths did not show


def test_time_that_is_over_gives_the_interval_so_far(monkeypatch):
    WorkClock(monkeypatch)
    found = ss.mlmc(ss.models.synchrotron(), "q**2", **PLACE, horizon=2.0, abs=1e-7, max_time=0.3)
    assert not found.reached and "max_time" in found.notes[-1]
    assert found.interval[0] < found.value < found.interval[1] and found.half_width > 1e-7


def test_progress_function_may_stop():
    seen = []

    def progress(done, total):
        seen.append((done, total))
        return len(seen) > 3

    found = ss.mlmc(ss.models.synchrotron(), "q**2", **PLACE, horizon=2.0, abs=1e-6, progress=progress)
    assert not found.reached and len(seen) == 4 and 0 <= seen[0][0] <= seen[0][1]


@pytest.mark.parametrize(
    ("change", "error", "words"),
    [
        ({"abs": None}, ss.errors.WrongTypeError, "one of abs and rel"),
        ({"abs": 1e-2, "rel": 1e-2}, ss.errors.WrongTypeError, "one of abs and rel"),
        ({"abs": -1.0}, ss.errors.InvalidArgumentError, "above 0"),
        ({"abs": 1e-18}, ss.errors.InvalidArgumentError, "double precision"),
        ({"abs": None, "rel": 1e-2, "f": "p", "q0": 0.0}, ss.errors.InvalidArgumentError, "give abs"),
        ({"scheme": "gauss2_weak2"}, ss.errors.InvalidArgumentError, "follow no Brownian path"),
        ({"scheme": "gauss_dkdkd", "antithetic": True}, ss.errors.InvalidArgumentError, "increments alone"),
        ({"horizon": 0.0}, ss.errors.InvalidArgumentError, "above 0"),
        ({"levels": 1}, ss.errors.InvalidArgumentError, "levels"),
        ({"steps": 0}, ss.errors.InvalidArgumentError, "steps"),
        ({"stepz": 3}, ss.errors.WrongTypeError, "no option 'stepz'"),
        ({"f": lambda q, p: q}, ss.errors.WrongShapeError, "one number a path"),
        ({"f": lambda q, p: q[0] / 0 * 1j}, ss.errors.WrongTypeError, "real numbers"),
        ({"f": lambda q, p: np.where(q[0] < 0.9, np.nan, q[0])}, ss.errors.InvalidArgumentError, "is nan on"),
        ({"f": lambda q, p: 1 / (q[0] + 0.27)}, ss.errors.NumericalError, "no finite variance"),
        ({"f": "q + z"}, ss.errors.InvalidArgumentError, "z, which is not given"),
        ({"f": 3}, ss.errors.WrongTypeError, "give a function"),
        ({"q0": [1.0, 2.0]}, ss.errors.WrongShapeError, "q0 has shape"),
        ({"q0": math.inf}, ss.errors.InvalidArgumentError, "q0 is not finite"),
        ({"max_time": 0}, ss.errors.InvalidArgumentError, "max_time"),
        ({"progress": 3}, ss.errors.WrongTypeError, "progress"),
    ],
)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_misuse_gets_a_sentence(change, error, words):
    given = {"f": "q", **PLACE, "horizon": 1.0, "abs": 1e-2, **change}
    with pytest.raises(error, match=words):
        ss.mlmc(ss.models.synchrotron(), **given)


SYNCHROTRON = {"f": "q**2", **PLACE, "horizon": 1.0, "scheme": "midpoint"}


def test_no_more_levels_than_asked_for():
    found = ss.mlmc(ss.models.synchrotron(), **SYNCHROTRON, abs=2e-3, levels=2)
    assert len(found.levels) == 2 and not found.reached
    assert "finest of 2 levels" in found.notes[0]


@pytest.mark.parametrize(("level", "left"), [(0, None), (1, 1), (2, 2)])
def test_ctrl_c_gives_the_levels_that_were_begun(level, left, monkeypatch):
    draw = LevelSampler.draw

    def interrupted(self, wanted, count):
        if wanted == level:
            raise KeyboardInterrupt
        return draw(self, wanted, count)

    monkeypatch.setattr(LevelSampler, "draw", interrupted)
    with pytest.raises(KeyboardInterrupt) as caught:
        ss.mlmc(ss.models.synchrotron(), **SYNCHROTRON, abs=1e-3)
    if left is None:
        assert caught.value.partial is None
    else:
        assert len(caught.value.partial.levels) == left and not caught.value.partial.reached
        assert math.isinf(caught.value.partial.half_width) == (left == 1)


def test_cost_is_all_that_was_spent(monkeypatch):
    """The clock is advanced by f alone: the first evaluation of f is counted in the total, but for no level."""
    clock = Clock()
    monkeypatch.setattr(time, "process_time", clock)
    found = ss.mlmc(ss.models.synchrotron(), **SYNCHROTRON | {"f": clock.f}, abs=0.3, steps=64, first=16)
    in_levels = sum(x.seconds for x in found.levels)
    assert found.cost == clock.now and 0 < in_levels < clock.now


def test_paths_that_all_fail_are_told_of():
    model = ss.models.henon_heiles(sigma1=0.6, sigma2=0.6)
    with pytest.raises(ss.errors.NumericalError, match=r"^1024 paths failed at 8 steps and 0 came to the end: give"):
        ss.mlmc(model, "q1**2", q0=3.0, p0=3.0, horizon=20.0, abs=1e-2, scheme="stormer_verlet", steps=8)


@pytest.mark.parametrize("method", ["plain", "multilevel"])
@pytest.mark.usefixtures("work_clock")
def test_what_happens_seldom_is_not_taken_for_impossible(method):
    """P(q > 3.09 standard deviations) = 1e-3: the half width asks for a standard error of 5e-4. With probability 77 %
    none of the first 256 paths meets the event, and the scatter of these paths is 0."""
    model = ss.models.linear_oscillator()
    edge = math.cos(2.0) + 3.0902 * math.sqrt(2.0 / 2 - math.sin(4.0) / 4)
    given = {**PLACE, "horizon": 2.0, "abs": 1e-3, "scheme": "verlet_dz"}

    def seldom(q, p):
        return q[0] > edge

    held = 0
    for seed in range(8):
        if method == "plain":
            found = ss.expect(model, seldom, **given, method="plain", seed=seed)
        else:
            found = ss.mlmc(model, seldom, **given, steps=8, first=256, seed=seed)
        assert found.error > 1e-4
        held += found.interval[0] <= 1e-3 <= found.interval[1]
    assert held >= 6  # fewer have probability 6e-3 at 95 %


def test_who_stopped_is_told(monkeypatch):
    WorkClock(monkeypatch)
    for stop in ({"progress": lambda done, total: True}, {"max_time": 0.05}):
        found = ss.mlmc(ss.models.synchrotron(), **SYNCHROTRON, abs=1e-6, **stop)
        wanted = "the progress function asked to stop" if "progress" in stop else "max_time = 0.05 s was over"
        assert found.notes[-1].startswith(wanted)


def test_failed_paths_are_not_in_the_sums():
    model = ss.models.henon_heiles(sigma1=0.6, sigma2=0.6)
    sampler = ss.level_sampler(model, "q1", q0=0.3, p0=0.0, horizon=10.0, steps=8, scheme="stormer_verlet")
    with pytest.warns(ss.errors.PathsFailedWarning, match="divide by"):
        sampler(0, 500)
