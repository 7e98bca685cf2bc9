# SPDX-License-Identifier: BSD-3-Clause
"""Too few paths show only part of f: the interval covers the unseen part, or the answer says that it may not."""

import importlib
import math
from types import SimpleNamespace

import numpy as np
import pytest
import symsde as ss
from clock import WorkClock
from symsde.answers.expectation import tails
from symsde.answers.expectation.carry_out import Execution, _Outcome
from symsde.answers.expectation.choice import EVEN_LEVELS, Plan
from symsde.answers.expectation.interval import Tally, make_tolerance
from symsde.answers.expectation.problem import make_problem
from symsde.answers.expectation.tails import unseen
from symsde.answers.expectation.watch import Watch
from symsde.cli.command_line import main
from symsde.schemes import as_scheme

PLACE = {"q0": 1.0, "p0": 0.0, "horizon": 1.0}
BUMP = "exp(-1e15*(1 - q)**2)"
#: calls in which the seed alone determines the paths that are drawn
WAYS = [(ss.expect, {"scheme": "midpoint", "method": "plain"}), (ss.mlmc, {"scheme": "midpoint"})]

EXACT = 4.59991e-5  #: P(|1 + 0.3 W(1) - 2 pi k| < arccos(0.99999))


def rare(q, p):
    return q[0] > 0.99999


@pytest.fixture
def kubo():
    """q = cos(t + 0.3 W(t)): q > 0.99999 where 0.3 W(1) is within 4.5e-3 of -1, with probability 4.6e-5."""
    return ss.models.kubo(a=1.0, sigma=0.3)


@pytest.fixture
def blind(monkeypatch):
    """A pilot that gives up after 8192 values: it misses these two events with probabilities of 69 and 98 %."""
    monkeypatch.setattr(tails, "_MOST", 4096)


@pytest.mark.parametrize(("solve", "way"), WAYS)
@pytest.mark.parametrize("given", [{"abs": 1e-5}, {"rel": 0.1}])
def test_an_event_that_no_path_showed_is_in_the_interval(kubo, blind, solve, way, given):
    found = solve(kubo, rare, **PLACE, **given, **way)
    assert found.value == 0.0 and not found.reached and "was not seen" in found.notes[0]
    assert 4.6e-5 < found.half_width < 1e-3
    assert solve(kubo, rare, **PLACE, abs=1e-2, **way).reached


@pytest.mark.parametrize(("solve", "way"), WAYS)
@pytest.mark.parametrize("given", [{"abs": 1e-5}, {"rel": 0.2}])
def test_an_event_that_the_pilot_looks_for_is_seen(kubo, monkeypatch, solve, way, given):
    """P = 4.6e-5, at two half widths (8e-5 each). Levels of 256 and 1024 paths do not distinguish P from 0, which rel
    refuses, but the pilot's values do. How well `expect` knows the bias depends on seconds, which are counted work."""
    WorkClock(monkeypatch)
    found = solve(kubo, rare, **PLACE, **given, **way)
    wanted = given.get("abs") or given["rel"] * found.value
    assert abs(found.value - EXACT) < 2 * found.half_width and found.half_width <= 1.05 * wanted
    assert found.reached


def test_a_bias_is_blamed_where_the_noise_is_as_wanted(kubo):
    """A half width of 1: noise of 0.9 and bias of 0.6 give 1.08, blamed on the bias; noise of 1.1 on too few paths."""
    plan = Plan("plain", as_scheme("midpoint"), 4, 4, 1.0, 1.0, (0.0, 0.0))
    pilot = {"tolerance": make_tolerance(1.0, None), "watch": Watch(None, False), "seconds": 0.0}
    work = Execution(SimpleNamespace(problem=make_problem(kubo, "q", **PLACE), **pilot), [plan])
    for noise, bias, why in ((0.9, 0.6, "the bias of the step is known only to"), (1.1, 0.3, "paths were too few")):
        found = _Outcome(0.0, math.hypot(noise, bias), noise / 1.96, bias / 1.96, 100, [])
        assert work._finished(found).notes[0].startswith(why)


@pytest.mark.parametrize(("solve", "way"), WAYS)
def test_an_event_that_the_pilot_looks_for_in_vain_is_in_the_interval(kubo, solve, way):
    """P = 4.6e-7, to 1e-5: 2^19 values show one event with 21 %, and the unseen part is 3.84/2^19 = 7.3e-6."""
    found = solve(kubo, lambda q, p: q[0] > 1 - 1e-9, **PLACE, abs=1e-5, **way)
    assert found.reached and found.interval[0] <= 4.6e-7 <= found.interval[1]
    assert 1.9e-6 < found.half_width <= 1.05e-5


@pytest.mark.parametrize(("solve", "way"), WAYS)
def test_a_smooth_peak_that_few_paths_meet_is_in_the_interval(kubo, blind, solve, way):
    """E f = 2.3e-6, of a peak that no path of the pilot meets: the half width stays above 1e-5."""
    found = solve(kubo, BUMP, **PLACE, abs=1e-6, **way)
    assert not found.reached and any("was not seen" in note for note in found.notes)
    assert found.half_width > 1e-5


def test_flanks_of_a_peak_are_no_unit():
    """If only a few values lie on a flank, the values do not show how large f is; values that are all 1e-140 do show
    it.
    """
    flank = np.zeros(4096)
    flank[:3] = 1e-140, 1e-200, 1e-235
    tails.require_variance(flank, "f")
    with pytest.raises(ss.errors.InvalidArgumentError, match=r"was at most 1e-140 on 4096 paths"):
        tails.require_variance(1e-140 * np.linspace(-0.5, 1, 4096), "f")


@pytest.mark.parametrize("solve", [ss.expect, ss.mlmc])
def test_what_is_constant_stays_an_answer(kubo, solve):
    """If f is constant, by itself or because the motion conserves it, to rounding or to the last bit, the answer
    stays an answer.
    """
    free = ss.models.linear_oscillator()
    for model, f, exact in (
        (kubo, lambda q, p: np.full(q.shape[1], 3.0), 3.0),
        (kubo, "q**2 + p**2", 1.0),
        (free, "4 + 0*q", 4.0),
    ):
        found = solve(model, f, **PLACE, abs=1e-8)
        assert found.reached and found.half_width < 1e-12 and abs(found.value - exact) < 1e-12
    assert solve(kubo, lambda q, p: np.zeros(q.shape[1]), **PLACE, rel=0.1).reached


def test_scale_of_what_was_not_seen(kubo):
    """For 3000 equal values 1.96^2/3000 of the scale (Wilson); if one differs, 1.96 (0.98 + 1.4)/3000. The scale is 1
    for truth values, 0 for values that vary between nearby states."""

    def hidden(f, *values):
        return unseen(make_problem(kubo, f, **PLACE), as_scheme("midpoint"), 4, Tally.of(np.array(values)))

    none, one = 1.96**2 / 3000, 1.96 * (0.98 + math.sqrt(1 + 0.98**2)) / 3000
    same, few = np.ones(3000), np.concatenate([np.zeros(2999), [5.0]])
    assert hidden(lambda q, p: q[0] > -9.0, *same) == pytest.approx(none)
    assert hidden(lambda q, p: 7.0 * (q[0] == 1.0) + 1.0, *same) == pytest.approx(7 * none)  # at the first state
    assert hidden("q**2 + p**2", *same) == 0.0
    assert hidden("exp(q)", *few) == pytest.approx(5 * one, rel=1e-3)
    assert hidden("exp(q)", *np.linspace(0, 1, 3000)) == 0.0

    def narrow(q, p):
        if (np.abs(q) > 1.1).any():
            raise ValueError("out of the table")
        return q[0] > 0.99999

    assert hidden(narrow, *np.zeros(3000)) == pytest.approx(none)


@pytest.mark.parametrize("solve", [ss.expect, ss.mlmc])
def test_values_whose_powers_underflow(kubo, solve):
    """E q = exp(-0.045) cos 1, within two half widths (8e-5)."""
    found = solve(kubo, "1e-90*q", **PLACE, rel=0.05)
    exact = 1e-90 * math.exp(-0.045) * math.cos(1.0)
    assert found.reached and 0 < abs(found.value - exact) < 2 * found.half_width < 0.11 * exact


def test_scene_with_an_unseen_event_exits_with_4(blind, tmp_path, capsys):
    scene = tmp_path / "scene.toml"
    scene.write_text(
        '[model]\nname = "kubo"\nsigma = 0.3\n[run]\nstep = 0.1\nsteps = 10\nq0 = 1.0\np0 = 0.0\n'
        f'[expect]\nf = "{BUMP}"\nabs = 1e-6\n'
        'scheme = "midpoint"\nmethod = "plain"\n'
    )
    assert main(["expect", str(scene)]) == 4
    assert "was not seen" in capsys.readouterr().out


@pytest.mark.parametrize("solve", ["expect", "mlmc"])
def test_ctrl_c_carries_none_before_anything_is_begun(kubo, solve, monkeypatch):
    def stopped(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(importlib.import_module(getattr(ss, solve).__module__), "make_problem", stopped)
    with pytest.raises(KeyboardInterrupt) as caught:
        getattr(ss, solve)(kubo, "q", **PLACE, abs=1e-2)
    assert caught.value.partial is None


def test_scramblings_fit_into_the_time(kubo, monkeypatch):
    """The plan needs 80 s and 10 are left: an eighth of the points is taken, but no fewer than 64."""
    WorkClock(monkeypatch)  # counted work, since on a busy machine fewer points would fit

    def points(max_time):
        plan = Plan(EVEN_LEVELS, as_scheme("midpoint"), 4, 4, 80.0, 1.0, (0.0, 0.0), [14])
        pilot = {"tolerance": make_tolerance(1e-2, None), "watch": Watch(max_time, False)}
        work = Execution(SimpleNamespace(problem=make_problem(kubo, "q", **PLACE), **pilot), [plan])
        return work.plan.points[0]

    assert points(100.0) == 14
    with pytest.warns(ss.BudgetWarning):
        assert points(10.1) == 11
    with pytest.warns(ss.BudgetWarning):
        assert points(1e-2) == 6


def test_the_index_of_a_tail_by_hand():
    """Of a hundred values +-2^-i the ten largest are 5, 5, 4, 4 .. 1, 1 halvings above the eleventh."""
    values = 2.0 ** -np.arange(50)
    index, error = tails.tail_index(np.concatenate([values, -values]))
    assert index == pytest.approx(1 / (3 * np.log(2))) and error == pytest.approx(index / np.sqrt(10))


@pytest.mark.parametrize(("a", "refused"), [(2.5, False), (1.9, False), (1.2, True)])
def test_a_variance_in_doubt_is_not_refused(a, refused):
    """4096 values of P(|f| > x) = x^-a determine a to an eighth: an estimate of 1.9 may belong to a = 2."""
    x = ((np.arange(2048) + 0.5) / 2048) ** (-1 / a)
    values = np.concatenate([x, -x])
    assert tails.tail_index(values)[0] == pytest.approx(a, rel=0.05)
    if refused:
        with pytest.raises(ss.errors.NumericalError, match="no finite variance"):
            tails.require_variance(values, "f")
    else:
        tails.require_variance(values, "f")


def escaping():
    """The mean of q^2 when two paths of 2^15 escape to q^2 = 1e6."""
    rng = np.random.default_rng(5)
    values = rng.standard_normal(2**15) ** 2
    values[:2] = 1e6
    return values


def test_paths_that_escape_seldom_are_told_of_by_their_largest_values():
    """Two of 2^15 values escape: the largest 181, the root of their number, show no heavy tail, but the largest 32 do;
    for squares of normals, or an event of one in ten thousand, they do not. Tallies do not overflow."""
    tails.require_variance(escaping(), "f")
    with pytest.raises(ss.errors.NumericalError, match="no finite variance"):
        tails.require_variance(escaping(), "f", tails._OUTERMOST)
    rng = np.random.default_rng(6)
    for values in (rng.standard_normal(2**15) ** 2, rng.random(2**15) < 1e-4, rng.lognormal(sigma=1.0, size=2**15)):
        tails.require_variance(values.astype(float), "f", tails._OUTERMOST)
    both = Tally.of(np.zeros(4)) + Tally.of(np.array([1e200, 1e160]))
    assert both.n == 6 and not math.isfinite(both.variance)


def test_an_escape_that_the_pilot_does_not_see_ends_the_work():
    """If a few of 2^15 values carry all variation, more are drawn, once; a variance that overflows is refused at once,
    fewer values or evenly varying ones are not."""
    model = ss.models.henon_heiles(sigma1=0.03, sigma2=0.03)
    problem = make_problem(model, "q1**2", q0=0.3, p0=0.0, horizon=10.0, threads=1)
    found, rare = tails.Doubt(problem), np.zeros(2**15)
    rare[:3] = 1e9
    for seen in (Tally.of(rare[:100]), Tally.of(np.arange(2.0**15))):
        found.look(seen, as_scheme("stormer_verlet"), 40)
    with pytest.raises(ss.errors.NumericalError, match=r"of 327.. values the largest fall off"):
        found.look(Tally.of(rare), as_scheme("stormer_verlet"), 40)
    found.look(Tally.of(rare), as_scheme("stormer_verlet"), 40)  # a refusal is given only once
    with pytest.raises(ss.errors.NumericalError, match="their variance overflows"):
        found.look(Tally(10, 0.0, math.inf), as_scheme("stormer_verlet"), 40)


@pytest.mark.usefixtures("work_clock")
def test_a_width_relative_to_a_mean_of_zero_is_refused_after_so_many_looks():
    """E q = 0, and 2^18 values of variance (1/2 - sin(2)/4) have this standard error: no more are drawn."""
    given = {"q0": 0.0, "p0": 0.0, "horizon": 1.0, "rel": 0.05, "max_time": 60.0}
    with pytest.raises(ss.errors.InvalidArgumentError, match=r"\+- 0\.00102 and may be 0"):
        ss.expect(ss.models.linear_oscillator(), "q", **given)
